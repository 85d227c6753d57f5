"""When an algorithm will reject a point whatever its gradient, so that none need be computed.

NLopt asks for the gradient together with the value. The first trial of a line search of LD_SLSQP and the inner
iterations of LD_MMA and LD_CCSAQ often fail on their values alone, and then the gradient is not used.
"""

from typing import Protocol

import numpy as np

from .nlopt_problem import Point

__all__ = ["REJECTIONS", "AboveFeasible", "Dominated", "Never", "Rejection"]


class Rejection(Protocol):
    """Knowledge of an algorithm's rule for rejecting points."""

    def is_sure(self, point: Point) -> bool:
        """Whether the algorithm will reject a new point."""

    def keep(self, point: Point) -> None:
        """Learn of a point whose gradient was given."""


class Never:
    """Nothing is known: every gradient is computed."""

    def is_sure(self, point: Point) -> bool:
        """Never."""
        return False

    def keep(self, point: Point) -> None:
        """Learn nothing."""


class Dominated:
    """Sequential quadratic programming: a trial must lower the merit function ``f + sum(mu |violations|)``.

    The line search starts from the last point whose gradient was given. A trial with a higher objective and no smaller
    violation has a higher merit, whatever the weights mu >= 0.
    """

    def __init__(self):
        self._base: Point | None = None

    def is_sure(self, point: Point) -> bool:
        """Whether the base of the line search is better in everything."""
        base = self._base
        return (
            base is not None and point.objective >= base.objective and bool(np.all(point.violations >= base.violations))
        )

    def keep(self, point: Point) -> None:
        """The next line search starts here."""
        self._base = point


class AboveFeasible:
    """Conservative approximations: once a point was feasible, only a lower objective is accepted."""

    def __init__(self):
        self._lowest = np.inf

    def is_sure(self, point: Point) -> bool:
        """Whether a feasible point with no higher objective is known."""
        return point.objective >= self._lowest

    def keep(self, point: Point) -> None:
        """Lower the level if the point is feasible, without any tolerance."""
        if point.violation == 0.0:
            self._lowest = min(self._lowest, point.objective)


REJECTIONS: dict[str, type[Rejection]] = {"LD_SLSQP": Dominated, "LD_MMA": AboveFeasible, "LD_CCSAQ": AboveFeasible}
"""Rules by algorithm; `Never` for all others."""
