"""Figures 4 and 5: orthogonality of the cells.

Orthogonality of the cells before and after the changes of shape of section IV, by both movers. The ONERA M6 becomes a
rectangular NACA 0012 wing, and a flat plate becomes a blended-wing body with winglets, by the control mesh and node by
node, with five increments of linear elasticity each. It takes half a minute, and an hour at the paper's size, where all
nodes are moved only if petsc4py is installed. The output is the distributions of Q by both movers, inverted cells, CPU
times, and the pictures of the figures.
"""

from __future__ import annotations

import time
from importlib.util import find_spec
from typing import Literal

import numpy as np
from scipy.signal import find_peaks
from threadpoolctl import threadpool_limits

import bspline_mdao as bm
from bspline_mdao.grids import GridQuality, report_quality
from bspline_mdao.movers import Cholesky
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, figure
from bspline_mdao.scripts import run

CASES = {
    "figure4_m6": (bm.generators.onera_m6_grid, bm.generators.rectangular_wing),
    "figure5_bwb": (bm.generators.flat_plate_grid, bm.generators.generic_blended_wing_body),
}
SIZES = {
    "figure4_m6": {True: ((45, 65, 33), (13, 13, 9)), False: ((11, 13, 9), (7, 8, 5))},
    "figure5_bwb": {True: ((45, 45, 45), (9, 9, 9)), False: ((11, 11, 11), (7, 7, 7))},
}
"""Nodes and control points of each of the twelve blocks, at the paper's size (True) and small."""

HAS_MULTIGRID = find_spec("petsc4py") is not None
N_BINS = 50
PROMINENCE = 0.25
"""A peak of a distribution rises this much over the valleys beside it."""


def main(paper: bool = False, figures=None, node_based: Literal["full", "coarse", "none"] | None = None) -> dict:
    """Move both grids with both movers, and measure what comes of them.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points, and of 45^3 nodes with 9^3.
    figures : path-like, optional
        Folder for ``figure4_m6.png`` and ``figure5_bwb.png``.
    node_based : {"full", "coarse", "none"}, optional
        Size of the grid that is moved node by node: the full one (the default, but at the paper's size only with
        petsc4py, as a Cholesky factor does not fit), one of half the cells per direction, or none.

    Returns
    -------
    dict
        For each figure what `study` returns.
    """
    study("figure4_m6", (5, 5, 5), (4, 4, 4), "full")  # compiles what is timed
    node_based = node_based or ("coarse" if paper and not HAS_MULTIGRID else "full")
    numbers = {name: study(name, *sizes[paper], node_based) for name, sizes in SIZES.items()}
    for name, found in numbers.items() if figures else ():
        with figure(figures, name, size=(5.2, 3.6)) as canvas:
            draw(canvas.subplots(), found, log=name == "figure5_bwb")
    return numbers


def study(name: str, shape, n_control, node_based: str) -> dict:
    """Move a grid by its control mesh and, if it is to be, node by node, each with the numbers of `measure`."""
    make_grid, make_shape = CASES[name]
    grid = make_grid(shape)
    model = bm.fit_grid(grid, n_control=n_control, keep_residual=False)  # Eq. (3) alone, as in the paper
    mesh = bm.movers.moving_mesh(model)
    model.grid_map()  # what the nodes depend on is found once per model
    surface, cholesky = bm.generators.fit_shape(model, mesh.surface_ids, make_shape()), Cholesky(n_threads=1)
    points, after, cost = move(mesh, surface, cholesky, model.regenerate)
    numbers = {"initial": measure(grid, grid), "b_spline": cost | measure(model.regenerate(), after)}
    if node_based != "none":
        factor = 0.5 if node_based == "coarse" else 1.0
        start, target = (bm.family_member(model, factor, at) for at in (model.control_points, points))
        nodes, ids = bm.movers.moving_grid(bm.find_topology(start), start.to_vector().reshape(-1, 3))
        wanted = np.empty((nodes.n_points, 3))
        wanted[ids] = target.to_vector().reshape(-1, 3)
        solver = bm.movers.PetscMultigrid() if HAS_MULTIGRID else cholesky
        _, after, cost = move(nodes, wanted[nodes.surface_ids], solver, lambda x: start.with_vector(x[ids].ravel()))
        numbers |= {"node_based": cost | measure(start, after), "b_spline_same_size": measure(start, target)}
    return numbers


def move(mesh, surface: np.ndarray, solver, finish) -> tuple[np.ndarray, bm.Grid, dict]:
    """Move a mesh as the paper does, on one thread, and make the grid of it: moved points, grid and what it took."""
    with threadpool_limits(1):
        start = time.process_time()
        mover = bm.movers.LinearElasticity(mesh, n_increments=5, solver=solver, keep_factors=False)
        movement = mover.move(mesh.points, surface)
        grid = finish(movement.points)
        seconds = time.process_time() - start
    solves = [increment.solve for increment in movement.report.increments]
    numbers = {"n_nodes": grid.n_nodes, "n_points": mesh.n_points, "cpu_seconds": seconds, "solver": solves[0].solver}
    numbers |= {"iterations": [one.iterations for one in solves], "residuals": [one.residual for one in solves]}
    return movement.points, grid, numbers


def measure(before: bm.Grid, after: bm.Grid) -> dict:
    """Describe the cells of a moved grid: extremes, the distribution of Q on [0, 1], its first bin and first peak."""
    report = report_quality(GridQuality.of_baseline(before), after.to_vector().reshape(-1, 3), N_BINS)
    density, names = report.histogram.density, ("n_cells", "n_inverted", "min_corner", "q_min", "q_mean")
    peak = lowest_peak(density)
    numbers = {"distribution": density, "lowest_bin": density[0], "lowest_peak": density[peak]}
    return {name: getattr(report, name) for name in names} | numbers | {"lowest_peak_at": (peak + 0.5) / N_BINS}


def lowest_peak(distribution: np.ndarray) -> int:
    """Find the bin of the first peak, which is not the first bin but may be the last."""
    return find_peaks(np.append(distribution, 0.0), prominence=PROMINENCE)[0][0]


def draw(axes, numbers: dict, log: bool) -> None:
    """Draw the distributions over each other, as the paper does."""
    is_coarse = numbers.get("node_based", numbers["b_spline"])["n_cells"] < numbers["b_spline"]["n_cells"]
    size = f" ({numbers['node_based']['n_cells']:,} cells)" if is_coarse else ""
    looks = {"initial": ("initial", {"color": GRAY, "linestyle": "--", "linewidth": 1.0})}
    looks |= {"b_spline": ("B-spline", {"color": BLUE}), "node_based": (f"node-based{size}", {"color": ORANGE})}
    looks |= {"b_spline_same_size": (f"B-spline{size}", {"color": BLUE, "linestyle": ":"})} if is_coarse else {}
    for name in (name for name in looks if name in numbers):
        distribution, (label, look) = numbers[name]["distribution"], looks[name]
        places = (np.arange(N_BINS) + 0.5) / N_BINS
        axes.plot(places, np.where(distribution > 0.0, distribution, np.nan), label=label, **look)
    axes.set(xlabel="orthogonality $Q$", ylabel="distribution of cells", xlim=(0, 1))
    axes.set(yscale="log") if log else axes.set(ylim=(0, None))
    axes.legend(loc="upper left")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/figure4_m6.png'
