"""Common base of the movers of elements: an increment is an equilibrium, Eq. (8), at the points before it.

Systems and their solutions are in `.equilibrium`; movers differ in their elements.

Theory: ``docs/theory/elasticity.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np

from ...base.display import OneLine
from ...base.numerics.stopwatch import working_seconds
from ...base.sparse.solved_together import solved
from ...errors import MovementError
from .equilibrium import REFINE_ABOVE, REFINE_PRODUCTS_ABOVE, Balanced, Equilibrium, in_two
from .increments import IncrementalMovement, IncrementalMover, in_increments
from .mover import SolveReport, digits_of

__all__ = ["Elements", "EquilibriumMover", "EquilibriumStep", "Start"]


class Elements(Balanced, Protocol):
    """Elements at given points, with the derivatives of their force."""

    def force_jvp(self, displacement: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the force of a given displacement with the initial points and the points; sums as for `force`."""

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of both: for the initial points, the points and the displacement, shape (n_points, 3) each."""


class EquilibriumMover(IncrementalMover):
    """Base of the movers of elements: an increment is an equilibrium."""

    # A leaf has the fields ``mesh``, ``n_increments``, ``solver`` and ``keep_factors``, and defines its elements. It
    # keeps the elimination order, which depends on the mesh; factors belong to the movements, see `Start`.

    solver: Any
    keep_factors: bool | None

    def move(self, initial: np.ndarray, surface: np.ndarray, start: Start | None = None) -> IncrementalMovement:
        """Move points (n_points, 3) with surface points (n_surface, 3), both in metres."""
        # See `IncrementalMover.move`. With the ``start`` of an earlier movement, or from `start`, moves from the same
        # initial points share their factor. A start from other points is not used.
        initial = np.array(initial, dtype=float)
        if start is None or not np.array_equal(start.points, initial):
            start = Start(initial)
        step = partial(self._balanced_step, start)
        movement = in_increments(self.mesh, step, initial, surface, self.n_increments)
        return replace(movement, start=start)

    def start(self, initial: np.ndarray) -> Start:
        """Factorise the stiffness at points (n_points, 3), in metres, for several moves that start from them."""
        initial = np.array(initial, dtype=float)
        return Start(initial, self._equilibrium.factorized(self._elements(initial, initial)))

    def predicted_bytes(self) -> int | None:
        """Memory of the factors of a move, and of the work on them (bytes); None if the solver does not report it."""
        # These are the first increment's factor and the current one, or all increments' if factors are kept. It takes
        # the analysis of the pattern, which the moves need anyway.
        analysis = self._equilibrium.analysis
        if not hasattr(analysis, "factor_bytes"):
            return None
        n_factors = self.n_increments if self.keep_factors else min(self.n_increments, 2)
        return n_factors * analysis.factor_bytes + analysis.work_bytes

    @cached_property
    def _equilibrium(self) -> Equilibrium:
        return Equilibrium.of(self.mesh, self.solver)

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> Elements:
        """Elements at the points before an increment, stiffened by the points before the move."""
        raise NotImplementedError

    def _balanced_step(
        self, start: Start, initial: np.ndarray, before: np.ndarray, surface: np.ndarray
    ) -> EquilibriumStep:
        """Make one increment, see `bspline_mdao.core.movement.increments.in_increments`."""
        began, is_first = working_seconds(), np.array_equal(before, initial)
        equilibrium, elements = self._equilibrium, self._elements(initial, before)
        if is_first:
            factor = start.factor = start.factor or equilibrium.factorized(elements)
        else:
            factor = equilibrium.factorized(elements)
        prescribed, surface_ids = np.zeros_like(before), self.mesh.surface_ids
        prescribed[surface_ids] = surface - before[surface_ids]
        nothing = np.zeros((1, 1, 1))
        balance = solved(equilibrium.balance_task(elements, factor, prescribed, nothing, REFINE_ABOVE))
        if not np.isfinite(balance.parts).all():
            raise MovementError("movement: the displacements are not finite; take a smaller step or more increments")
        points = before + balance.parts[0]
        points[surface_ids] = surface
        seconds = working_seconds() - began
        report = SolveReport(self.solver.name, balance.n_steps, balance.residual, seconds, digits_of(balance.error))
        kept = factor if is_first or self.keep_factors else None
        return EquilibriumStep(equilibrium, elements, balance.parts, points, report, kept)


@dataclass(frozen=True, eq=False)
class EquilibriumStep:
    """A completed increment, see `bspline_mdao.core.movement.mover.Step`."""

    equilibrium: Equilibrium
    elements: Elements
    displacement: np.ndarray
    points: np.ndarray
    report: SolveReport
    factor: Any  # of the stiffness; None if it is not kept

    def jvp(self, d_initial: np.ndarray, d_before: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points after the increment, shape (n_points, 3)."""
        surface_ids = self.equilibrium.mesh.surface_ids
        d_prescribed = np.zeros_like(d_before)
        d_prescribed[surface_ids] = d_surface - d_before[surface_ids]
        d_force = self.elements.force_jvp(in_two(self.displacement), d_initial, d_before)
        d_points = d_before + self._balance(d_prescribed, -d_force)[0]
        d_points[surface_ids] = d_surface
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`: for the initial points, the points before, and the surface points."""
        surface_ids = self.equilibrium.mesh.surface_ids
        initial_bar, before_bar, prescribed_bar = self.elements.force_vjp(
            self.displacement, self._balance(np.zeros_like(bar), -bar[None])
        )
        surface_bar = bar[surface_ids] + prescribed_bar[surface_ids]
        before_bar += bar
        before_bar[surface_ids] -= surface_bar
        return initial_bar, before_bar, surface_bar

    def _balance(self, prescribed: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Parts of the displacement that is prescribed on the surface and balances a load on the free points."""
        factor = self.factor or self.equilibrium.factorized(self.elements)
        task = self.equilibrium.balance_task(self.elements, factor, prescribed, load, REFINE_PRODUCTS_ABOVE)
        return solved(task).parts


@dataclass(eq=False)
class Start(OneLine):
    """Points that moves start from, and the factor of their stiffness once it exists."""

    # The matrix of the first increment depends only on the initial points, so moves of different surfaces share it. A
    # start belongs to the movement that made it, and to those that receive it; the mover has none.

    points: np.ndarray  # (n_points, 3), initial points (m)
    factor: Any = None  # of the stiffness there, made by the first increment that needs it
