"""Shape control in unsteady flow, section II.E: grids and exact grid velocities for a surface that moves in time.

A motion is a function of time and of the surface points at rest. It gives the surface points and their velocities; the
mover and the model's map carry both to the grid: x = x(b(s(t))), dx/dt = (dx/db) (db/ds) ds/dt. Theory:
``docs/theory/unsteady.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.frame import mesh_frame
from ..mesh.moving_mesh import MovingMesh
from ..model.fitted_model import FittedModel
from ..model.movable import ControlPointMap
from ..movement.mover import MovementReport, Mover, differentiable
from .deformation import Bend, Deformation, Pitch, PointMap, amount_jvp, jvp

__all__ = ["GridState", "Motion", "Oscillation", "SurfaceMotion", "UnsteadyGrid", "flapping", "pitching"]

Motion = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Surface points (m) and their velocities (m/s), each of shape (n_surface, 3), from a time (s) and the points at
rest."""


@dataclass(frozen=True, eq=False)
class Oscillation:
    """A deformation whose amount is sinusoidal in time."""

    point_map: PointMap  # the deformation; its own amount does not count
    amplitude: float  # amplitude about the mean, in the unit of the amount: rad for angles
    frequency: float  # periods per second (1/s)
    mean: float = 0.0  # mean amount
    phase: float = 0.0  # phase at time 0 (rad)

    def map_at(self, time: float) -> PointMap:
        """The deformation at a time (s)."""
        return replace(self.point_map, amount=self.mean + self.amplitude * np.sin(self._angle(time)))

    def rate_at(self, time: float) -> float:
        """Change of the amount per second at a time (s)."""
        return self.amplitude * 2.0 * np.pi * self.frequency * np.cos(self._angle(time))

    def _angle(self, time: float) -> float:
        return 2.0 * np.pi * self.frequency * time + self.phase


@dataclass(frozen=True, eq=False)
class SurfaceMotion(OneLine):
    """Superposed oscillations of the surface of a mesh."""

    mesh: MovingMesh  # the control mesh whose surface moves
    oscillations: tuple[Oscillation, ...]  # applied one after the other

    def __call__(self, time: float, surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return surface points (m) and velocities (m/s), each (n_surface, 3), from surface points at rest."""
        # `InputError` if a point leaves a symmetry plane
        maps = tuple(oscillation.map_at(time) for oscillation in self.oscillations)
        deformation, points, velocities = Deformation(self.mesh, maps), surface, np.zeros_like(surface)
        for point_map, oscillation in zip(maps, self.oscillations):
            velocities = jvp(point_map, points, velocities) + oscillation.rate_at(time) * amount_jvp(point_map, points)
            points = point_map.apply(points)
        return deformation.apply(surface), deformation.slide(velocities)


def pitching(
    mesh: MovingMesh, amplitude: float, frequency: float, at: float = 0.25, mean: float = 0.0
) -> SurfaceMotion:
    """Oscillate the surface in pitch about an axis along its span.

    Parameters
    ----------
    mesh : MovingMesh
        The control mesh whose surface moves.
    amplitude, mean : float
        Angles (rad), upstream end up positive.
    frequency : float
        Periods per second (1/s).
    at : float
        Position of the axis between the upstream (0) and downstream end (1) of the surface's box.

    Returns
    -------
    SurfaceMotion
        The angle is ``mean + amplitude sin(2 pi frequency time)``.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import pitching
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> motion = pitching(mesh, amplitude=5.0, frequency=1.0)
    >>> motion
    SurfaceMotion(mesh=MovingMesh, oscillations=1 x Oscillation)
    """
    return SurfaceMotion(mesh, (Oscillation(Pitch(mesh_frame(mesh), mean, at), amplitude, frequency, mean),))


def flapping(mesh: MovingMesh, amplitude: float, frequency: float, mean: float = 0.0) -> SurfaceMotion:
    """Bend the surface up and down along circular arcs that start level at the root.

    Parameters
    ----------
    mesh : MovingMesh
        The control mesh whose surface moves.
    amplitude, mean : float
        Angles of the tip (rad), upwards positive.
    frequency : float
        Periods per second (1/s).

    Returns
    -------
    SurfaceMotion
        The angle of the tip is ``mean + amplitude sin(2 pi frequency time)``.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import flapping
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> motion = flapping(mesh, amplitude=5.0, frequency=1.0)
    >>> motion
    SurfaceMotion(mesh=MovingMesh, oscillations=1 x Oscillation)
    """
    bend = Bend(mesh_frame(mesh), mean, at=0.0, length=1.0)
    return SurfaceMotion(mesh, (Oscillation(bend, amplitude, frequency, mean),))


@dataclass(frozen=True, eq=False)
class GridState(OneLine):
    """A moving grid at one time."""

    time: float  # time (s)
    # the grid (m) and its velocities (m/s)
    nodes: np.ndarray  # (n_nodes, 3)
    velocities: np.ndarray  # (n_nodes, 3)
    # the control mesh (m) and its velocities (m/s)
    control_points: np.ndarray  # (n_control_points, 3)
    control_velocities: np.ndarray  # (n_control_points, 3)
    report: MovementReport  # report of the mover


@dataclass(frozen=True, eq=False)
class UnsteadyGrid(OneLine):
    """The grid of a model whose surface moves in time.

    Every state is moved from the baseline, so it depends only on its time: a periodic motion has a periodic grid, and
    states may be computed in any order.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    mover : Mover
        The mover of its control mesh. Set its number of increments if the motion needs more than one at some times: a
        mover that chooses the number takes more only at these times, and the grid jumps in between.
    motion : Motion
        Motion of the surface: a `SurfaceMotion` or any function of time and of the surface points at rest.

    Raises
    ------
    InputError
        If the mover is of another mesh.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.movers import FixedInterior, moving_mesh
    >>> model = fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5))
    >>> mesh = moving_mesh(model)
    >>> unsteady = UnsteadyGrid(model, FixedInterior(mesh), pitching(mesh, amplitude=0.1, frequency=2.0))
    >>> bool(np.abs(unsteady.at(0.125).velocities).max() < 1e-12)  # where the angle is largest, nothing moves
    True
    """

    model: FittedModel
    mover: Mover
    motion: Motion

    def __post_init__(self) -> None:
        if self.mover.mesh.n_points != len(self.model.control_points):
            raise InputError(
                f"unsteady grid: the mover's mesh has {self.mover.mesh.n_points} points and the model "
                f"{len(self.model.control_points)} control points; make the mesh of this model"
            )

    def at(self, time: float) -> GridState:
        """Grid and velocities at a time (s).

        Raises
        ------
        InputError
            If the motion does not give points and velocities of the surface.
        MovementError
            If the mover cannot follow.
        """
        initial = self.model.control_points
        rest = initial[self.mover.mesh.surface_ids]
        surface, d_surface = self.motion(time, rest)
        if not np.shape(surface) == np.shape(d_surface) == rest.shape:
            raise InputError(
                f"unsteady grid: the motion gives points of shape {np.shape(surface)} and velocities of shape "
                f"{np.shape(d_surface)}; give both of shape {rest.shape}"
            )
        movement = self._differentiable_mover.move(initial, surface, **self._shared)
        control_velocities = movement.jvp(np.zeros_like(initial), d_surface)
        state = self._map.at(movement.points)
        velocities = state.jvp(control_velocities)
        return GridState(time, state.nodes, velocities, movement.points, control_velocities, movement.report)

    @cached_property
    def _map(self) -> ControlPointMap:
        """Map to the grid, with the sliding patches of the mover's mesh."""
        return self.model.map_sliding(self.mover.mesh.slides, self.model)

    @cached_property
    def _differentiable_mover(self) -> Mover:
        return differentiable(self.mover)

    @cached_property
    def _shared(self) -> dict:
        """Options common to the moves at all times: the baseline's factor if the mover has one."""
        start = getattr(self._differentiable_mover, "start", None)
        return {} if start is None else {"start": start(self.model.control_points)}
