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
from .stagnation import course_of, hovering_cfl, lowest_before, since_it_hovers

__all__ = [
    "Field",
    "FlowSolution",
    "advance",
    "relative_residual",
    "solve_flow",
]


FIRST_CFL, FIRST_LONG_CFL, LARGEST_CFL, SMALLEST_CFL = 20.0, 0.5, 1e12, 1e-2
"""CFL number of the first step from the uniform stream, that with long time steps, and where growth and cuts end."""

CFL_GROWTH, LARGEST_GROWTH = 1.5, 10.0
"""Growth of the CFL number in addition to that of the inverse residual, since time terms are to fade faster than it
falls, and the most in a step."""

CAREFUL, GROWTH_AFTER_CUTS = 4, 3.0
"""Steps after a shortened one in which the CFL number grows by so much at most: late in a run each step that is
too long costs a hundred products."""

NEAR = 1e3
"""A start whose residual is smaller by more than this is near a solution and needs still less of the time terms."""

LARGEST_FALL, LARGEST_RISE, SMALLEST_STEP = 0.3, 2.0, 1e-3
"""Bounds of a step: largest relative fall of a density or pressure, largest rise of the residual, and the smallest
part of a Newton step that is worth its residual."""

STALLED, STALLED_LONG = 20, 36
"""The residual has to be halved within so many steps, or the run ends, and another way is tried; of those with long
time steps, in which a shock travels by about a cell each, at little cost."""

ROUNDED = 1e-9
"""Residual below which steps that gain nothing end the run: what is left is rounding of the fluxes."""

ROUGH, FORCING, ROUGH_UNTIL = 0.1, 1e-2, 1e-4
"""Tolerances of the linear solves before the residual has fallen by so much, and after, where Newton's steps leave less
than a tenth."""

KEPT_FROM, KEPT_FALL = 1e-5, 0.05
"""Residual from which on a step is made with the Jacobian and factor of the one before, as long as that left less than
this part."""

FACTOR_KEPT_FROM, FACTOR_KEPT_CFL, FACTOR_KEPT_FALL = 1e-3, 1e3, 0.3
"""Residual and CFL number from which on a step has the factor of the one before, as long as that left less than this
part: states change by so little that the factor is as good, and takes as long as ten products."""

WORTH, LARGEST_SOLVE, MOST_LEFT = 0.3, 300, 0.8
"""Part of its right-hand side that a linear solve has to leave less of for a step; the products after which it ends,
and the part of its residual that a cycle may leave: a smaller CFL number is cheaper, but where Jacobians are kept, a
cut gives Newton's convergence away, and longer cycles do it."""

MOST_PRODUCTS = 1200
"""Products with the Jacobian after which a run has failed: a fourth more than the flow about any grid of others
takes, and a third more than that about a flat plate at 4 degrees."""


@dataclass(frozen=True, eq=False)
class FlowSolution:
    """States of all cells, with the history of the residual."""

    states: np.ndarray  # (n_cells, 5)
    stream: np.ndarray  # (5,), the free stream
    history: tuple[NewtonStep, ...]  # the first is the state at the start
    tolerance: float  # residual that was asked for

    @property
    def residual(self) -> float:
        """Norm of the last residual, relative to that of the uniform stream."""
        return self.history[-1].residual

    @property
    def is_converged(self) -> bool:
        """Whether the residual is as small as asked for."""
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
    progress: Callable[[NewtonStep, np.ndarray], None] | None = None,
) -> FlowSolution:
    """Solve for the steady flow by Newton steps with pseudo-time terms that fade out as the residual falls.

    With the volumes divided by the time steps T, until the residual R is small enough:

    1. Linearise, and add time terms to the diagonal: ``A = T / CFL + dR/dW``; near the end that of the last step stays.
    2. Factor a compact neighbour of A for the preconditioner; from a moderate residual on, that of the last step stays.
    3. Solve ``A dW = -R`` inexactly [1] [4] by GMRES.
    4. Take as much of the step as keeps densities, pressures and the residual within bounds.
    5. Let the CFL number grow as the residual falls, switched evolution relaxation [2] [3], or cut it where the
       linear solve failed, the step was shortened much or the residual rose; see `.hovering` for runs that hover.

    Parameters
    ----------
    discretization : Discretization
    areas : ndarray, shape (n_faces, 3)
        Area vectors (m^2).
    stream : ndarray, shape (5,)
        The free stream.
    pattern : FactorPattern
        Of the preconditioner.
    states : ndarray, shape (n_cells, 5), optional
        Where to start; the uniform stream by default.
    tolerance : float
        Norm of the residual relative to that of the uniform stream.
    max_steps : int
        Largest number of Newton steps.
    is_long : bool
        Whether flat cells have long time steps, see `time_terms`: surer with shocks in layers of flat cells at walls.
    progress : callable, optional
        Called with every step and the states after it, on all processes.

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
    if not np.isfinite(norm):  # a start with shocks on coarser members can be too harsh for the extrapolation here
        states = discretization.uniform(stream)
        residual = field.residual(states)
        norm = field.norm(residual)
    cfl = _first_cfl(scale / norm, is_long) if norm else LARGEST_CFL
    history = [NewtonStep(norm / scale, cfl, 0, 1.0)]
    system: _StepSystem | None = None
    factor: Factor | None = None
    last: np.ndarray | None = None
    while history[-1].residual > tolerance and len(history) <= max_steps and cfl > SMALLEST_CFL:
        n_stalled = STALLED_LONG if is_long or history[-1].hovers_from else STALLED
        is_stalled = _is_stalled(since_it_hovers(history), n_stalled)
        if is_stalled or _is_rounded(history) or _is_spent(history):
            break
        part = _forcing(history, tolerance)
        if not _is_kept(history):
            factor = system.factor if system and _is_factor_kept(history, cfl) else None
            system = None  # it makes room for the next
        system = system or _StepSystem.of(field, pattern, states, cfl, is_long, factor)  # steps 1 and 2
        most_left = MOST_LEFT if history[-1].residual > KEPT_FROM else np.inf
        update, n_products = system.solve(residual, part, most_left)  # step 3
        course = system.course(update, last, residual)
        if history[-1].hovers_from and course.is_backward:
            update = None  # it would lead back to where the run came from, and the next one here again
        states, residual, length = advance(field, states, residual, update)  # step 4
        before, norm = norm, field.norm(residual)
        last = last if update is None else update
        history.append(NewtonStep(norm / scale, cfl, n_products, length, course))
        history[-1] = replace(history[-1], hovers_from=lowest_before(history))
        if progress:
            progress(history[-1], states)
        cfl = _next_cfl(history, before, norm, is_long)  # step 5
    return FlowSolution(states, stream, tuple(history), tolerance)


def relative_residual(
    discretization: Discretization, states: np.ndarray, areas: np.ndarray, stream: np.ndarray, tolerance: float = 1e-10
) -> float:
    """Norm of the residual of states relative to that of the uniform stream; arguments are those of `solve_flow`."""
    field = Field(discretization, areas, stream)
    return field.norm(field.residual(states)) / field.scale(tolerance)


@dataclass(frozen=True, eq=False)
class Field:
    """What is solved: a discretisation with its area vectors and stream, its residual per surface of the cells."""

    discretization: Discretization
    areas: np.ndarray
    stream: np.ndarray

    @cached_property
    def sizes(self) -> np.ndarray:
        """Surfaces of the cells (m^2), shape (n_cells, 1)."""
        return self.discretization.sizes(self.areas)

    def residual(self, states: np.ndarray) -> np.ndarray:
        """What flows out of every cell, by its surface, shape (n_cells, 5)."""
        return self.discretization.residual(states, self.areas, self.stream) / self.sizes

    def norm(self, residual: np.ndarray) -> float:
        """Euclidean norm of an array of all cells."""
        return self.discretization.norm(residual)

    def scale(self, tolerance: float) -> float:
        """Norm of the residual of the uniform stream, but no less than rounding of the fluxes by the tolerance."""
        uniform = self.discretization.uniform(self.stream)
        rounding = float(np.finfo(float).eps) * self.norm(np.ones_like(uniform[:, :1]))
        return max(self.norm(self.residual(uniform)), rounding / tolerance)


def _is_rounded(history: list[NewtonStep]) -> bool:
    """Whether the residual is so small that the last steps could not halve it."""
    residuals = [step.residual for step in history[-3:]]
    return len(residuals) == 3 and residuals[0] < ROUNDED and min(residuals[1:]) > 0.5 * residuals[0]


def _is_stalled(history: list[NewtonStep], n: int, part: float = 0.5) -> bool:
    """Whether the last n steps have brought the lowest residual to no less than a part of it."""
    before, lately = ([step.residual for step in part] for part in (history[:-n], history[-n:]))
    return bool(before) and min(lately) > part * min(before)


def _is_spent(history: list[NewtonStep]) -> bool:
    """Whether a run has had its products, and its last step, late in the run, left more than a fifth."""
    is_near = len(history) > 1 and history[-1].residual < 0.2 * min(ROUGH_UNTIL, history[-2].residual)
    return sum(step.n_products for step in history) >= MOST_PRODUCTS and not is_near


def _is_kept(history: list[NewtonStep]) -> bool:
    """Whether the Jacobian of the last step serves the next one too."""
    if len(history) < 2 or history[-1].residual > KEPT_FROM or history[-1].length < 1.0:
        return False
    return history[-1].residual < KEPT_FALL * history[-2].residual


def _is_factor_kept(history: list[NewtonStep], cfl: float) -> bool:
    """Whether the factor of the last step serves one with a CFL number too, with another Jacobian."""
    if len(history) < 2 or history[-1].residual > FACTOR_KEPT_FROM or history[-1].length < 1.0:
        return False
    has_fallen = history[-1].residual < FACTOR_KEPT_FALL * history[-2].residual
    return has_fallen and min(cfl, history[-1].cfl) >= FACTOR_KEPT_CFL


@dataclass(frozen=True, eq=False)
class _StepSystem:
    """Linear system of a Newton step, with its preconditioner."""

    field: Field
    linearization: Linearization
    diagonal: np.ndarray
    factor: Factor

    @classmethod
    def of(
        cls, field: Field, pattern: FactorPattern, states: np.ndarray, cfl: float, is_long: bool, factor=None
    ) -> _StepSystem:
        """Linearise, add time terms to the diagonal, and factor a compact neighbour, unless there is a factor."""
        discretization = field.discretization
        linearization = discretization.linearize(states, field.areas, field.stream)
        diagonal = (time_terms(discretization, states, field.areas, is_long) / cfl).astype(np.float32)
        return cls(field, linearization, diagonal, factor or compact_factor(linearization, pattern, diagonal))

    def solve(self, residual: np.ndarray, part: float, most_left) -> tuple[np.ndarray | None, int]:
        """Newton update, or none where the linear solve fails, and its number of products with the Jacobian."""
        product, comm = self.linearization.jacobians.product, self.field.discretization.halo.comm
        system = by_surface(product, self.factor.solve, self.field.sizes, self.diagonal)
        solution = solve_roughly(*system, -residual, part, LARGEST_SOLVE, comm, most_left)
        is_usable = largest(comm, float(not np.isfinite(solution.x).all())) == 0.0 and solution.left < WORTH
        return (solution.x if is_usable else None), solution.n_products

    def course(self, update: np.ndarray, last, residual: np.ndarray) -> Course:
        """Where an update leads, after the one before."""
        if update is None:
            return UNKNOWN
        inverse = (1.0 / self.field.sizes.ravel()).astype(np.float32)
        held = add_blocks(self.diagonal, update.astype(np.float32), inverse, np.zeros(update.shape, np.float32))
        return course_of(update, last, residual, held, self.field.discretization.halo.comm)


def advance(field: Field, states: np.ndarray, residual: np.ndarray, update: np.ndarray):
    """Take as much of a step as keeps the states physical and the residual bounded."""
    if update is None:
        return states, residual, 0.0
    largest = LARGEST_RISE * field.norm(residual)
    length = _physical_length(states, update, field.discretization.halo.comm)
    while length > SMALLEST_STEP:
        moved = states + length * update
        after = field.residual(moved)
        if field.norm(after) < largest:
            return moved, after, length
        length *= 0.5
    return states, residual, 0.0


def _physical_length(states: np.ndarray, update: np.ndarray, comm: Any) -> float:
    """Largest part of a step, up to all of it, at which no density or pressure falls by more than `LARGEST_FALL`."""
    fall = largest(comm, np.max(-update[:, [0, 4]] / states[:, [0, 4]], initial=-np.inf))
    return min(1.0, LARGEST_FALL / max(fall, np.finfo(float).tiny))


def _forcing(history: list[NewtonStep], tolerance: float) -> float:
    """Tolerance of the next linear solve: the square of what the last step left, or what is asked for, within bounds.

    Where the residual did not fall as the linear system had it, a better solution of the next one is of no use.
    """
    if history[-1].residual > ROUGH_UNTIL:
        return ROUGH
    left = history[-1].residual / history[-2].residual if len(history) > 1 else 0.0
    return min(ROUGH, max(FORCING, left**2, 0.5 * tolerance / history[-1].residual))


def _first_cfl(fall: float, is_long: bool) -> float:
    """CFL number of the first step from a start whose residual has fallen so many times from the uniform stream's."""
    return min(LARGEST_CFL, (FIRST_LONG_CFL if is_long else FIRST_CFL) * max(1.0, fall) * max(1.0, fall / NEAR))


def _next_cfl(history: list[NewtonStep], before: float, after: float, is_long: bool) -> float:
    """CFL number of the next step, from those and the lengths of the last ones and the norms of the residual."""
    cfl, length = history[-1].cfl, history[-1].length
    if history[-1].hovers_from:
        return hovering_cfl(history, is_long)
    if length < 1.0:  # while shocks travel, shorter time steps get further than parts of long ones
        return cfl * min(1.0, max(0.2, 1.5 * length))
    if after > 1.5 * before:
        return 0.7 * cfl
    is_careful = any(step.length < 1.0 for step in history[-CAREFUL:])
    growth = CFL_GROWTH * before / max(after, np.finfo(float).tiny)
    return min(LARGEST_CFL, cfl * min(GROWTH_AFTER_CUTS if is_careful else LARGEST_GROWTH, max(1.0, growth)))
