"""The two changes of shape of section IV, made by the B-spline mover and node by node."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from bspline_mdao import (
    FittedModel,
    Grid,
    Shape,
    family_member,
    find_topology,
    fit_grid,
    fit_shape,
    flat_plate_grid,
    generic_blended_wing_body,
    onera_m6_grid,
    rectangular_wing,
)
from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.cells.report import QualityReport, report_quality
from bspline_mdao.mesh.boundary import moving_grid, moving_mesh
from bspline_mdao.mesh.moving_mesh import MovingMesh
from bspline_mdao.movement.elasticity import LinearElasticity
from bspline_mdao.movement.mover import MovementReport
from bspline_mdao.sparse.cholesky import Cholesky

COARSE = 0.5
"""Cells per direction of the largest grid that moves node by node within minutes, by those of the paper's."""


ONE_THREAD = {"solver": Cholesky(n_threads=1), "keep_factors": False}
"""Settings of moves that are timed and not differentiated."""

PAPER_INCREMENTS = 5
"""The paper's m."""


@dataclass(frozen=True)
class Case:
    """A wing that becomes another.

    Parameters
    ----------
    title : str
        What becomes what.
    make_grid : callable
        Grid about the first, given the nodes of each block.
    make_shape : callable
        Shape of the second.
    sizes : dict
        Nodes and control points of each block, at the paper's size (True) and small (False).
    paper_seconds : tuple of float
        What the paper's B-spline and node-based movers took.
    """

    title: str
    make_grid: Callable[[tuple[int, int, int]], Grid]
    make_shape: Callable[[], Shape]
    sizes: dict[bool, tuple[tuple[int, int, int], tuple[int, int, int]]]
    paper_seconds: tuple[float, float]

    def morph(self, paper: bool) -> Morph:
        """Prepare the case at the paper's size, or small."""
        shape, n_control = self.sizes[paper]
        return Morph.of(self, self.make_grid(shape), n_control)


ONERA_M6 = Case(
    "ONERA M6 to rectangular wing",
    onera_m6_grid,
    rectangular_wing,
    {True: ((45, 65, 33), (13, 13, 9)), False: ((11, 13, 9), (7, 8, 5))},
    (227.0, 27.79 * 3600),
)
BLENDED_WING_BODY = Case(
    "flat plate to blended-wing body",
    flat_plate_grid,
    generic_blended_wing_body,
    {True: ((45, 45, 45), (9, 9, 9)), False: ((11, 11, 11), (7, 7, 7))},
    (128.0, 32.4 * 3600),
)


@dataclass(frozen=True)
class Moved:
    """A grid that was moved.

    Parameters
    ----------
    before, after : Grid
        The grid.
    n_points : int
        Points that the mover moved.
    report : MovementReport
        What it did.
    cpu_seconds : float
        Process time of the move on one thread, regenerated grid included.
    """

    before: Grid
    after: Grid
    n_points: int
    report: MovementReport
    cpu_seconds: float

    def numbers(self) -> dict:
        """What a run script tells of it."""
        solves = [increment.solve for increment in self.report.increments]
        return {
            "n_nodes": self.after.n_nodes,
            "n_points": self.n_points,
            "cpu_seconds": self.cpu_seconds,
            "solver": solves[0].solver,
            "iterations": [solve.iterations for solve in solves],
            "residuals": [solve.residual for solve in solves],
        }


@dataclass(frozen=True, eq=False)
class Morph:
    """A case that is ready to move.

    Parameters
    ----------
    grid : Grid
        The initial grid.
    model : FittedModel
        Its fit, without the residual, as in the paper.
    mesh : MovingMesh
        The control mesh.
    surface : ndarray, shape (n_surface, 3)
        Where its surface control points move to (m).
    """

    grid: Grid
    model: FittedModel
    mesh: MovingMesh
    surface: np.ndarray

    @classmethod
    def of(cls, case: Case, grid: Grid, n_control: tuple[int, int, int]) -> Morph:
        """Prepare a case with a grid about its first shape and these control points in each block."""
        model = fit_grid(grid, n_control=n_control, keep_residual=False)
        mesh = moving_mesh(model)
        return cls(grid, model, mesh, fit_shape(model, mesh.surface_ids, case.make_shape()))

    def move_control_mesh(self, **settings) -> tuple[Moved, np.ndarray]:
        """Move the control mesh, settings those of `LinearElasticity`, and regenerate the grid.

        Returns
        -------
        moved : Moved
        control_points : ndarray, shape (n_control_points, 3)
            Moved control points (m).
        """
        self.model.grid_map()  # what the nodes depend on is found once per model
        start = time.process_time()
        movement = elastic_move(self.mesh, self.surface, settings)
        after = self.model.regenerate(movement.points)
        seconds = time.process_time() - start
        return Moved(self.model.regenerate(), after, self.mesh.n_points, movement.report, seconds), movement.points

    def move_nodes(self, control_points: np.ndarray, factor: float = 1.0, **settings) -> Moved:
        """Move the grid node by node to the surface nodes of moved control points.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Moved control points (m).
        factor : float
            Cells per direction of the grid that is moved, by those of the model's grid.
        **settings
            Those of `LinearElasticity`.

        Returns
        -------
        Moved
        """
        nodes = NodeBased.of(self.model, control_points, factor)
        start = time.process_time()
        movement = elastic_move(nodes.mesh, nodes.surface, settings)
        seconds = time.process_time() - start
        after = nodes.grid.with_vector(movement.points[nodes.point_ids].ravel())
        return Moved(nodes.grid, after, nodes.mesh.n_points, movement.report, seconds)


@dataclass(frozen=True, eq=False)
class NodeBased:
    """A member of a model's grid family that is ready to move node by node."""

    grid: Grid
    mesh: MovingMesh
    point_ids: np.ndarray
    surface: np.ndarray

    @classmethod
    def of(cls, model: FittedModel, control_points: np.ndarray, factor: float) -> NodeBased:
        """Take the surface from moved control points."""
        grid, target = (family_member(model, factor, points) for points in (model.control_points, control_points))
        mesh, point_ids = moving_grid(find_topology(grid), grid.to_vector().reshape(-1, 3))
        points = np.empty((mesh.n_points, 3))
        points[point_ids] = target.to_vector().reshape(-1, 3)
        return cls(grid, mesh, point_ids, points[mesh.surface_ids])


def warm_up(*solvers) -> None:
    """Compile what is timed: both movers with each solver."""
    morph = Morph.of(BLENDED_WING_BODY, BLENDED_WING_BODY.make_grid((5, 5, 5)), (4, 4, 4))
    for solver in solvers:
        _, control_points = morph.move_control_mesh(solver=solver)
        morph.move_nodes(control_points, solver=solver)


def elastic_move(mesh: MovingMesh, surface: np.ndarray, settings: dict):
    """Move a mesh as the paper does, on one thread: nu = -0.2, the mover's default, in five increments."""
    with threadpool_limits(1):
        mover = LinearElasticity(mesh, **{"n_increments": PAPER_INCREMENTS, **ONE_THREAD, **settings})
        return mover.move(mesh.points, surface)


def report_cells(before: Grid, after: Grid, n_bins: int = 50) -> QualityReport:
    """Report on the cells of a grid that was moved; what has collapsed is decided before the move."""
    return report_quality(GridQuality.of_baseline(before), after.to_vector().reshape(-1, 3), n_bins)
