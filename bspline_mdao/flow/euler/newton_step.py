"""Records of Newton steps: what they left, what they took, and where they led.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["UNKNOWN", "Course", "NewtonStep"]


@dataclass(frozen=True)
class Course:
    """Where an update leads."""

    turn: float = 1.0  # cosine of the angle to the update before
    # CFL number times the rate at which what it is made of grows in pseudo-time, negative where that decays
    growth: float = -np.inf

    @property
    def has_turned(self) -> bool:
        """Whether it goes back, at more than 120 degrees to the update before."""
        return self.turn < -0.5

    @property
    def is_backward(self) -> bool:
        """Whether what grows is taken back by a time step that is too long for it, and the update before with it."""
        return self.growth >= 1.0 and self.has_turned


UNKNOWN = Course()
"""Of a start, or where there was no update."""


@dataclass(frozen=True)
class NewtonStep:
    """Record of a Newton step."""

    residual: float  # norm of the residual after it, relative to that of the uniform stream
    cfl: float  # CFL number
    n_products: int  # products with the Jacobian
    length: float  # part of the step that was taken; 0 where none was
    course: Course = UNKNOWN  # where it leads
    stagnates_from: float = 0.0  # lowest residual before the run began to stagnate; 0 where it does not stagnate
