"""OpenMDAO driver for all algorithms of NLopt."""

from functools import partial

import numpy as np
from openmdao.core.driver import Driver

from ...errors import InputError
from .foresight import Blind, Conservative, Foresight, Sequential
from .nlopt_algorithms import ALGORITHMS, Needs
from .nlopt_functions import Functions
from .nlopt_optimizer import ENDS, Outcome, Settings, minimise
from .nlopt_options import declare_options, make_settings
from .nlopt_problem import Limits, Point, Statement
from .recovery import RECOVERIES
from .scaled_model import ScaledModel

__all__ = ["NLoptDriver"]

CITATION = """
@misc{NLopt,
  author = {Steven G. Johnson},
  title = {The {NLopt} nonlinear-optimization package},
  year = {2007},
  howpublished = {https://github.com/stevengj/nlopt},
}
"""


def _needs(model: ScaledModel, designs: tuple[Limits, ...], constraints: tuple[Limits, ...]) -> Needs:
    """What the problem asks of an algorithm."""
    is_equality = {limits.name: not np.isnan(limits.equals).all() for limits in constraints}
    return Needs(
        n_variables=sum(limits.lower.size for limits in designs),
        inequality=tuple(name for name, is_equal in is_equality.items() if not is_equal),
        equality=tuple(name for name, is_equal in is_equality.items() if is_equal),
        bounded=tuple(d.name for d in designs if np.isfinite(d.lower).any() or np.isfinite(d.upper).any()),
        unbounded=tuple(d.name for d in designs if not (np.isfinite(d.lower).all() and np.isfinite(d.upper).all())),
        has_derivatives=model.has_derivatives,
    )


class NLoptDriver(Driver):
    """Optimise with any algorithm of NLopt.

    After the run the model is at the best point found: the one of lowest objective among those that violate no
    constraint by more than ``constraint_tolerance``, or the one of least violation if there are none. An end that is
    infeasible, is stopped from outside or leaves a local search without convergence is reported as failure. An
    exception that is no ``om.AnalysisError`` passes through, with a note of the best point (Python 3.11 on), which
    stays in ``best``; the design variables are set to it.

    Options are those of NLopt in scaled variables; zero switches a stopping criterion off.

    Parameters
    ----------
    **kwargs : dict
        Options of the driver.

    Attributes
    ----------
    outcome : Outcome or None
        How the last run ended.
    best : Point or None
        The best point of the last run so far, in scaled variables: kept from the first point on, whatever ends the run.
    n_failed_analyses : int
        Number of analyses that failed in the last run.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import NLoptDriver
    >>> prob = om.Problem(reports=None)
    >>> _ = prob.model.add_subsystem("paraboloid", om.ExecComp("f = (x - 3)**2 + x*y + (y + 4)**2 - 3"), promotes=["*"])
    >>> prob.model.add_design_var("x", lower=-50, upper=50)
    >>> prob.model.add_design_var("y", lower=-50, upper=50)
    >>> prob.model.add_objective("f")
    >>> prob.driver = NLoptDriver(optimizer="LD_MMA", disp=False)
    >>> _ = prob.setup()
    >>> prob.run_driver().success
    True
    >>> print(f"{prob.get_val('x').item():.2f} {prob.get_val('y').item():.2f}")
    6.67 -7.33
    """

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for feature in ("optimization", "two_sided_constraints", "linear_constraints", "simultaneous_derivatives"):
            self.supports[feature] = True
        for feature in ("multiple_objectives", "active_set", "integer_design_vars", "distributed_design_vars"):
            self.supports[feature] = False
        self.supports._read_only = True
        self._total_jac_format = "array"
        self.outcome: Outcome | None = None
        self.best: Point | None = None
        self.n_failed_analyses = 0
        self.cite = CITATION

    def _declare_options(self):
        """Declare the options of this driver."""
        declare_options(self.options)

    def _get_name(self) -> str:
        """Name of the driver in records and reports."""
        return f"NLopt_{self.options['optimizer']}"

    def _setup_driver(self, problem):
        """Say what the algorithm supports, before OpenMDAO checks it."""
        super()._setup_driver(problem)
        algorithm = ALGORITHMS[self.options["optimizer"]]
        local_optimizer = ALGORITHMS.get(self.options["local_optimizer"], algorithm)
        self.supports._read_only = False
        self.supports["gradients"] = algorithm.gradients or local_optimizer.gradients
        self.supports["inequality_constraints"] = algorithm.inequality
        self.supports["equality_constraints"] = algorithm.equality
        self.supports._read_only = True
        if len(self._objs) > 1:
            raise InputError(
                f"NLoptDriver: one objective is needed, and there are {len(self._objs)}: {list(self._objs)}"
            )

    def run(self) -> bool:
        """Optimise.

        Returns
        -------
        bool
            True if it failed.
        """
        self.result.reset()
        self.iter_count, self.outcome, self.best, self.n_failed_analyses = 0, None, None, 0
        model = ScaledModel(self)
        designs, constraints = model.design_limits(), model.constraint_limits()
        settings = make_settings(self.options, _needs(model, designs, constraints))
        statement = Statement.of(designs, constraints, self.options["constraint_tolerance"])
        functions = self._functions(model, statement, settings)
        try:
            self.outcome = _minimise(settings, functions)
            functions.settle()
        except BaseException as error:
            self.outcome, self.best = None, functions.best
            model.place(self.best.x)
            self._report_exception(error)
            raise
        self.best, self.n_failed_analyses = functions.best, functions.n_failed
        fail = not (self.outcome.is_success(settings.algorithm) and self.is_feasible)
        self._report(fail)
        return fail

    def _functions(self, model: ScaledModel, statement: Statement, settings: Settings) -> Functions:
        """The functions for NLopt, after the first run of the model."""
        x, *responses = model.start()
        within = np.clip(x, statement.lower, statement.upper)
        start = statement.point(within, *(responses if np.array_equal(x, within) else model.run(within)))
        recover, foresee = RECOVERIES[settings.algorithm.recovery], partial(_foresee, settings, statement.tolerance)
        log = IterationLog(settings.uses_gradients, self.options["disp"])
        log.add(start, start, None)
        self.best = start

        def watch(functions: Functions, norm: float | None):
            self.best, self.n_failed_analyses = functions.best, functions.n_failed
            log.add(functions.last, functions.best, norm)

        return Functions(model, statement, recover, foresee, start, watch)

    @property
    def is_feasible(self) -> bool:
        """Whether the best point of the last run satisfies all constraints."""
        return self.best is not None and self.best.violation <= self.options["constraint_tolerance"]

    def get_exit_status(self) -> str:
        """How the last run ended, in words."""
        if self.outcome is None:
            status = "NOT_FINISHED: the run ended in an exception"
            return status if self.best is None else f"{status}; {self._best_in_words()}"
        status = f"{self.outcome.end}: {ENDS[self.outcome.end]}"
        if not self.is_feasible:
            status += f", and constraints are violated by up to {self.best.violation:.1e}"
        if self.n_failed_analyses:
            status += f"; {self.n_failed_analyses} analyses failed, {self.outcome.n_restarts} restarts"
        return status

    def _best_in_words(self) -> str:
        """Name the best point, for a run that did not end by itself."""
        limits = "is feasible" if self.is_feasible else f"violates constraints by up to {self.best.violation:.1e}"
        return (
            f"the best design so far has objective {self.best.objective:.10g} (scaled) and {limits}; it is kept in "
            f"driver.best, and the design variables are set to it: run_model() gives its outputs"
        )

    def _report_exception(self, error: BaseException) -> None:
        """Name the best point in an exception that ends the run."""
        if hasattr(error, "add_note"):
            error.add_note(f"NLoptDriver: {self._best_in_words()}")
        if self.options["disp"]:
            print(f"Optimization FAILED ({self.options['optimizer']})\n    {self.get_exit_status()}")

    def _report(self, fail: bool) -> None:
        """Print how the run ended."""
        if self.options["disp"]:
            print(f"Optimization {'FAILED' if fail else 'complete'} ({self.options['optimizer']})")
            print(f"    {self.get_exit_status()}")
            print(f"    objective {self.best.objective:.10g} (scaled), {self.result.model_evals} model runs, ", end="")
            print(f"{self.result.deriv_evals} total derivatives")


class IterationLog:
    """Table of a run, a line as soon as it is known.

    A line is a point at which totals were computed or, without gradients, one that is better than all before it.

    Parameters
    ----------
    has_gradients : bool
        Whether the algorithm uses gradients.
    is_shown : bool
        Whether to print anything.
    """

    def __init__(self, has_gradients: bool, is_shown: bool):
        self._has_gradients, self._is_shown = has_gradients, is_shown
        self._n_lines, self._n_runs, self._best = 0, 0, None

    def add(self, last: Point, best: Point, norm: float | None) -> None:
        """Take note of a run of the model, or of the norm of the gradient of the objective at the last point."""
        self._n_runs += norm is None
        is_line = norm is not None if self._has_gradients else best is not self._best
        self._best = best
        if not (is_line and self._is_shown):
            return
        if self._n_lines == 0:
            print(f"{'iteration':>9} {'runs':>6} {'objective':>18} {'violation':>10} {'gradient':>10}  (scaled)")
        self._n_lines += 1
        shown = "" if norm is None else f"{norm:10.3e}"
        line = f"{self._n_lines:9d} {self._n_runs:6d} {last.objective:18.10e} {last.violation:10.3e} {shown}"
        print(line.rstrip(), flush=True)


def _foresee(settings: Settings, tolerance: float) -> Foresight:
    """What can be foreseen of the algorithm."""
    if settings.algorithm.name == "LD_SLSQP":
        return Sequential(settings.criteria.ftol_rel, settings.criteria.ftol_abs, tolerance)
    return Conservative() if settings.algorithm.name in ("LD_MMA", "LD_CCSAQ") else Blind()


def _minimise(settings: Settings, functions: Functions) -> Outcome:
    """Minimise; an interrupt from the keyboard ends it in good order."""
    try:
        return minimise(settings, functions)
    except KeyboardInterrupt:
        return Outcome("INTERRUPTED")
