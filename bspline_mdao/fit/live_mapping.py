"""The mapping ``x = A b`` whose parameters and knots follow the baseline grid ("live"), with its derivatives.

The matrix A of an entity depends on the parameters of its nodes and on the knots on the edges of its
block, and both depend on the nodes of the baseline grid. Spans stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..model.fitted_model import FittedModel
from ..splines.volume import Volume
from .design_matrix import DesignMatrix, build_design_matrix
from .edge_knots import joined_corners, knots_of_segment_jvp, knots_of_segment_vjp, knots_of_segments
from .entities import Entity
from .matrix_derivatives import LiveMatrix
from .parameters import (
    EXPONENTS,
    chord_length_parameters,
    chord_length_parameters_jvp,
    chord_length_parameters_vjp,
)
from .problem import FitProblem, problem_of_mesh


@dataclass(frozen=True, eq=False)
class Change:
    """Derivatives, or cotangents, of what the matrices depend on.

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
class LiveMapping:
    """Regeneration of a grid with the parameters and knots of one baseline grid.

    Parameters
    ----------
    problem : FitProblem
        Entities and shared nodes, the knots of the mesh being those of this grid.
    kind : str
        Kind of knots.
    exponent : float
        Power of the chords that parameters are made of, see `bspline_mdao.fit.parameters.EXPONENTS`.
    nodes : ndarray, shape (n_nodes, 3)
        The baseline grid (m).
    parameters : tuple of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of every segment.
    matrices : tuple of DesignMatrix
        Of every entity of the problem.
    """

    problem: FitProblem
    kind: str
    exponent: float
    nodes: np.ndarray
    parameters: tuple[np.ndarray, ...]
    matrices: tuple[DesignMatrix, ...]

    def evaluate(self, control_points: np.ndarray) -> np.ndarray:
        """Grid, shape (n_nodes, 3), of control points, shape (n_control_points, 3)."""
        points = np.empty_like(self.nodes)
        for entity, matrix in zip(self.problem.entities, self.matrices):
            points[entity.rows] = matrix.apply(entity.net(control_points))
        return self._copy_shared(points)

    def jvp(self, control_points: np.ndarray, d_nodes: np.ndarray, d_control: np.ndarray) -> np.ndarray:
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
        change, d_points = self.change(d_nodes), np.empty_like(self.nodes)
        for entity, matrix in zip(self.problem.entities, self.matrices):
            by_matrix = sum_apply(self.matrix_jvp(entity, matrix, change), entity.net(control_points))
            d_points[entity.rows] = matrix.apply(entity.net(d_control)) + by_matrix
        return self._copy_shared(d_points)

    def vjp(self, control_points: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`.

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
        nodes_bar, control_bar, bars = np.zeros_like(self.nodes), np.zeros_like(control_points), self.no_change()
        for entity, matrix in zip(self.problem.entities, self.matrices):
            net_bar = matrix.apply_transpose(bar[entity.rows]).reshape(*entity.control_ids.shape, 3)
            np.add.at(control_bar, entity.control_ids, net_bar)
            self.add_matrix_vjp(entity, matrix, bars, [(bar[entity.rows], entity.net(control_points))])
        self.add_change_vjp(bars, nodes_bar)
        return nodes_bar, control_bar

    def change(self, d_nodes: np.ndarray) -> Change:
        """Differentiate parameters and edge knots along ``d_nodes``, shape (n_nodes, 3)."""
        d_parameters, d_corners = [], []
        for rows, x, volume in zip(self.problem.sharing.rows, self.parameters, self.problem.mesh.volumes):
            d_parameters.append(chord_length_parameters_jvp(self.nodes[rows], x, d_nodes[rows], self.exponent))
            arguments = x, volume.n_control, volume.orders, self.kind, d_parameters[-1]
            d_corners.append(knots_of_segment_jvp(*arguments))
        return Change(d_parameters, self._joined(d_corners))

    def add_change_vjp(self, bars: Change, nodes_bar: np.ndarray) -> None:
        """Add the cotangent of the nodes for those of parameters and edge knots: transpose of `change`."""
        corners = self._joined(bars.corners)
        for segment, (rows, x) in enumerate(zip(self.problem.sharing.rows, self.parameters)):
            volume = self.problem.mesh.volumes[segment]
            arguments = x, volume.n_control, volume.orders, self.kind, corners[segment]
            parameters_bar = bars.parameters[segment] + knots_of_segment_vjp(*arguments)
            nodes_bar[rows] += chord_length_parameters_vjp(self.nodes[rows], x, parameters_bar, self.exponent)

    def _joined(self, corners):
        """Changes of edge knots, or their cotangents, with those joined that neighbours share."""
        return joined_corners(self.problem.topology, corners) if self.kind == "constant" else corners

    def no_change(self) -> Change:
        """Zeros of the shapes of a `Change`."""
        shapes = [[(2, 2, k.n_control + k.order) for k in volume.knots] for volume in self.problem.mesh.volumes]
        corners = [[np.zeros(shape) for shape in triple] for triple in shapes]
        return Change([np.zeros_like(x) for x in self.parameters], corners)

    def matrix_jvp(self, entity: Entity, matrix: DesignMatrix, change: Change) -> list[DesignMatrix]:
        """Differentiate the matrix of an entity; the result is a sum of design matrices."""
        d_parameters = change.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return self._live_matrix(entity, matrix).jvp(d_parameters, change.corners[entity.segment])

    def add_matrix_vjp(self, entity: Entity, matrix: DesignMatrix, bars: Change, pairs) -> None:
        """Add the cotangents of the sum of ``bar . (A b)`` over pairs of bar and b: transpose of `matrix_jvp`."""
        parameters_bar, corners_bar = self._live_matrix(entity, matrix).vjp(pairs)
        inner = bars.parameters[entity.segment][entity.inner]
        inner += parameters_bar.reshape(inner.shape)
        for total, part in zip(bars.corners[entity.segment], corners_bar):
            total += part

    def _live_matrix(self, entity: Entity, matrix: DesignMatrix) -> LiveMatrix:
        parameters = self.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return LiveMatrix.of(matrix, self.problem.mesh.volumes[entity.segment], parameters, entity.is_free)

    def _copy_shared(self, points: np.ndarray) -> np.ndarray:
        copies = self.problem.sharing.copies
        points[copies[:, 0]] = points[copies[:, 1]]
        return points


def live_mapping(model: FittedModel, nodes: np.ndarray) -> LiveMapping:
    """Regenerate with the parameters and knots that another baseline grid has.

    Parameters
    ----------
    model : FittedModel
        Gives topology, numbers of control points, orders and kind of knots.
    nodes : ndarray, shape (n_nodes, 3)
        The baseline grid (m).

    Returns
    -------
    LiveMapping

    Raises
    ------
    InputError
        If the model has corrected parameters or the user's own parameters or knots, which are no functions of the grid.
    """
    problem, parameters = live_problem(model, nodes)
    matrices = tuple(
        build_design_matrix(problem.mesh.volumes[e.segment], parameters[e.segment][e.inner].reshape(-1, 3), e.is_free)
        for e in problem.entities
    )
    settings = model.settings
    return LiveMapping(problem, settings.knots, EXPONENTS[settings.parametrization], nodes, parameters, matrices)


def live_problem(model: FittedModel, nodes: np.ndarray) -> tuple[FitProblem, tuple[np.ndarray, ...]]:
    """Set up the fit of another baseline grid, with parameters and knots of its own; see `live_mapping`."""
    settings = model.settings
    if settings.corrections or "given" in (settings.knots, settings.parametrization):
        raise InputError(
            f"{model.header.source}: a fit with corrected or given parameters or given knots does not follow the grid; "
            f"fit without them, or keep parameters and knots frozen"
        )
    frozen = problem_of_mesh(model.topology, model.mesh)
    exponent = EXPONENTS[settings.parametrization]
    parameters = tuple(chord_length_parameters(nodes[rows], exponent) for rows in frozen.sharing.rows)
    sizes = zip(*((v.n_control, v.orders) for v in model.mesh.volumes))
    knots = knots_of_segments(model.topology, parameters, *sizes, settings.knots)
    volumes = tuple(map(Volume, knots))
    return replace(frozen, mesh=replace(model.mesh, volumes=volumes)), parameters


def sum_apply(terms, net: np.ndarray):
    """Apply a sum of design matrices; 0 for a corner, which has none."""
    return sum(term.apply(net) for term in terms)
