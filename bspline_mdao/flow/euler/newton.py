"""Newton-GMRES: steady states of a discretisation.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.numerics.processes import largest
from .factor_pattern import FactorPattern
from .krylov import solve_roughly
from .linearization import Linearization
from .newton_step import UNKNOWN, Course, NewtonStep
from .preconditioner import Factor, add_blocks, by_surface, compact_factor, time_terms
from .residual import Discretization
from .settings import NEWTON, NewtonSettings
from .stagnation import course_of, lowest_before, since_stagnation, stagnation_cfl

__all__ = [
    "Field",
    "FlowSolution",
    "advance",
    "relative_residual",
    "solve_flow",
]


@dataclass(frozen=True, eq=False)
class FlowSolution:
    """States of all cells, with the history of the residual."""

    states: np.ndarray  # (n_cells, 5)
    stream: np.ndarray  # (5,), the free stream
    history: tuple[NewtonStep, ...]  # the first is the initial state
    tolerance: float  # requested residual

    @property
    def residual(self) -> float:
        """Norm of the last residual, relative to the uniform stream's."""
        return self.history[-1].residual

    @property
    def is_converged(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.residual <= self.tolerance


def solve_flow(
    discretization: Discretization,
    areas: np.ndarray,
    stream: np.ndarray,
    *,
    pattern: FactorPattern,
    states: np.ndarray | None = None,
    tolerance: float = 1e-10,
    max_steps: int = 100,
    is_long: bool = False,
    settings: NewtonSettings = NEWTON,
    progress: Callable[[NewtonStep, np.ndarray], None] | None = None,
) -> FlowSolution:
    """Solve for the steady flow by Newton steps with pseudo-time terms that fade out as the residual falls.

    With the volumes divided by the time steps T, until the residual R is small enough:

    1. Linearise, and add time terms to the diagonal: ``A = T / CFL + dR/dW``.
    2. Factor a compact approximation of A for the preconditioner; below a moderate residual, keep the last step's
    factor. 3. Solve ``A dW = -R`` inexactly [1] [4] by GMRES. 4. Take as much of the step as keeps densities, pressures
    and the residual within bounds. 5. Let the CFL number grow as the residual falls, switched evolution relaxation [2]
    [3], or cut it if the linear solve
       failed, the step was shortened much or the residual rose; see `.stagnation` for runs that stagnate.

    It starts from ``states``, by default the uniform stream, and stops at the tolerance, the norm of the residual
    relative to the uniform stream's. With ``is_long`` flat cells have long time steps, see `time_terms`: more robust
    with shocks in layers of flat cells at walls. ``progress`` is called with every step and its states, on all
    processes.

    Returns
    -------
    FlowSolution
        Converged or not: see ``is_converged``.

    References
    ----------
    - [1] R. S. Dembo, S. C. Eisenstat, T. Steihaug, "Inexact Newton methods", SIAM J. Numer. Anal. 19 (1982), 400-408.
    - [2] W. A. Mulder, B. van Leer, "Experiments with implicit upwind methods for the Euler equations", J. Comput.
      Phys. 59 (1985), 232-246.
    - [3] C. T. Kelley, D. E. Keyes, "Convergence analysis of pseudo-transient continuation", SIAM J. Numer. Anal. 35
      (1998), 508-523.
    - [4] S. C. Eisenstat, H. F. Walker, "Choosing the forcing terms in an inexact Newton method", SIAM J. Sci. Comput.
      17 (1996), 16-32.
    """
    field = Field(discretization, areas, stream)
    scale = field.scale(tolerance)
    states = discretization.uniform(stream) if states is None else states
    residual = field.residual(states)
    norm = field.norm(residual)
    if not np.isfinite(norm):  # a start with shocks from coarser members can be too harsh for the extrapolation here
        states = discretization.uniform(stream)
        residual = field.residual(states)
        norm = field.norm(residual)
    cfl = (settings.first_long_cfl if is_long else settings.first_cfl) * max(1.0, scale / norm) if norm else np.inf
    history = [NewtonStep(norm / scale, cfl, 0, 1.0)]
    system: _StepSystem | None = None
    last: np.ndarray | None = None
    while history[-1].residual > tolerance and len(history) <= max_steps and cfl > settings.smallest_cfl:
        is_stalled = _is_stalled(since_stagnation(history), settings.stalled)
        if is_stalled or _is_rounded(settings, history) or _is_spent(settings, history):
            break
        part = _forcing(settings, history, tolerance)
        factor = system.factor if system and _is_factor_kept(settings, history) else None
        system = None  # free memory for the next
        system = _StepSystem.of(field, pattern, states, cfl, is_long, factor)  # steps 1 and 2
        is_rough = history[-1].residual > settings.rough_until
        update, n_products = system.solve(settings, residual, part, is_rough)  # step 3
        course = system.course(update, last, residual)
        if history[-1].stagnates_from and course.is_backward:
            update = None  # it would lead back to where the run came from, and the next one here again
        states, residual, length = advance(settings, field, states, residual, update)  # step 4
        before, norm = norm, field.norm(residual)
        last = last if update is None else update
        history.append(NewtonStep(norm / scale, cfl, n_products, length, course))
        history[-1] = replace(history[-1], stagnates_from=lowest_before(settings, history))
        if progress:
            progress(history[-1], states)
        cfl = _next_cfl(settings, history, before, norm, is_long)  # step 5
    return FlowSolution(states, stream, tuple(history), tolerance)


def relative_residual(
    discretization: Discretization, states: np.ndarray, areas: np.ndarray, stream: np.ndarray, tolerance: float = 1e-10
) -> float:
    """Norm of the residual of states relative to the uniform stream's; arguments as in `solve_flow`."""
    field = Field(discretization, areas, stream)
    return field.norm(field.residual(states)) / field.scale(tolerance)


@dataclass(frozen=True, eq=False)
class Field:
    """The equations: a discretisation with its area vectors and stream, its residual per surface of the cells."""

    discretization: Discretization
    areas: np.ndarray
    stream: np.ndarray

    @cached_property
    def sizes(self) -> np.ndarray:
        """Surfaces of the cells (m^2), shape (n_cells, 1)."""
        return self.discretization.sizes(self.areas)

    def residual(self, states: np.ndarray) -> np.ndarray:
        """Outflow of every cell divided by its surface, shape (n_cells, 5)."""
        return self.discretization.residual(states, self.areas, self.stream) / self.sizes

    def norm(self, residual: np.ndarray) -> float:
        """Euclidean norm of an array of all cells."""
        return self.discretization.norm(residual)

    def scale(self, tolerance: float) -> float:
        """Norm of the residual of the uniform stream, at least the rounding of the fluxes divided by the tolerance."""
        uniform = self.discretization.uniform(self.stream)
        rounding = float(np.finfo(float).eps) * self.norm(np.ones_like(uniform[:, :1]))
        return max(self.norm(self.residual(uniform)), rounding / tolerance)


def _is_rounded(settings: NewtonSettings, history: list[NewtonStep]) -> bool:
    """Whether the residual is so small that the last steps could not halve it."""
    residuals = [step.residual for step in history[-3:]]
    return len(residuals) == 3 and residuals[0] < settings.rounded and min(residuals[1:]) > 0.5 * residuals[0]


def _is_stalled(history: list[NewtonStep], n: int, part: float = 0.5) -> bool:
    """Whether the last n steps have not reduced the lowest residual below a given fraction of it."""
    before, lately = ([step.residual for step in part] for part in (history[:-n], history[-n:]))
    return bool(before) and min(lately) > part * min(before)


def _is_spent(settings: NewtonSettings, history: list[NewtonStep]) -> bool:
    """Whether a run has used its products, and its last step, late in the run, left more than a fifth."""
    is_near = len(history) > 1 and history[-1].residual < 0.2 * min(settings.rough_until, history[-2].residual)
    return sum(step.n_products for step in history) >= settings.most_products and not is_near


def _is_factor_kept(settings: NewtonSettings, history: list[NewtonStep]) -> bool:
    """Whether the factor of the last step, which was taken in full, is kept for the next one, with another Jacobian."""
    if len(history) < 2 or history[-1].residual > settings.factor_kept_from or history[-1].length < 1.0:
        return False
    return history[-1].residual < settings.factor_kept_fall * history[-2].residual


@dataclass(frozen=True, eq=False)
class _StepSystem:
    """Linear system of a Newton step, with its preconditioner."""

    field: Field
    linearization: Linearization
    diagonal: np.ndarray
    factor: Factor

    @classmethod
    def of(
        cls, field: Field, pattern: FactorPattern, states: np.ndarray, cfl: float, is_long: bool, factor: Any = None
    ) -> _StepSystem:
        """Linearise, add time terms to the diagonal, and factor a compact approximation, unless a factor is given."""
        discretization = field.discretization
        linearization = discretization.linearize(states, field.areas, field.stream)
        diagonal = (time_terms(discretization, states, field.areas, is_long) / cfl).astype(np.float32)
        return cls(field, linearization, diagonal, factor or compact_factor(linearization, pattern, diagonal))

    def solve(
        self, settings: NewtonSettings, residual: np.ndarray, part: float, is_rough: bool
    ) -> tuple[np.ndarray | None, int]:
        """Newton update, or none if the linear solve fails, and its number of products with the Jacobian."""
        product, comm = self.linearization.jacobians.product, self.field.discretization.halo.comm
        system = by_surface(product, self.factor.solve, self.field.sizes, self.diagonal)
        most_left = settings.most_left if is_rough else np.inf
        solution = solve_roughly(*system, -residual, part, settings.largest_solve, comm, most_left)
        is_usable = largest(comm, float(not np.isfinite(solution.x).all())) == 0.0 and solution.left < 1.0
        return (solution.x if is_usable else None), solution.n_products

    def course(self, update: np.ndarray | None, last: np.ndarray | None, residual: np.ndarray) -> Course:
        """Course of an update, relative to the previous one."""
        if update is None:
            return UNKNOWN
        inverse = (1.0 / self.field.sizes.ravel()).astype(np.float32)
        scaled = add_blocks(self.diagonal, update.astype(np.float32), inverse, np.zeros(update.shape, np.float32))
        return course_of(update, last, residual, scaled, self.field.discretization.halo.comm)


def advance(
    settings: NewtonSettings, field: Field, states: np.ndarray, residual: np.ndarray, update: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Take as much of a step as keeps the states physical and the residual bounded."""
    if update is None:
        return states, residual, 0.0
    largest = settings.largest_rise * field.norm(residual)
    length = _physical_length(settings, states, update, field.discretization.halo.comm)
    while length > settings.smallest_step:
        moved = states + length * update
        after = field.residual(moved)
        if field.norm(after) < largest:
            return moved, after, length
        length *= 0.5
    return states, residual, 0.0


def _physical_length(settings: NewtonSettings, states: np.ndarray, update: np.ndarray, comm: Any) -> float:
    """Largest fraction of a step, at most 1, at which no density or pressure falls by more than allowed."""
    fall = largest(comm, np.max(-update[:, [0, 4]] / states[:, [0, 4]], initial=-np.inf))
    return min(1.0, settings.largest_fall / max(fall, np.finfo(float).tiny))


def _forcing(settings: NewtonSettings, history: list[NewtonStep], tolerance: float) -> float:
    """Tolerance of the next linear solve: the square of what the last step left, or the goal, within bounds.

    If the residual did not fall as the linear system predicted, a better solution of the next one is of no use.
    """
    if history[-1].residual > settings.rough_until:
        return settings.rough
    left = history[-1].residual / history[-2].residual if len(history) > 1 else 0.0
    return min(settings.rough, max(settings.forcing, left**2, 0.5 * tolerance / history[-1].residual))


def _next_cfl(settings: NewtonSettings, history: list[NewtonStep], before: float, after: float, is_long: bool) -> float:
    """CFL number of the next step, from the last CFL numbers, step lengths and norms of the residual."""
    cfl, length = history[-1].cfl, history[-1].length
    if history[-1].stagnates_from:
        return stagnation_cfl(settings, history, is_long)
    if length < 1.0:  # while shocks travel, shorter time steps get farther than fractions of long ones
        return cfl * min(1.0, max(0.2, 1.5 * length))
    if after > 1.5 * before:
        return 0.7 * cfl
    is_careful = any(step.length < 1.0 for step in history[-settings.careful :])
    growth = settings.cfl_growth * before / max(after, np.finfo(float).tiny)
    return cfl * min(settings.growth_after_cuts if is_careful else settings.largest_growth, max(1.0, growth))
