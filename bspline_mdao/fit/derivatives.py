"""The fit as a function of the baseline grid, through chord-length parameters and knots as well ("live").

With b the control points, A the matrix of an entity and r = x - A b its residual, the unknown part of b satisfies
``A_u^T r = shift (b_u - prior)``. Differentiated,

    (A_u^T A_u + shift I) db_u = A_u^T (dx - dA b - A_k db_k) + dA_u^T r + shift dprior,

where u are the unknown and k the known control points. dA follows from the parameters of the nodes and the knots on the
edges of the block, and these from the nodes. The reverse runs through the same steps backwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError
from ..model import FittedModel
from ..splines.volume import Volume
from .edge_knots import knots_of_segment, knots_of_segment_jvp, knots_of_segment_vjp
from .fitting import FitProblem, problem_of_mesh
from .least_squares import FitStep
from .matrix_derivatives import LiveMatrix
from .parameters import chord_length_parameters, chord_length_parameters_jvp, chord_length_parameters_vjp


@dataclass(frozen=True, eq=False)
class _Change:
    """Derivatives of what the matrices depend on.

    Parameters
    ----------
    parameters : list of ndarray, each of shape (L0, L1, L2, 3)
        Of every segment.
    corners : list of lists of three ndarray, each of shape (2, 2, N + p)
        Edge knots of every segment.
    """

    parameters: list[np.ndarray]
    corners: list[list[np.ndarray]]


@dataclass(frozen=True, eq=False)
class LiveFit:
    """A fit at one baseline grid with its first derivatives.

    Parameters
    ----------
    problem : FitProblem
        The fit, its knots being those of this grid.
    kind : str
        Kind of knots.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    parameters : tuple of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of every segment.
    steps : tuple of FitStep
        Factored least squares.
    control_points : ndarray, shape (n_control_points, 3)
        The fitted control points (m).
    """

    problem: FitProblem
    kind: str
    nodes: np.ndarray
    parameters: tuple[np.ndarray, ...]
    steps: tuple[FitStep, ...]
    control_points: np.ndarray

    def jvp(self, d_nodes: np.ndarray) -> np.ndarray:
        """Differentiate the control points, shape (n_control_points, 3), along ``d_nodes``, shape (n_nodes, 3)."""
        change, d_control = self._change(d_nodes), np.zeros_like(self.control_points)
        with threadpool_limits(1, "blas"):
            for step in self.steps:
                if step.cholesky is not None:
                    self._step_jvp(step, change, d_nodes, d_control)
        return d_control

    def vjp(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: cotangent of the nodes, shape (n_nodes, 3)."""
        control_bar, nodes_bar, bars = control_bar.copy(), np.zeros_like(self.nodes), self._no_change()
        with threadpool_limits(1, "blas"):
            for step in reversed(self.steps):
                if step.cholesky is not None:
                    self._step_vjp(step, control_bar, nodes_bar, bars)
        self._change_transpose(bars, nodes_bar)
        return nodes_bar

    def evaluate(self, control_points: np.ndarray) -> np.ndarray:
        """Regenerate the grid, shape (n_nodes, 3), from control points at the parameters and knots of this grid."""
        points = np.empty_like(self.nodes)
        for step in self.steps:
            points[step.entity.rows] = step.evaluate(control_points)
        return self._copy_shared(points)

    def evaluate_jvp(self, control_points: np.ndarray, d_nodes: np.ndarray, d_control: np.ndarray) -> np.ndarray:
        """Differentiate `evaluate`, through the parameters and knots as well.

        Parameters
        ----------
        control_points, d_control : ndarray, shape (n_control_points, 3)
            Control points and direction in them.
        d_nodes : ndarray, shape (n_nodes, 3)
            Direction in the baseline grid.

        Returns
        -------
        ndarray, shape (n_nodes, 3)
        """
        change, d_points = self._change(d_nodes), np.empty_like(self.nodes)
        for step in self.steps:
            rows, net = step.entity.rows, _net(control_points, step)
            d_points[rows] = step.evaluate(d_control) + _sum_apply(self._matrix_jvp(step, change), net)
        return self._copy_shared(d_points)

    def evaluate_vjp(self, control_points: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `evaluate_jvp`.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Control points.
        bar : ndarray, shape (n_nodes, 3)
            Cotangent of the regenerated grid.

        Returns
        -------
        nodes_bar : ndarray, shape (n_nodes, 3)
            Cotangent of the baseline grid.
        control_bar : ndarray, shape (n_control_points, 3)
        """
        bar, copies = bar.copy(), self.problem.sharing.copies
        np.add.at(bar, copies[:, 1], bar[copies[:, 0]])
        nodes_bar, control_bar, bars = np.zeros_like(self.nodes), np.zeros_like(control_points), self._no_change()
        for step in self.steps:
            step_bar = bar[step.entity.rows]
            net_bar = step.matrix.apply_transpose(step_bar).reshape(*step.entity.control_ids.shape, 3)
            np.add.at(control_bar, step.entity.control_ids, net_bar)
            self._matrix_vjp(step, bars, [(step_bar, _net(control_points, step))])
        self._change_transpose(bars, nodes_bar)
        return nodes_bar, control_bar

    def _step_jvp(self, step: FitStep, change: _Change, d_nodes, d_control) -> None:
        """Solve the differentiated normal equations of an entity."""
        terms, net = self._matrix_jvp(step, change), _net(self.control_points, step)
        residual = self.nodes[step.entity.rows] - step.matrix.apply(net)
        moved = d_nodes[step.entity.rows] - _sum_apply(terms, net)
        right = sum(term.apply_transpose(residual) for term in terms)
        step.solve_residual(moved, right, d_nodes, d_control)

    def _step_vjp(self, step: FitStep, control_bar, nodes_bar, bars: _Change) -> None:
        """Reverse of `_step_jvp`."""
        moved_bar, right_bar = step.solve_residual_transpose(control_bar, nodes_bar)
        np.add.at(nodes_bar, step.entity.rows, moved_bar)
        net = _net(self.control_points, step)
        residual = self.nodes[step.entity.rows] - step.matrix.apply(net)
        self._matrix_vjp(step, bars, [(-moved_bar, net), (residual, right_bar)])

    def _change(self, d_nodes: np.ndarray) -> _Change:
        """Differentiate parameters and edge knots."""
        d_parameters, d_corners = [], []
        for rows, x, volume in zip(self.problem.sharing.rows, self.parameters, self.problem.mesh.volumes):
            d_parameters.append(chord_length_parameters_jvp(self.nodes[rows], x, d_nodes[rows]))
            arguments = x, volume.n_control, volume.orders, self.kind, d_parameters[-1]
            d_corners.append(knots_of_segment_jvp(*arguments))
        return _Change(d_parameters, d_corners)

    def _change_transpose(self, bars: _Change, nodes_bar: np.ndarray) -> None:
        """Add the cotangent of the nodes for those of parameters and edge knots."""
        for segment, (rows, x) in enumerate(zip(self.problem.sharing.rows, self.parameters)):
            volume = self.problem.mesh.volumes[segment]
            arguments = x, volume.n_control, volume.orders, self.kind, bars.corners[segment]
            parameters_bar = bars.parameters[segment] + knots_of_segment_vjp(*arguments)
            nodes_bar[rows] += chord_length_parameters_vjp(self.nodes[rows], x, parameters_bar)

    def _no_change(self) -> _Change:
        shapes = [[(2, 2, k.n_control + k.order) for k in volume.knots] for volume in self.problem.mesh.volumes]
        corners = [[np.zeros(shape) for shape in triple] for triple in shapes]
        return _Change([np.zeros_like(x) for x in self.parameters], corners)

    def _live_matrix(self, step: FitStep) -> LiveMatrix:
        entity = step.entity
        parameters = self.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return LiveMatrix.of(step.matrix, self.problem.mesh.volumes[entity.segment], parameters, entity.is_free)

    def _matrix_jvp(self, step: FitStep, change: _Change):
        entity = step.entity
        d_parameters = change.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return self._live_matrix(step).jvp(d_parameters, change.corners[entity.segment])

    def _matrix_vjp(self, step: FitStep, bars: _Change, pairs) -> None:
        entity = step.entity
        parameters_bar, corners_bar = self._live_matrix(step).vjp(pairs)
        inner = bars.parameters[entity.segment][entity.inner]
        inner += parameters_bar.reshape(inner.shape)
        for total, part in zip(bars.corners[entity.segment], corners_bar):
            total += part

    def _copy_shared(self, points: np.ndarray) -> np.ndarray:
        copies = self.problem.sharing.copies
        points[copies[:, 0]] = points[copies[:, 1]]
        return points


def live_fit(model: FittedModel, nodes: np.ndarray) -> LiveFit:
    """Fit another baseline grid exactly as a model was fitted, with parameters, knots and derivatives of its own.

    Parameters
    ----------
    model : FittedModel
        Gives topology, numbers of control points, orders, kind of knots and smoothing.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).

    Returns
    -------
    LiveFit

    Raises
    ------
    InputError
        If the model has corrected parameters or the user's own knots, which are no functions of the grid.
    """
    settings = model.settings
    if settings.corrections or settings.knots == "given":
        raise InputError(
            f"{model.header.source}: a fit with corrected parameters or given knots does not follow the grid; "
            f"fit without them, or keep parameters and knots frozen"
        )
    frozen = problem_of_mesh(model.topology, model.mesh, settings.smoothing)
    parameters = tuple(chord_length_parameters(nodes[rows]) for rows in frozen.sharing.rows)
    problem = replace(frozen, mesh=replace(model.mesh, volumes=_volumes(model, parameters)))
    operator = problem.operator(parameters)
    return LiveFit(problem, settings.knots, nodes, parameters, operator.steps, operator.forward(nodes))


def _volumes(model: FittedModel, parameters: Sequence[np.ndarray]) -> tuple[Volume, ...]:
    kind = model.settings.knots
    return tuple(
        Volume(knots_of_segment(x, v.n_control, v.orders, kind)) for x, v in zip(parameters, model.mesh.volumes)
    )


def _net(points: np.ndarray, step: FitStep) -> np.ndarray:
    """Points of the section of an entity, shape (N0 N1 N2, 3)."""
    return points[step.entity.control_ids].reshape(-1, 3)


def _sum_apply(terms, net: np.ndarray):
    """Apply a sum of design matrices; 0 for a corner, which has none."""
    return sum(term.apply(net) for term in terms)
