"""Optimisations that are recorded: how a driver went on, how near to an optimum it ended, and what took the time."""

from __future__ import annotations

import functools
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver
from threadpoolctl import threadpool_limits

from .case_history import Convergence, read_history
from .nlopt_driver import NLoptDriver
from .optimality import optimality_of
from .scaled_model import ScaledModel
from .scipy_driver import ScipyDriver

__all__ = [
    "RecordedRun",
    "disagreement",
    "nlopt",
    "optimise",
    "optimise_with",
    "run_at",
    "scipy_slsqp",
    "time_components",
]

TIMED = (
    *("compute", "compute_partials", "compute_jacvec_product"),
    *("solve_nonlinear", "linearize", "apply_linear", "solve_linear"),
)
"""Methods of components whose time counts."""

QUIET = {"disp": False, "singular_jac_behavior": "ignore"}
"""Options of all drivers. Symmetry makes some derivatives zero at the start; idle variables are refused elsewhere."""


def scipy_slsqp(
    tolerance: float,  # of the objective, in units of the driver
    max_iterations: int,  # largest number of iterations
) -> Driver:
    """Make SciPy's SLSQP, which ends where the objective changes by less than the tolerance; failures shorten steps."""
    return ScipyDriver(optimizer="SLSQP", tol=tolerance, maxiter=max_iterations, **QUIET)


def nlopt(tolerance: float, max_iterations: int, algorithm: str = "LD_SLSQP") -> Driver:
    """Make an algorithm of NLopt, which ends where the objective changes by less than the tolerance, constraints met.

    Parameters
    ----------
    tolerance : float
        Of the objective, in units of the driver; a tenth of it, but at least 1e-8, is allowed to constraints.
    max_iterations : int
        Largest number of iterations; three times as many evaluations.
    algorithm : str
        Its name, as `NLoptDriver` takes it.

    Returns
    -------
    NLoptDriver
    """
    violation = max(1e-8, 0.1 * tolerance)
    stop = {"ftol_abs": tolerance, "ftol_rel": 0.0, "maxeval": 3 * max_iterations}
    return NLoptDriver(optimizer=algorithm, constraint_tolerance=violation, **stop, **QUIET)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """An optimisation that has ended."""

    problem: om.Problem  # the problem at the optimum
    history: dict[str, np.ndarray]  # objective and constraints by name, one row per evaluation, as the model gives them
    seconds: dict[str, float]  # wall time by component, and of the ``rest``: OpenMDAO and the optimizer
    initial_gradient: float  # norm of the objective's gradient at the start, as the driver sees it
    convergence: Convergence  # optimality and violations on the way

    def numbers(
        self,
        flow: str | None = None,  # name of a group of the model whose components count as one in ``shares``
    ) -> dict:
        """Summarise the optimisation."""
        # Returns ``success``, ``exit_status``, ``evaluations``, ``gradients``, the ``objective`` as the model gives it,
        # ``optimality``, the residual of the first-order conditions relative to the first gradient of the objective,
        # the largest ``violation`` in units of the driver, ``seconds`` of wall time and the ``shares`` of components.
        result, total = self.problem.driver.result, sum(self.seconds.values())
        counts = {"evaluations": result.model_evals, "gradients": result.deriv_evals}  # before one more gradient
        residual, violation = optimality_of(self.problem)
        shares = {name: seconds / total for name, seconds in self.seconds.items()}
        if flow is not None:
            parts = {part.name for part in getattr(self.problem.model, flow).system_iter(recurse=True)}
            total_share = sum(share for name, share in shares.items() if name in parts)
            shares = {name: share for name, share in shares.items() if name not in parts} | {flow: total_share}
        return {
            "success": bool(result.success),
            "exit_status": str(result.exit_status),
            **counts,
            "objective": self.problem.driver.get_objective_values(driver_scaling=False).popitem()[1].item(),
            "optimality": residual / self.initial_gradient,
            "violation": violation,
            "seconds": total,
            "shares": shares,
        }


def optimise(
    make_problem: Callable[[], om.Problem],  # makes the problem, not yet set up
    driver: Driver,  # the driver
    cases: str | os.PathLike | None = None,  # file of the recorded cases, which is kept; a temporary one by default
) -> RecordedRun:
    """Run a problem with a driver, with reverse derivatives, and record every evaluation and every gradient."""
    problem = make_problem()
    problem.driver = driver
    problem.options["group_by_pre_opt_post"] = True  # what no design variable reaches runs once
    with tempfile.TemporaryDirectory() as folder:
        file = Path(cases or Path(folder) / "cases.sql")
        file.parent.mkdir(parents=True, exist_ok=True)
        driver.add_recorder(om.SqliteRecorder(file, record_viewer_data=False))
        driver.recording_options["record_derivatives"] = True
        problem.setup(mode="rev")
        problem.run_model()
        gradient = problem.compute_totals(driver_scaling=True, return_format="array")[0]
        seconds = time_components(problem)
        start = time.perf_counter()
        with threadpool_limits(1, "blas"):  # dense algebra of a few hundred variables is no work for many threads
            problem.run_driver()
        seconds["rest"] = time.perf_counter() - start - sum(seconds.values())
        problem.cleanup()
        history, convergence = _read(file)
    return RecordedRun(problem, history, dict(seconds), float(np.linalg.norm(gradient)), convergence)


def optimise_with(
    # makers of drivers by name, such as `scipy_slsqp` and `nlopt`, called with the next two arguments
    drivers: Mapping[str, Callable[[float, int], Driver]],
    make_problem: Callable[[], om.Problem],  # makes the problem, not yet set up
    tolerance: float,  # of the objective, in units of the driver
    max_iterations: int,  # largest number of iterations
    folder: str | os.PathLike | None = None,  # folder for the recorded cases, ``<name>_<driver>.sql``
    name: str = "cases",  # beginning of their names
) -> dict[str, RecordedRun]:  # by the names of the drivers
    """Solve a problem with several drivers, one after another."""
    files = {key: folder and Path(folder) / f"{name}_{key.lower().replace(' ', '_')}.sql" for key in drivers}
    return {key: optimise(make_problem, make(tolerance, max_iterations), files[key]) for key, make in drivers.items()}


def run_at(design: om.Problem, problem: om.Problem) -> om.Problem:
    """Run a problem at the design variables of another one: on a finer member of the grid family, at another condition.

    Parameters
    ----------
    design : openmdao.api.Problem
        A problem at an optimum.
    problem : openmdao.api.Problem
        Another one with the same design variables, not yet set up.

    Returns
    -------
    openmdao.api.Problem
        The other one, which has run.
    """
    problem.setup(mode="rev")
    for name in design.model.get_design_vars():
        problem.set_val(name, design.get_val(name))
    problem.run_model()
    return problem


def disagreement(
    runs: Mapping[str, RecordedRun],  # optimisations by the names of their drivers
) -> dict[str, float]:
    """Tell by how much drivers differ that have solved the same problem."""
    # Returns ``objective``, the range of the objectives relative to the largest, and ``design``, the largest range of a
    # design variable in units of the driver.
    drivers = [run.problem.driver for run in runs.values()]
    values = np.array([driver.get_objective_values().popitem()[1].item() for driver in drivers])
    designs = np.array([ScaledModel(driver).present()[0] for driver in drivers])
    return {"objective": np.ptp(values) / np.abs(values).max(), "design": np.ptp(designs, axis=0).max()}


def time_components(
    problem: om.Problem,  # the problem, set up
) -> dict[str, float]:  # wall time by the name of the component (s); it grows as the problem runs
    """Measure the time that is spent in every component from now on."""
    seconds = {}
    for component in problem.model.system_iter(recurse=True, typ=(om.ExplicitComponent, om.ImplicitComponent)):
        if not component.name.startswith("_auto_ivc"):
            seconds[component.name] = 0.0
            for name in TIMED:
                if hasattr(component, name):
                    setattr(component, name, _timed(getattr(component, name), seconds, component.name))
    return seconds


def _read(file: Path) -> tuple[dict[str, np.ndarray], Convergence]:
    """Responses of every evaluation, and how it converged."""
    found = read_history(file)
    assert found.convergence is not None  # there is one objective
    return {q.name: q.values for q in found.quantities if q.kind != "variable"}, found.convergence


def _timed(method: Callable, seconds: dict[str, float], name: str) -> Callable:
    """Wrap a method so that its time is added up."""

    @functools.wraps(method)
    def run(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return method(*args, **kwargs)
        finally:
            seconds[name] += time.perf_counter() - start

    return run
