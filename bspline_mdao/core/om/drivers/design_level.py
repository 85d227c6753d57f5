"""Design levels: from an optimum with few control points to a finer start, keeping what was learnt.

The variables of a level are combinations of the values of a `CoarseNet`, along which the second derivatives of the
Lagrangian are one, as far as the previous level has found them. So the identity with which a quasi-Newton method starts
is the matrix with which the previous one ended. Theory: ``docs/theory/progressive.rst``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np
import openmdao.api as om
from numpy.typing import ArrayLike

from ....base.display import OneLine
from ....errors import InputError
from ....names import SURFACE_CONTROL_POINTS
from ...design.coarse_net import CoarseNet, Knot
from ...design.variable import Layout
from .case_history import read_history
from .nlopt_problem import Statement
from .optimality import multipliers
from .scaled_model import ScaledModel

__all__ = ["DesignLevel", "unused_gradient"]

DAMPING = 0.2
"""Smallest fraction of the present curvature along a step that an update keeps: Powell's."""


def unused_gradient(problem: om.Problem, net: CoarseNet, surface: str = SURFACE_CONTROL_POINTS) -> np.ndarray:
    """Differentiate the Lagrangian with respect to all control points that a net combines.

    The multipliers are the best ones for the problem's variables. At an optimum in these variables the net can follow
    none of this gradient, except along active bounds; the rest is what further knots can use. It takes one reverse
    product for the objective and one for each constraint.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has run with any driver.
    net : CoarseNet
        The net.
    surface : str
        Name of the surface control points.

    Returns
    -------
    ndarray, shape (n_all,)
        Gradient, in driver units per unit of the values of ``net.variable``.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SurfaceControl, fit_grid
    >>> from bspline_mdao.design import CoarseNet, DesignLevel, Local, OnPatch, Parametrization, unused_gradient
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(7, 5, 6))
    >>> mesh = moving_mesh(model)
    >>> net = CoarseNet.of(model, mesh, Local("bumps", OnPatch(model, "wing_upper"), "y"), n=4)
    >>> problem = om.Problem(reports=None)
    >>> DesignLevel.first(net, unit=0.1).add_to(problem.model)
    >>> control = SurfaceControl(parametrization=Parametrization(mesh, [net]))
    >>> _ = problem.model.add_subsystem("control", control, promotes=["*"])
    >>> squares = om.ExecComp("f = sum(s**4)", s={"shape": 3 * mesh.surface_ids.size, "units": "m"})
    >>> _ = problem.model.add_subsystem("squares", squares, promotes=["f", ("s", "surface_control_points")])
    >>> problem.model.add_objective("f")
    >>> _ = problem.setup(mode="rev")
    >>> problem.run_model()
    >>> gradient = unused_gradient(problem, net)
    >>> net.where_to_refine(gradient, 1), 0.0 < net.part_used(gradient) < 1.0
    ([(1, 0)], True)
    """
    model = ScaledModel(problem.driver)
    statement = Statement.of(model.design_limits(), model.constraint_limits(), tolerance=0.0)
    weights = multipliers(statement, statement.point(*model.present()), model.differentiate())
    on_surface = model.differentiate_in(surface)
    directions = net.variable.bind(Layout(net.mesh)).matrix
    return (on_surface[0] + weights @ on_surface[1:]) @ directions


@dataclass(frozen=True, eq=False)
class DesignLevel(OneLine):
    """A net with initial values, bounds, and the combinations varied by a driver. Made by `first`.

    Parameters
    ----------
    net : CoarseNet
        The variable.
    start : ndarray, shape (n_values,)
        Its values where all combinations are zero.
    lower, upper : ndarray, shape (n_values,)
        Bounds of its values.
    columns : ndarray, shape (n_values, n_values)
        Values for a unit of each combination.
    metric : ndarray, shape (n_all, n_all), or None
        See `CoarseNet.where_to_refine`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import CoarseNet, DesignLevel, Local, OnPatch
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(7, 5, 6))
    >>> mesh = moving_mesh(model)
    >>> net = CoarseNet.of(model, mesh, Local("bumps", OnPatch(model, "wing_upper"), "y"), n=4)
    >>> level = DesignLevel.first(net, lower=-0.02, upper=0.02, unit=0.01)
    >>> level.columns.shape, level.start.tolist()
    ((6, 6), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    """

    net: CoarseNet
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    columns: np.ndarray
    metric: np.ndarray | None = None

    @classmethod
    def first(
        cls,
        net: CoarseNet,
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
        unit: float = 1.0,
        metric: np.ndarray | None = None,
    ) -> DesignLevel:
        """Make the first level, starting at the baseline.

        Parameters
        ----------
        net : CoarseNet
            The variable.
        lower, upper : float or array_like, shape (n_values,)
            Bounds of its values.
        unit : float
            Size in the metric of the change of values for a unit of any combination: the size of a first step if the
            gradient is one.
        metric : ndarray, shape (n_all, n_all), optional
            See `CoarseNet.where_to_refine`.
        """
        low, high = (np.array(np.broadcast_to(np.asarray(b, dtype=float), net.n_values)) for b in (lower, upper))
        return cls(net, np.zeros(net.n_values), low, high, unit * _evening(net.mass(metric)), metric)

    def add_to(self, model: om.Group) -> None:
        """Add ``combine_<name>``, and declare ``combinations`` as design variables and bounds as constraints.

        Parameters
        ----------
        model : openmdao.api.Group
            Model in which the net's values are promoted by name; add the subsystem that uses them afterwards.
        """
        name, (n_values, n) = self.net.name, self.columns.shape
        combine = om.ExecComp(
            f"{name} = start + dot(columns, combinations)",
            start={"val": self.start, "constant": True},
            columns={"val": self.columns, "constant": True},
            combinations={"val": np.zeros(n)},
            **{name: {"shape": n_values, "units": self.net.units}},
            do_coloring=False,
        )
        model.add_subsystem(f"combine_{name}", combine, promotes=["combinations", name])
        model.add_design_var("combinations")
        if np.isfinite([self.lower, self.upper]).any():
            model.add_constraint(name, lower=self.lower, upper=self.upper)

    def refined(self, problem: om.Problem, knots: list[Knot], cases: str | os.PathLike | None = None) -> DesignLevel:
        """Make the next level, with more knots.

        Parameters
        ----------
        problem : openmdao.api.Problem
            This level's problem at its optimum.
        knots : list of (int, int)
            Knots to insert, from `CoarseNet.halves` or `CoarseNet.where_to_refine`.
        cases : path-like, optional
            Case file of this level's run, with derivatives (``driver.recording_options["record_derivatives"]``), to
            carry over the second derivatives learnt by the driver. Without it, combinations are even in the metric.

        Returns
        -------
        DesignLevel
            Level with the same shape at its start, within its bounds.

        Raises
        ------
        InputError
            If the file is not from a run of this level, or has no derivatives.
        """
        net = self.net.refine(knots)
        refinement = self.net.to(net)
        start = refinement.values(problem.get_val(self.net.name))
        lower, upper = refinement.bounds(self.lower, self.upper)
        finer = replace(self, net=net, start=start, lower=np.minimum(lower, start), upper=np.maximum(upper, start))
        inverse = np.linalg.inv(self.columns)
        curvature = np.eye(len(inverse)) if cases is None else _curvature_of(cases, len(inverse))
        coarse, mass = inverse.T @ curvature @ inverse, net.mass(self.metric)
        return replace(finer, columns=_evening(_carried(coarse, refinement.matrix.toarray(), mass)))


def _evening(curvature: np.ndarray) -> np.ndarray:
    """Combinations along which a curvature is one: ``C^T B C = 1``."""
    return np.linalg.inv(np.linalg.cholesky(0.5 * (curvature + curvature.T))).T


def _carried(coarse: np.ndarray, refinement: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Curvature on a finer net: the coarse curvature on coarse shapes, its mean size on shapes normal to them."""
    on_coarse = refinement.T @ mass
    within = on_coarse @ refinement
    to_coarse = np.linalg.solve(within, on_coarse)
    sizes = np.linalg.eigvalsh(_evening(within).T @ coarse @ _evening(within))
    mean = np.exp(np.mean(np.log(sizes)))
    return to_coarse.T @ coarse @ to_coarse + mean * (mass - on_coarse.T @ to_coarse)


def _curvature_of(cases: str | os.PathLike, n: int) -> np.ndarray:
    """Second derivatives (n, n) of the Lagrangian in the combinations, in driver units, from a run's gradients."""
    # Updates of Broyden, Fletcher, Goldfarb and Shanno with Powell's damping, in the order of the run, with the
    # multipliers of its best point. A run that ended where it started has no updates: the result is the identity.
    history = read_history(cases)
    found, variables = history.convergence, history.of_kind("variable")
    ends = dict(zip([q.name for q in variables], np.cumsum([q.values.shape[1] for q in variables])))
    if not any(q.name == "combinations" and q.values.shape[1] == n for q in variables):
        raise InputError(f"{cases}: is of other variables; give the case file of the level before")
    if found is None or (len(found.violations) > 1 and not len(found.differentiated)):
        raise InputError(f"{cases}: holds no gradients; set driver.recording_options['record_derivatives'] = True")
    if not len(found.differentiated):
        return np.eye(n)
    points = history.scaled_points()
    statement = history.statement()
    last = int(np.argmin(np.abs(found.differentiated - history.best)))
    best = points[found.differentiated[last]]
    weights = multipliers(statement, best, found.totals[last])
    gradients = found.totals[:, 0] + np.einsum("c,kcn->kn", weights, found.totals[:, 1:])
    x = np.array([points[number].x for number in found.differentiated])
    steps, changes = np.diff(x, axis=0), np.diff(gradients, axis=0)
    tail = slice(ends["combinations"] - n, ends["combinations"])
    return _updated(steps, changes)[tail, tail]


def _updated(steps: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Second derivatives from steps and gradient changes, both of shape (m, n)."""
    along = np.einsum("kn,kn->k", steps, changes) / np.maximum(np.einsum("kn,kn->k", steps, steps), 1e-300)
    sizes = along[along > 0.0]
    matrix = np.eye(steps.shape[1]) * (np.exp(np.mean(np.log(sizes))) if len(sizes) else 1.0)
    for step, change in zip(steps, changes):
        image = matrix @ step
        present, found = step @ image, step @ change
        if not present > 0.0:
            continue
        part = 1.0 if found >= DAMPING * present else (1.0 - DAMPING) * present / (present - found)
        change = part * change + (1.0 - part) * image
        matrix += np.outer(change, change) / (step @ change) - np.outer(image, image) / present
    return matrix
