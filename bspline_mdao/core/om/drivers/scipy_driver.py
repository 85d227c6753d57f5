"""SciPy's optimizers through OpenMDAO, surviving failed analyses and showing progress.

Theory: ``docs/theory/drivers.rst``, "Failed analyses".
"""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import openmdao.api as om

from ....base.numerics.progress import Progress, progress_bar
from .case_history import FEASIBLE
from .kept_design import KeptDesign
from .nlopt_problem import Point, Statement
from .nlopt_rules import SearchRecord, Substitute, uphill, worst
from .scaled_model import ScaledModel, derivative_at_fault, unusable_derivatives
from .short_records import ShortRecords

__all__ = ["ScipyDriver"]

RECOVERIES = {
    **dict.fromkeys(("L-BFGS-B", "TNC"), uphill),
    **dict.fromkeys(("SLSQP", "COBYLA", "COBYQA", "Nelder-Mead", "Powell", "differential_evolution"), worst),
}
"""What optimizers are given when an analysis fails. With any of these values the optimizers not listed end away from
the optimum (BFGS, CG, trust-constr), or do not call the driver as they should; failures pass through them."""


class ScipyDriver(KeptDesign, ShortRecords, om.ScipyOptimizeDriver):
    """SciPy's optimizers with a progress bar and shorter steps after failed analyses.

    This is OpenMDAO's ``ScipyOptimizeDriver`` with all its options. Where the original ends at the first
    ``om.AnalysisError``, this driver gives the optimizer a value that makes it take a shorter step, restores the model
    to the states of the last good run, and continues. This works with ``SLSQP``, ``L-BFGS-B``, ``TNC``, ``COBYLA``,
    ``COBYQA``, ``Nelder-Mead``, ``Powell`` and ``differential_evolution``; with other optimizers, and in the first run,
    a failure passes through. Failed derivatives end the search at the current point with a warning, except the first
    ones, which raise. `NLoptDriver` continues there, and also restarts from the best point when failures have ended a
    search.

    At the end the model is run at the point found by the optimizer, if it was last run elsewhere. A search that failed,
    or was interrupted from the keyboard, leaves the model at its best point: the lowest objective among points that
    violate no scaled constraint by more than ``constraint_tolerance``. Other exceptions pass through, with a note of
    the best point, to which the design variables are set. Records are short, like `NLoptDriver`'s.

    Parameters
    ----------
    **kwargs : dict
        Options of the driver.

    Attributes
    ----------
    n_failed_analyses : int
        Number of failed analyses in the last run.
    best : Point or None
        The best point of the last run so far, see `bspline_mdao.core.om.drivers.kept_design`.
    is_interrupted : bool
        Whether the last run was interrupted from the keyboard.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import ScipyDriver
    >>> problem = om.Problem(driver=ScipyDriver(optimizer="SLSQP", tol=1e-9, disp=False), reports=None)
    >>> _ = problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3)**2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-50, upper=50)
    >>> problem.model.add_objective("f")
    >>> _ = problem.setup()
    >>> problem.run_driver().success
    True
    >>> print(f"{problem.get_val('x').item():.3f}")
    3.000
    """

    def __init__(self, **kwargs: Any):
        super().__init__(**kwargs)
        self.n_failed_analyses = 0
        self._progress: Progress | None = None
        self._record: SearchRecord | None = None
        self._substitute: Substitute | None = None
        self._last = self._good_states = np.zeros(0)
        self._base_constraints: dict = {}
        self._n_gradients = 0
        self.is_interrupted = False
        self._model: ScaledModel | None = None
        self._statement: Statement | None = None
        self._exc_info: tuple | None = None

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(  # type: ignore[misc]
            self,
            *,
            optimizer: str = "SLSQP",
            tol: float = 1e-06,
            maxiter: int = 200,
            disp: int | bool = True,
            singular_jac_behavior: Literal["error", "warn", "ignore"] = "warn",
            singular_jac_tol: float = 1e-16,
            constraint_tolerance: float = 1e-06,
            **options: Any,
        ) -> None: ...

    @property
    def largest_violation(self) -> float:
        """Scaled violation up to which constraints count as satisfied."""
        return self.options["constraint_tolerance"]

    def _declare_options(self) -> None:
        """Declare the options."""
        super()._declare_options()
        self.options.declare(
            "constraint_tolerance",
            FEASIBLE,
            types=Real,
            lower=0.0,
            desc="Scaled violation up to which a constraint counts as satisfied: of flows, what residuals leave of it.",
        )

    def run(self) -> bool:
        """Optimise.

        Returns
        -------
        bool
            True if it failed.
        """
        self.n_failed_analyses, self._record, self._substitute, self._n_gradients = 0, None, None, 0
        self.best, self._statement, self.is_interrupted = None, None, False
        with progress_bar(self._get_name()) as report:
            self._progress = report
            try:
                self.fail = self._end_at_the_result(super().run())
            except _GradientError as error:  # no optimizer tries another step instead
                self.fail = True
                om.issue_warning(
                    f"{self._get_name()}: the search ended after {self.iter_count} runs, where derivatives failed; the "
                    f"model is left at the best point. {error}",
                    category=om.DriverWarning,
                )
                self._go_to_best()
            except KeyboardInterrupt:
                if self.best is None:
                    raise
                self.fail = self.is_interrupted = True
                self._last = np.zeros(0)  # an interrupted run leaves half of its states
                self._go_to_best()
            except Exception as error:
                if self.best is not None:
                    self._place_at_best()
                    self.add_best_to(error, self.best)
                raise
            finally:
                self._progress = None
        return self.fail

    def get_exit_status(self) -> str:
        """Describe the end of the last run in words."""
        return "INTERRUPTED" if self.is_interrupted else super().get_exit_status()

    def _objfunc(self, x_new: np.ndarray) -> float:
        """Objective at a point, or the value that makes the optimizer turn back if the analysis fails."""
        if self._record is None:
            self._begin()
        self._last = np.array(x_new, dtype=float)
        objective, self._substitute = super()._objfunc(x_new), None
        is_failed = self._exc_info is not None and issubclass(self._exc_info[0], om.AnalysisError)
        is_failed |= self._exc_info is None and not np.all(np.isfinite(objective))
        if is_failed and self.options["optimizer"] in RECOVERIES:
            objective, self._con_cache = self._turn_back(), self._base_constraints
        elif self._exc_info is None:
            objective = float(np.ravel(objective)[0])
            self._keep(objective)
        if self._progress is not None and self._record is not None:
            self._progress(-1.0, f"run {self.iter_count}, best objective {self._record.base.objective:.6g}")
        return objective

    def _gradfunc(self, x_new: np.ndarray) -> np.ndarray:
        """Gradient at a point whose analysis did not fail."""
        if self._substitute is not None:
            return self._substitute.totals[0]
        has_analysis = self._exc_info is None
        gradient, self._base_constraints = super()._gradfunc(x_new), self._con_cache
        if self._exc_info is None:
            self._require_derivatives()
        if has_analysis and self._exc_info is not None and self._n_gradients:
            self._end_where_derivatives_fail()
        self._n_gradients += 1
        if self._exc_info is None and self._record is not None and np.array_equal(self._last, self._record.base.x):
            self._record = self._record.with_totals(self._record.base, np.array(gradient, dtype=float)[None])
        return gradient

    def _end_where_derivatives_fail(self) -> None:
        """End the search here: some optimizers would go on without the derivatives."""
        assert self._exc_info is not None
        if issubclass(self._exc_info[0], om.AnalysisError):
            error = self._exc_info[1]
            self._exc_info = None
            raise _GradientError(error)

    def _require_derivatives(self) -> None:
        """Name the first derivative just computed that is not a finite number."""
        fault = derivative_at_fault(self, self._obj_and_nlcons, self._grad_cache)
        if fault and self._n_gradients:
            raise _GradientError(f"{fault} is not a finite number")
        if fault:
            raise unusable_derivatives(f"{fault} is not a finite number")

    def _begin(self) -> None:
        """Take the driver's first run as the first point."""
        self._model = ScaledModel(self)
        limits = self._model.design_limits(), self._model.constraint_limits()
        self._statement = Statement.of(*limits, self.largest_violation)
        self.best = self._statement.point(*self._model.present())
        if not (np.isfinite(self.best.objective) and np.isfinite(self.best.constraints).all()):
            self.best = None
            raise om.AnalysisError("the objective or a constraint at the start is not a finite number")
        self._record = SearchRecord.at(_point(self.best.x, self.best.objective))
        self._good_states, self._base_constraints = self._states().copy(), self._con_cache

    def _keep(self, objective: float) -> None:
        """Note a point."""
        assert self._record is not None
        self._record = self._record.with_point(_point(self._last, objective), 0.0)
        self._good_states[:] = self._states()
        assert self._model is not None
        assert self._statement is not None
        assert self.best is not None
        point = self._statement.point(*self._model.present())
        is_number = np.isfinite(point.objective) and np.isfinite(point.constraints).all()
        if is_number and point.is_better(self.best, self.largest_violation):
            self.best = point

    def _place_at_best(self) -> None:
        """Set the design variables to the best point, and the states to the last good point's."""
        assert self._model is not None
        assert self.best is not None
        self._states()[:] = self._good_states
        self._model.set(self.best.x)

    def _go_to_best(self) -> None:
        """Run the model at the best point, unless it was last run there."""
        assert self.best is not None
        if self._substitute is None and self._exc_info is None and np.array_equal(self._last, self.best.x):
            return
        self._exc_info, self._last = None, self.best.x
        self._states()[:] = self._good_states
        super()._objfunc(self.best.x)
        if self._exc_info is not None:
            self._reraise()

    def _turn_back(self) -> float:
        """Count a failure and restore the model; return the value for the optimizer."""
        assert self._record is not None
        self._exc_info = None
        self.n_failed_analyses += 1
        self._states()[:] = self._good_states
        self._substitute = RECOVERIES[self.options["optimizer"]](self._record, self._last)
        return self._substitute.objective

    def _states(self) -> np.ndarray:
        """All outputs of the model."""
        return self._problem().model._outputs.asarray()

    def _end_at_the_result(self, fail: bool) -> bool:
        """Run the model at the optimizer's end point, or at the best point if it failed; return whether it failed."""
        # A search in which every step failed ends next to the last good point, whatever it reports.
        found = np.asarray(getattr(self._scipy_optimize_result, "x", self._last), dtype=float)
        if self._record is None:
            return fail
        if not fail and (self._substitute is not None or not np.array_equal(found, self._last)):
            self._objfunc(found)
            if self._exc_info is not None:
                self._reraise()
            fail = self._substitute is not None
        if fail:
            self._go_to_best()
        return fail


class _GradientError(Exception):
    """Failure of derivatives at a point accepted by an optimizer."""


def _point(x: np.ndarray, objective: float) -> Point:
    """A point with its objective only: the optimizer keeps its own account of constraints."""
    return Point(x.copy(), objective, np.zeros(0), np.zeros(0))
