"""Section IV: CPU times of the movers.

CPU times of the B-spline mover and the node-based mover, in one run. Both move with five increments of linear
elasticity, each on a sequence of ever finer meshes: control meshes up to the one that is used, and members of the grid
family up to the largest that the time allows. Both are solved in two ways, by the paper's conjugate gradients
preconditioned with ILU(p) and by sparse Cholesky factors; if petsc4py is installed also by conjugate gradients
preconditioned with hypre's multigrid, with which all nodes of the grid are moved. The time of another solver there is
extrapolated from the measured growth, and marked as such.

Process time on one thread, meshes and movers in turn; finding the unknowns and the order of elimination counts. It
takes half a minute, and an hour and a half at the paper's size. The output is all times, the ratio of the two movers
next to the paper's, and a picture of the growth.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
from threadpoolctl import threadpool_limits

import bspline_mdao as bm
from bspline_mdao.generators import (
    fit_shape,
    flat_plate_grid,
    generic_blended_wing_body,
    onera_m6_grid,
    rectangular_wing,
)
from bspline_mdao.movers import Cholesky, ConjugateGradients, LinearElasticity, PetscMultigrid, moving_grid, moving_mesh
from bspline_mdao.plotting import BLUE, ORANGE, figure
from bspline_mdao.scripts import run

CASES = {
    "onera_m6": ("ONERA M6 to rectangular wing", onera_m6_grid, rectangular_wing),
    "blended_wing_body": ("flat plate to blended-wing body", flat_plate_grid, generic_blended_wing_body),
}
SIZES = {"onera_m6": ((45, 65, 33), (13, 13, 9)), "blended_wing_body": ((45, 45, 45), (9, 9, 9))}
SMALL = ((9, 9, 9), (5, 5, 5))
"""Nodes and control points of each block: the paper's, and the small size."""

PAPER_RATIOS = {"onera_m6": 27.79 * 3600 / 227.0, "blended_wing_body": 32.4 * 3600 / 128.0}
"""Times of the paper's node-based mover, relative to its B-spline mover's."""

LEVELS = {True: (0.2, 1 / 3, 0.5), False: (0.5, 0.75)}
"""Cells and elements per direction, relative to the case's, at the paper's size and small.

At half the paper's cells per direction a Cholesky factor takes 5 GB; twice as many would take a hundred.
"""

SOLVERS = {"conjugate_gradients": ConjugateGradients(), "cholesky": Cholesky(n_threads=1)}
SOLVERS |= {"multigrid": PetscMultigrid()} if find_spec("petsc4py") else {}
SLOWEST_GROWTH = 4 / 3
"""Power with which the time of conjugate gradients grows at least: iterations as the points along an edge."""


@dataclass(frozen=True)
class Series:
    """CPU times of one mover with one solver on ever larger meshes."""

    n_points: list[int] = field(default_factory=list)
    cpu_seconds: list[float] = field(default_factory=list)
    iterations: list[list[int]] = field(default_factory=list)

    @property
    def exponent(self) -> float:
        """Power of the number of points with which the time grows, from the two largest meshes; 2 until there are."""
        n, t = (np.log(values[-2:]) for values in (self.n_points, self.cpu_seconds))
        return float(np.diff(t)[0] / np.diff(n)[0]) if len(n) == 2 else 2.0

    def at(self, n_points: float, exponent: float | None = None) -> float:
        """Time on a mesh of another size: the time of the largest, scaled by the measured growth or by another one."""
        exponent = self.exponent if exponent is None else exponent
        return self.cpu_seconds[-1] * (n_points / self.n_points[-1]) ** exponent

    def move(self, mesh, surface: np.ndarray, solver, finish=lambda points: None) -> np.ndarray:
        """Time a move as the paper does it, with what follows it, and return the moved points."""
        with threadpool_limits(1):
            start = time.process_time()
            mover = LinearElasticity(mesh, n_increments=5, solver=solver, keep_factors=False)
            movement = mover.move(mesh.points, surface)
            finish(movement.points)
            self.cpu_seconds.append(time.process_time() - start)
        self.n_points.append(mesh.n_points)
        self.iterations.append([increment.solve.iterations for increment in movement.report.increments])
        return movement.points


def main(paper: bool = False, figures=None, minutes: float = 120.0) -> dict:
    """Time both movers on both cases.

    Parameters
    ----------
    paper : bool
        The paper's grids and control meshes.
    figures : path-like, optional
        Folder for ``section4_cpu.png``.
    minutes : float
        Time after which no larger mesh is tried (120 by default), half of it for each case.

    Returns
    -------
    dict
        ``onera_m6`` and ``blended_wing_body``. Each has the times of both movers with all solvers, ``b_spline`` and
        ``node_based``: ``n_points``, ``cpu_seconds`` and ``iterations`` of every mesh, and the ``exponent`` of the
        growth; ``full_grid``, what moving all nodes one by one takes, and whether it ``is_extrapolated``; and
        ``ratio``, node-based to B-spline, measured at the largest mesh, for the full grid, and for the full grid if the
        time grew from there on as slowly as it can: with the ``same_algorithm``, with the ``multigrid`` on both sides
        where it is there, with the ``best_solvers`` of each, and in the ``paper``.
    """
    study("blended_wing_body", (5, 5, 5), (4, 4, 4), (1.0,), 0.0)  # compiles what is timed
    sizes, seconds = SIZES if paper else dict.fromkeys(CASES, SMALL), 60.0 * minutes / len(CASES)
    numbers = {name: study(name, *size, LEVELS[paper], seconds) for name, size in sizes.items()}
    if figures:
        draw(figures, numbers)
    return numbers


def study(name: str, shape, n_control, levels, seconds: float) -> dict:
    """Time both movers with all solvers on the meshes of all levels; node by node only if time allows, or first.

    The multigrid alone has the memory for all nodes, which come last.
    """
    deadline = time.monotonic() + seconds
    b_spline, node_based = ({solver: Series() for solver in SOLVERS} for _ in range(2))
    grid = CASES[name][1](shape)
    model, mesh, surface = pose(name, grid, n_control)
    target = Series().move(mesh, surface, SOLVERS["cholesky"])  # its surface is what the nodes of all levels move to
    n_full = 1 + max(int(ids.max()) for ids in model.topology.node_ids())
    for level in levels:
        coarse = [max(4, 1 + round(level / levels[-1] * (n - 1))) for n in n_control]
        model_here, mesh_here, surface_here = pose(name, grid, tuple(coarse))
        for key, solver in SOLVERS.items():
            b_spline[key].move(mesh_here, surface_here, solver, model_here.regenerate)
            found = node_based[key]
            if not found.n_points or time.monotonic() + found.at(n_full * level**3) < deadline:
                found.move(*pose_nodes(model, target, level), solver)
    found = node_based.get("multigrid")
    if found and time.monotonic() + found.at(n_full) < deadline:
        found.move(*pose_nodes(model, target, 1.0), SOLVERS["multigrid"])
    return numbers_of(name, b_spline, node_based, n_full)


def pose(name: str, grid, n_control):
    """Fit a grid: the model, its control mesh, and where the surface control points move to."""
    model = bm.fit_grid(grid, n_control=n_control, keep_residual=False)  # Eq. (3) alone, as in the paper
    mesh = moving_mesh(model)
    model.grid_map()  # what the nodes depend on is found once per model
    return model, mesh, fit_shape(model, mesh.surface_ids, CASES[name][2]())


def pose_nodes(model, target: np.ndarray, factor: float):
    """Make a member of the grid family ready to move node by node to where moved control points put its surface."""
    start, wanted = (bm.family_member(model, factor, points) for points in (model.control_points, target))
    mesh, ids = moving_grid(bm.find_topology(start), start.to_vector().reshape(-1, 3))
    points = np.empty((mesh.n_points, 3))
    points[ids] = wanted.to_vector().reshape(-1, 3)
    return mesh, points[mesh.surface_ids]


def numbers_of(name: str, b_spline: dict, node_based: dict, n_full: int) -> dict:
    """Sum a case up, see `main`."""

    def fastest(series: dict) -> str:
        largest = max(one.n_points[-1] for one in series.values())
        reached = {key: one.cpu_seconds[-1] for key, one in series.items() if one.n_points[-1] == largest}
        return min(reached, key=reached.get)

    def ratio(first: str, second: str) -> dict:
        seconds, nodes = b_spline[first].cpu_seconds[-1], node_based[second]
        return {
            "solvers": [SOLVERS[first].name, SOLVERS[second].name],
            "measured": nodes.cpu_seconds[-1] / seconds,
            "measured_at": nodes.n_points[-1],
            "full_grid": nodes.at(n_full) / seconds,
            "full_grid_at_least": nodes.at(n_full, min(nodes.exponent, SLOWEST_GROWTH)) / seconds,
        }

    def times(series: dict) -> dict:
        return {key: vars(one) | {"exponent": one.exponent} for key, one in series.items()}

    return {
        "b_spline": times(b_spline),
        "node_based": times(node_based),
        "full_grid": {
            "n_points": n_full,
            "is_extrapolated": max(one.n_points[-1] for one in node_based.values()) < n_full,
            "cpu_seconds": {key: one.at(n_full) for key, one in node_based.items()},
        },
        "ratio": {
            "same_algorithm": ratio("conjugate_gradients", "conjugate_gradients"),
            **({"multigrid": ratio("multigrid", "multigrid")} if "multigrid" in SOLVERS else {}),
            "best_solvers": ratio(fastest(b_spline), fastest(node_based)),
            "paper": PAPER_RATIOS[name],
        },
    }


def draw(folder, numbers: dict) -> None:
    """Draw the times over the numbers of points, the full grid as open marks where it is extrapolated."""
    with figure(folder, "section4_cpu", size=(7.6, 3.6)) as canvas:
        for axes, (name, case) in zip(canvas.subplots(1, 2, sharey=True), numbers.items()):
            for mover, title, color in (("b_spline", "B-spline", BLUE), ("node_based", "node-based", ORANGE)):
                for solver, marker in zip(SOLVERS, "os^"):
                    n, t = (case[mover][solver][key] for key in ("n_points", "cpu_seconds"))
                    look = {"color": color, "marker": marker, "markersize": 4}
                    axes.loglog(n, t, label=f"{title}, {SOLVERS[solver].name}", **look)
                    full = case["full_grid"]
                    if mover == "node_based" and n[-1] < full["n_points"]:
                        look |= {"markerfacecolor": "white", "markevery": [1], "linestyle": ":"}
                        axes.loglog([n[-1], full["n_points"]], [t[-1], full["cpu_seconds"][solver]], **look)
            axes.set(title=CASES[name][0], xlabel="points that are moved")
            axes.xaxis.set_minor_formatter("")
        canvas.axes[0].set_ylabel("CPU time of a move (s)")
        canvas.axes[0].legend(loc="upper left", fontsize=8)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/section4_cpu.png'
