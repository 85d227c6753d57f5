"""What can be foreseen of an algorithm from its published rules: rejection of a point, and convergence.

NLopt asks for the gradient together with the value. The first trial of a line search of LD_SLSQP and the inner
iterations of LD_MMA and LD_CCSAQ often fail on their values alone, and then the gradient is not used.
"""

from typing import Protocol

import numpy as np

from .nlopt_problem import Point

__all__ = ["Blind", "Conservative", "Foresight", "Sequential"]


class Foresight(Protocol):
    """Knowledge of an algorithm's rules."""

    def is_rejected(self, point: Point) -> bool:
        """Whether the algorithm will reject a new point, whatever its gradient."""

    def is_converged(self, x: np.ndarray) -> bool:
        """Whether a new trial at x (n,) shows that the algorithm has converged before."""

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Learn of a point whose gradient (n,) of the objective was given."""

    def fail(self) -> None:
        """Learn of a failed analysis."""


class Blind:
    """Nothing is foreseen: every gradient is computed."""

    def is_rejected(self, point: Point) -> bool:
        """Never."""
        return False

    def is_converged(self, x: np.ndarray) -> bool:
        """Never."""
        return False

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Learn nothing."""

    def fail(self) -> None:
        """Learn nothing."""


class Conservative(Blind):
    """Conservative approximations: once a point was feasible, only a lower objective is accepted."""

    def __init__(self):
        self._lowest = np.inf

    def is_rejected(self, point: Point) -> bool:
        """Whether a feasible point with no higher objective is known."""
        return point.objective >= self._lowest

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """Lower the level if the point is feasible, without any tolerance."""
        if point.violation == 0.0:
            self._lowest = min(self._lowest, point.objective)


class Sequential(Blind):
    """Sequential quadratic programming: every line search starts from the last point whose gradient was given.

    A trial must lower the merit function ``f + sum(mu |violations|)``: one with a higher objective and no smaller
    violation does not, whatever the weights mu >= 0. The first trial is the solution of the quadratic problem: where it
    promises less than ftol, a feasible base is the optimum, by the criterion of Kraft's original code, which NLopt
    leaves out: there a line search among rounding errors would follow.

    Parameters
    ----------
    ftol_rel, ftol_abs : float
        Change of the objective that counts as none.
    tolerance : float
        Violation that counts as none.
    """

    def __init__(self, ftol_rel: float, ftol_abs: float, tolerance: float):
        self._ftol_rel, self._ftol_abs, self._tolerance = ftol_rel, ftol_abs, tolerance
        self._base: tuple[Point, np.ndarray] | None = None
        self._is_first_trial = False

    def is_rejected(self, point: Point) -> bool:
        """Whether the base of the line search is better in everything."""
        if self._base is None:
            return False
        base, _ = self._base
        return point.objective >= base.objective and bool(np.all(point.violations >= base.violations))

    def is_converged(self, x: np.ndarray) -> bool:
        """Whether the first trial of a line search promises nothing more."""
        if self._base is None or not self._is_first_trial:
            return False
        base, gradient = self._base
        promise = abs(float(gradient @ (x - base.x)))
        ftol = max(self._ftol_abs, self._ftol_rel * abs(base.objective))
        return promise < ftol and base.violation <= self._tolerance

    def keep(self, point: Point, gradient: np.ndarray) -> None:
        """The next line search starts here."""
        self._base, self._is_first_trial = (point, gradient.copy()), True

    def fail(self) -> None:
        """What follows is not a first trial."""
        self._is_first_trial = False
