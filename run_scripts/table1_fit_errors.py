"""Table 1: errors of the fits.

Errors between the initial grids and their B-spline fits, for the ONERA M6 wing and the blended-wing body. The paper's
grids were never published. These are grids of the same topology, counts and spacings; the grid of the blended-wing body
is the grid about the flat plate from which the optimisation starts.

It takes some seconds, and a minute at the paper's size. The output is the table next to the paper's, without and with
correction of the parameters, and pictures of the grids and of the distribution of the errors.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao import FittedModel, Grid, fit_grid
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids import cell_quality
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net, figure
from bspline_mdao.scripts import run

CORRECTIONS = 3
"""Rounds of parameter correction (Hoschek) of the corrected fits."""

CASES = {"onera_m6": (onera_m6_grid, "ONERA M6"), "blended_wing_body": (flat_plate_grid, "blended-wing body")}

SIZES = {
    "onera_m6": {True: ((45, 65, 33), (13, 13, 9)), False: ((17, 25, 17), (7, 8, 7))},
    "blended_wing_body": {True: ((45, 45, 45), (9, 9, 9)), False: ((17, 17, 17), (7, 7, 7))},
}
"""Nodes and control points per block, at the paper's size and small."""

PAPER = {
    "onera_m6": {"rms": 4.04e-4, "max_error": [2.01e-3, 1.52e-3, 1.54e-3]},
    "blended_wing_body": {"rms": 7.11e-5, "max_error": [1.35e-4, 5.21e-4, 2.41e-4]},
}
"""Table 1 as printed."""


def main(paper: bool = False, figures=None) -> dict:
    """Fit both grids, without and with parameter correction, and print Table 1 next to the paper's numbers.

    Parameters
    ----------
    paper : bool
        The paper's sizes: 12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points, and of 45^3 with 9^3.
    figures : path-like, optional
        Folder for ``table1_grids.png`` and ``table1_errors.png``.

    Returns
    -------
    dict
        ``onera_m6`` and ``blended_wing_body``, each with ``shape``, ``n_control``, ``n_nodes``, ``n_control_points``,
        ``smallest_q`` of the grid, ``rms``, ``max_error`` (x, y, z), ``n_invalid`` control elements, ``seconds``, the
        same four under ``corrected``, and the paper's numbers under ``paper``.
    """
    grids = {name: make(SIZES[name][paper][0]) for name, (make, _) in CASES.items()}
    models = {
        name: [
            fit_grid(grid, n_control=SIZES[name][paper][1], method="least_squares", corrections=rounds)  # folded or not
            for rounds in (0, CORRECTIONS)
        ]
        for name, grid in grids.items()
    }
    numbers = {name: measure(name, grids[name], *models[name], paper) for name in CASES}
    print(table(numbers))
    if figures:
        draw_grids(figures, grids)
        draw_errors(figures, models, paper)
    return numbers


def measure(name: str, grid: Grid, plain: FittedModel, corrected: FittedModel, paper: bool) -> dict:
    """Gather the numbers of one case."""
    shape, n_control = SIZES[name][paper]
    return {
        "shape": shape,
        "n_control": n_control,
        "n_nodes": grid.n_nodes,
        "n_control_points": plain.report.n_control_points,
        "smallest_q": min(cell_quality(block.nodes).q.min() for block in grid.blocks),
        **errors(plain),
        "corrected": errors(corrected),
        "paper": PAPER[name],
    }


def errors(model: FittedModel) -> dict:
    """Errors of one fit."""
    names = ("rms", "max_error", "n_invalid", "seconds")
    return {name: getattr(model.report, name) for name in names}


def table(numbers: dict) -> str:
    """Table 1, next to the paper's."""
    lines = [f"{'case':<28}{'RMS error':>12}{'max |dx|':>12}{'max |dy|':>12}{'max |dz|':>12}"]
    for name, case in numbers.items():
        rows = {CASES[name][1]: case, "  parameters corrected": case["corrected"], "  paper": case["paper"]}
        for label, row in rows.items():
            lines.append(f"{label:<28}" + "".join(f"{value:>12.2e}" for value in (row["rms"], *row["max_error"])))
    return "\n".join(lines)


def draw_grids(folder, grids: dict) -> None:
    """Draw the symmetry plane and the plane of the wing of both grids."""
    with figure(folder, "table1_grids", size=(8.2, 8.4)) as canvas:
        for row, (name, grid) in zip(canvas.subplots(2, 2), grids.items()):
            for block in grid.blocks[3:6]:
                draw_net(row[0], block.nodes[:, :, 0, :2], color=BLUE, linewidth=0.3)
            for n in (3, 4, 5, 9, 10, 11):
                plane, color = grid.blocks[n].nodes[:, 0][..., ::2], ORANGE if n == 4 else BLUE
                draw_net(row[1], plane, color=color, linewidth=0.3)
            row[0].set(title=f"{CASES[name][1]}: symmetry plane", ylabel="$y$")
            row[1].set(title=f"{CASES[name][1]}: wing and its plane", ylabel="$z$")
            for axes in row:
                axes.set(xlim=(-0.6, 2.2), ylim=(0, 2.6), xlabel="$x$", aspect="equal")


def draw_errors(folder, models: dict, paper: bool) -> None:
    """Draw how many nodes have errors larger than a given one; with the paper's errors at the paper's size."""
    with figure(folder, "table1_errors", size=(7.5, 3.4)) as canvas:
        for axes, (name, pair) in zip(canvas.subplots(1, 2, sharey=True), models.items()):
            for model, label, color in zip(pair, ("chord length", "corrected"), (BLUE, ORANGE)):
                distance = np.maximum(np.sort(np.linalg.norm(model.residual, axis=1))[::-1], 1e-17)
                axes.loglog(distance, np.arange(1, distance.size + 1) / distance.size, color, label=label)
            if paper:
                axes.axvline(PAPER[name]["rms"], color=GRAY, linestyle=":", label="RMS in the paper")
            axes.set(title=CASES[name][1], xlabel="error of a node (chords)", xlim=(1e-8, 1e-2), ylim=(1e-6, 2))
        axes.legend()
        canvas.axes[0].set_ylabel("fraction of nodes with a larger error")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/table1_fit_errors.png'
