"""An optimisation problem in NLopt's form: bounds, and constraints with one limit each.

Theory: ``docs/theory/drivers.rst``.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ....base.display import OneLine

__all__ = ["AnalysisFailed", "Limits", "Model", "Point", "Rows", "Statement", "Stop", "split_constraints"]


class AnalysisFailed(ArithmeticError):
    """The model cannot be analysed at a point."""


class Stop(Exception):
    """A reason to stop that NLopt does not detect; the message is the name of the end."""


class Model(Protocol):
    """The model as a function of one scaled vector of all design variables."""

    def run(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Run at a point (n,): objective and constraints (m,); raises `AnalysisFailed`."""

    def keep(self) -> None:
        """Store the states of the last run."""

    def restore(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Like `run`, at the stored point and from its stored states."""

    def differentiate(self) -> np.ndarray:
        """Totals (1 + m, n) of objective and constraints at the last run's point; raises `AnalysisFailed`."""


@dataclass(frozen=True)
class Limits:
    """Scaled limits of one design variable or constraint."""

    name: str  # its name
    # lower, upper: (size,), limits, infinite if there is none
    lower: np.ndarray
    upper: np.ndarray
    equals: np.ndarray  # (size,), required values, NaN except for equality constraints


@dataclass(frozen=True)
class Rows:
    """Constraints in the form NLopt takes: ``signs (c[ids] - limits)`` is at most zero, or zero."""

    ids: np.ndarray  # (m,) of int, the constraint of each row
    signs: np.ndarray  # (m,), +1 for an upper limit or an equality, -1 for a lower limit
    limits: np.ndarray  # (m,), the limit of each row

    def values(self, constraints: np.ndarray) -> np.ndarray:
        """Values (m,) of the rows."""
        return self.signs * (constraints[self.ids] - self.limits)

    def gradients(self, jacobian: np.ndarray) -> np.ndarray:
        """Gradients (m, n) of the rows from the constraints' gradients."""
        return self.signs[:, None] * jacobian[self.ids]


def split_constraints(
    lower: np.ndarray,  # lower, upper: (m,), limits, infinite if there is none
    upper: np.ndarray,
    equals: np.ndarray,  # (m,), required values, NaN for inequalities
) -> tuple[Rows, Rows]:  # inequalities, upper limits before lower ones; equalities
    """Split constraints with limits on both sides into rows."""
    is_equality = ~np.isnan(equals)
    above, below = (np.flatnonzero(np.isfinite(limit) & ~is_equality) for limit in (upper, lower))
    same = np.flatnonzero(is_equality)
    signs = np.repeat([1.0, -1.0], [above.size, below.size])
    inequalities = Rows(np.concatenate([above, below]), signs, np.concatenate([upper[above], lower[below]]))
    return inequalities, Rows(same, np.ones(same.size), equals[same])


@dataclass(frozen=True)
class Point(OneLine):
    """A point with the model's results, or with substitutes if the analysis failed."""

    x: np.ndarray  # (n,), design variables
    objective: float  # the objective
    constraints: np.ndarray  # (m,), the constraints
    violations: np.ndarray  # (n_rows,), violation of each row
    is_analysed: bool = True  # false if the analysis failed

    @property
    def violation(self) -> float:
        """Largest violation of any row."""
        return float(self.violations.max(initial=0.0))

    def is_better(self, other: "Point", tolerance: float) -> bool:
        """Lower objective among feasible points, else less violation."""
        if max(self.violation, other.violation) <= tolerance:
            return self.objective < other.objective
        return self.violation < other.violation


@dataclass(frozen=True)
class Statement:
    """Bounds and constraints of a problem."""

    # lower, upper: (n,), bounds of the variables, infinite if there is none
    lower: np.ndarray
    upper: np.ndarray
    # inequalities, equalities: the constraints
    inequalities: Rows
    equalities: Rows
    tolerance: float  # violation up to which a constraint counts as satisfied

    @classmethod
    def of(cls, designs: tuple[Limits, ...], constraints: tuple[Limits, ...], tolerance: float) -> "Statement":
        """Convert the limits of all design variables and constraints to NLopt's form."""
        sides = (_joined(constraints, side) for side in ("lower", "upper", "equals"))
        return cls(_joined(designs, "lower"), _joined(designs, "upper"), *split_constraints(*sides), tolerance)

    def violations(self, constraints: np.ndarray) -> np.ndarray:
        """Violation of each row (n_rows,), zero if satisfied."""
        return np.concatenate(
            [np.maximum(self.inequalities.values(constraints), 0.0), np.abs(self.equalities.values(constraints))]
        )

    def point(self, x: np.ndarray, objective: float, constraints: np.ndarray) -> Point:
        """Make the point x (n,) with the model's results."""
        return Point(x.copy(), float(objective), constraints, self.violations(constraints))


def _joined(limits: tuple[Limits, ...], side: str) -> np.ndarray:
    """Limits of one side of all variables in one vector."""
    return np.concatenate([np.zeros(0), *(getattr(limit, side) for limit in limits)])
