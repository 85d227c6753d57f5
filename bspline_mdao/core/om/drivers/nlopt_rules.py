"""Rules of the algorithms: which gradients they will not use, and what they need when an analysis fails.

NLopt requests the gradient together with the value. The first trial of a line search of LD_SLSQP and the inner
iterations of LD_MMA and LD_CCSAQ often fail on their values alone, and then the gradient is not used. `AlgorithmRules`
predict that, so it is not computed.

NLopt does not know of points where the analysis fails, and each algorithm needs a different value there, its
*recovery*. A line search that halves its step at NaN gets NaN. A line search that interpolates gets a parabola that
leaves the base point with the true slope and turns uphill after a fiftieth of the way. An algorithm that samples or
models the objective gets a value worse than all so far, yet of their magnitude.

Theory: ``docs/theory/drivers.rst``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from .nlopt_problem import Point

__all__ = [
    "RECOVERIES",
    "AlgorithmRules",
    "ConservativeRules",
    "LineSearchRules",
    "NoRules",
    "SearchRecord",
    "Substitute",
    "not_a_number",
    "uphill",
    "worst",
]


class AlgorithmRules(Protocol):
    """Published rules of an algorithm, to predict that it rejects a point or has converged."""

    def is_rejected(self, point: Point) -> bool:
        """Whether the algorithm will reject a new point, whatever its gradient."""

    def is_converged(self, x: np.ndarray) -> bool:
        """Whether a new trial at x (n,) shows that the algorithm had already converged."""

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Note a point whose objective gradient (n,) was given."""

    def fail(self) -> None:
        """Note a failed analysis."""


class NoRules:
    """No predictions for an algorithm: every gradient is computed."""

    def is_rejected(self, point: Point) -> bool:
        """Predict no rejection."""
        return False

    def is_converged(self, x: np.ndarray) -> bool:
        """Predict no convergence."""
        return False

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Ignore a point whose gradient was given."""

    def fail(self) -> None:
        """Ignore a failed analysis."""


class ConservativeRules(NoRules):
    """Rules of conservative approximations [Svanberg, SIAM J. Optim. 12 (2002)]."""

    # Once a point was feasible, only a lower objective is accepted.

    def __init__(self) -> None:
        self._lowest = np.inf

    def is_rejected(self, point: Point) -> bool:
        """Whether a feasible point with an objective at most as high is known."""
        return point.objective >= self._lowest

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Lower the level if the point is feasible, without any tolerance."""
        if point.violation == 0.0:
            self._lowest = min(self._lowest, point.objective)


class LineSearchRules(NoRules):
    """Rules of sequential quadratic programming with line searches [Kraft, DFVLR-FB 88-28, 1988]."""

    # Every line search starts from the last point whose gradient was given. A trial must lower the merit function ``f +
    # sum(mu |violations|)``: one with a higher objective and no smaller violation does not, whatever the weights mu >=
    # 0. The first trial is the solution of the quadratic problem: if it promises less than ftol, a feasible base is the
    #    optimum, by the criterion of Kraft's original code. NLopt leaves this criterion out and continues with a line
    #    search among rounding errors.

    def __init__(
        self,
        ftol_rel: float,  # ftol_rel, ftol_abs: change of the objective that counts as zero
        ftol_abs: float,
        tolerance: float,  # violation that counts as zero
    ):
        self._ftol_rel, self._ftol_abs, self._tolerance = ftol_rel, ftol_abs, tolerance
        self._base: tuple[Point, np.ndarray] | None = None
        self._is_first_trial = False

    def is_rejected(self, point: Point) -> bool:
        """Whether the base of the line search is better in every respect."""
        if self._base is None:
            return False
        base, _ = self._base
        return point.objective >= base.objective and bool(np.all(point.violations >= base.violations))

    def is_converged(self, x: np.ndarray) -> bool:
        """Whether the first trial of a line search promises no further decrease."""
        if self._base is None or not self._is_first_trial:
            return False
        base, gradient = self._base
        promise = abs(float(gradient @ (x - base.x)))
        ftol = max(self._ftol_abs, self._ftol_rel * abs(base.objective))
        return promise < ftol and base.violation <= self._tolerance

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Note the base from which the next line search starts."""
        self._base, self._is_first_trial = (point, gradient.copy()), True

    def fail(self) -> None:
        """Note that the next trial is not a first one: the line search continues with a shorter step."""
        self._is_first_trial = False


TURN = 0.02
"""Fraction of the way from the base to the failed point at which the parabola of `uphill` turns: turning at 0.1 to 0.25
takes fewer runs in open space, but fails along the edge of a narrow corridor."""


@dataclass(frozen=True)
class SearchRecord:
    """Extreme points of a run so far, from which values for failed analyses are made."""

    base: Point  # the best point so far
    totals: np.ndarray  # (1 + m, n), totals of objective and constraints there; zero if none were computed
    worst_objective: float  # the highest objective so far
    most_violating: Point  # the point of largest violation so far

    @classmethod
    def at(cls, point: Point) -> "SearchRecord":
        """Record of the first run of the model."""
        return cls(point, np.zeros((1 + point.constraints.size, point.x.size)), point.objective, point)

    def with_point(self, point: Point, tolerance: float) -> "SearchRecord":
        """Record with a run at one more point; violations up to `tolerance` count as zero."""
        is_base = point.is_better(self.base, tolerance)
        return SearchRecord(
            point if is_base else self.base,
            np.zeros_like(self.totals) if is_base else self.totals,
            max(self.worst_objective, point.objective),
            point if point.violation > self.most_violating.violation else self.most_violating,
        )

    def with_totals(self, point: Point, totals: np.ndarray) -> "SearchRecord":
        """Record with the totals at a point, which are kept if it is the base."""
        return replace(self, totals=totals) if point is self.base else self

    @property
    def spread(self) -> float:
        """Scale of the objective: its range so far, or a tenth of its size; positive even if both are 0."""
        return max(self.worst_objective - self.base.objective, 0.1 * abs(self.worst_objective), 1e-6)


@dataclass(frozen=True)
class Substitute:
    """Substitute values for a failed analysis."""

    objective: float  # the objective
    constraints: np.ndarray  # (m,), the constraints
    totals: np.ndarray  # (1 + m, n), totals of objective and constraints


def not_a_number(record: SearchRecord, x: np.ndarray) -> Substitute:
    """Return NaN, at which some line searches halve their step."""
    return Substitute(np.nan, record.base.constraints, np.zeros_like(record.totals))


def worst(record: SearchRecord, x: np.ndarray) -> Substitute:
    """Return a value worse than all so far by the objective's range, of a magnitude that spoils no model of it."""
    objective = record.worst_objective + record.spread
    return Substitute(objective, record.most_violating.constraints, np.zeros_like(record.totals))


def uphill(record: SearchRecord, x: np.ndarray) -> Substitute:
    """Return a value and a slope as if the path from the base point had turned uphill."""
    # With the step d = x - base and the slope s along it (downwards), the parabola ``f + s t + s / (2 TURN) t^2`` of t
    # in [0, 1] has its minimum at t = TURN; its value and gradient at t = 1 are returned.
    step = x - record.base.x
    length2 = max(float(step @ step), np.finfo(float).tiny)
    # without totals, or along a limit, the true slope may be zero: the parabola still has to turn uphill
    slope = -max(abs(float(record.totals[0] @ step)), 1e-3 * record.spread)
    totals = record.totals.copy()
    totals[0] = slope * (1.0 - 1.0 / TURN) * step / length2
    return Substitute(record.base.objective + slope * (1.0 - 0.5 / TURN), record.base.constraints, totals)


RECOVERIES: dict[str, Callable[[SearchRecord, np.ndarray], Substitute]] = {
    "nan": not_a_number,
    "uphill": uphill,
    "worst": worst,
}
"""Recoveries by name (`nlopt_algorithms.Algorithm.recovery`)."""
