"""The fit as a function of the baseline grid, through chord-length parameters and knots as well ("live").

With b the control points, A the matrix of an entity and r = x - A b its residual, the unknown part of b satisfies
``A_u^T r = shift (b_u - b_reference)``. Differentiated,

    (A_u^T A_u + shift I) db_u = A_u^T (dx - dA b - A_k db_k) + dA_u^T r + shift db_reference,

where u are the unknown and k the known control points; dA comes from `bspline_mdao.fit.live_mapping`. The reverse runs
through the same steps backwards.

Where control points fall back on a quasi-interpolant, it, the A of its iteration and the weights of the candidates are
those of the model's own grid: the fallback is a linear map of the nodes, as the choice that it comes from is made once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..model.fitted_model import FittedModel
from .least_squares import FitStep
from .live_mapping import Change, LiveMapping, live_mapping, live_problem, sum_apply
from .parameters import EXPONENTS
from .problem import problem_of_mesh
from .quasi_interpolant import Mixture


@dataclass(frozen=True, eq=False)
class LiveFit:
    """A fit at one baseline grid with its first derivatives.

    Parameters
    ----------
    mapping : LiveMapping
        Parameters, knots and matrices of this grid.
    steps : tuple of FitStep
        Factored least squares; none where they have no weight in any control point.
    least_squares : ndarray, shape (n_control_points, 3)
        Control points by least squares (m).
    mixture : Mixture
        What control points are where least squares fold.
    """

    mapping: LiveMapping
    steps: tuple[FitStep, ...]
    least_squares: np.ndarray
    mixture: Mixture

    @property
    def control_points(self) -> np.ndarray:
        """The fitted control points (m), shape (n_control_points, 3)."""
        return self.mixture.forward(self.least_squares, self.nodes)

    @property
    def nodes(self) -> np.ndarray:
        """The grid (m), shape (n_nodes, 3)."""
        return self.mapping.nodes

    def jvp(self, d_nodes: np.ndarray) -> np.ndarray:
        """Differentiate the control points, shape (n_control_points, 3), along ``d_nodes``, shape (n_nodes, 3)."""
        change, d_control = self.mapping.change(d_nodes), np.zeros_like(self.least_squares)
        with threadpool_limits(1, "blas"):
            for step in self.steps:
                if step.factor is not None:
                    self._step_jvp(step, change, d_nodes, d_control)
        return self.mixture.forward(d_control, d_nodes)

    def vjp(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: cotangent of the nodes, shape (n_nodes, 3)."""
        control_bar, nodes_bar = self.mixture.adjoint(control_bar, len(self.nodes))
        bars = self.mapping.no_change()
        with threadpool_limits(1, "blas"):
            for step in reversed(self.steps):
                if step.factor is not None:
                    self._step_vjp(step, control_bar, nodes_bar, bars)
        self.mapping.add_change_vjp(bars, nodes_bar)
        return nodes_bar

    def _step_jvp(self, step: FitStep, change: Change, d_nodes, d_control) -> None:
        """Solve the differentiated normal equations of an entity."""
        net, residual = self._net_and_residual(step)
        terms = self.mapping.matrix_jvp(step.entity, step.matrix, change)
        moved = d_nodes[step.entity.rows] - sum_apply(terms, net)
        by_matrix = sum(term.apply_transpose(residual) for term in terms)
        step.solve_residual(moved, by_matrix, d_nodes, d_control)

    def _step_vjp(self, step: FitStep, control_bar, nodes_bar, bars: Change) -> None:
        """Reverse of `_step_jvp`."""
        moved_bar, right_bar = step.solve_residual_transpose(control_bar, nodes_bar)
        np.add.at(nodes_bar, step.entity.rows, moved_bar)
        net, residual = self._net_and_residual(step)
        self.mapping.add_matrix_vjp(step.entity, step.matrix, bars, [(-moved_bar, net), (residual, right_bar)])

    def _net_and_residual(self, step: FitStep) -> tuple[np.ndarray, np.ndarray]:
        """Control points of the section of an entity, and what they miss of its nodes."""
        net = step.entity.net(self.least_squares)
        return net, self.nodes[step.entity.rows] - step.matrix.apply(net)


def live_fit(model: FittedModel, nodes: np.ndarray) -> LiveFit:
    """Fit another baseline grid exactly as a model was fitted, with parameters, knots and derivatives of its own.

    Parameters
    ----------
    model : FittedModel
        Gives topology, numbers of control points, orders, kind of knots, and the fallback of control points.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).

    Returns
    -------
    LiveFit

    Raises
    ------
    InputError
        If the model has corrected parameters or the user's own parameters or knots, which are no functions of the grid.
    """
    mixture = problem_of_mesh(model.topology, model.mesh).mixture(model.parameters, model.candidate_weights)
    if not mixture.has_least_squares:
        return LiveFit(live_mapping(model, nodes), (), np.zeros_like(model.control_points), mixture)
    problem, parameters = live_problem(model, nodes)
    operator = problem.operator(parameters)
    matrices = tuple(step.matrix for step in operator.steps)
    exponent = EXPONENTS[model.settings.parametrization]
    mapping = LiveMapping(problem, model.settings.knots, exponent, nodes, parameters, matrices)
    return LiveFit(mapping, operator.steps, operator.forward(nodes), mixture)
