"""What the optimisations share: both drivers on one problem, and what they cost."""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import openmdao.api as om
from history import Course, Scaling, read_course, read_history
from openmdao.core.driver import Driver
from threadpoolctl import threadpool_limits

from bspline_mdao import NLoptDriver
from bspline_mdao.om.drivers.optimality import optimality
from bspline_mdao.om.drivers.scaled_model import ScaledModel

TIMED = ("compute", "compute_partials", "compute_jacvec_product")
TIMED += ("solve_nonlinear", "linearize", "apply_linear", "solve_linear")
"""Methods of components whose time counts."""

QUIET = {"disp": False, "singular_jac_behavior": "ignore"}
"""Options of all drivers. Symmetry makes some derivatives zero at the start; idle variables are refused elsewhere."""


def scipy_slsqp(tolerance: float, max_iterations: int) -> Driver:
    """Give SciPy's SLSQP by OpenMDAO's own driver; it ends where the objective changes by less than the tolerance."""
    return om.ScipyOptimizeDriver(optimizer="SLSQP", tol=tolerance, maxiter=max_iterations, **QUIET)


def nlopt(algorithm: str, tolerance: float, max_iterations: int) -> Driver:
    """Give an algorithm of NLopt; it ends where the objective changes by less than the tolerance, constraints met."""
    violation = max(1e-8, 0.1 * tolerance)
    stop = {"ftol_abs": tolerance, "ftol_rel": 0.0, "maxeval": 3 * max_iterations}
    return NLoptDriver(optimizer=algorithm, constraint_tolerance=violation, **stop, **QUIET)


Drivers = dict[str, Callable[[float, int], Driver]]
"""Makers of drivers by name, given the tolerance of the objective and the largest number of iterations."""

DRIVERS: Drivers = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": partial(nlopt, "LD_SLSQP")}
"""Those of the problems with constraints."""

UNCONSTRAINED: Drivers = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_LBFGS": partial(nlopt, "LD_LBFGS")}
"""Those of problems with many variables and no constraint: SLSQP of NLopt spends most of the time on itself there."""


@dataclass(frozen=True, eq=False)
class Run:
    """An optimisation that has ended.

    Parameters
    ----------
    problem : om.Problem
        At the optimum.
    history : dict of ndarray
        Objective and constraints by name, one row per evaluation, as the model gives them.
    seconds : dict of float
        Wall time by component, and of the ``rest``: OpenMDAO and the optimizer.
    initial_gradient : float
        Norm of the objective's gradient at the start, as the driver sees it.
    course : Course
        Optimality and violations on the way.
    """

    problem: om.Problem
    history: dict[str, np.ndarray]
    seconds: dict[str, float]
    initial_gradient: float
    course: Course

    def numbers(self) -> dict:
        """What a run script tells of it."""
        result, total = self.problem.driver.result, sum(self.seconds.values())
        counts = {"evaluations": result.model_evals, "gradients": result.deriv_evals}  # before one more gradient
        residual, violation = optimality_of(self.problem)
        return {
            "success": bool(result.success),
            "exit_status": str(result.exit_status),
            **counts,
            "objective": self.problem.driver.get_objective_values(driver_scaling=False).popitem()[1].item(),
            "optimality": residual / self.initial_gradient,
            "violation": violation,
            "seconds": total,
            "shares": {name: seconds / total for name, seconds in self.seconds.items()},
        }


def optimise(make_problem: Callable[[], om.Problem], driver: Driver, cases: Path | None = None) -> Run:
    """Run a problem, not yet set up, with a driver.

    Parameters
    ----------
    make_problem : callable
        Makes the problem.
    driver : Driver
        The driver.
    cases : path-like, optional
        File of the recorded cases, which is kept; a temporary one by default.
    """
    problem = make_problem()
    problem.driver = driver
    problem.options["group_by_pre_opt_post"] = True  # what no design variable reaches runs once
    with tempfile.TemporaryDirectory() as folder:
        file = Path(cases or Path(folder) / "cases.sql")
        record(driver, file)
        problem.setup(mode="rev")
        problem.run_model()
        gradient = problem.compute_totals(driver_scaling=True, return_format="array")[0]
        seconds = time_components(problem)
        start = time.perf_counter()
        with threadpool_limits(1, "blas"):  # dense algebra of a few hundred variables is no work for many threads
            problem.run_driver()
        seconds["rest"] = time.perf_counter() - start - sum(seconds.values())
        problem.cleanup()
        history, course = read_history(file), read_course(problem, file)
    return Run(problem, history, dict(seconds), float(np.linalg.norm(gradient)), course)


def record(driver: Driver, file: Path) -> None:
    """Record every evaluation and every gradient of a driver in a file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    driver.add_recorder(om.SqliteRecorder(file, record_viewer_data=False))
    driver.recording_options["record_derivatives"] = True


def time_components(problem: om.Problem) -> dict[str, float]:
    """Wall time spent in every component from now on, by its name (s)."""
    seconds = {}
    for component in problem.model.system_iter(recurse=True, typ=(om.ExplicitComponent, om.ImplicitComponent)):
        if not component.name.startswith("_auto_ivc"):
            seconds[component.name] = 0.0
            for name in TIMED:
                if hasattr(component, name):
                    setattr(component, name, _timed(getattr(component, name), seconds, component.name))
    return seconds


def _timed(method, seconds: dict[str, float], name: str):
    """A method whose time is added up."""

    @functools.wraps(method)
    def run(*args, **kwargs):
        start = time.perf_counter()
        try:
            return method(*args, **kwargs)
        finally:
            seconds[name] += time.perf_counter() - start

    return run


def optimality_of(problem: om.Problem) -> tuple[float, float]:
    """Residual of the first-order conditions of an optimum, and the largest violation, in units of the driver."""
    model, statement = ScaledModel(problem.driver), Scaling.of(problem).statement
    point = statement.point(*model.present())
    return optimality(statement, point, model.differentiate()), point.violation


def set_up(problem: om.Problem) -> om.Problem:
    """Set a problem up, for reverse derivatives, and run it."""
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def write_n2(problem: om.Problem, folder: Path, name: str) -> None:
    """Write the N2 diagram of a problem as a page."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    om.n2(problem, outfile=str(Path(folder) / f"{name}.html"), show_browser=False, title=name.replace("_", " "))


def flow_in_one(found: Run) -> dict:
    """Numbers of a run, the shares of the components of the flow added up."""
    numbers, flow = found.numbers(), {system.name for system in found.problem.model.flow.system_iter(recurse=True)}
    shares = {name: share for name, share in numbers["shares"].items() if name not in flow}
    shares["flow"] = sum(share for name, share in numbers["shares"].items() if name in flow)
    return numbers | {"shares": shares}
