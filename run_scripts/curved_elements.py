"""Curved elements for high-order solvers.

Curved elements of degree 1 to 4 from B-spline volumes, and how close their walls are to the splines. It takes half a
minute, with ``--quick`` some seconds. The output, for a ball with volumes of order 4 and 6, is the distance of curved
walls from the splines on ever finer grids of elements of each degree, its order, and the smallest Jacobian; a picture
of them; and the coarsest elements as CGNS and, with meshio, for Gmsh.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import bspline_mdao as bm
from bspline_mdao.grids import CurvedGrid
from bspline_mdao.plotting import BLUE, GREEN, ORANGE, PURPLE, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.splines import evaluate_gradients, invert_points

DEGREES = {1: BLUE, 2: ORANGE, 3: GREEN, 4: PURPLE}
"""Degrees of elements and their colours."""

SIZES = {
    "quick": (9, (4,), (1, 2), (0.25, 0.5)),
    "default": (17, (4, 6), tuple(DEGREES), (0.125, 0.25, 0.5, 1.0)),
    "paper": (17, (4, 6), tuple(DEGREES), (0.125, 0.25, 0.5, 1.0, 2.0)),
}
"""Nodes along edges of the six blocks about the ball, orders of the volumes, degrees, and elements per cell."""

MOST_POINTS = 2500
"""Points of a wall whose distance is measured."""


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Measure walls of curved elements.

    Parameters
    ----------
    paper, quick : bool
        One level more, or a small case.
    figures : path-like, optional
        Folder for ``curved_elements.png``, ``ball.cgns`` and ``ball.msh``.

    Returns
    -------
    dict
        For volumes of each order, for elements of each degree: ``n_elements``, ``distance``, the largest from the
        splines (m), ``order``, between each grid and the one before it, and ``worst_jacobian``, lists over the grids.
    """
    n, orders, degrees, factors = pick_size(SIZES, paper, quick)
    grid = bm.generators.ball_grid((n, n, n, (n + 1) // 2), far=4.0)
    options = {"n_control": min((n + 1) // 2, 8), "keep_residual": False}
    models = {order: bm.fit_grid(grid, order=order, **options) for order in orders}
    numbers = {
        f"order {order}": {f"degree {degree}": study(model, degree, factors) for degree in degrees}
        for order, model in models.items()
    }
    if figures:
        draw(figures, numbers, models[orders[0]], factors)
        coarsest = bm.splines.curved_grid(models[orders[0]], 2, factors[0])
        for suffix in ("cgns", "msh"):
            bm.files.write_curved_grid(Path(figures) / f"ball.{suffix}", coarsest)
    return numbers


def study(model: bm.FittedModel, degree: int, factors: tuple[float, ...]) -> dict:
    """Distances from the splines, and Jacobians, of elements of one degree."""
    grids = [bm.splines.curved_grid(model, degree, factor) for factor in factors]
    distances = [wall_distance(model, grid) for grid in grids]
    ratios = np.log(np.divide(factors[1:], factors[:-1]))
    return {
        "n_elements": [len(grid.elements) for grid in grids],
        "distance": distances,
        "order": [float(x) for x in np.log(np.divide(distances[:-1], distances[1:])) / ratios],
        "worst_jacobian": [float(grid.worst_jacobians().min()) for grid in grids],
    }


def wall_distance(model: bm.FittedModel, grid: CurvedGrid) -> float:
    """Largest distance (m) of points inside of curved wall faces from the splines' wall, zeta = 0 or 1 of all volumes.

    A point in the ball is off the nearest point of the volumes; one in the grid has a parameter off the wall's.
    """
    points = grid.points("body", 6)[:, 1:-1, 1:-1].reshape(-1, 3)
    points = np.random.default_rng(0).permutation(points)[:MOST_POINTS]
    found = invert_points(model.mesh, model.control_points, points)
    distance, nets = found.distance.copy(), model.mesh.nets(model.control_points)
    walls = {face.window.block: float(face.window.lo[2] > 0) for face in model.topology.boundary if face.kind == "wall"}
    for volume, wall in walls.items():
        inside = np.flatnonzero((found.volume == volume) & (found.distance < 1e-13))
        at = found.parameters[inside]
        x = evaluate_gradients(model.mesh.volumes[volume], nets[volume], at)
        normal = np.cross(x[:, :, 0], x[:, :, 1])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        distance[inside] = np.abs(np.einsum("nx,nx->n", x[:, :, 2], normal) * (at[:, 2] - wall))
    return float(distance.max())


def draw(folder, numbers: dict, model: bm.FittedModel, factors: tuple[float, ...]) -> None:
    """Draw distances over the size of elements with lines of order d + 1, and the coarsest elements of two degrees."""
    size = 1.0 / np.array(factors)
    with figure(folder, "curved_elements", size=(4.0 * (len(numbers) + 1), 3.8)) as canvas:
        panels = canvas.subplots(1, len(numbers) + 1)
        for axes, (name, of_degree) in zip(panels, numbers.items()):
            for (degree, color), found in zip(DEGREES.items(), of_degree.values()):
                axes.loglog(size, found["distance"], "o-", color=color, label=f"degree {degree}")
                slope = found["distance"][-1] * (size / size[-1]) ** (degree + 1)
                axes.loglog(size, slope, ":", color=color, linewidth=0.8)
            axes.set(title=f"volumes of {name}", xlabel="size of elements, by that of cells")
            axes.set_xticks(size, [f"{x:g}" for x in size])
            axes.minorticks_off()
            axes.legend(fontsize=9)
        panels[0].set_ylabel("distance of walls from the splines (m)")
        highest = len(numbers["order 4"])
        for degree in (1, highest):
            x = bm.splines.curved_grid(model, degree, factors[0]).points("body", 13)
            for line in (x[:, 0], x[:, -1], x[:, :, 0], x[:, :, -1]):
                front = line[line[..., 1].mean(axis=1) < 1e-9]
                panels[-1].plot(front[..., 0].T, front[..., 2].T, color=DEGREES[degree], linewidth=1.0)
        panels[-1].set(aspect="equal", title=f"walls of degree 1 and {highest}", xlabel="x (m)", ylabel="z (m)")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/curved_elements.png'
