"""The functions that NLopt calls: one model run per point, derivatives on demand, keeping the best point.

Theory: ``docs/theory/drivers.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any

import numpy as np

from .nlopt_problem import AnalysisFailed, Model, Point, Rows, Statement, Stop
from .nlopt_rules import AlgorithmRules, SearchRecord, Substitute
from .optimality import optimality

__all__ = ["Functions"]


def _remembering(callback: Callable) -> Callable:
    """Remember what a callback raises: some algorithms drop it and keep calling."""

    @wraps(callback)
    def remembered(self: Functions, *arguments: Any) -> Any:
        if self.exception is not None:
            raise self.exception
        try:
            return callback(self, *arguments)
        except BaseException as error:
            self.exception = error
            raise

    return remembered


@dataclass
class Functions:
    """Objective and constraints of a model as callbacks."""

    model: Model  # the model, run at `start`
    statement: Statement  # bounds and constraints
    # makes the algorithm's values if the analysis fails, one of `nlopt_rules.RECOVERIES`
    recover: Callable[[SearchRecord, np.ndarray], Substitute]
    make_rules: Callable[[], AlgorithmRules]  # makes the `AlgorithmRules` of the algorithm
    start: Point  # the first point
    # called after every run of the model, with None, and after every computation of totals, with the totals
    watch: Callable[[Functions, np.ndarray | None], None] = lambda functions, totals: None
    maxiter: int | None = None  # computations of totals allowed after the first; one more ends the search
    last: Point = field(init=False)  # the point where the model was last run
    # n_failed, n_failed_gradients: number of failed analyses, and how many of them failed in computing totals
    n_failed: int = field(init=False, default=0)
    n_failed_gradients: int = field(init=False, default=0)
    n_substituted: int = field(init=False, default=0)  # points with substitutes for failed values
    last_failure: str = field(init=False, default="")  # message of the last failed analysis
    # what the model or a keyboard interrupt raised
    exception: BaseException | None = field(init=False, default=None)
    _n_gradients: int = field(init=False, default=0)
    _totals: np.ndarray | None = field(init=False, default=None)
    _is_rejected: bool = field(init=False, default=False)
    _is_underway: bool = field(init=False, default=False)
    _rules: AlgorithmRules = field(init=False)
    _record: SearchRecord = field(init=False)
    _record_before: SearchRecord = field(init=False)
    _largest_gradient: float = field(init=False, default=np.finfo(float).tiny)

    def __post_init__(self) -> None:
        self.last = self.start
        self._rules = self.make_rules()
        self._record = self._record_before = SearchRecord.at(self.start)

    @property
    def best(self) -> Point:
        """The best point so far, by `Point.is_better`."""
        return self._record.base

    def restore_best(self) -> None:
        """Run the model at the best point, unless it was last run there."""
        if self.last is not self.best or self._is_underway:
            self.model.restore(self.best.x)
            self.last, self._totals = self.best, None
            self._is_rejected = self._is_underway = False

    def optimality(self) -> float:
        """Residual of the first-order conditions at the best point, see `residual`; infinite without derivatives."""
        self.restore_best()
        totals = self._record.totals
        if not totals.any():  # none were computed there
            try:
                totals = self.model.differentiate()
            except AnalysisFailed as error:
                self._count_gradient(error)
                return np.inf
        return self.residual(self.best, totals)

    def residual(self, point: Point, totals: np.ndarray) -> float:
        """Residual of the first-order conditions at a point, relative to the largest gradient of the objective."""
        if not np.isfinite(self._largest_gradient):
            return np.inf
        return optimality(self.statement, point, totals) / self._largest_gradient

    def restart(self) -> np.ndarray:
        """Forget the algorithm's state; return the best point (n,), from which it restarts."""
        self.exception = None
        self._rules = self.make_rules()
        return self.best.x.copy()

    @_remembering
    def objective(self, x: np.ndarray, gradient: np.ndarray) -> float:
        """Objective at x (n,), and its gradient (n,) if NLopt provides an array for it."""
        if gradient.size and self._is_new(x) and self._rules.is_converged(x):
            raise Stop("FTOL_REACHED")
        is_new = self._move_to(x)
        if gradient.size:
            self._is_rejected = is_new and self.last.is_analysed and self._rules.is_rejected(self.last)
            gradient[:] = self._differentiate(is_new)[0]
        return self.last.objective

    @_remembering
    def inequalities(self, values: np.ndarray, x: np.ndarray, gradients: np.ndarray) -> None:
        """Write the inequality rows (m,), at most zero where satisfied, and their gradients (m, n)."""
        self._write(self.statement.inequalities, values, x, gradients)

    @_remembering
    def equalities(self, values: np.ndarray, x: np.ndarray, gradients: np.ndarray) -> None:
        """Write the equality rows (m,), zero where satisfied, and their gradients (m, n)."""
        self._write(self.statement.equalities, values, x, gradients)

    @_remembering
    def inequality(self, row: int, x: np.ndarray, gradient: np.ndarray) -> float:
        """One inequality row, for algorithms without gradients that take constraints one by one."""
        self._move_to(x)
        return float(self.statement.inequalities.values(self.last.constraints)[row])

    def _write(self, rows: Rows, values: np.ndarray, x: np.ndarray, gradients: np.ndarray) -> None:
        is_new = self._move_to(x)
        values[:] = rows.values(self.last.constraints)
        if gradients.size:
            gradients[:] = rows.gradients(self._differentiate(is_new)[1:])

    def _is_new(self, x: np.ndarray) -> bool:
        """Whether the model was last run elsewhere."""
        return not np.array_equal(x, self.last.x)

    def _move_to(self, x: np.ndarray) -> bool:
        """Run the model unless it was last run here; True if it ran."""
        if not self._is_new(x):
            return False
        if not np.isfinite(x).all():
            raise Stop("ROUNDOFF_LIMITED")
        self._is_rejected, self._totals, self._is_underway = False, None, True
        try:
            self.last = self.statement.point(x, *self.model.run(x))
            self._record_before, self._record = (
                self._record,
                self._record.with_point(self.last, self.statement.tolerance),
            )
            if self.best is self.last:
                self.model.keep()
        except AnalysisFailed as error:
            self.n_failed, self.last_failure = self.n_failed + 1, str(error)
            self._totals = self._substitute(x)
        self._is_underway = False
        self.watch(self, None)
        return True

    def _substitute(self, x: np.ndarray) -> np.ndarray:
        """Substitute values for the failed analysis at x; return the substitute totals (1 + m, n)."""
        self.n_substituted += 1
        self._rules.fail()
        substitute = self.recover(self._record, x)
        point = self.statement.point(x, substitute.objective, substitute.constraints)
        self.last = replace(point, is_analysed=False)
        return substitute.totals

    def _differentiate(self, is_new: bool) -> np.ndarray:
        """Totals (1 + m, n) at the last point: computed once, zero if they will not be used."""
        if self._is_rejected:
            return np.zeros_like(self._record.totals)
        if self._totals is None:
            self._totals = self._compute_totals(is_new)
        return self._totals

    def _compute_totals(self, is_new: bool) -> np.ndarray:
        """Totals at the last run's point, or substitutes if they cannot be computed."""
        if self.maxiter is not None and self._n_gradients > self.maxiter:
            raise Stop("MAXITER_REACHED")
        try:
            totals = self.model.differentiate()
            self._n_gradients += 1
        except AnalysisFailed as error:
            self._count_gradient(error)
            if not is_new:
                raise Stop("BLOCKED") from None  # the algorithm has used the value already
            self._record = self._record_before
            return self._substitute(self.last.x)
        self._rules.keep(self.last, totals[0])
        self._largest_gradient = max(self._largest_gradient, float(np.linalg.norm(totals[0])))
        self._record = self._record.with_totals(self.last, totals)
        self.watch(self, totals)
        return totals

    def _count_gradient(self, error: AnalysisFailed) -> None:
        """Count a failure of derivatives."""
        self.n_failed, self.n_failed_gradients = self.n_failed + 1, self.n_failed_gradients + 1
        self.last_failure = str(error)
