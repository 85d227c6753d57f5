"""What an optimiser is told about a point where the model cannot be analysed.

Every algorithm needs something else. A line search that halves its step at what is not a number is told so. One that
interpolates is given a parabola that leaves the base point with the true slope and turns uphill after a fiftieth of the
way. An algorithm that samples or builds models of the objective is told a value worse than all it has seen, yet of
their size.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .nlopt_problem import Point

__all__ = ["RECOVERIES", "Known", "Standin", "not_a_number", "uphill", "worst"]

TURN = 0.02
"""Where on the way from the base to the failed point the parabola of `uphill` turns."""


@dataclass(frozen=True)
class Known:
    """What is known of the problem so far.

    Parameters
    ----------
    base : Point
        The best point so far.
    totals : ndarray, shape (1 + m, n)
        Totals of objective and constraints there; zero if none were computed.
    worst_objective : float
        The highest objective so far.
    most_violating : Point
        The point of largest violation so far.
    """

    base: Point
    totals: np.ndarray
    worst_objective: float
    most_violating: Point

    @classmethod
    def at(cls, point: Point) -> "Known":
        """What is known after the first run."""
        return cls(point, np.zeros((1 + point.constraints.size, point.x.size)), point.objective, point)

    def learn(self, point: Point, tolerance: float) -> "Known":
        """What is known after a run at one more point; violations up to `tolerance` count as none."""
        is_base = point.is_better(self.base, tolerance)
        return Known(
            point if is_base else self.base,
            np.zeros_like(self.totals) if is_base else self.totals,
            max(self.worst_objective, point.objective),
            point if point.violation > self.most_violating.violation else self.most_violating,
        )

    def differentiate(self, point: Point, totals: np.ndarray) -> "Known":
        """What is known after the totals at a point were computed."""
        return replace(self, totals=totals) if point is self.base else self

    @property
    def spread(self) -> float:
        """Scale of the objective: how much it has varied, or a tenth of its size."""
        return max(self.worst_objective - self.base.objective, 0.1 * abs(self.worst_objective), 1e-6)


@dataclass(frozen=True)
class Standin:
    """What stands in for the analysis.

    Parameters
    ----------
    objective : float
        The objective.
    constraints : ndarray, shape (m,)
        The constraints.
    totals : ndarray, shape (1 + m, n)
        Totals of objective and constraints.
    """

    objective: float
    constraints: np.ndarray
    totals: np.ndarray


def not_a_number(known: Known, x: np.ndarray) -> Standin:
    """Say that there is no number."""
    return Standin(np.nan, known.base.constraints, np.zeros_like(known.totals))


def worst(known: Known, x: np.ndarray) -> Standin:
    """Say that it is worse than everything seen so far, in the objective by as much as has been seen."""
    objective = known.worst_objective + known.spread
    return Standin(objective, known.most_violating.constraints, np.zeros_like(known.totals))


def uphill(known: Known, x: np.ndarray) -> Standin:
    """Say that the way from the base point turned uphill.

    With the step d = x - base and the slope s along it (downwards), the parabola ``f + s t + s / (2 TURN) t^2`` of
    t in [0, 1] has its minimum at t = TURN; its value and gradient at t = 1 are returned.
    """
    step = x - known.base.x
    length2 = max(float(step @ step), np.finfo(float).tiny)
    slope = -max(abs(float(known.totals[0] @ step)), 1e-3 * known.spread)
    totals = known.totals.copy()
    totals[0] = slope * (1.0 - 1.0 / TURN) * step / length2
    return Standin(known.base.objective + slope * (1.0 - 0.5 / TURN), known.base.constraints, totals)


RECOVERIES: dict[str, Callable[[Known, np.ndarray], Standin]] = {
    "nan": not_a_number,
    "uphill": uphill,
    "worst": worst,
}
"""Recoveries by name (`nlopt_algorithms.Algorithm.recovery`)."""
