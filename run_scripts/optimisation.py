"""What the optimisations share: both drivers on one problem, what they cost, and checks of the total derivatives."""

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
from history import OptimalityHistory, read_history, read_optimality, statement_of
from openmdao.core.driver import Driver
from threadpoolctl import threadpool_limits

from bspline_mdao import NLoptDriver
from bspline_mdao.drivers.optimality import optimality
from bspline_mdao.drivers.scaled_model import ScaledModel

TIMED = ("compute", "compute_partials", "compute_jacvec_product")
TIMED += ("solve_nonlinear", "linearize", "apply_linear", "solve_linear")
"""Methods of components whose time counts."""

QUIET = {"disp": False, "singular_jac_behavior": "ignore"}
"""Options of all drivers. Symmetry makes some derivatives zero at the start; idle variables are refused elsewhere."""


def scipy_slsqp(tolerance: float, max_iterations: int) -> Driver:
    """Give SciPy's SLSQP by OpenMDAO's own driver; it ends where the objective changes by less than the tolerance."""
    return om.ScipyOptimizeDriver(optimizer="SLSQP", tol=tolerance, maxiter=max_iterations, **QUIET)


def nlopt(algorithm: str, tolerance: float, max_iterations: int) -> Driver:
    """Give an algorithm of NLopt; it ends where the objective changes by less than the tolerance."""
    stop = {"ftol_abs": tolerance, "ftol_rel": 0.0, "maxeval": 3 * max_iterations}
    return NLoptDriver(optimizer=algorithm, constraint_tolerance=1e-8, **stop, **QUIET)


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
    optimality_history : OptimalityHistory
        On the way.
    """

    problem: om.Problem
    history: dict[str, np.ndarray]
    seconds: dict[str, float]
    initial_gradient: float
    optimality_history: OptimalityHistory

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
        histories = read_history(file), read_optimality(problem, file)
    return Run(problem, histories[0], dict(seconds), float(np.linalg.norm(gradient)), histories[1])


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
    model, statement = ScaledModel(problem.driver), statement_of(problem)
    point = statement.point(*model.present())
    return optimality(statement, point, model.differentiate()), point.violation


def set_up(problem: om.Problem) -> om.Problem:
    """Set a problem up, for reverse derivatives, and run it."""
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def move_at_random(problem: om.Problem, size: float = 0.1) -> om.Problem:
    """Run a problem with every value off its present one by up to ``size`` in units of the driver."""
    rng = np.random.default_rng(4)
    for name, meta in problem.model.get_design_vars().items():
        value = problem.get_val(name)
        problem.set_val(name, value + size * _scale(meta) * rng.uniform(-1.0, 1.0, value.shape))
    problem.run_model()
    return problem


def check_totals(problem: om.Problem, n_directions: int = 2, step: float = 1e-3, levels: int = 4) -> dict:
    """Hold the total derivatives at the present point against each other and against differences.

    Parameters
    ----------
    problem : om.Problem
        A problem that has run.
    n_directions : int
        Random directions in the space of all design variables.
    step : float
        First step of the differences, in units of the driver. It is halved, and the differences are extrapolated.
    levels : int
        Steps.

    Returns
    -------
    dict
        ``transposed``, the largest difference of forward and reverse products by the product of the norms, and
        ``differences``, that of extrapolated central differences and forward products by the largest of those.
    """
    rng, of = np.random.default_rng(5), [*problem.model.get_objectives(), *problem.model.get_constraints()]
    scales = {name: _scale(meta) for name, meta in problem.model.get_design_vars().items()}
    start = {name: problem.get_val(name).copy() for name in scales}
    directions = [
        {name: scales[name] * rng.uniform(-1.0, 1.0, value.size) for name, value in start.items()}
        for _ in range(n_directions)
    ]
    reverse = problem.compute_totals(of, list(start))
    forward = [problem.compute_jacvec_product(of, list(start), "fwd", direction) for direction in directions]
    differences = [
        extrapolated(partial(_responses, problem, of, start, direction), step, levels) for direction in directions
    ]
    _responses(problem, of, start, directions[0], 0.0)
    return {
        "transposed": max(_untransposed(reverse, *pair) for pair in zip(forward, directions)),
        "differences": max(
            _largest_error([d[name] for d in differences], [f[name].ravel() for f in forward]) for name in of
        ),
    }


def _untransposed(reverse: dict, forward: dict, direction: dict) -> float:
    """Largest difference of products with rows from reverse mode and forward products, by the norm of the terms."""
    errors = []
    for name, product in forward.items():
        terms = np.concatenate([reverse[name, wrt] * values for wrt, values in direction.items()], axis=1)
        errors.append(np.abs(terms.sum(axis=1) - product).max() / np.linalg.norm(terms))
    return max(errors)


def _largest_error(differences: list[np.ndarray], products: list[np.ndarray]) -> float:
    """Largest error of several differences by the largest product."""
    return np.abs(np.subtract(differences, products)).max() / np.abs(products).max()


def extrapolated(function: Callable[[float], dict[str, np.ndarray]], step: float, levels: int) -> dict[str, np.ndarray]:
    """Central differences of a function of the step at halved steps, extrapolated to none (Richardson)."""
    table = []
    for h in step / 2.0 ** np.arange(levels):
        above, below = function(h), function(-h)
        table.append({name: (above[name] - below[name]) / (2.0 * h) for name in above})
    for power in 4.0 ** np.arange(1, levels):
        pairs = zip(table, table[1:])
        table = [{name: (power * b[name] - a[name]) / (power - 1.0) for name in a} for a, b in pairs]
    return table[0]


def write_n2(problem: om.Problem, folder: Path, name: str) -> None:
    """Write the N2 diagram of a problem as a page."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    om.n2(problem, outfile=str(Path(folder) / f"{name}.html"), show_browser=False, title=name.replace("_", " "))


def _responses(problem: om.Problem, of: list[str], start: dict, direction: dict, h: float) -> dict[str, np.ndarray]:
    """Responses at a step along a direction."""
    for name, value in start.items():
        problem.set_val(name, value + h * direction[name])
    problem.run_model()
    return {name: problem.get_val(name).ravel().copy() for name in of}


def _scale(meta: dict) -> np.ndarray | float:
    """What one unit of the driver is, for a design variable."""
    return 1.0 if meta["total_scaler"] is None else 1.0 / meta["total_scaler"]
