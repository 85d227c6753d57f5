"""Recorded optimisations: how a driver progressed, how near to an optimum it ended, and what took the time."""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver
from threadpoolctl import threadpool_limits

from ....base.display import OneLine
from ....base.numerics.processes import on_first
from .case_history import Convergence, read_history
from .nlopt_driver import NLoptDriver
from .optimality import optimality_of
from .scaled_model import ScaledModel
from .scipy_driver import ScipyDriver

__all__ = [
    "RecordedRun",
    "disagreement",
    "nlopt",
    "recorded",
    "run_at",
    "scipy_slsqp",
    "time_components",
]

TIMED = (
    *("compute", "compute_partials", "compute_jacvec_product"),
    *("solve_nonlinear", "linearize", "apply_linear", "solve_linear"),
)
"""Methods of components that are timed."""

QUIET = {"disp": False, "singular_jac_behavior": "ignore"}
"""Options of all drivers. Symmetry makes some derivatives zero at the start; idle variables are refused elsewhere."""


def scipy_slsqp(tolerance: float, max_iterations: int) -> Driver:
    """Make SciPy's SLSQP, which ends when the objective changes by less than the tolerance; failures shorten steps.

    Parameters
    ----------
    tolerance : float
        Tolerance of the objective, in units of the driver.
    max_iterations : int
        Largest number of iterations.

    Returns
    -------
    ScipyDriver

    Examples
    --------
    >>> from bspline_mdao.drivers import scipy_slsqp
    >>> scipy_slsqp(1e-8, 50).options["maxiter"]
    50
    """
    return ScipyDriver(optimizer="SLSQP", tol=tolerance, maxiter=max_iterations, **QUIET)


def nlopt(tolerance: float, max_iterations: int, algorithm: str = "LD_SLSQP") -> Driver:
    """Make an NLopt algorithm, which ends when the objective changes by less than the tolerance, constraints met.

    Parameters
    ----------
    tolerance : float
        Tolerance of the objective, in units of the driver; constraints get a tenth of it, but at least 1e-8.
    max_iterations : int
        Largest number of iterations; three times as many evaluations.
    algorithm : str
        Name of the algorithm, as for `NLoptDriver`.

    Returns
    -------
    NLoptDriver

    Examples
    --------
    >>> from bspline_mdao.drivers import nlopt
    >>> nlopt(1e-8, 50, "LD_MMA").options["maxeval"]
    150
    """
    violation = max(1e-8, 0.1 * tolerance)
    stop = {"ftol_abs": tolerance, "ftol_rel": 0.0, "maxeval": 3 * max_iterations}
    return NLoptDriver(optimizer=algorithm, constraint_tolerance=violation, **stop, **QUIET)


@dataclass(eq=False)
class RecordedRun(OneLine):
    """A recorded optimisation. Made by `recorded`; its history is complete when that block ends.

    Parameters
    ----------
    problem : openmdao.api.Problem
        The problem, which ends at the optimum.
    seconds : dict of float
        Wall time by component, and for the ``rest``: OpenMDAO and the optimizer.
    initial_gradient : float
        Norm of the objective's gradient at the start, as the driver sees it.

    Attributes
    ----------
    history : dict of ndarray
        Objective and constraints by name, one row per evaluation, in units of the model.
    convergence : Convergence
        Optimality and violations during the run.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import NLoptDriver
    >>> from bspline_mdao.drivers import recorded
    >>> problem = om.Problem(reports=None, driver=NLoptDriver(optimizer="LD_SLSQP", disp=False))
    >>> _ = problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3) ** 2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    >>> problem.model.add_objective("f")
    >>> with recorded(problem) as run:
    ...     _ = problem.run_driver()
    >>> run.numbers()["success"], len(run.history["f"]) > 1
    (True, True)
    """

    problem: om.Problem
    seconds: dict[str, float]
    initial_gradient: float
    history: dict[str, np.ndarray] = field(init=False, repr=False)
    convergence: Convergence = field(init=False, repr=False)

    def numbers(self, flow: str | None = None) -> dict:
        """Summarise the optimisation.

        Parameters
        ----------
        flow : str, optional
            Name of a group of the model whose components count as one in ``shares``.

        Returns
        -------
        dict
            ``success``, ``exit_status``, ``evaluations``, ``gradients``, the ``objective`` in units of the model,
            ``optimality``, the residual of the first-order conditions relative to the first gradient of the objective,
            the largest ``violation`` in units of the driver, ``seconds`` of wall time and the ``shares`` of components.
        """
        result, total = self.problem.driver.result, sum(self.seconds.values())
        counts = {"evaluations": result.model_evals, "gradients": result.deriv_evals}  # before one more gradient
        residual, violation = optimality_of(self.problem)
        fractions = {name: seconds / total for name, seconds in self.seconds.items()}
        if flow is not None:
            parts = {part.name for part in getattr(self.problem.model, flow).system_iter(recurse=True)}
            of_flow = sum(fraction for name, fraction in fractions.items() if name in parts)
            fractions = {name: fraction for name, fraction in fractions.items() if name not in parts} | {flow: of_flow}
        return {
            "success": bool(result.success),
            "exit_status": str(result.exit_status),
            **counts,
            "objective": self.problem.driver.get_objective_values(driver_scaling=False).popitem()[1].item(),
            "optimality": residual / self.initial_gradient,
            "violation": violation,
            "seconds": total,
            "shares": fractions,
        }


@contextmanager
def recorded(problem: om.Problem, folder: str | PathLike | None = None, name: str = "cases") -> Iterator[RecordedRun]:
    """Set a problem up with reverse derivatives, and record every evaluation and every gradient of its driver.

    Run the driver in the block. Dense linear algebra uses one thread there, since a few hundred variables do not pay
    for more.

    Parameters
    ----------
    problem : openmdao.api.Problem
        The problem with its driver, not yet set up.
    folder : path-like, optional
        Folder for the recorded cases, ``<name>.sql``, which are kept there; a temporary one by default.
    name : str
        Name of their file; it is written in lower case, with _ for spaces.

    Yields
    ------
    RecordedRun
        The start, and after the block the history.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import ScipyDriver
    >>> from bspline_mdao.drivers import recorded
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3) ** 2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    >>> problem.model.add_objective("f")
    >>> problem.driver = ScipyDriver(optimizer="SLSQP", disp=False)
    >>> with recorded(problem) as run:
    ...     _ = problem.run_driver()
    >>> problem.get_val("x").round(6)
    array([3.])
    """
    problem.options["group_by_pre_opt_post"] = True  # what does not depend on design variables runs once
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(folder or temporary) / f"{name.lower().replace(' ', '_')}.sql"
        file.parent.mkdir(parents=True, exist_ok=True)
        problem.driver.add_recorder(om.SqliteRecorder(file, record_viewer_data=False))
        problem.driver.recording_options["record_derivatives"] = True
        problem.setup(mode="rev")
        problem.run_model()
        gradient = problem.compute_totals(driver_scaling=True, return_format="array")[0]
        growing, start = time_components(problem), time.perf_counter()
        run = RecordedRun(problem, growing, float(np.linalg.norm(gradient)))
        with threadpool_limits(1, "blas"):
            yield run
        rest = time.perf_counter() - start - sum(growing.values())
        run.seconds = growing | {"rest": rest}  # a copy: the problem may run again
        problem.cleanup()
        run.history, run.convergence = on_first(problem.comm, lambda: _read(file))  # which has written it


def run_at(design: om.Problem, problem: om.Problem) -> om.Problem:
    """Run a problem at another problem's design variables: on a finer grid of the family, or at another condition.

    Parameters
    ----------
    design : openmdao.api.Problem
        A problem at an optimum.
    problem : openmdao.api.Problem
        Another problem with the same design variables, not yet set up.

    Returns
    -------
    openmdao.api.Problem
        The other problem, after its run.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.drivers import run_at
    >>> def pose():
    ...     problem = om.Problem(reports=None)
    ...     problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3) ** 2"), promotes=["*"])
    ...     problem.model.add_design_var("x")
    ...     return problem
    >>> design = pose()
    >>> _ = design.setup()
    >>> design.set_val("x", 5.0)
    >>> run_at(design, pose()).get_val("f")
    array([4.])
    """
    problem.setup(mode="rev")
    for name in design.model.get_design_vars():
        problem.set_val(name, design.get_val(name))
    problem.run_model()
    return problem


def disagreement(runs: Mapping[str, RecordedRun]) -> dict[str, float]:
    """Compute by how much drivers differ after solving the same problem.

    Parameters
    ----------
    runs : mapping of str to RecordedRun
        Optimisations by the names of their drivers.

    Returns
    -------
    dict
        ``objective``, the range of the objectives relative to the largest, and ``design``, the largest range of a
        design variable in units of the driver.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.drivers import disagreement, nlopt, recorded, scipy_slsqp
    >>> runs = {}
    >>> for name, make_driver in {"SciPy": scipy_slsqp, "NLopt": nlopt}.items():
    ...     problem = om.Problem(reports=None, driver=make_driver(1e-12, 50))
    ...     _ = problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3) ** 2 + 1"), promotes=["*"])
    ...     problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    ...     problem.model.add_objective("f")
    ...     with recorded(problem) as runs[name]:
    ...         _ = problem.run_driver()
    >>> bool(disagreement(runs)["design"] < 1e-5)
    True
    """
    drivers = [run.problem.driver for run in runs.values()]
    values = np.array([driver.get_objective_values().popitem()[1].item() for driver in drivers])
    designs = np.array([ScaledModel(driver).present()[0] for driver in drivers])
    return {"objective": np.ptp(values) / np.abs(values).max(), "design": np.ptp(designs, axis=0).max()}


def time_components(
    problem: om.Problem,  # the problem, set up
) -> dict[str, float]:  # wall time by the name of the component (s); it grows as the problem runs
    """Measure the time spent in each component from now on."""
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
