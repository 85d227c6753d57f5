"""One increment of Eq. (8), K(b^(i-1)) (b^(i) - b^(i-1)) = f, for any elements with a linear force.

With u the displacement of an increment, known on the surface and unknown at the free points, and F(u) = K u the force
of the elements, the free components of F(u) vanish. Differentiated,

    K du_free = - (change of F with the points, at fixed u) - K du_known,

and the transpose takes one solution with the same factor and the transposed derivative of F.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from ..errors import MovementError
from ..sparse.blocks import BlockMatrix
from .assembly import Unknowns
from .increments import IncrementalMover
from .mesh import MovingMesh
from .mover import SolveReport

__all__ = ["Elements", "Equilibrium", "EquilibriumMover", "EquilibriumStep"]


class Elements(Protocol):
    """Elements at given points: their force is linear in the displacement, their stiffness is symmetric."""

    def add_stiffness(self, element_rows: np.ndarray, slots: np.ndarray, data: np.ndarray) -> None:
        """Add the stiffness to blocks, see `bspline_mdao.movement.element_stiffness.add_stiffness`."""

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Force on all points, shape (n_points, 3)."""

    def force_jvp(
        self, displacement: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray, d_displacement: np.ndarray
    ) -> np.ndarray:
        """Change of the force with the initial points of the move, the points and the displacement."""

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `force_jvp`: by the initial points, the points, and the displacement."""


@dataclass(frozen=True, eq=False)
class Factored:
    """A matrix with its factor, and how long that took."""

    matrix: BlockMatrix
    factor: object

    def solve(self, right):
        """Solution for a right-hand side, shape (n_rows, 3)."""
        return self.factor.solve(right, self.matrix)


@dataclass(eq=False)
class LastBaseline:
    """The last points that a move has started from, and their factor."""

    points: np.ndarray | None = None
    factored: Factored | None = None


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Makes increments, and keeps the factor of the points that a move starts from.

    That matrix depends on the initial points alone, so that moves of different surfaces share it.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    solver : object
        Settings of a sparse solver.
    keep_factors : bool or None
        Whether the other increments keep their factors for derivatives, or factorise again in each product; None is no.
    """

    mesh: MovingMesh
    solver: object
    keep_factors: bool | None = None
    baseline: LastBaseline = field(default_factory=LastBaseline)

    @cached_property
    def unknowns(self) -> Unknowns:
        """Numbering of the unknowns."""
        return Unknowns(self.mesh)

    @cached_property
    def _analysis(self):
        return self.solver.analyze(self.unknowns.pattern, self.mesh.points[self.unknowns.point_ids])

    def factorized(self, elements: Elements) -> Factored:
        """Assemble and factorise the stiffness of elements."""
        matrix = self.unknowns.matrix(elements.add_stiffness)
        return Factored(matrix, self._analysis.factorize(matrix))

    def step(self, elements: Elements, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> EquilibriumStep:
        """Make one increment.

        Parameters
        ----------
        elements : Elements
            The elements at ``before``.
        initial, before : ndarray, shape (n_points, 3)
            Points before the move and before the increment (m).
        surface : ndarray, shape (n_surface, 3)
            Surface points after it (m).

        Raises
        ------
        MovementError
            If the stiffness is not positive definite or the solution not finite.
        """
        start, is_first = time.perf_counter(), np.array_equal(before, initial)
        factored = self._of_baseline(elements, initial) if is_first else self.factorized(elements)
        known = np.zeros_like(before)
        known[self.mesh.surface_ids] = surface - before[self.mesh.surface_ids]
        solution = factored.solve(self.unknowns.gather(-elements.force(known)))
        displacement = known + self.unknowns.scatter(solution.x)
        if not np.isfinite(displacement).all():
            raise MovementError("movement: the displacements are not finite; take a smaller step or more increments")
        points = before + displacement
        points[self.mesh.surface_ids] = surface
        seconds = time.perf_counter() - start
        report = SolveReport(self.solver.name, solution.iterations, solution.residual, seconds)
        kept = factored if is_first or self.keep_factors else None
        return EquilibriumStep(self, elements, displacement, points, report, kept)

    def _of_baseline(self, elements, initial):
        """Factor of the initial points, made when they are new."""
        if self.baseline.points is None or not np.array_equal(self.baseline.points, initial):
            self.baseline.points = self.baseline.factored = None  # its memory serves the next one
            self.baseline.factored = self.factorized(elements)
            self.baseline.points = initial.copy()
        return self.baseline.factored


@dataclass(frozen=True, eq=False)
class EquilibriumStep:
    """An increment that was made, see `bspline_mdao.movement.mover.Step`."""

    equilibrium: Equilibrium
    elements: Elements
    displacement: np.ndarray
    points: np.ndarray
    report: SolveReport
    factored: Factored | None

    def jvp(self, d_initial: np.ndarray, d_before: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points after the increment, shape (n_points, 3)."""
        surface_ids = self.equilibrium.mesh.surface_ids
        d_known = np.zeros_like(d_before)
        d_known[surface_ids] = d_surface - d_before[surface_ids]
        d_force = self.elements.force_jvp(self.displacement, d_initial, d_before, d_known)
        d_points = d_before + d_known - self._inverse(d_force)
        d_points[surface_ids] = d_surface
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives by the initial points, the points before, and the surface points."""
        surface_ids = self.equilibrium.mesh.surface_ids
        initial_bar, before_bar, known_bar = self.elements.force_vjp(self.displacement, -self._inverse(bar))
        surface_bar = bar[surface_ids] + known_bar[surface_ids]
        before_bar += bar
        before_bar[surface_ids] -= surface_bar
        return initial_bar, before_bar, surface_bar

    def _inverse(self, force):
        """Displacement of the free points under a force; symmetric."""
        factored = self.factored or self.equilibrium.factorized(self.elements)
        return self.equilibrium.unknowns.scatter(factored.solve(self.equilibrium.unknowns.gather(force)).x)


class EquilibriumMover(IncrementalMover):
    """What the movers of elements share: an increment is an equilibrium.

    A leaf has the fields ``mesh``, ``n_increments``, ``solver`` and ``keep_factors``, and says what its elements are.
    """

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> Elements:
        """Elements at the points before an increment, stiffened by those before the move."""
        raise NotImplementedError

    @cached_property
    def _equilibrium(self) -> Equilibrium:
        return Equilibrium(self.mesh, self.solver, self.keep_factors)

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> EquilibriumStep:
        return self._equilibrium.step(self._elements(initial, before), initial, before, surface)
