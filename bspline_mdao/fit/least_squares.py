"""Least squares for the control points, one entity after the other (section II.D), as a linear map with its transpose.

With the control points of an entity's boundary known, the inner ones are a *prior* (`bspline_mdao.fit.prior`) plus a
deviation d that solves the normal equations

    (A^T A + shift I) d = A^T (x - A b_prior).

The shift is zero unless the Gram matrix is singular (knot spans that hold no node); with no shift the prior has no
influence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError
from ..splines.volume import Volume
from ..topology.sections import whole_slices
from .cholesky import Cholesky, factorize
from .design_matrix import DesignMatrix, build_design_matrix
from .entities import Entity
from .prior import Prior, greville_prior
from .quasi_interpolant import LEAST_SQUARES, Mixture

LARGEST_GRAM = 2**31
"""Bytes beyond which a Gram matrix is refused."""


@dataclass(frozen=True, eq=False)
class FitStep:
    """The least squares of one entity, factored.

    Parameters
    ----------
    entity : Entity
        Its nodes and control points.
    matrix : DesignMatrix
        A, of all control points of its section.
    cholesky : Cholesky or None
        Factor of the normal equations; None where all control points are known before.
    prior : Prior
        What the control points lean on where the Cholesky factor has a shift.
    """

    entity: Entity
    matrix: DesignMatrix
    cholesky: Cholesky | None
    prior: Prior

    def solve(self, nodes: np.ndarray, control_points: np.ndarray) -> None:
        """Write the entity's control points, from the nodes and the control points of its boundary.

        Parameters
        ----------
        nodes : ndarray, shape (n_rows, 3)
            All nodes of the grid.
        control_points : ndarray, shape (n_control_points, 3)
            All control points.
        """
        if self.cholesky is not None:
            self.solve_residual(nodes[self.entity.rows], 0.0, nodes, control_points)

    def solve_residual(self, points: np.ndarray, right, nodes: np.ndarray, control_points: np.ndarray) -> None:
        """Solve ``(A_u^T A_u + shift I) d = A_u^T (points - A prior) + right_u`` and write ``prior + d``.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Values at the entity's nodes.
        right : ndarray, shape (N0 N1 N2, 3), or 0
            What is added on the right, for all control points of the section.
        nodes : ndarray, shape (n_rows, 3)
            All nodes of the grid, for the prior.
        control_points : ndarray, shape (n_control_points, 3)
            Those of the boundary are read, those of the entity written.
        """
        net = self.prior.net(nodes, control_points[self.entity.control_ids]).reshape(-1, 3)
        prior = net[self._places]
        net = self._with_columns(net, prior)
        right = right + self.matrix.apply_transpose(points - self.matrix.apply(net))
        control_points[self.entity.unknown_ids] = prior + self.cholesky.solve(self._sum_columns(right))

    def solve_transpose(self, control_bar: np.ndarray, nodes_bar: np.ndarray) -> None:
        """Reverse of `solve`: move ``control_bar`` of the entity to its nodes and to its boundary.

        Parameters
        ----------
        control_bar : ndarray, shape (n_control_points, 3)
            Cotangent of the control points; the entity's own entries are used up.
        nodes_bar : ndarray, shape (n_rows, 3)
            Cotangent of the nodes, added to.
        """
        if self.cholesky is not None:
            points_bar, _ = self.solve_residual_transpose(control_bar, nodes_bar)
            np.add.at(nodes_bar, self.entity.rows, points_bar)

    def solve_residual_transpose(self, control_bar, nodes_bar) -> tuple[np.ndarray, np.ndarray]:
        """Reverse of `solve_residual`: cotangents of ``points`` and ``right``; the other two are updated in place."""
        ids = self.entity.control_ids
        unknown_bar = control_bar[self.entity.unknown_ids]
        control_bar[self.entity.unknown_ids] = 0
        right_bar = self._with_columns(np.zeros((ids.size, 3)), self.cholesky.solve(unknown_bar))
        points_bar = self.matrix.apply(right_bar)
        net_bar = -self.matrix.apply_transpose(points_bar)
        prior_bar = unknown_bar + self._sum_columns(net_bar)
        net_bar = self._with_columns(net_bar, np.zeros_like(prior_bar))
        net_bar[self._places] += prior_bar
        np.add.at(control_bar, ids, self.prior.net_transpose(net_bar.reshape(*ids.shape, 3), nodes_bar))
        return points_bar, right_bar

    def evaluate(self, control_points: np.ndarray) -> np.ndarray:
        """Points of the spline at the entity's nodes, shape (n, 3)."""
        return self.matrix.apply(self.entity.net(control_points))

    @property
    def _places(self) -> np.ndarray:
        """First place of each column in the section."""
        columns = self.entity.columns
        places = np.empty(len(self.entity.unknown_ids), dtype=np.int64)
        places[columns[columns >= 0][::-1]] = np.flatnonzero(columns >= 0)[::-1]
        return places

    def _with_columns(self, net: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        """Return the net with the unknown points replaced."""
        columns = self.entity.columns
        return np.where(columns[:, None] >= 0, unknowns[columns], net)

    def _sum_columns(self, net: np.ndarray) -> np.ndarray:
        """Transpose of `_with_columns`: the sum of the net over the places of each unknown."""
        columns, result = self.entity.columns, np.zeros((len(self.entity.unknown_ids), 3))
        np.add.at(result, columns[columns >= 0], net[columns >= 0])
        return result


@dataclass(frozen=True, eq=False)
class FitOperator:
    """The linear map from the nodes of a grid to the control points, for given parameters and knots.

    Parameters
    ----------
    steps : tuple of FitStep
        In the order of section II.D; none where the mixture has no share of least squares.
    n_nodes, n_control_points : int
        Sizes of the two sides.
    mixture : Mixture
        What control points are where least squares fold.
    """

    steps: tuple[FitStep, ...]
    n_nodes: int
    n_control_points: int
    mixture: Mixture = LEAST_SQUARES

    def forward(self, nodes: np.ndarray) -> np.ndarray:
        """Control points, shape (n_control_points, 3), fitted to the nodes, shape (n_nodes, 3)."""
        control_points = np.zeros((self.n_control_points, 3))
        with threadpool_limits(1, "blas"):
            for step in self.steps:
                step.solve(nodes, control_points)
        return self.mixture.forward(control_points, nodes)

    def adjoint(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`: shape (n_nodes, 3), of shape (n_control_points, 3)."""
        control_bar, nodes_bar = self.mixture.adjoint(control_bar, self.n_nodes)
        with threadpool_limits(1, "blas"):
            for step in reversed(self.steps):
                step.solve_transpose(control_bar, nodes_bar)
        return nodes_bar


def build_step(
    entity: Entity,
    volume: Volume,
    parameters: np.ndarray,
    rows: np.ndarray,
    blends,
    n_rows: int,
    name: str = "entity",
) -> FitStep:
    """Set up and factor the normal equations of an entity.

    Parameters
    ----------
    entity : Entity
        Its nodes and control points.
    volume : Volume
        Orders and knots of its segment.
    parameters : ndarray, shape (L0, L1, L2, 3)
        Parameters of the nodes of its segment.
    rows : ndarray of int, shape (L0, L1, L2)
        Rows of these nodes in the grid vector.
    blends : sequence of three ndarray, each of shape (N_d,)
        For the prior, see `bspline_mdao.fit.prior.edge_blends`.
    n_rows : int
        Length of the grid vector.
    name : str
        Name of the entity for messages.

    Returns
    -------
    FitStep

    Raises
    ------
    InputError
        If the Gram matrix would be too large.
    """
    matrix = build_design_matrix(volume, parameters[entity.inner].reshape(-1, 3), entity.is_free)
    n_columns = len(entity.unknown_ids)
    blends = tuple(blend if free else np.zeros(1) for blend, free in zip(blends, entity.is_free))
    if n_columns == 0:
        return FitStep(entity, matrix, None, Prior(blends))
    cholesky = factorize(*_gram(matrix, entity, name), matrix.shape[0] / n_columns)
    if cholesky.shift == 0.0:
        return FitStep(entity, matrix, cholesky, Prior(blends))
    section_rows = rows[whole_slices(entity.section)]
    return FitStep(entity, matrix, cholesky, greville_prior(blends, section_rows, matrix.orders, n_rows))


def _gram(matrix: DesignMatrix, entity: Entity, name: str) -> tuple[np.ndarray, bool]:
    """Gram matrix of an entity, and whether it is banded: where that is less work."""
    n_columns, bandwidth = len(entity.unknown_ids), matrix.bandwidth(entity.columns)
    is_banded = 3 * bandwidth < n_columns
    n_bytes = 8 * n_columns * (bandwidth + 1 if is_banded else n_columns)
    if n_bytes > LARGEST_GRAM:
        raise InputError(
            f"{name}: least squares of {n_columns:,} control points need {n_bytes / 2**30:.1f} GiB, more than "
            f"{LARGEST_GRAM / 2**30:g}; use fewer, or split the block"
        )
    return matrix.gram(entity.columns, n_columns, bandwidth if is_banded else None), is_banded
