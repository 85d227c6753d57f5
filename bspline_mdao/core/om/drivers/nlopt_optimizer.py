"""Runs of NLopt with all its settings: build, run and restart the optimizer, and describe its end.

Theory: ``docs/theory/drivers.rst``.
"""

import time
from dataclasses import dataclass, replace
from functools import partial

import nlopt
import numpy as np

from ....errors import InputError
from .nlopt_algorithms import Algorithm
from .nlopt_functions import Functions
from .nlopt_problem import Point, Statement, Stop

__all__ = ["ENDS", "Criteria", "Outcome", "Settings", "minimise"]

ENDS = {
    "SUCCESS": "the algorithm is done",
    "STOPVAL_REACHED": "the objective fell below stopval",
    "FTOL_REACHED": "the objective changes by less than ftol_rel or ftol_abs",
    "XTOL_REACHED": "the design variables change by less than xtol_rel or xtol_abs",
    "MAXEVAL_REACHED": "maxeval evaluations were spent",
    "MAXITER_REACHED": "maxiter iterations were done",
    "MAXTIME_REACHED": "maxtime seconds were spent",
    "FAILURE": "the algorithm gave up",
    "OUT_OF_MEMORY": "NLopt ran out of memory",
    "ROUNDOFF_LIMITED": "round-off limits progress",
    "FORCED_STOP": "it was stopped from outside",
    "OPTIMAL": "the algorithm can get no further, at a point that satisfies the first-order conditions",
    "STALLED": "steps became too small, at a point that is no optimum: it does not satisfy the first-order conditions",
    "BLOCKED": "analyses or gradients fail around the best point, which is no optimum",
    "INTERRUPTED": "it was interrupted from the keyboard",
}
"""Descriptions of the ends of a run, by NLopt's names and this package's."""

_CODES = {getattr(nlopt, name): name for name in ENDS if hasattr(nlopt, name)}
_CONVERGED = ("SUCCESS", "OPTIMAL", "STOPVAL_REACHED", "FTOL_REACHED", "XTOL_REACHED")
TINY = float(np.finfo(float).tiny)
OPTIMAL, BLOCKED = 1e-5, 1e-3
"""Gradients of the Lagrangian, relative to the objective's largest gradient, below which a point is an optimum and
above which it is not; in between NLopt's own result is kept."""

STALLED = 1e-2
"""Upper bound if nothing failed, or the square root of the relative ftol if larger: 193 runs of SLSQP, MMA and CCSAQ
that started infeasible ended below 2e-3 at optima (2.5e-2 with an ftol_rel of 1e-3) and above 1.5e-2 elsewhere."""

_SPENT = ("MAXEVAL_REACHED", "MAXITER_REACHED", "MAXTIME_REACHED")


@dataclass(frozen=True)
class Criteria:
    """Stopping criteria; zero disables one."""

    # ftol_rel, ftol_abs: change of the objective, relative and absolute
    ftol_rel: float
    ftol_abs: float
    xtol_rel: float  # change of the design variables, relative
    xtol_abs: float | np.ndarray  # float or ndarray, shape (n,), change of each design variable
    maxeval: int  # number of evaluations as NLopt counts them

    def apply(self, optimizer: nlopt.opt) -> None:
        """Set the criteria of an optimizer of NLopt."""
        optimizer.set_ftol_rel(self.ftol_rel)
        optimizer.set_ftol_abs(self.ftol_abs)
        optimizer.set_xtol_rel(self.xtol_rel)
        optimizer.set_xtol_abs(self.xtol_abs)
        optimizer.set_maxeval(self.maxeval)


@dataclass(frozen=True)
class Settings:
    """All settings of a run apart from the problem."""

    # algorithm, local_optimizer: the algorithm, and its inner algorithm
    algorithm: Algorithm
    local_optimizer: Algorithm | None
    # criteria, local_criteria: when they stop
    criteria: Criteria
    local_criteria: Criteria
    stopval: float | None  # objective that is good enough
    maxiter: int | None  # gradients after the first one; None for no limit
    maxtime: float  # seconds; zero for no limit
    # float, ndarray, shape (n,) or None, first step of algorithms without gradients; None for NLopt's choice
    initial_step: float | np.ndarray | None
    population: int  # initial population of stochastic algorithms; zero for NLopt's choice
    vector_storage: int  # number of gradients that limited-memory algorithms store; zero for NLopt's choice
    seed: int | None  # seed of the random numbers; None for a different one every time
    parameters: dict[str, float]  # parameters specific to one algorithm (``nlopt.opt.set_param``)
    restarts: int  # maximum number of restarts from the best point after failed analyses

    @property
    def uses_gradients(self) -> bool:
        """Whether the algorithm or its inner one uses gradients."""
        return self.algorithm.gradients or (self.local_optimizer is not None and self.local_optimizer.gradients)


@dataclass(frozen=True)
class Outcome:
    """End of a run."""

    end: str  # key of `ENDS`
    n_restarts: int = 0  # number of restarts
    # residual of the first-order conditions at the best point, relative to the largest gradient of the objective, if
    # computed
    optimality: float | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether it neither converged nor failed: a budget was spent, or it was stopped."""
        return self.end in (*_SPENT, "FORCED_STOP", "INTERRUPTED")

    def is_success(self, algorithm: Algorithm) -> bool:
        """Whether it converged; a global search that spent its budget has done what it can."""
        return self.end in _CONVERGED or (algorithm.is_global and self.end in _SPENT)


def _bounded(algorithm: Algorithm, statement: Statement) -> nlopt.opt:
    """An optimizer with its bounds."""
    optimizer = nlopt.opt(getattr(nlopt, algorithm.name), statement.lower.size)
    optimizer.set_lower_bounds(statement.lower)
    optimizer.set_upper_bounds(statement.upper)
    return optimizer


def _constrain(optimizer: nlopt.opt, functions: Functions) -> None:
    """Pass the constraints to NLopt, grouped by kind."""
    statement = functions.statement
    for rows, add, function in (
        (statement.inequalities, optimizer.add_inequality_mconstraint, functions.inequalities),
        (statement.equalities, optimizer.add_equality_mconstraint, functions.equalities),
    ):
        if rows.ids.size:
            add(function, np.full(rows.ids.size, statement.tolerance))


def _constrain_one_by_one(optimizer: nlopt.opt, functions: Functions) -> None:
    """Pass inequality constraints to an algorithm that takes only one at a time."""
    for row in range(functions.statement.inequalities.ids.size):
        optimizer.add_inequality_constraint(partial(functions.inequality, row), functions.statement.tolerance)


def _subsidiary(local_optimizer: Algorithm, settings: Settings, statement: Statement) -> nlopt.opt:
    """The inner optimizer."""
    optimizer = _bounded(local_optimizer, statement)
    settings.local_criteria.apply(optimizer)
    if settings.vector_storage:
        optimizer.set_vector_storage(settings.vector_storage)
    return optimizer


def _build(settings: Settings, functions: Functions) -> nlopt.opt:
    """The optimizer with everything but its seed."""
    optimizer = _bounded(settings.algorithm, functions.statement)
    optimizer.set_min_objective(functions.objective)
    constrain = _constrain_one_by_one if settings.algorithm.name == "GN_AGS" else _constrain
    constrain(optimizer, functions)
    settings.criteria.apply(optimizer)
    optimizer.set_maxtime(settings.maxtime)
    if settings.stopval is not None:
        optimizer.set_stopval(settings.stopval)
    if settings.initial_step is not None:
        optimizer.set_initial_step(settings.initial_step)
    if settings.population:
        optimizer.set_population(settings.population)
    if settings.vector_storage:
        optimizer.set_vector_storage(settings.vector_storage)
    for name, value in settings.parameters.items():
        optimizer.set_param(name, value)
    if settings.local_optimizer is not None:
        optimizer.set_local_optimizer(_subsidiary(settings.local_optimizer, settings, functions.statement))
    return optimizer


def _run(optimizer: nlopt.opt, functions: Functions, x: np.ndarray) -> str:
    """Run once and return how it ended; pass on what the model raises, even if NLopt drops it."""
    try:
        optimizer.optimize(x)
    except Exception:
        if functions.exception is None and optimizer.last_optimize_result() > 0:
            raise
    if isinstance(functions.exception, Stop):
        return str(functions.exception)
    if functions.exception is not None:
        raise functions.exception
    if optimizer.last_optimize_result() == nlopt.INVALID_ARGS:
        name = optimizer.get_algorithm_name()
        raise InputError(f"NLoptDriver: NLopt refuses to run {name}: {optimizer.get_errmsg() or 'invalid argument'}")
    return _CODES[optimizer.last_optimize_result()]


def _remaining(settings: Settings, n_evaluations: int, seconds: float) -> Settings:
    """Settings for the remaining budget, at least one evaluation, since zero means no limit."""
    maxeval, maxtime = settings.criteria.maxeval, settings.maxtime
    return replace(
        settings,
        criteria=replace(settings.criteria, maxeval=maxeval and max(maxeval - n_evaluations, 1)),
        maxtime=maxtime and max(maxtime - seconds, 1e-3),
    )


def _is_worth_restarting(end: str, functions: Functions, n_substituted: int, before: Point) -> bool:
    """Whether analyses failed, so the end may not be an optimum, and the last restart, if any, made progress."""
    is_near_failures = functions.n_substituted > n_substituted and end not in (
        *_SPENT,
        "STOPVAL_REACHED",
        "FORCED_STOP",
    )
    return is_near_failures and functions.best is not before


def _judged(end: str, settings: Settings, functions: Functions, n_restarts: int) -> Outcome:
    """End of a run, corrected by the gradients if NLopt's own says nothing about the point."""
    is_stuck = end in ("ROUNDOFF_LIMITED", "FAILURE")
    is_open = is_stuck or (end in _CONVERGED and end != "STOPVAL_REACHED")
    if settings.algorithm.is_global or not settings.uses_gradients or not is_open:
        return Outcome(end, n_restarts)
    optimality, is_feasible = functions.optimality(), functions.best.violation <= functions.statement.tolerance
    if is_stuck and is_feasible and optimality < OPTIMAL:
        end = "OPTIMAL"
    elif not is_stuck and functions.n_substituted > 0 and optimality > BLOCKED:
        end = "BLOCKED"
    elif not is_stuck and is_feasible and optimality > max(STALLED, _coarseness(settings, functions.best) ** 0.5):
        end = "STALLED"
    return Outcome(end, n_restarts, optimality)


def _coarseness(settings: Settings, best: Point) -> float:
    """Relative change of the objective that counts as zero."""
    criteria = settings.criteria
    return max(criteria.ftol_rel, criteria.ftol_abs / max(abs(best.objective), criteria.ftol_abs, TINY))


def minimise(
    settings: Settings,  # the algorithm and when it stops
    functions: Functions,  # the problem; its ``best`` is the result
) -> Outcome:  # the end of the run
    """Minimise, restarting from the best point if a local search has ended too early."""
    # Reasons are failed analyses or, for MMA and CCSAQ, an infeasible start.
    nlopt.srand_time() if settings.seed is None else nlopt.srand(settings.seed)
    began, x = time.perf_counter(), functions.start.x.copy()
    n_evaluations = n_restarts = 0
    while True:
        n_substituted, before = functions.n_substituted, functions.best
        optimizer = _build(_remaining(settings, n_evaluations, time.perf_counter() - began), functions)
        end = _run(optimizer, functions, x)
        n_evaluations += optimizer.get_numevals()
        is_last = settings.algorithm.is_global or n_restarts == settings.restarts
        if is_last or not _is_worth_restarting(end, functions, n_substituted, before):
            outcome = _judged(end, settings, functions, n_restarts)
            if is_last or outcome.end != "STALLED" or functions.best is before:
                return outcome
        x = functions.restart()
        n_restarts += 1
