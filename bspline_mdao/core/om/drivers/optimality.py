"""The first-order conditions of an optimum: the residual of a point, and of a problem that has run.

Theory: ``docs/theory/drivers.rst``, "How a run ends".
"""

import numpy as np
import openmdao.api as om
from scipy.optimize import nnls

from .nlopt_problem import Point, Statement
from .scaled_model import ScaledModel

__all__ = ["ACTIVE", "multipliers", "optimality", "optimality_of"]

ACTIVE = 1e-4
"""Distance from a limit, relative to its size if that exceeds one, within which it may be active: a hundred times the
default constraint tolerance, and small compared with variables scaled to one."""


def _is_near(distance: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Whether a point is so near to its limits that they may be active."""
    return np.isfinite(limits) & (distance <= ACTIVE * np.maximum(1.0, np.abs(limits)))


def _outward(statement: Statement, point: Point, totals: np.ndarray) -> np.ndarray:
    """Gradients (n, k) of all possibly active limits, pointing out of the feasible set."""
    rows, same, identity = statement.inequalities, statement.equalities, np.eye(point.x.size)
    is_active = _is_near(-rows.values(point.constraints), rows.limits)
    equal = same.gradients(totals[1:])
    at_upper = _is_near(statement.upper - point.x, statement.upper)
    at_lower = _is_near(point.x - statement.lower, statement.lower)
    # an equality may act from either side: its multiplier of any sign becomes two gradients with positive ones
    fixing = (rows.gradients(totals[1:])[is_active], equal, -equal, identity[at_upper], -identity[at_lower])
    return np.vstack(fixing).T


def optimality(
    statement: Statement,  # bounds and constraints
    point: Point,  # the point
    totals: np.ndarray,  # (1 + m, n), totals of objective and constraints there
) -> float:
    """Norm of the gradient of the Lagrangian with the best multipliers."""
    # Returns ``min |grad f + sum(y_i grad c_i)|`` over multipliers y_i >= 0 of the possibly active limits: the part of
    # the gradient that no limit balances. Zero at an optimum.
    outward = _outward(statement, point, totals)
    if outward.shape[1] == 0:
        return float(np.linalg.norm(totals[0]))
    return float(nnls(outward, -totals[0], maxiter=10 * outward.shape[1])[1])


def multipliers(
    statement: Statement,  # statement, point, totals: as for `optimality`
    point: Point,
    totals: np.ndarray,
) -> np.ndarray:
    """Best multipliers of the constraints, see `optimality`."""
    # Returns (m,). ``grad f + sum(y_i grad c_i)`` is then the gradient of the Lagrangian apart from bounds. Multipliers
    # have either sign, and are zero if no limit may be active.
    outward = _outward(statement, point, totals)
    if outward.shape[1] == 0:
        return np.zeros(len(totals) - 1)
    found = nnls(outward, -totals[0], maxiter=10 * outward.shape[1])[0]
    # each constraint separately: the same rows of the outward gradients, for unit gradients of the constraints
    unit = np.vstack([np.zeros(len(totals) - 1), np.eye(len(totals) - 1)])
    rows, same = statement.inequalities, statement.equalities
    is_active = _is_near(-rows.values(point.constraints), rows.limits)
    equal = same.gradients(unit[1:])
    signs = np.vstack([rows.gradients(unit[1:])[is_active], equal, -equal])
    return signs.T @ found[: len(signs)]


def optimality_of(problem: om.Problem) -> tuple[float, float]:
    """Check the first-order conditions of an optimum for a problem that has run with any driver, see `optimality`.

    Parameters
    ----------
    problem : openmdao.api.Problem
        The problem; this computes its totals.

    Returns
    -------
    float
        Norm of the gradient of the Lagrangian with the best multipliers, in units of the driver.
    float
        Largest violation of a constraint, in units of the driver.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import NLoptDriver, optimality_of
    >>> problem = om.Problem(reports=None, driver=NLoptDriver(optimizer="LD_SLSQP", disp=False))
    >>> _ = problem.model.add_subsystem("body", om.ExecComp("f = (x - 3)**2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-5.0, upper=2.0)
    >>> problem.model.add_objective("f")
    >>> _ = problem.setup()
    >>> _ = problem.run_driver()
    >>> [residual < 1e-6 for residual in optimality_of(problem)]
    [True, True]
    """
    model = ScaledModel(problem.driver)
    statement = Statement.of(model.design_limits(), model.constraint_limits(), tolerance=0.0)
    point = statement.point(*model.present())
    return optimality(statement, point, model.differentiate()), point.violation
