"""A cube turned by 45 degrees: its grid tangles without the quality constraint, and does not with it.

Every side of a cube is to lie in the plane of the same side of the cube turned about z. All control points of the
surface are free, and nothing asks where in its plane a point is to be: points go straight to their planes and crowd at
one edge, where cells turn inside out. The objective reaches its known least value, zero, either way; with a lower bound
of the corner triple products of all cells as a constraint it does so with a grid that can be used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import openmdao.api as om
from common import BLUE, GRAY, RED, figure, run
from history import draw_history
from optimisation import DRIVERS, Run, optimise, set_up, write_n2
from scipy.sparse import csr_array
from totals import check_totals, move_at_random

from bspline_mdao import FittedModel, GridMovement, LinearElasticity, Quality, brick_grid, fit_grid, moving_mesh
from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.cells.report import QualityReport, report_quality
from bspline_mdao.design.displacement import Local
from bspline_mdao.design.parametrization import Parametrization
from bspline_mdao.mesh.surface import SurfaceGrid
from bspline_mdao.names import GRID

ANGLE = np.radians(45.0)
"""By which the cube turns."""

LEAST_CORNER = 0.1
"""Lower bound of the corner triple products of unit edges; they are 0.58 at the corners of the cube."""

RHO = 30.0
"""Sharpness of the bound: a sharp one is hardly differentiable to a quasi-Newton method."""

TOLERANCE = 1e-10
"""Of the objective in units of the driver."""

UNIT = 1e-4
"""Unit of the objective for the driver: it starts at 1, and where it is small the constraint still bends it."""

FAR = 5.0
"""Radius of the outer boundary (m)."""

SIZES = {False: (7, 4, 2), True: (17, 5, 5)}
"""Nodes and control points along the edges of the cube, and increments of the mover."""


@dataclass(frozen=True, eq=False)
class DistanceFromPlanes:
    """Mean square distance of the nodes of every face of a surface from a plane, a measure; make it by `of`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    matrix : csr_array, shape (n, 3 n_points)
        Turns the nodes into their places along the normals of the planes, by a length.
    places : ndarray, shape (n,)
        Those of the planes.
    """

    surface: SurfaceGrid
    matrix: csr_array
    places: np.ndarray
    name = "distance"
    units = None
    shape = (1,)

    @classmethod
    def of(cls, surface: SurfaceGrid, normals: np.ndarray, offsets: np.ndarray) -> DistanceFromPlanes:
        """Take the distance on the baseline as 1; unit normals (n_faces, 3), distances from the origin (n_faces,)."""
        ids = np.concatenate([ids.ravel() for ids in surface.faces])
        face = np.repeat(np.arange(len(surface.faces)), [ids.size for ids in surface.faces])
        columns = (3 * ids[:, None] + [0, 1, 2]).ravel()
        matrix = csr_array((normals[face].ravel(), columns, 3 * np.arange(len(ids) + 1)))
        length = np.linalg.norm(matrix @ surface.points.ravel() - offsets[face])
        return cls(surface, matrix / length, offsets[face] / length)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Mean square of the distances of nodes, shape (n_points, 3), by that of the baseline, shape (1,)."""
        return np.array([np.sum((self.matrix @ points.ravel() - self.places) ** 2)])

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate it, shape (1, 3 n_points)."""
        gradient = 2.0 * self.matrix.T @ (self.matrix @ points.ravel() - self.places)
        return csr_array((gradient, np.arange(gradient.size), [0, gradient.size]), shape=(1, gradient.size))


@dataclass(frozen=True, eq=False)
class Turn:
    """A cube that is to turn.

    Parameters
    ----------
    model : FittedModel
        Fit of the grid about it.
    parametrization : Parametrization
        Displacements of all surface control points (m).
    mover : LinearElasticity
        What moves the grid.
    measure : DistanceFromPlanes
        From those of the turned cube.
    """

    model: FittedModel
    parametrization: Parametrization
    mover: LinearElasticity
    measure: DistanceFromPlanes

    @classmethod
    def of(cls, n_nodes: int, n_control: int, n_increments: int) -> Turn:
        """Make one with so many nodes and control points along its edges."""
        grid = brick_grid((n_nodes, n_nodes, n_nodes, 7), far=FAR)
        # without the constraint the grid is turned inside out: Eq. (3) alone goes on there, to show it
        model = fit_grid(grid, n_control=(n_control, n_control, 5), wall_layer=False)
        mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
        centres = np.array([surface.points[ids].mean(axis=(0, 1)) for ids in surface.faces])
        measure = DistanceFromPlanes.of(surface, turned(2.0 * centres), np.full(6, 0.5))
        mover = LinearElasticity(mesh, n_increments=n_increments)
        return cls(model, Parametrization(mesh, [Local("move")]), mover, measure)

    def problem(self, is_constrained: bool, refuses: bool = False) -> om.Problem:
        """Least distance, not set up; ``refuses`` tells whether a tangled control mesh is an error or a constraint."""
        problem = om.Problem(reports=False)
        movement = GridMovement(
            model=self.model,
            parametrization=self.parametrization,
            measures=[self.measure],
            mover=self.mover,
            require_valid=refuses,
            quality=False,
        )
        problem.model.add_subsystem("grid_movement", movement, promotes=["*"])
        problem.model.add_subsystem(
            "quality", Quality(model=self.model, aggregates=("corner_ks",), rho=RHO), promotes=["*"]
        )
        problem.model.add_design_var("move", ref=0.3)
        problem.model.add_objective("distance", ref=UNIT)
        if is_constrained:
            problem.model.add_constraint("corner_ks", lower=LEAST_CORNER)
        return problem

    def report(self, problem: om.Problem) -> QualityReport:
        """Look at the cells."""
        cells = GridQuality.of_baseline(self.model.regenerate())
        return report_quality(cells, problem.get_val(GRID).reshape(-1, 3))

    def numbers(self, result: Run) -> dict:
        """What is told of a run: also how far corners and nodes are from where they belong (m), and the cells."""
        cells, nodes = self.report(result.problem), result.problem.get_val("surface").reshape(-1, 3)
        start = self.measure.surface.points
        is_corner = np.isclose(np.abs(start), 0.5).all(axis=1)
        residuals = self.measure.matrix @ nodes.ravel() - self.measure.places
        length = 0.5 / np.abs(self.measure.places[0])
        return result.numbers() | {
            "corners": np.abs(nodes[is_corner] - turned(start[is_corner])).max(),
            "planes": length * np.abs(residuals).max(),
            "n_inverted": cells.n_inverted,
            "min_corner": cells.min_corner,
        }


def turned(points: np.ndarray) -> np.ndarray:
    """Turn points, shape (n, 3), about z."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Turn the cube without and with the constraint, with every driver.

    Parameters
    ----------
    paper : bool
        More nodes and control points, and five increments.
    figures : path-like, optional
        Folder for ``quality_constrained.png`` and the N2 diagram ``quality_constrained.html``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        ``n_variables``; for each driver, under ``unconstrained`` and ``constrained``, what `optimisation.Run.numbers`
        tells, the largest distance of ``corners`` from where they belong and of nodes from their ``planes`` (m),
        ``n_inverted`` and ``min_corner`` of the cells; ``totals``, see `totals.check_totals`.
    """
    turn = Turn.of(*SIZES[paper])
    runs = {
        kind: {
            name: optimise(partial(turn.problem, is_constrained), make(TOLERANCE, 600))
            for name, make in drivers.items()
        }
        for kind, is_constrained in {"unconstrained": False, "constrained": True}.items()
    }
    numbers = {
        "n_variables": len(turn.parametrization.initial["move"]),
        **{kind: {name: turn.numbers(result) for name, result in row.items()} for kind, row in runs.items()},
        "totals": check_totals(move_at_random(set_up(turn.problem(True)))),
    }
    if figures:
        draw(figures, turn, runs)
        write_n2(set_up(turn.problem(True)), figures, "quality_constrained")
    return numbers


def draw(folder, turn: Turn, runs: dict[str, dict[str, Run]]) -> None:
    """Draw the grid half-way up at the start, without and with the constraint, and the histories."""
    problems = {kind: next(reversed(row.values())).problem for kind, row in runs.items()}
    grids = {"start": turn.model.regenerate().to_vector()}
    grids |= {f"{kind}: {turn.report(p).n_inverted} inverted cells": p.get_val(GRID) for kind, p in problems.items()}
    with figure(folder, "quality_constrained", (12.0, 3.3)) as canvas:
        *cuts, history = canvas.subplots(1, 4, width_ratios=(1.0, 1.0, 1.0, 1.2))
        for axes, color, (title, nodes) in zip(cuts, (GRAY, RED, BLUE), grids.items()):
            draw_cut(axes, turn.model, nodes, color)
            axes.set_title(title, fontsize=10)
        draw_history(history, runs["constrained"], "distance", "mean square distance by that of the start")


def draw_cut(axes, model: FittedModel, nodes: np.ndarray, color: str) -> None:
    """Draw the grid lines in the plane z = 0 next to the cube, and the outline of the turned cube."""
    baseline = model.regenerate()
    for start, block in zip(baseline.blocks, model.header.grid(model.topology.shapes, nodes.reshape(-1, 3)).blocks):
        for direction in (0, 1):
            half = start.shape[direction] // 2
            if np.abs(np.take(start.nodes, half, axis=direction)[..., 2]).max() < 1e-9:
                x, y, _ = np.moveaxis(np.take(block.nodes, half, axis=direction), -1, 0)
                for lines in ((x, y), (x.T, y.T)):
                    axes.plot(*lines, color=color, linewidth=0.7)
    outline = turned(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) / 2.0)
    axes.plot(*outline.T[:2], "--", color="black", linewidth=1.0)
    axes.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), aspect="equal")
    axes.set_axis_off()


if __name__ == "__main__":
    run(main, __doc__)
