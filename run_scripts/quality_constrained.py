"""Keep the grid valid by a constraint.

A cube turned by 45 degrees: its grid tangles without the quality constraint, but not with it. Every side of a cube has
to move to the plane of the same side of the cube turned about z. All control points of the surface are free, and
nothing determines where in its plane a point has to be: points go straight to their planes and gather at one edge,
where cells turn inside out. The objective reaches its known minimum, zero, either way. With a lower bound of the corner
triple products of all cells as a constraint, it does so with a usable grid. It takes a minute, and more than an hour at
the paper's size. The output is both optima with their inverted cells, a check of the totals, and a picture of the grids
and the histories.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om
from scipy.sparse import csr_array

import bspline_mdao as bm
from bspline_mdao.drivers import nlopt, recorded, scipy_slsqp
from bspline_mdao.grids import GridQuality, report_quality
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, GRAY, RED, draw_history, draw_net, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals, perturb_design

ANGLE = np.radians(45.0)
"""By which the cube turns."""

LEAST_CORNER = 0.1
"""Lower bound of the corner triple products of unit edges; they are 0.58 at the corners of the cube."""

RHO = 30.0
"""Sharpness of the bound: a sharp one is hardly differentiable to a quasi-Newton method."""

UNIT, TOLERANCE = 1e-4, 1e-10
"""Unit of the objective for the driver, as it starts at 1 and the constraint still bends it where it is small.

The tolerance is in that unit.
"""

SIZES = {False: (7, 4, 2), True: (17, 5, 5)}
"""Nodes and control points along the edges of the cube, and increments of the mover."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}


class DistanceFromPlanes:
    """Mean square distance of the nodes of every face of a surface from a plane, relative to the baseline's.

    A measure of one's own: it has a name, units, a shape and a surface, and methods ``evaluate`` and ``partials``.
    """

    name, units, shape = "distance", None, (1,)

    def __init__(self, surface: bm.measures.SurfaceGrid, normals: np.ndarray, offsets: np.ndarray):
        self.surface = surface
        ids = np.concatenate([ids.ravel() for ids in surface.faces])
        face = np.repeat(np.arange(len(surface.faces)), [ids.size for ids in surface.faces])
        columns = (3 * ids[:, None] + [0, 1, 2]).ravel()
        matrix = csr_array((normals[face].ravel(), columns, 3 * np.arange(len(ids) + 1)))
        self.length = np.linalg.norm(matrix @ surface.points.ravel() - offsets[face])
        self.matrix, self.places = matrix / self.length, offsets[face] / self.length

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Mean square of the distances of nodes, shape (n_points, 3)."""
        return np.array([np.sum((self.matrix @ points.ravel() - self.places) ** 2)])

    def partials(self, points: np.ndarray) -> csr_array:
        """Its derivatives, shape (1, 3 n_points)."""
        gradient = 2.0 * self.matrix.T @ (self.matrix @ points.ravel() - self.places)
        return csr_array((gradient, np.arange(gradient.size), [0, gradient.size]), shape=(1, gradient.size))


class Turn:
    """A cube that is to turn, with so many nodes and control points along its edges."""

    def __init__(self, n_nodes: int, n_control: int, n_increments: int):
        grid = bm.generators.brick_grid((n_nodes, n_nodes, n_nodes, 7), far=5.0)
        # without the constraint the grid is turned inside out: Eq. (3) alone goes on there, to show it
        self.model = bm.fit_grid(grid, n_control=(n_control, n_control, 5), wall_layer=False)
        mesh, surface = bm.movers.moving_mesh(self.model), bm.measures.SurfaceGrid.of(self.model)
        centres = np.array([surface.points[ids].mean(axis=(0, 1)) for ids in surface.faces])
        self.measure = DistanceFromPlanes(surface, turned(2.0 * centres), np.full(6, 0.5))
        self.parametrization = bm.design.Parametrization(mesh, [bm.design.Local("move")])
        self.mover = bm.movers.LinearElasticity(mesh, n_increments=n_increments)

    def problem(self, is_constrained: bool) -> om.Problem:
        """Least distance, not set up; inverted cells on the way are no error."""
        problem = om.Problem(reports=None)
        chain = {"parametrization": self.parametrization, "measures": [self.measure], "mover": self.mover}
        movement = bm.GridMovement(model=self.model, require_valid=False, quality=False, **chain)
        quality = bm.Quality(model=self.model, aggregates=("corner_ks",), rho=RHO)
        problem.model.add_subsystem("grid_movement", movement, promotes=["*"])
        problem.model.add_subsystem("quality", quality, promotes=["*"])
        problem.model.add_design_var("move", ref=0.3)
        problem.model.add_objective("distance", ref=UNIT)
        if is_constrained:
            problem.model.add_constraint("corner_ks", lower=LEAST_CORNER)
        return problem

    def summary(self, problem: om.Problem) -> dict:
        """Largest distance of ``corners`` from where they belong and of nodes from their ``planes`` (m); the cells."""
        cells = report_quality(GridQuality.of_baseline(self.model.regenerate()), problem.get_val(GRID).reshape(-1, 3))
        nodes, start = problem.get_val("surface").reshape(-1, 3), self.measure.surface.points
        is_corner = np.isclose(np.abs(start), 0.5).all(axis=1)
        return {
            "corners": np.abs(nodes[is_corner] - turned(start[is_corner])).max(),
            "planes": self.measure.length * np.abs(self.measure.matrix @ nodes.ravel() - self.measure.places).max(),
            "n_inverted": cells.n_inverted,
            "min_corner": cells.min_corner,
        }


def turned(points: np.ndarray) -> np.ndarray:
    """Turn points, shape (n, 3), about z."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def started(turn: Turn) -> om.Problem:
    """Run the problem with the constraint off the start, where derivatives vanish."""
    problem = turn.problem(is_constrained=True)
    problem.setup(mode="rev")
    problem.run_model()
    return perturb_design(problem)


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Turn the cube without and with the constraint, with every driver.

    Parameters
    ----------
    paper : bool
        More nodes and control points, and five increments.
    figures : path-like, optional
        Folder for ``quality_constrained.png`` and the N2 diagram ``quality_constrained.html``.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_variables``; for each driver, under ``unconstrained`` and ``constrained``, what `RecordedRun.numbers` and
        `Turn.summary` return; ``totals``, see `check_totals`.
    """
    turn, numbers, runs = Turn(*SIZES[paper]), {}, {}
    start = started(turn)
    for kind, is_constrained in {"unconstrained": False, "constrained": True}.items():
        runs[kind] = {}
        for driver, make_driver in drivers.items():
            problem = turn.problem(is_constrained)
            problem.driver = make_driver(TOLERANCE, 600)
            with recorded(problem) as runs[kind][driver]:
                problem.run_driver()
        numbers[kind] = {name: result.numbers() | turn.summary(result.problem) for name, result in runs[kind].items()}
    if figures:
        draw(figures, turn, runs)
        om.n2(start, outfile=str(Path(figures) / "quality_constrained.html"), show_browser=False)
    return {"n_variables": start.get_val("move").size, **numbers, "totals": check_totals(start)._asdict()}


def draw(folder, turn: Turn, runs: dict) -> None:
    """Draw the grid half-way up at the start, without and with the constraint, and the histories."""
    grids = {"start": turn.model.regenerate().to_vector()}
    for kind, row in runs.items():
        problem = next(reversed(row.values())).problem
        grids[f"{kind}: {turn.summary(problem)['n_inverted']} inverted cells"] = problem.get_val(GRID)
    with figure(folder, "quality_constrained", (12.0, 3.3)) as canvas:
        *cuts, history = canvas.subplots(1, 4, width_ratios=(1.0, 1.0, 1.0, 1.2))
        for axes, color, (title, nodes) in zip(cuts, (GRAY, RED, BLUE), grids.items()):
            draw_cut(axes, turn.model, nodes, color)
            axes.set_title(title, fontsize=10)
        draw_history(history, runs["constrained"], "distance", "mean square distance relative to the start")


def draw_cut(axes, model: bm.FittedModel, nodes: np.ndarray, color: str) -> None:
    """Draw the grid lines in the plane z = 0 next to the cube, and the outline of the turned cube."""
    moved = model.header.grid(model.topology.shapes, nodes.reshape(-1, 3))
    for start, block in zip(model.regenerate().blocks, moved.blocks):
        for direction in (0, 1):
            half = start.shape[direction] // 2
            if np.abs(np.take(start.nodes, half, axis=direction)[..., 2]).max() < 1e-9:
                draw_net(axes, np.take(block.nodes, half, axis=direction)[..., :2], color=color, linewidth=0.7)
    outline = turned(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) / 2.0)
    axes.plot(*outline.T[:2], "--", color="black", linewidth=1.0)
    axes.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), aspect="equal")
    axes.set_axis_off()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/quality_constrained.png'
