"""Recorded optimisations: the cases of a driver read back, and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from common import BLUE, ORANGE

from bspline_mdao.drivers.nlopt_problem import Statement
from bspline_mdao.drivers.optimality import optimality
from bspline_mdao.drivers.scaled_model import ScaledModel

COLORS = {"SciPy SLSQP": ORANGE, "NLopt LD_SLSQP": BLUE, "NLopt LD_LBFGS": BLUE}


class OptimalityHistory(NamedTuple):
    """How far the points of an optimisation were from an optimum.

    Parameters
    ----------
    evaluations : ndarray of int, shape (n,)
        Which evaluations had a gradient, from 0.
    residuals : ndarray, shape (n,)
        Residuals of the first-order conditions there, in units of the driver.
    """

    evaluations: np.ndarray
    residuals: np.ndarray


def read_cases(file: Path) -> list:
    """Read all cases of the driver from a recorded file, in order."""
    reader = om.CaseReader(str(file))
    return [reader.get_case(name) for name in reader.list_cases("driver", out_stream=None)]


def read_history(file: Path) -> dict[str, np.ndarray]:
    """Read objective and constraints of every evaluation from a recorded file."""
    responses = [{**case.get_objectives(), **case.get_constraints()} for case in read_cases(file)]
    return {name: np.array([values[name] for values in responses]) for name in responses[0]}


def read_optimality(problem: om.Problem, file: Path) -> OptimalityHistory:
    """Read how the gradients of a recorded optimisation approached an optimum.

    Parameters
    ----------
    problem : om.Problem
        The problem that was recorded, with its design variables and derivatives. Its limits are not in the file.
    file : path-like
        The recorded file.
    """
    statement, cases = statement_of(problem), read_cases(file)
    # OpenMDAO files a gradient under the evaluation that comes next
    pairs = [(n, case, after.derivatives) for n, (case, after) in enumerate(zip(cases, cases[1:])) if after.derivatives]
    residuals = [_residual(statement, problem, case, derivatives) for _, case, derivatives in pairs]
    return OptimalityHistory(np.array([n for n, _, _ in pairs]), np.array(residuals))


def statement_of(problem: om.Problem) -> Statement:
    """Bounds and constraints of a problem in units of its driver."""
    model = ScaledModel(problem.driver)
    return Statement.of(model.design_limits(), model.constraint_limits(), tolerance=0.0)


def _residual(statement: Statement, problem: om.Problem, case, derivatives) -> float:
    """Residual of the first-order conditions at a case, with derivatives that are recorded in units of the driver."""
    variables, constraints = case.get_design_vars(scaled=True), case.get_constraints(scaled=True)
    (objective,) = case.get_objectives(scaled=True).items()
    point = statement.point(_joined(variables.values()), objective[1].item(), _joined(constraints.values()))
    rows = [np.hstack([derivatives[name, wrt] for wrt in variables]) for name in (objective[0], *constraints)]
    return optimality(statement, point, np.vstack(rows))


def _joined(values) -> np.ndarray:
    """Values of several variables in one vector."""
    return np.concatenate([np.zeros(0), *map(np.ravel, values)])


def draw_history(axes, runs: dict, response: str, label: str, error=np.abs) -> None:
    """Draw a function of a response, an error, over the evaluations of every driver."""
    for name, result in runs.items():
        axes.semilogy(error(result.history[response].ravel()), color=COLORS[name], label=name, linewidth=1.0)
    axes.set(xlabel="evaluation", ylabel=label)
    axes.legend()


def draw_optimality(axes, runs: dict) -> None:
    """Draw the optimality of every recorded driver by that of its first gradient."""
    for name, result in runs.items():
        history = result.optimality_history
        relative = history.residuals / history.residuals[0]
        axes.semilogy(history.evaluations, relative, "o-", color=COLORS[name], label=name, linewidth=1.0, markersize=3)
    axes.set(xlabel="evaluation", ylabel="optimality by that of the start")
    axes.legend()
