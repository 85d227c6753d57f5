"""OpenMDAO driver for all algorithms of NLopt, with its options.

Theory: ``docs/theory/drivers.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver

from ....base.numerics.processes import from_first
from ....base.numerics.progress import Progress, progress_bar
from ....errors import InputError
from .broadcast_model import BroadcastModel, run_broadcast
from .familiar_options import translated
from .kept_design import KeptDesign
from .nlopt_algorithms import ALGORITHMS, Algorithm, Needs, find_algorithm
from .nlopt_functions import Functions
from .nlopt_optimizer import ENDS, Criteria, Outcome, Settings, minimise
from .nlopt_options import declare_options
from .nlopt_problem import AnalysisFailed, Limits, Point, Statement
from .nlopt_rules import RECOVERIES, AlgorithmRules, ConservativeRules, LineSearchRules, NoRules
from .scaled_model import ScaledModel
from .short_records import ShortRecords

__all__ = ["NLoptDriver", "make_settings"]


CITATION = """
@misc{NLopt,
  author = {Steven G. Johnson},
  title = {The {NLopt} nonlinear-optimization package},
  year = {2007},
  howpublished = {https://github.com/stevengj/nlopt},
}
"""


class NLoptDriver(KeptDesign, ShortRecords, Driver):
    """Optimise with any algorithm of NLopt.

    After the run the model is at the best point found: the lowest objective among points that violate no constraint by
    more than ``constraint_tolerance``, or the smallest violation if there are none. A run that ends infeasible, is
    stopped from outside, or is a local search without convergence is reported as a failure. Exceptions other than
    ``om.AnalysisError`` are passed on with a note of the best point (from Python 3.11). The best point stays in
    ``best``, and the design variables are set to it.

    Options are NLopt's, in scaled variables; zero disables a stopping criterion. Options of OpenMDAO's
    ``ScipyOptimizeDriver`` are accepted too: ``tol``, ``maxiter``, ``disp`` and the dictionary ``opt_settings``, where
    ``ftol``, ``maxfun`` and others mean the same as in SciPy; an option without a counterpart is an error.

    Recorders of the driver and of its problem leave out variables of more than 10,000 values, such as grids, unless
    ``recording_options["includes"]`` names them.

    Parameters
    ----------
    **kwargs : dict
        Options of the driver.

    Attributes
    ----------
    opt_settings : dict
        More options by the driver's names or by SciPy's, read when the run begins; they override ``options``.
    outcome : Outcome or None
        The end of the last run.
    best : Point or None
        The best point of the last run so far, see `bspline_mdao.core.om.drivers.kept_design`.
    n_failed_analyses, n_failed_gradients : int
        Number of failed analyses in the last run, and how many of them failed in computing totals.

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

    def __init__(self, **kwargs: Any):
        super().__init__(**kwargs)
        for feature in ("optimization", "two_sided_constraints", "linear_constraints", "simultaneous_derivatives"):
            self.supports[feature] = True
        for feature in ("multiple_objectives", "active_set", "integer_design_vars", "distributed_design_vars"):
            self.supports[feature] = False
        self.supports._read_only = True
        self._total_jac_format = "array"
        self.opt_settings: dict = {}
        self.outcome: Outcome | None = None
        self.n_failed_analyses = self.n_failed_gradients = 0
        self._last_failure = ""
        self.cite = CITATION

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(  # type: ignore[misc]
            self,
            *,
            optimizer: Literal[
                "LD_SLSQP",
                "LD_MMA",
                "LD_CCSAQ",
                "LD_LBFGS",
                "LD_LBFGS_NOCEDAL",
                "LD_VAR1",
                "LD_VAR2",
                "LD_TNEWTON",
                "LD_TNEWTON_RESTART",
                "LD_TNEWTON_PRECOND",
                "LD_TNEWTON_PRECOND_RESTART",
                "AUGLAG",
                "AUGLAG_EQ",
                "LD_AUGLAG",
                "LD_AUGLAG_EQ",
                "LN_AUGLAG",
                "LN_AUGLAG_EQ",
                "LN_COBYLA",
                "LN_BOBYQA",
                "LN_NEWUOA",
                "LN_NEWUOA_BOUND",
                "LN_PRAXIS",
                "LN_NELDERMEAD",
                "LN_SBPLX",
                "G_MLSL",
                "G_MLSL_LDS",
                "GD_MLSL",
                "GD_MLSL_LDS",
                "GN_MLSL",
                "GN_MLSL_LDS",
                "GD_STOGO",
                "GD_STOGO_RAND",
                "GN_DIRECT",
                "GN_DIRECT_L",
                "GN_DIRECT_L_RAND",
                "GN_DIRECT_NOSCAL",
                "GN_DIRECT_L_NOSCAL",
                "GN_DIRECT_L_RAND_NOSCAL",
                "GN_ORIG_DIRECT",
                "GN_ORIG_DIRECT_L",
                "GN_CRS2_LM",
                "GN_ISRES",
                "GN_ESCH",
                "GN_AGS",
            ] = "LD_SLSQP",
            local_optimizer: Literal[
                "LD_SLSQP",
                "LD_MMA",
                "LD_CCSAQ",
                "LD_LBFGS",
                "LD_LBFGS_NOCEDAL",
                "LD_VAR1",
                "LD_VAR2",
                "LD_TNEWTON",
                "LD_TNEWTON_RESTART",
                "LD_TNEWTON_PRECOND",
                "LD_TNEWTON_PRECOND_RESTART",
                "LN_COBYLA",
                "LN_BOBYQA",
                "LN_NEWUOA",
                "LN_NEWUOA_BOUND",
                "LN_PRAXIS",
                "LN_NELDERMEAD",
                "LN_SBPLX",
            ]
            | None = None,
            ftol_rel: float = 1e-09,
            ftol_abs: float = 0.0,
            xtol_rel: float = 0.0,
            xtol_abs: float | np.ndarray = 0.0,
            stopval: float | None = None,
            tol: float | None = None,
            maxiter: int | None = None,
            maxeval: int = 1000,
            maxtime: float = 0.0,
            constraint_tolerance: float = 1e-06,
            local_ftol_rel: float = 1e-09,
            local_xtol_rel: float = 1e-09,
            local_ftol_abs: float = 0.0,
            local_xtol_abs: float = 0.0,
            local_maxeval: int = 0,
            initial_step: float | np.ndarray | None = None,
            population: int = 0,
            vector_storage: int = 0,
            seed: int | None = 0,
            parameters: dict[str, float] = {},  # noqa: B006
            restarts: int = 5,
            disp: bool = True,
            singular_jac_behavior: Literal["error", "warn", "ignore"] = "warn",
            singular_jac_tol: float = 1e-16,
            **options: Any,
        ) -> None: ...

    def _declare_options(self) -> None:
        """Declare the options of this driver."""
        declare_options(self.options)

    def _get_name(self) -> str:
        """Name of the driver in records and reports."""
        return f"NLopt_{self.options['optimizer']}"

    def _setup_driver(self, problem: om.Problem) -> None:
        """Declare the capabilities of the algorithm before OpenMDAO checks them."""
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
        """Optimise, and leave the model at the best point.

        Returns
        -------
        bool
            True if it failed.
        """
        self.result.reset()
        self.iter_count, self.outcome, self.best = 0, None, None
        self.n_failed_analyses = self.n_failed_gradients = 0
        self._last_failure = ""
        model = ScaledModel(self)
        designs, constraints = model.design_limits(), model.constraint_limits()
        self._adopt_settings()
        settings = make_settings(self.options, _needs(model, designs, constraints))
        statement = Statement.of(designs, constraints, self.options["constraint_tolerance"])

        def optimise(model: ScaledModel | BroadcastModel) -> tuple[Outcome, Point, int, int, str]:
            with progress_bar(self._get_name()) as report:
                return self._optimise(model, statement, settings, report)

        comm = self._problem().comm
        try:
            self.outcome, self.best, *counts, self._last_failure = run_broadcast(comm, model, optimise)
            self.n_failed_analyses, self.n_failed_gradients = counts
        except Exception:
            found = self.best, self.n_failed_analyses, self.n_failed_gradients
            self.best, self.n_failed_analyses, self.n_failed_gradients = from_first(comm, found)
            raise
        fail = not (self.outcome.is_success(settings.algorithm) and self.is_feasible)
        if comm.rank == 0:
            self._report(fail, self.best)
        return fail

    def _adopt_settings(self) -> None:
        """Set options from ``opt_settings``."""
        for name, value in translated(self.opt_settings, [name for name, _ in self.options.items()]).items():
            self.options[name] = value

    def _optimise(
        self, model: ScaledModel | BroadcastModel, statement: Statement, settings: Settings, report: Progress
    ) -> tuple[Outcome, Point, int, int, str]:
        """End of the run, the best point, at which the model is left, the numbers of failures, and the last failure."""
        functions = self._functions(model, statement, settings, report)
        try:
            outcome = _minimise(settings, functions)
            functions.restore_best()
        except BaseException as error:
            self.outcome, self.best = None, functions.best
            model.place(functions.best.x)
            self._report_exception(error, functions.best)
            raise
        return outcome, functions.best, functions.n_failed, functions.n_failed_gradients, functions.last_failure

    def _functions(
        self, model: ScaledModel | BroadcastModel, statement: Statement, settings: Settings, report: Progress
    ) -> Functions:
        """The functions for NLopt, after the first run of the model."""
        x, objective, constraints = model.start()
        within = np.clip(x, statement.lower, statement.upper)
        if not np.array_equal(x, within):
            objective, constraints = _responses_within(model, within)
        start = statement.point(within, objective, constraints)
        recover, make_rules = RECOVERIES[settings.algorithm.recovery], partial(_rules_of, settings, statement.tolerance)
        log = IterationLog(settings.uses_gradients, self.options["disp"])
        log.add(start, start, None)
        self.best = start

        def watch(functions: Functions, totals: np.ndarray | None) -> None:
            self.best, self.n_failed_analyses = functions.best, functions.n_failed
            self.n_failed_gradients, self._last_failure = functions.n_failed_gradients, functions.last_failure
            residual = None if totals is None else partial(functions.residual, functions.last, totals)
            log.add(functions.last, functions.best, residual)
            report(-1.0, f"run {self.iter_count}, best objective {functions.best.objective:.6g}")

        return Functions(model, statement, recover, make_rules, start, watch, settings.maxiter)

    @property
    def largest_violation(self) -> float:
        """Scaled violation up to which constraints count as satisfied."""
        return self.options["constraint_tolerance"]

    @property
    def is_interrupted(self) -> bool:
        """Whether the last run was interrupted from the keyboard and ended cleanly."""
        return self.outcome is not None and self.outcome.end == "INTERRUPTED"

    def get_exit_status(self) -> str:
        """Describe the end of the last run in words."""
        if self.outcome is None or self.best is None:
            status = "NOT_FINISHED: the run ended in an exception"
            return status if self.best is None else f"{status}; {self.best_in_words(self.best)}"
        status = f"{self.outcome.end}: {ENDS[self.outcome.end]}"
        if self.outcome.optimality is not None:
            status += f"; first-order residual {self.outcome.optimality:.1e} of the largest gradient"
        if not self.is_feasible:
            status += f", and constraints are violated by up to {self.best.violation:.1e}"
        if self.n_failed_analyses:
            gradients = f" ({self.n_failed_gradients} of them in gradients)" if self.n_failed_gradients else ""
            status += f"; {self.n_failed_analyses} analyses failed{gradients}, {self.outcome.n_restarts} restarts"
            status += f"; the last failure: {self._last_failure.partition(chr(10))[0]}" if self._last_failure else ""
        return status

    def _report_exception(self, error: BaseException, best: Point) -> None:
        """Name the best point in an exception that ends the run."""
        self.add_best_to(error, best)
        if self.options["disp"]:
            print(f"Optimization FAILED ({self.options['optimizer']})\n    {self.get_exit_status()}")

    def _report(self, fail: bool, best: Point) -> None:
        """Print how the run ended."""
        if self.options["disp"]:
            is_stopped = self.outcome is not None and self.outcome.is_stopped and self.is_feasible
            how = "complete" if not fail else "stopped" if is_stopped else "FAILED"
            print(f"Optimization {how} ({self.options['optimizer']})")
            print(f"    {self.get_exit_status()}")
            print(f"    objective {best.objective:.10g} (scaled), {self.result.model_evals} model runs, ", end="")
            print(f"{self.result.deriv_evals} total derivatives")


def _responses_within(model: ScaledModel | BroadcastModel, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Objective and constraints at the start after moving it within bounds; no optimisation begins if this fails."""
    try:
        return model.run(x)
    except AnalysisFailed as error:
        raise om.AnalysisError(f"at the start, which was brought within its bounds: {error}") from error


def _needs(model: ScaledModel, designs: tuple[Limits, ...], constraints: tuple[Limits, ...]) -> Needs:
    """The problem's requirements of an algorithm."""
    is_equality = {limits.name: not np.isnan(limits.equals).all() for limits in constraints}
    return Needs(
        n_variables=sum(limits.lower.size for limits in designs),
        inequality=tuple(name for name, is_equal in is_equality.items() if not is_equal),
        equality=tuple(name for name, is_equal in is_equality.items() if is_equal),
        bounded=tuple(d.name for d in designs if np.isfinite(d.lower).any() or np.isfinite(d.upper).any()),
        unbounded=tuple(d.name for d in designs if not (np.isfinite(d.lower).all() and np.isfinite(d.upper).all())),
        has_derivatives=model.has_derivatives,
    )


def _rules_of(settings: Settings, tolerance: float) -> AlgorithmRules:
    """Rules of the algorithm, if any are used."""
    if settings.algorithm.name == "LD_SLSQP":
        return LineSearchRules(settings.criteria.ftol_rel, settings.criteria.ftol_abs, tolerance)
    return ConservativeRules() if settings.algorithm.name in ("LD_MMA", "LD_CCSAQ") else NoRules()


def _minimise(settings: Settings, functions: Functions) -> Outcome:
    """Minimise; a keyboard interrupt ends it cleanly."""
    try:
        return minimise(settings, functions)
    except KeyboardInterrupt:
        return Outcome("INTERRUPTED")


class IterationLog:
    """Table of a run, printed line by line as it proceeds."""

    # Each line is a point where totals were computed or, without gradients, a point better than all earlier ones.

    def __init__(
        self,
        has_gradients: bool,  # whether the algorithm uses gradients
        is_printed: bool,  # whether to print anything
    ):
        self._has_gradients, self._is_printed = has_gradients, is_printed
        self._n_lines, self._n_runs = 0, 0
        self._best: Point | None = None

    def add(self, last: Point, best: Point, residual: Callable[[], float] | None) -> None:
        """Note a run of the model, or the first-order residual at the last point."""
        self._n_runs += residual is None
        is_line = residual is not None if self._has_gradients else best is not self._best
        self._best = best
        if not (is_line and self._is_printed):
            return
        if self._n_lines == 0:
            print(f"{'iteration':>9} {'runs':>6} {'objective':>18} {'violation':>10} {'optimality':>10}  (scaled)")
        self._n_lines += 1
        progress_bar = "" if residual is None else f"{residual():10.3e}"
        line = f"{self._n_lines:9d} {self._n_runs:6d} {last.objective:18.10e} {last.violation:10.3e} {progress_bar}"
        print(line.rstrip(), flush=True)


def make_settings(
    options: Mapping[str, Any],  # options by name, as declared by `declare_options`
    needs: Needs,  # requirements of the problem
) -> Settings:  # the algorithms and when they stop
    """Make the settings of a run from the options."""
    if needs.n_variables == 0:
        raise InputError("NLoptDriver: the problem has no design variables; add some to its model")
    algorithm = find_algorithm(options["optimizer"], needs)
    _require_end(algorithm, options)
    for name in ("xtol_abs", "initial_step"):
        _require_length(options, name, needs.n_variables)
    _require_gradients(algorithm, options)
    same = (
        "stopval",
        "maxiter",
        "maxtime",
        "initial_step",
        "population",
        "vector_storage",
        "seed",
        "parameters",
        "restarts",
    )
    return Settings(
        algorithm=algorithm,
        local_optimizer=_local_optimizer(algorithm, options, needs),
        criteria=_criteria(options),
        local_criteria=_criteria(options, "local_"),
        **{name: options[name] for name in same},
    )


def _criteria(options: Mapping[str, Any], prefix: str = "") -> Criteria:
    """Stopping criteria of the algorithm, or of the local one."""
    names = ("ftol_rel", "ftol_abs", "xtol_rel", "xtol_abs", "maxeval")
    criteria = Criteria(**{name: options[prefix + name] for name in names})
    is_given = options["tol"] is not None and not prefix
    return replace(criteria, ftol_abs=options["tol"], ftol_rel=0.0) if is_given else criteria


def _require_end(algorithm: Algorithm, options: Mapping[str, Any]) -> None:
    """Require a criterion that ends a global search."""
    if algorithm.is_global and not (options["maxeval"] or options["maxtime"] or options["stopval"] is not None):
        raise InputError(f"NLoptDriver: {algorithm.name} has no end; set maxeval, maxtime or stopval")


def _require_gradients(algorithm: Algorithm, options: Mapping[str, Any]) -> None:
    """Require gradients, by which iterations are counted."""
    local = ALGORITHMS.get(options["local_optimizer"], algorithm)
    if options["maxiter"] is not None and not (algorithm.gradients or local.gradients):
        raise InputError(
            f"NLoptDriver: {algorithm.name} takes no gradients, by which iterations are counted; set maxeval instead "
            f"of maxiter"
        )


def _require_length(options: Mapping[str, Any], name: str, n_variables: int) -> None:
    """Require one number, or one for every variable."""
    if options[name] is not None and np.size(options[name]) not in (1, n_variables):
        raise InputError(
            f"NLoptDriver: option {name} has {np.size(options[name])} values; give one, or one for each of the"
            f" {n_variables} design variables"
        )


def _local_optimizer(algorithm: Algorithm, options: Mapping[str, Any], needs: Needs) -> Algorithm | None:
    """The algorithm to run inside, or None for NLopt's choice or if there is none."""
    name = options["local_optimizer"]
    if algorithm.local_optimizer == "none" and name is not None:
        raise InputError(f"NLoptDriver: {algorithm.name} runs no other algorithm; leave local_optimizer out")
    if algorithm.local_optimizer == "needed" and name is None:
        raise InputError(
            f"NLoptDriver: {algorithm.name} needs a local_optimizer, such as LD_LBFGS, LD_MMA or LN_BOBYQA"
        )
    return name and find_algorithm(name, needs.of_subsidiary(algorithm), is_subsidiary=True)
