"""Runs that stagnate: their residual is low and oscillates, but there is no steady flow nearby.

As a shock moves across the cells, one steady state after another disappears at a fold, where it meets an unstable one.
A run passes points where the last one has just disappeared. There the residual has a minimum that is not zero, and the
Jacobian is singular. On the far side, some components of the states move away at a rate mu in pseudo-time. A step with
a time step h changes these components by

    (1/h - mu) T dW = -R ,

As long as h mu < 1 this is forward, and the residual grows by 1/(1 - h mu). With h mu = 1 the step is unbounded. With
more it goes *backward*, to the near side. From there the next long step leads to the far side again, so the run
oscillates forever.

The growth h mu of the components of a step, `growth`, is known from the step and its residual: it is the Rayleigh
quotient of the Jacobian in the metric of the time terms. A stagnating run returns to short time steps, and lets them
grow only as far as `growth` allows. This takes it past the fold, while the residual rises by orders of magnitude, to
where there is a steady flow.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.numerics.processes import summed
from .newton_step import Course, NewtonStep
from .settings import NewtonSettings

__all__ = ["begins_to_stagnate", "course_of", "lowest_before", "since_stagnation", "stagnation_cfl"]


def course_of(
    update: np.ndarray,  # update, last: (n_cells, 5), the update and the previous one, which may be missing
    last: np.ndarray | None,
    residual: np.ndarray,  # (n_cells, 5), before the step
    # (n_cells, 5), the time terms' product with the update, ``T dW / CFL``, in the units of the residual
    scaled: np.ndarray,
    comm: Any,  # the processes
) -> Course:
    """Return the course of an update."""
    last = np.zeros_like(update) if last is None else last
    pairs = (update, last), (update, update), (last, last), (scaled, residual), (scaled, scaled)
    along, new, old, driven, slowed = summed(comm, np.array([np.einsum("ij,ij", a, b) for a, b in pairs]))
    tiny = np.finfo(float).tiny
    return Course(float(along / max(np.sqrt(new * old), tiny)), float(1.0 + driven / max(slowed, tiny)))


def begins_to_stagnate(settings: NewtonSettings, history: Sequence[NewtonStep]) -> bool:
    """Whether residuals are low but the last ones have no new minimum, or steps reverse each other."""
    # While shocks travel, residuals are higher, and steps continue or are shortened. Two whole steps in a row that each
    # reverse the previous one, and together do not halve the residual, oscillate at any residual: on an M6 of a million
    # cells, at 1e-3 in ten cells at the tip.
    residuals = [step.residual for step in history]
    if len(residuals) < 3:
        return False
    goes_back = (
        history[-1].course.has_turned
        and residuals[-1] > residuals[-2]
        and max(residuals[-3:]) < settings.stagnation_from
    )
    is_stagnant = (
        max(residuals[-settings.stagnation_steps :]) < settings.stagnation_from
        and len(residuals) > settings.stagnation_steps
    )
    is_taken_back = all(step.course.has_turned and step.length == 1.0 for step in history[-2:])
    goes_to_and_fro = is_taken_back and residuals[-1] > 0.5 * residuals[-3]
    return (
        goes_back
        or goes_to_and_fro
        or (is_stagnant and min(residuals[-settings.stagnation_steps :]) > min(residuals[: -settings.stagnation_steps]))
    )


def lowest_before(settings: NewtonSettings, history: Sequence[NewtonStep]) -> float:
    """Lowest residual before a run began to stagnate, zero if it does not. The last step does not have it yet."""
    before = history[-2].stagnates_from if len(history) > 1 else 0.0
    if before:
        return before if history[-1].residual > settings.stagnates_until * before else 0.0
    return min(step.residual for step in history) if begins_to_stagnate(settings, history) else 0.0


def stagnation_cfl(settings: NewtonSettings, history: Sequence[NewtonStep], is_long: bool) -> float:
    """CFL number of the next step of a stagnating run: short at first, then as long as growth allows."""
    cfl, length, growth = history[-1].cfl, history[-1].length, history[-1].course.growth
    if not history[-2].stagnates_from:
        return min(cfl, settings.long_rest_cfl if is_long else settings.first_cfl)
    fall = history[-2].residual / max(history[-1].residual, np.finfo(float).tiny)
    factor = (
        min(settings.largest_growth, max(settings.cfl_growth, fall))
        if length == 1.0
        else min(1.0, max(0.2, 1.5 * length))
    )
    return cfl * (min(factor, settings.most_growing / growth) if growth > 0.0 else factor)


def since_stagnation(history: list[NewtonStep]) -> list[NewtonStep]:
    """Steps of a stagnating run, from the first stagnating one; all steps of other runs. Residuals rise past a fold."""
    first = len(history)
    while history[first - 1].stagnates_from:
        first -= 1
    return history[first:] or history
