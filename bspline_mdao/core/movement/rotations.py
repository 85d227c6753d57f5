"""A mover that extends the rotations of its surface, with the same factors for any angle.

A rotation is not a linear function of its angle, so displacements from a single solution stretch what should turn. Here
the rotations come first, as in the gradient-based editing of shapes:

1. the rotation of every surface point, from rest to its new place, as a vector;
2. a harmonic extension of these vectors into the volume: w, and R = exp([w]x) in every element;
3. the displacement whose gradient is nearest to R - I;
4. R from the rotation of the elements in this displacement, and step 3 again, a fixed number of times.

Steps 1 and 2 are in `bspline_mdao.core.movement.rotation_field`. The systems of 2 and 3, whose matrices depend only on
the initial points, are in `bspline_mdao.core.movement.target_gradients`. Nothing depends on earlier moves.

Y. Yu, K. Zhou, D. Xu, X. Shi, H. Bao, B. Guo and H.-Y. Shum, "Mesh editing with Poisson-based gradient field
manipulation", ACM Transactions on Graphics 23(3), 2004, pp. 644-651.

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np

from ...base.checks import as_array
from ...base.display import OneLine
from ...base.numerics.rotation_group import turns, turns_jvp, turns_vjp
from ...base.numerics.stopwatch import working_seconds
from ...base.sparse.cholesky import Cholesky
from ...base.sparse.scalar import ScalarCholesky
from ...base.sparse.solved_together import Task, solved
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh
from ..mesh.sliding_points import SlidPoints
from ..walls.rotations import LocalRotations
from .elasticity import lame_constants
from .element_rotations import ElementRotations
from .equilibrium import Equilibrium, Unknowns
from .mover import IncrementReport, MovementReport, SolveReport, check_reach, check_request, digits_of, met_alike
from .rotation_field import RotationUnknowns, SurfaceVectors, surface_rotations
from .target_gradients import TargetGradientField, TargetGradientSystem
from .trilinear import add_at_corners
from .young_modulus import InverseVolumeLaw

__all__ = ["RotatedMovement", "RotatedStart", "Rotations"]

OF_DISPLACEMENTS = InverseVolumeLaw(shape=0.25)
"""Modulus of the system of displacements: elements that are small or initially have flat corners keep their shape."""

OF_ROTATIONS = InverseVolumeLaw(power=0.1)
"""Modulus of the extension of rotations. A larger one makes everything near the surface turn with it, and the far field
beyond abruptly; with none, the region around the edges of tips turns too little."""

HARMONIC = (1.0, 0.0, 0.0)
"""Law of the extension, see `bspline_mdao.core.movement.target_gradients`."""

MIXED = (1.0, *lame_constants(-0.2))
"""Law of the displacements: deviation of the gradient from the rotation, and strain of the element."""


@dataclass(frozen=True, eq=False)
class Rotations(OneLine):
    """Moves a mesh by extending the rotations of its surface, with the same two factors for all surfaces.

    There are no increments: a move of any angle takes ``2 + n_repetitions`` solutions, and depends only on the initial
    points and the surface. A rigid motion of all points that are not free is followed exactly. Angles may exceed half a
    turn along the surface, up to a full turn.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    n_repetitions : int
        How often the rotations are recomputed from the displacement, at the cost of one solution each.
    solver : object
        Settings of a sparse solver of `bspline_mdao.base.sparse`; `Cholesky` by default.

    Raises
    ------
    InputError
        If the number of repetitions is not a non-negative integer.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import Rotations, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> movement = Rotations(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> movement.points.shape, movement.report.n_increments
    ((78, 3), 1)
    """

    mesh: MovingMesh
    n_repetitions: int = 1
    solver: Any = field(default_factory=Cholesky)

    def __post_init__(self) -> None:
        n = self.n_repetitions
        if not isinstance(n, Integral) or isinstance(n, bool) or n < 0:
            raise InputError(f"rotations: {n} repetitions; give a whole number from 0")

    @cached_property
    def _displacements(self) -> Equilibrium:
        return Equilibrium.of(self.mesh, self.solver)

    @cached_property
    def _rotations(self) -> Equilibrium:
        return Equilibrium(self.mesh, RotationUnknowns(Unknowns(self.mesh)), ScalarCholesky())

    @cached_property
    def _surface(self) -> LocalRotations:
        return surface_rotations(self.mesh)

    def start(self, initial: np.ndarray) -> RotatedStart:
        """Factorise both systems at points (n_points, 3), in metres, for several moves that start from them."""
        initial = np.array(initial, dtype=float)
        return RotatedStart(
            initial,
            TargetGradientSystem.of(self._rotations, OF_ROTATIONS, HARMONIC, initial),
            TargetGradientSystem.of(self._displacements, OF_DISPLACEMENTS, MIXED, initial),
        )

    def move(self, initial: np.ndarray, surface: np.ndarray, start: RotatedStart | None = None) -> RotatedMovement:
        """Move points (n_points, 3) with surface points (n_surface, 3), both in metres.

        With the ``start`` of an earlier movement, or from `start`, moves from the same initial points share their
        factors. A start from other points is not used.

        Raises
        ------
        InputError
            If a shape is wrong.
        MovementError
            If a coordinate is not finite, a surface point leaves its symmetry plane, the surface is turned inside out,
            a system cannot be solved, or a point is moved much farther than the surface.
        """
        return solved(self.move_task(initial, surface, start))

    def move_task(
        self, initial: np.ndarray, surface: np.ndarray, start: RotatedStart | None = None
    ) -> Task[RotatedMovement]:
        """Task of `move`, see `bspline_mdao.core.movement.moved_together`."""
        began, mesh = working_seconds(), self.mesh
        initial = np.array(as_array(initial, "movement: points"), dtype=float)
        surface = np.array(as_array(surface, "movement: surface points"), dtype=float)
        check_request(mesh, initial, surface)
        if start is None or not np.array_equal(start.points, initial):
            start = self.start(initial)
        at_rest = initial[mesh.surface_ids]
        surface = met_alike(mesh, at_rest, surface)
        vectors = SurfaceVectors.of(self._surface, at_rest, surface, mesh.surface_ties)  # step 1
        extension = yield from start.rotations.field_task(vectors.values)  # step 2
        of_elements = extension.values[mesh.elements].mean(axis=1)
        displacement = surface - at_rest
        displacements = [(yield from start.displacements.field_task(displacement, turns(of_elements)))]  # step 3
        repetitions = []
        for _ in range(self.n_repetitions):  # step 4
            repetitions.append(ElementRotations.of(displacements[-1].elements, displacements[-1].balance.parts))
            displacements.append((yield from start.displacements.field_task(displacement, repetitions[-1].turns)))
        points = initial + displacements[-1].balance.parts[0]
        points[mesh.surface_ids] = surface
        check_reach(mesh, initial, surface, points)
        slid = mesh.slid(initial, points)
        points = points if slid is None else slid.points
        report = self._report([extension, *displacements], points, began)
        return RotatedMovement(
            vectors, extension, of_elements, tuple(displacements), tuple(repetitions), points, report, start, slid
        )

    def _report(self, fields: Sequence[TargetGradientField], points: np.ndarray, began: float) -> MovementReport:
        """Report of a move that began at a time."""
        balances, seconds = [field.balance for field in fields], working_seconds() - began
        solve = SolveReport(
            self.solver.name,
            sum(balance.n_steps for balance in balances),
            max(balance.residual for balance in balances),
            seconds,
            digits_of(max(balance.error for balance in balances)),
        )
        increment = IncrementReport(solve=solve, **vars(self.mesh.tangled(points)))
        took = working_seconds() - began
        return MovementReport((increment,), took, n_invalid=self.mesh.n_invalid)


@dataclass(frozen=True, eq=False)
class RotatedStart(OneLine):
    """Points that moves start from, and both systems there, see `Rotations.start`."""

    points: np.ndarray
    rotations: TargetGradientSystem
    displacements: TargetGradientSystem


@dataclass(frozen=True, eq=False)
class RotatedMovement(OneLine):
    """A move of `Rotations`, with its exact derivative."""

    vectors: SurfaceVectors  # rotations of the surface points
    extension: TargetGradientField  # rotation vectors of all points
    of_elements: np.ndarray  # (n_elements, 3), their means over the corners of every element
    # displacement of all points (m), the first and one for every repetition
    displacements: tuple[TargetGradientField, ...]
    repetitions: tuple[ElementRotations, ...]  # rotations of the elements in each except the last
    points: np.ndarray  # (n_points, 3), moved points (m)
    report: MovementReport  # report on the move
    start: RotatedStart  # data that moves from the same initial points share
    slid: SlidPoints | None  # positions of points after sliding; None if none slide

    @property
    def surface_ids(self) -> np.ndarray:
        """Points on the surface, shape (n_surface,)."""
        return self._mesh.surface_ids

    @property
    def _mesh(self) -> MovingMesh:
        return self.extension.elements.mesh

    def jvp(
        self,
        d_initial: np.ndarray,  # (n_points, 3), change of the initial points
        d_surface: np.ndarray,  # (n_surface, 3), change of the surface points after the move
    ) -> np.ndarray:
        """Change of the points, shape (n_points, 3)."""
        return solved(self.jvp_task(d_initial, d_surface))

    def vjp(
        self,
        bar: np.ndarray,  # (n_points, 3), derivative of a scalar with respect to the points
    ) -> tuple[np.ndarray, np.ndarray]:  # initial_bar: (n_points, 3); surface_bar: (n_surface, 3)
        """Transpose of `jvp`."""
        return solved(self.vjp_task(bar))

    def jvp_task(self, d_initial: np.ndarray, d_surface: np.ndarray) -> Task[np.ndarray]:
        """Task of `jvp`."""
        d_at_rest = d_initial[self.surface_ids]
        d_surface = d_at_rest + self._mesh.alike(d_surface - d_at_rest)
        d_vectors = self.vectors.jvp(d_at_rest, d_surface)
        d_extension = yield from self.extension.jvp_task(d_initial, d_vectors, None)
        d_target = turns_jvp(self.of_elements, d_extension.sum(axis=0)[self._mesh.elements].mean(axis=1))
        d_relative = d_surface - d_at_rest
        d_displacement = yield from self.displacements[0].jvp_task(d_initial, d_relative, d_target)
        for rotations, displacement in zip(self.repetitions, self.displacements[1:]):
            d_target = rotations.jvp(d_initial, d_displacement)
            d_displacement = yield from displacement.jvp_task(d_initial, d_relative, d_target)
        d_points = d_initial + d_displacement.sum(axis=0)
        d_points[self.surface_ids] = d_surface
        return d_points if self.slid is None else self.slid.jvp(d_initial, d_points)

    def vjp_task(self, bar: np.ndarray) -> Task[tuple[np.ndarray, np.ndarray]]:
        """Task of `vjp`."""
        by_slides, bar = (0.0, bar) if self.slid is None else self.slid.vjp(bar)
        mesh, initial_bar, surface_bar = self._mesh, bar.copy(), np.zeros((len(self.surface_ids), 3))
        parts_bar = bar[None]
        for rotations, displacement in zip(self.repetitions[::-1], self.displacements[:0:-1]):
            by_points, by_surface, target_bar = yield from displacement.vjp_task(parts_bar)
            by_gradient, parts_bar = rotations.vjp(target_bar)
            initial_bar += by_points + by_gradient
            surface_bar += by_surface
        by_points, by_surface, target_bar = yield from self.displacements[0].vjp_task(parts_bar)
        surface_bar += by_surface
        of_elements_bar = 0.125 * turns_vjp(self.of_elements, target_bar)
        at_corners = np.repeat(of_elements_bar[:, None], 8, axis=1)
        extension_bar = add_at_corners(mesh.elements, at_corners, mesh.n_points)
        by_extension, vectors_bar, _ = yield from self.extension.vjp_task(extension_bar[None])
        at_rest_bar, by_vectors = self.vectors.vjp(vectors_bar)
        initial_bar += by_points + by_extension
        initial_bar[self.surface_ids] += at_rest_bar - surface_bar
        surface_bar = surface_bar + by_vectors
        alike_bar = mesh.alike(surface_bar)
        initial_bar[self.surface_ids] += surface_bar - alike_bar
        return initial_bar + by_slides, alike_bar
