"""Recorded optimisations: the cases of a driver read back, and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from common import BLUE, ORANGE

from bspline_mdao.drivers.nlopt_problem import Point, Statement
from bspline_mdao.drivers.optimality import optimality
from bspline_mdao.drivers.scaled_model import ScaledModel

COLORS = {"SciPy SLSQP": ORANGE, "NLopt LD_SLSQP": BLUE, "NLopt LD_LBFGS": BLUE}
"""Of the drivers."""

LEAST = 1e-12
"""Violations below it are drawn as if they were this."""


class Course(NamedTuple):
    """How the points of an optimisation approached an optimum, in units of the driver.

    Parameters
    ----------
    violations : ndarray, shape (n,)
        Largest violation of the constraints at every evaluation.
    differentiated : ndarray of int, shape (m,)
        Which evaluations had a gradient, from 0.
    residuals : ndarray, shape (m,)
        Residuals of the first-order conditions there.
    """

    violations: np.ndarray
    differentiated: np.ndarray
    residuals: np.ndarray


def read_cases(file: Path) -> list:
    """Read all cases of the driver from a recorded file, in order."""
    reader = om.CaseReader(str(file))
    return [reader.get_case(name) for name in reader.list_cases("driver", out_stream=None)]


def read_history(file: Path) -> dict[str, np.ndarray]:
    """Read objective and constraints of every evaluation from a recorded file."""
    responses = [{**case.get_objectives(), **case.get_constraints()} for case in read_cases(file)]
    return {name: np.array([values[name] for values in responses]) for name in responses[0]}


def read_course(problem: om.Problem, file: Path) -> Course:
    """Read how a recorded optimisation went on.

    Parameters
    ----------
    problem : om.Problem
        The problem that was recorded, with its design variables and derivatives. Its limits are not in the file.
    file : path-like
        The recorded file.
    """
    statement, cases = statement_of(problem), read_cases(file)
    points = [_point(statement, case) for case in cases]
    # OpenMDAO files a gradient under the evaluation that comes next
    found = [(n, after.derivatives) for n, after in enumerate(cases[1:]) if after.derivatives]
    residuals = [optimality(statement, points[n], _totals(cases[n], derivatives)) for n, derivatives in found]
    return Course(
        np.array([point.violation for point in points]), np.array([n for n, _ in found], dtype=int), np.array(residuals)
    )


def statement_of(problem: om.Problem) -> Statement:
    """Bounds and constraints of a problem in units of its driver."""
    model = ScaledModel(problem.driver)
    return Statement.of(model.design_limits(), model.constraint_limits(), tolerance=0.0)


def _point(statement: Statement, case) -> Point:
    """A recorded point in units of the driver."""
    (objective,) = case.get_objectives(scaled=True).values()
    variables, constraints = case.get_design_vars(scaled=True), case.get_constraints(scaled=True)
    return statement.point(_joined(variables.values()), objective.item(), _joined(constraints.values()))


def _totals(case, derivatives) -> np.ndarray:
    """Totals at a case, shape (1 + m, n), of derivatives, which are recorded in units of the driver."""
    responses = [*case.get_objectives(), *case.get_constraints()]
    return np.vstack([np.hstack([derivatives[name, wrt] for wrt in case.get_design_vars()]) for name in responses])


def _joined(values) -> np.ndarray:
    """Values of several variables in one vector."""
    return np.concatenate([np.zeros(0), *map(np.ravel, values)])


def draw_history(axes, runs: dict, response: str, label: str, error=np.abs) -> None:
    """Draw a function of a response, an error, over the evaluations of every driver."""
    for name, result in runs.items():
        axes.semilogy(error(result.history[response].ravel()), color=COLORS[name], label=name, linewidth=1.0)
    axes.set(xlabel="evaluation", ylabel=label)
    axes.legend()


def draw_objective(axes, runs: dict, response: str, unit: float, label: str) -> None:
    """Draw a response by a unit over the evaluations of every driver."""
    for name, result in runs.items():
        axes.plot(result.history[response].ravel() / unit, color=COLORS[name], label=name, linewidth=1.0)
    axes.set(xlabel="evaluation", ylabel=label)
    axes.legend()


def draw_course(axes, runs: dict) -> None:
    """Draw the optimality of every driver by that of its first gradient, and the violations of constraints."""
    for name, result in runs.items():
        course, style = result.course, {"color": COLORS[name], "linewidth": 1.0, "markersize": 3}
        relative = course.residuals / course.residuals[0]
        axes.semilogy(course.differentiated, relative, "o-", label=f"{name}: optimality", **style)
        axes.semilogy(np.maximum(course.violations, LEAST), ":", label="violation", **style)
    axes.set(xlabel="evaluation", ylabel="optimality by the first, violation")
    axes.legend(fontsize=8)
