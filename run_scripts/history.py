"""Recorded optimisations: the cases of a driver read back, and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from common import BLUE, ORANGE

from bspline_mdao.om.drivers.nlopt_problem import Point, Statement
from bspline_mdao.om.drivers.optimality import optimality
from bspline_mdao.om.drivers.scaled_model import ScaledModel

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
    scaling, cases = Scaling.of(problem), read_cases(file)
    points = [scaling.point(case) for case in cases]
    # OpenMDAO files a gradient under the evaluation that comes next, in units of the driver
    found = [(n, scaling.totals(after.derivatives)) for n, after in enumerate(cases[1:]) if after.derivatives]
    residuals = [optimality(scaling.statement, points[n], totals) for n, totals in found]
    return Course(
        np.array([point.violation for point in points]), np.array([n for n, _ in found], dtype=int), np.array(residuals)
    )


@dataclass(frozen=True)
class Scaling:
    """What recorded cases, which are in units of the model, are in units of the driver.

    Parameters
    ----------
    statement : Statement
        Bounds and constraints in units of the driver.
    objective, designs, constraints : dict
        What OpenMDAO knows of them by name, in the order of the statement.
    """

    statement: Statement
    objective: dict[str, dict]
    designs: dict[str, dict]
    constraints: dict[str, dict]

    @classmethod
    def of(cls, problem: om.Problem) -> Scaling:
        """Find the scaling of a problem that has run."""
        model, known = ScaledModel(problem.driver), problem.model
        limits = model.design_limits(), model.constraint_limits()
        metas = known.get_design_vars(), known.get_constraints()
        named = ({limit.name: meta[limit.name] for limit in each} for each, meta in zip(limits, metas))
        return cls(Statement.of(*limits, tolerance=0.0), known.get_objectives(), *named)

    def point(self, case) -> Point:
        """Give a recorded point."""
        parts = (
            (self.designs, case.get_design_vars(scaled=False)),
            (self.objective, case.get_objectives(scaled=False)),
            (self.constraints, case.get_constraints(scaled=False)),
        )
        x, objective, constraints = (_joined(metas, values) for metas, values in parts)
        return self.statement.point(x, objective.item(), constraints)

    def totals(self, derivatives) -> np.ndarray:
        """Totals, shape (1 + m, n), of recorded derivatives."""
        rows = ([derivatives[name, wrt] for wrt in self.designs] for name in (*self.objective, *self.constraints))
        return np.vstack([np.hstack(row) for row in rows])


def _joined(metas: dict[str, dict], values) -> np.ndarray:
    """Scaled values of several variables in one vector."""
    scaled = (_scaled(values[name], meta["total_adder"], meta["total_scaler"]) for name, meta in metas.items())
    return np.concatenate([np.zeros(0), *map(np.ravel, scaled)])


def _scaled(value: np.ndarray, adder, scaler) -> np.ndarray:
    """A value in units of the driver."""
    return (value + (0.0 if adder is None else adder)) * (1.0 if scaler is None else scaler)


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
        if course.violations.any():
            axes.semilogy(np.maximum(course.violations, LEAST), ":", label="violation", **style)
    axes.set(xlabel="evaluation", ylabel="optimality by the first, violation")
    axes.legend(fontsize=8)
