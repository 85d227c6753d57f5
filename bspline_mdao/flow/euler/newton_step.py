"""Records of Newton steps: remaining residuals, costs, and courses.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["UNKNOWN", "Course", "NewtonStep"]


@dataclass(frozen=True)
class Course:
    """Course of an update."""

    turn: float = 1.0  # cosine of the angle to the previous update
    # CFL number times the growth rate of its components in pseudo-time, negative if they decay
    growth: float = -np.inf

    @property
    def has_turned(self) -> bool:
        """Whether it reverses, at more than 120 degrees to the previous update."""
        return self.turn < -0.5

    @property
    def is_backward(self) -> bool:
        """Whether a time step that is too long reverses growing components, and with them the previous update."""
        return self.growth >= 1.0 and self.has_turned


UNKNOWN = Course()
"""For a start, or if there was no update."""


@dataclass(frozen=True)
class NewtonStep:
    """Record of a Newton step."""

    residual: float  # norm of the residual after it, relative to the uniform stream's
    cfl: float  # CFL number
    n_products: int  # products with the Jacobian
    length: float  # fraction of the step that was taken; 0 if there was none
    course: Course = UNKNOWN  # course of its update
    stagnates_from: float = 0.0  # lowest residual before the run began to stagnate; 0 if it does not stagnate
