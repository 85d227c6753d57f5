"""One increment of Eq. (8), K(b^(i-1)) (b^(i) - b^(i-1)) = f, for any elements with a linear force.

With u the displacement of an increment, known on the surface and unknown at the free points, and F(u) = K u the force
of the elements, the free components of F(u) vanish. Differentiated,

    K du_free = - (change of F with the points, at fixed u) - K du_known,

and the transpose takes one solution with the same factor and the transposed derivative of F.

Elements that are a million times as long as they are high, as in boundary layers and wakes, make K so stiff against a
change of their height, and so soft against rotations, that rounding of K and of u leaves few digits or none. Where the
factor tells of that, solutions are refined: u is a sum of two parts, the second of which holds what rounding leaves of
the first [Wilkinson, Rounding Errors in Algebraic Processes (1963)], and F(u) comes from the elements, whose strains
are differences of neighbours, and not from a matrix.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from ..errors import MovementError
from ..mesh.moving_mesh import MovingMesh
from ..sparse.blocks import BlockMatrix
from .assembly import Unknowns
from .increments import IncrementalMover
from .mover import SolveReport, digits_of

__all__ = ["Balance", "Elements", "Equilibrium", "EquilibriumMover", "EquilibriumStep"]


EPSILON = float(np.finfo(float).eps)


class Elements(Protocol):
    """Elements at given points: their force is linear in the displacement, their stiffness is symmetric."""

    def add_stiffness(self, element_rows: np.ndarray, slots: np.ndarray, data: np.ndarray) -> None:
        """Add the stiffness to blocks, see `bspline_mdao.movement.element_stiffness.add_stiffness`."""

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Force on all points of a displacement, both sums of as many parts, shape (n_parts, n_points, 3)."""

    def force_jvp(self, displacement: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the force of a given displacement with the initial points and the points; sums as `force`."""

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of both: by the initial points, the points and the displacement, shape (n_points, 3) each."""


REFINE_ABOVE = 1e-11
"""Relative error, as the factor estimates it, above which a move is refined."""

REFINE_PRODUCTS_ABOVE = 1e-13
"""The same for products with derivatives, which are to agree with each other better than they need to be exact."""

TOLERANCE = 1e-14
"""Relative error to refine to."""

MAX_CORRECTIONS = 30
"""Corrections after which to stop."""

LEAST_GAIN = 0.5
"""A correction that is not smaller than the last one by this factor is rounding, and the end."""


@dataclass(frozen=True, eq=False)
class Balance:
    """A displacement that balances a load on the free points.

    Parameters
    ----------
    parts : ndarray, shape (n_parts, n_points, 3)
        The displacement (m) as a sum of parts: one, or two where it was refined.
    n_steps : int
        Iterations of the solver, or corrections.
    residual : float
        Relative residual of the system that was solved first.
    error : float
        Estimate of its error relative to the largest displacement.
    """

    parts: np.ndarray
    n_steps: int
    residual: float
    error: float


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

    def balance(
        self, elements: Elements, factored: Factored, known: np.ndarray, load: np.ndarray, above: float
    ) -> Balance:
        """Find the displacement u that is known on the surface and has ``F(u) = load`` at the free points.

        Parameters
        ----------
        elements : Elements
            Their forces are F.
        factored : Factored
            Their matrix.
        known : ndarray, shape (n_points, 3)
            Displacement of the surface (m), 0 elsewhere.
        load : ndarray, shape (n_parts, n_points, 3)
            Load on the points, as a sum of parts.
        above : float
            Estimate of the relative error above which the displacement is refined.
        """
        gather, scatter = self.unknowns.gather, self.unknowns.scatter
        solution = factored.solve(gather(_less(load, elements.force(known[None]))))
        parts, error = (known + scatter(solution.x))[None], EPSILON * factored.factor.cancellation
        size, last, n_steps = np.abs(solution.x).max(initial=0.0), 1.0, solution.iterations
        if size == 0.0 or not np.isfinite(size):
            return Balance(parts, n_steps, solution.residual, 0.0)
        if error <= above:
            return Balance(parts, n_steps, solution.residual, error)
        parts = _in_two(parts)
        for _ in range(MAX_CORRECTIONS):
            solved = factored.solve(gather(_less(load, elements.force(parts))))
            correction = scatter(solved.x)
            change = np.abs(correction).max() / size
            if not change < LEAST_GAIN * last:
                error = change
                break
            parts, n_steps = _corrected(parts, correction), n_steps + max(solved.iterations, 1)
            error, last = change * change / last, change
            if error <= TOLERANCE:
                break
        return Balance(parts, n_steps, solution.residual, error)

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
        balance = self.balance(elements, factored, known, np.zeros((1, 1, 1)), REFINE_ABOVE)
        if not np.isfinite(balance.parts).all():
            raise MovementError("movement: the displacements are not finite; take a smaller step or more increments")
        points = before + balance.parts[0]
        points[self.mesh.surface_ids] = surface
        seconds = time.perf_counter() - start
        report = SolveReport(self.solver.name, balance.n_steps, balance.residual, seconds, digits_of(balance.error))
        kept = factored if is_first or self.keep_factors else None
        return EquilibriumStep(self, elements, balance.parts, points, report, kept)

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
        d_force = self.elements.force_jvp(_in_two(self.displacement), d_initial, d_before)
        d_points = d_before + self._balance(d_known, -d_force)[0]
        d_points[surface_ids] = d_surface
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives by the initial points, the points before, and the surface points."""
        surface_ids = self.equilibrium.mesh.surface_ids
        initial_bar, before_bar, known_bar = self.elements.force_vjp(
            self.displacement, self._balance(np.zeros_like(bar), -bar[None])
        )
        surface_bar = bar[surface_ids] + known_bar[surface_ids]
        before_bar += bar
        before_bar[surface_ids] -= surface_bar
        return initial_bar, before_bar, surface_bar

    def _balance(self, known, load):
        """Parts of the displacement that is known on the surface and balances a load on the free points."""
        factored = self.factored or self.equilibrium.factorized(self.elements)
        return self.equilibrium.balance(self.elements, factored, known, load, REFINE_PRODUCTS_ABOVE).parts


def _in_two(parts: np.ndarray) -> np.ndarray:
    """The same sum of parts, as one of two."""
    return parts if len(parts) == 2 else np.stack([parts[0], np.zeros_like(parts[0])])


def _corrected(parts: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """Add a correction to a sum of two parts: two again, the second below the last digit of the first."""
    first, lost = _sum(parts[0], correction)
    return np.stack(_sum(first, lost + parts[1]))


def _less(load: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Difference of two sums of parts, exact until it is rounded once, shape (n_points, 3)."""
    first, lost = _sum(load[0], -force[0])
    return first + (lost + (load[1:].sum(axis=0) - force[1:].sum(axis=0)))


def _sum(a, b):
    """Sum, and exactly what its rounding leaves [Knuth, The Art of Computer Programming 2, 4.2.2]."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


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
