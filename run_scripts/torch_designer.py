"""A network that designs wings, in PyTorch.

A small network that proposes wings, trained in PyTorch through the grid, with and without regard to its cells. A
request to the network is a volume and a height of the leading edge of the tip, relative to the ONERA M6, and it answers
with twist, dihedral and factors of the thickness. The loss is how far `bspline_mdao.torch.measures` and nodes of
`bspline_mdao.torch.grid` are from the request; one network is trained with the bound of the cells' corner triple
products of `bspline_mdao.torch.quality` as well, the other one without. Requests go beyond what the grid can follow. It
takes a minute. The output, for requests that neither has seen, is errors of the volume, the smallest bound of the
cells, and how many proposals have inverted cells.
"""

from __future__ import annotations

import numpy as np
import torch

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, ORANGE, figure
from bspline_mdao.scripts import run
from bspline_mdao.torch import grid, measures, quality

LARGEST = {"twist": 20.0, "dihedral": 60.0, "thickness": 0.5}
"""Largest values that may be proposed, from the baseline: degrees, degrees, part of one."""

REQUESTS = ((0.7, 1.3), (-2.0, 2.0))
"""Ranges of volumes relative to the M6's, and of heights of the tip (m)."""

WORST_CORNER = 0.1
"""What the bound of the corner triple products is to keep."""


class Designer(torch.nn.Module):
    """Proposes a design for a volume and a height."""

    def __init__(self, shape: bm.design.Parametrization):
        super().__init__()
        self.start = {name: torch.tensor(values) for name, values in shape.initial.items()}
        n_values = sum(values.numel() for values in self.start.values())
        layers = torch.nn.Linear(2, 12), torch.nn.Tanh(), torch.nn.Linear(12, n_values), torch.nn.Tanh()
        self.layers = torch.nn.Sequential(*layers).double()

    def forward(self, request: torch.Tensor) -> dict[str, torch.Tensor]:
        """Values of all variables."""
        low, high = torch.tensor(REQUESTS, dtype=torch.float64).T
        scaled = self.layers((2.0 * request - low - high) / (high - low))
        parts = torch.split(scaled, [values.numel() for values in self.start.values()])
        return {name: self.start[name] + LARGEST[name] * part for name, part in zip(self.start, parts)}


class Task:
    """The wing, and what is asked of a design."""

    def __init__(self) -> None:
        self.wing = bm.DesignSurface.of(bm.fit_grid(bm.generators.onera_m6_grid((9, 8, 7)), n_control=(6, 5, 4)))
        axis, surface = self.wing.axis, self.wing.surface
        design = bm.design
        variables = [design.Twist("twist", axis, stations=2), design.Dihedral("dihedral", axis, stations=2)]
        self.shape = self.wing.parametrization([*variables, design.ThicknessFactor("thickness", axis, stations=2)])
        self.nodes, self.bounds = grid(self.wing.model, self.shape), quality(self.wing.model, ["corner_ks"])
        volume = bm.measures.EnclosedVolume.of(surface, relative=True)
        self.sizes = measures([volume], self.wing.model, self.shape)
        self.tip = int(surface.rows[surface.faces[0][-1, 0]])
        self.height = self.wing.model.baseline.to_vector().reshape(-1, 3)[self.tip, 1]

    def judged(self, design: dict) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Volume, height of the tip, bound of the cells, and nodes."""
        nodes = self.nodes(design)
        volume = self.sizes(design)["volume"][0]
        return volume, nodes[self.tip, 1] - self.height, self.bounds(nodes)["corner_ks"], nodes


def requests(n: int, seed: int) -> torch.Tensor:
    """Random volumes and heights."""
    low, high = np.array(REQUESTS).T
    return torch.tensor(np.random.default_rng(seed).uniform(low, high, (n, 2)))


def train(task: Task, weight: float, n_steps: int, n_together: int) -> tuple[Designer, list[float]]:
    """Train a network; the weight is for bad cells."""
    torch.manual_seed(0)
    network, losses = Designer(task.shape), []
    optimizer = torch.optim.Adam(network.parameters(), lr=0.03)
    for step in range(n_steps):
        loss = torch.zeros(())
        for request in requests(n_together, seed=step):
            volume, height, corner, _ = task.judged(network(request))
            short = torch.relu(WORST_CORNER - corner) / WORST_CORNER
            loss = loss + 10.0 * (volume - request[0]) ** 2 + (height - request[1]) ** 2 + weight * short**2
        optimizer.zero_grad()
        (loss / n_together).backward()
        optimizer.step()
        losses.append(loss.item() / n_together)
    return network, losses


def judge(task: Task, network: Designer, n: int) -> tuple[dict, np.ndarray]:
    """Look at what a network proposes for requests that it has not seen; bounds of the cells of each."""
    cells = bm.grids.GridQuality.of_baseline(task.wing.model.baseline)
    rows = []
    with torch.no_grad():
        for request in requests(n, seed=10_000):
            volume, height, corner, nodes = task.judged(network(request))
            n_inverted = bm.grids.report_quality(cells, nodes.numpy()).n_inverted
            rows.append([abs(volume - request[0]), abs(height - request[1]), corner, n_inverted > 0])
    volumes, heights, corners, inverted = np.array(rows, dtype=float).T
    numbers = {
        "volume_error": float(volumes.mean()),
        "height_error": float(heights.mean()),
        "worst_corner": float(corners.min()),
        "inverted": int(inverted.sum()),
    }
    return numbers, corners


def main(figures=None, n_steps: int = 40, n_together: int = 4, n_seen: int = 12) -> dict:
    """Train both networks.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``torch_designer.png``.
    n_steps, n_together : int
        Steps of the training, and requests of each.
    n_seen : int
        Requests that the networks are judged by.

    Returns
    -------
    dict
        For ``with_cells`` and ``without``: mean ``volume_error`` and ``height_error`` (m), ``worst_corner``, and how
        many proposals are ``inverted``; ``losses`` at the start and at the end.
    """
    task, numbers, drawn = Task(), {}, {}
    for name, weight in (("with_cells", 1.0), ("without", 0.0)):
        network, losses = train(task, weight, n_steps, n_together)
        found, corners = judge(task, network, n_seen)
        numbers[name], drawn[name] = {**found, "losses": [losses[0], losses[-1]]}, (losses, corners)
    if figures is not None:
        heights = requests(n_seen, seed=10_000)[:, 1]
        with figure(figures, "torch_designer", (8.0, 3.2)) as canvas:
            left, right = canvas.subplots(1, 2)
            for (losses, corners), color, width, label in zip(
                drawn.values(), (BLUE, ORANGE), (2.4, 1.2), ("trained with the cells", "without them")
            ):
                left.semilogy(losses, color=color, linewidth=width, label=label)
                right.plot(heights, corners, "o", color=color, markersize=3.0 + width, label=label)
            right.axhline(0.0, color="black", linewidth=0.7)
            left.set(xlabel="step", ylabel="loss of the requests of a step")
            right.set(xlabel="height of the tip that is asked for (m)", ylabel="bound of the worst corner")
            right.annotate("inverted below", (0.98, 0.0), xycoords=("axes fraction", "data"), ha="right", va="top")
            left.legend()
    return numbers


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/torch_designer.png'
