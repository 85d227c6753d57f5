"""Least squares for the control points, one entity after the other (section II.D), as a linear map with its transpose.

Once the control points of an entity's boundary are found, the inner ones are a `ReferenceNet` plus a deviation d that
solves the normal equations

    (A^T A + shift I) d = A^T (x - A b_reference).

The shift (Tikhonov's regularization) is zero unless the Gram matrix is singular, as for knot spans without nodes.
Without a shift the reference has no influence.

Theory: ``docs/theory/fit.rst``.

References
----------
L. Piegl and W. Tiller, "The NURBS Book", 2nd edition, Springer, 1997, section 9.4.
A. N. Tikhonov and V. Y. Arsenin, "Solutions of Ill-Posed Problems", Winston, 1977.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dpotrf, dpotrs
from scipy.sparse import coo_array, csr_array, kron

from ...base.numerics.threads import one_blas_thread
from ...base.numerics.transfinite import boolean_sum, inner_of
from ...errors import InputError
from ...grids.topology.index_space import whole_slices
from ..splines.volume import Volume
from .design_matrix import DesignMatrix, build_design_matrix
from .edge_knots import edge_corners
from .entities import Entity
from .quasi_interpolant import LEAST_SQUARES, Mixture, greville_means, greville_places

LARGEST_GRAM = 2**31
"""Most bytes of a Gram matrix; a larger one is refused."""

SMALLEST_PIVOT = 1e-11
"""A Gram matrix with a pivot below this fraction of its largest diagonal entry counts as singular."""

SHIFT = 1e-8
"""Shift of the diagonal of a singular Gram matrix, in nodes per control point."""


@dataclass(frozen=True, eq=False)
class FitStep:
    """The least squares of one entity, factored."""

    entity: Entity  # its nodes and control points
    matrix: DesignMatrix  # A, of all control points of its section
    factor: GramFactor | None  # of the normal equations; None if earlier entities solve for all control points
    reference: ReferenceNet  # net that the control points are drawn to if the factor has a shift

    def solve(
        self,
        nodes: np.ndarray,  # (n_rows, 3), all nodes of the grid
        control_points: np.ndarray,  # (n_control_points, 3), all control points
    ) -> None:
        """Write the entity's control points from the nodes and the control points of its boundary."""
        if self.factor is not None:
            self.solve_residual(nodes[self.entity.rows], 0.0, nodes, control_points)

    def solve_residual(
        self,
        points: np.ndarray,  # (n, 3), values at the entity's nodes
        right: np.ndarray
        | float,  # (N0 N1 N2, 3), or 0, addition to the right-hand side, for all control points of the section
        nodes: np.ndarray,  # (n_rows, 3), all nodes of the grid, for the reference
        # the boundary's are read, the entity's are written
        control_points: np.ndarray,  # (n_control_points, 3)
    ) -> None:
        """Solve ``(A_u^T A_u + shift I) d = A_u^T (points - A b_reference) + right_u``; write ``b_reference + d``."""
        assert self.factor is not None, "this entity has no control points of its own"
        net = self.reference.net(nodes, self.entity.net(control_points))
        reference = net[self._places]
        net = self._with_columns(net, reference)
        right = right + self.matrix.apply_transpose(points - self.matrix.apply(net))
        control_points[self.entity.unknown_ids] = reference + self.factor.solve(self._sum_columns(right))

    def solve_transpose(
        self,
        # cotangent of the control points; the entity's own entries are overwritten
        control_bar: np.ndarray,  # (n_control_points, 3)
        nodes_bar: np.ndarray,  # (n_rows, 3), cotangent of the nodes, added to
    ) -> None:
        """Reverse of `solve`: move ``control_bar`` of the entity to its nodes and to its boundary."""
        if self.factor is not None:
            points_bar, _ = self.solve_residual_transpose(control_bar, nodes_bar)
            np.add.at(nodes_bar, self.entity.rows, points_bar)

    def solve_residual_transpose(self, control_bar: np.ndarray, nodes_bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reverse of `solve_residual`: cotangents of ``points`` and ``right``; the arguments are updated in place."""
        assert self.factor is not None, "this entity has no control points of its own"
        ids = self.entity.control_ids
        unknown_bar = control_bar[self.entity.unknown_ids]
        control_bar[self.entity.unknown_ids] = 0
        right_bar = self._with_columns(np.zeros((ids.size, 3)), self.factor.solve(unknown_bar))
        points_bar = self.matrix.apply(right_bar)
        net_bar = -self.matrix.apply_transpose(points_bar)
        reference_bar = unknown_bar + self._sum_columns(net_bar)
        net_bar = self._with_columns(net_bar, np.zeros_like(reference_bar))
        net_bar[self._places] += reference_bar
        np.add.at(control_bar, ids.ravel(), self.reference.net_transpose(net_bar, nodes_bar))
        return points_bar, right_bar

    def evaluate(self, control_points: np.ndarray) -> np.ndarray:
        """Points of the spline at the entity's nodes, shape (n, 3)."""
        return self.matrix.apply(self.entity.net(control_points))

    @cached_property
    def _places(self) -> np.ndarray:
        """First place of each column in the section."""
        columns = self.entity.columns
        places = np.empty(len(self.entity.unknown_ids), dtype=np.int64)
        places[columns[columns >= 0][::-1]] = np.flatnonzero(columns >= 0)[::-1]
        return places

    def _with_columns(self, net: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        """The net with the unknown points replaced."""
        columns = self.entity.columns
        return np.where(columns[:, None] >= 0, unknowns[columns], net)

    def _sum_columns(self, net: np.ndarray) -> np.ndarray:
        """Transpose of `_with_columns`: the sum of the net over the places of each unknown."""
        columns, result = self.entity.columns, np.zeros((len(self.entity.unknown_ids), 3))
        np.add.at(result, columns[columns >= 0], net[columns >= 0])
        return result


@dataclass(frozen=True, eq=False)
class FitOperator:
    """The linear map from the nodes of a grid to the control points, for given parameters and knots."""

    steps: tuple[FitStep, ...]  # in the order of section II.D; none if least squares have no weight in the mixture
    # sizes of the two sides
    n_nodes: int
    n_control_points: int
    mixture: Mixture = LEAST_SQUARES  # control points where least squares fold

    def forward(self, nodes: np.ndarray) -> np.ndarray:
        """Control points, shape (n_control_points, 3), fitted to the nodes, shape (n_nodes, 3)."""
        control_points = np.zeros((self.n_control_points, 3))
        with one_blas_thread:
            for step in self.steps:
                step.solve(nodes, control_points)
        return self.mixture.forward(control_points, nodes)

    def adjoint(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`: from shape (n_control_points, 3) to (n_nodes, 3)."""
        control_bar, nodes_bar = self.mixture.adjoint(control_bar, self.n_nodes)
        with one_blas_thread:
            for step in reversed(self.steps):
                step.solve_transpose(control_bar, nodes_bar)
        return nodes_bar


def build_step(
    entity: Entity,  # its nodes and control points
    volume: Volume,  # orders and knots of its segment
    parameters: np.ndarray,  # (L0, L1, L2, 3), parameters of the nodes of its segment
    rows: np.ndarray,  # int (L0, L1, L2), rows of these nodes in the grid vector
    edge_places: Sequence[np.ndarray],  # three, each (N_d,), for the reference, see `places_on_edges`
    n_rows: int,  # length of the grid vector
    name: str = "entity",  # name of the entity for messages
) -> FitStep:
    """Set up and factor the normal equations of an entity. `InputError` if the Gram matrix would be too large."""
    matrix = build_design_matrix(volume, parameters[entity.inner].reshape(-1, 3), entity.is_free)
    n_columns = len(entity.unknown_ids)
    places = tuple(along if free else np.zeros(1) for along, free in zip(edge_places, entity.is_free))
    if n_columns == 0:
        return FitStep(entity, matrix, None, ReferenceNet.of(places))
    factor = factorize(*_gram(matrix, entity, name), matrix.shape[0] / n_columns)
    sampling = None
    if factor.shift:
        sampling = greville_sampling(rows[whole_slices(entity.section)], matrix.n_control, matrix.orders, n_rows)
    return FitStep(entity, matrix, factor, ReferenceNet.of(places, sampling))


def _gram(matrix: DesignMatrix, entity: Entity, name: str) -> tuple[np.ndarray, bool]:
    """Gram matrix of an entity, and whether it is banded, which it is if that is less work."""
    n_columns, bandwidth = len(entity.unknown_ids), matrix.bandwidth(entity.columns)
    is_banded = 3 * bandwidth < n_columns
    n_bytes = 8 * n_columns * (bandwidth + 1 if is_banded else n_columns)
    if n_bytes > LARGEST_GRAM:
        raise InputError(
            f"{name}: least squares of {n_columns:,} control points need {n_bytes / 2**30:.1f} GiB, more than "
            f"{LARGEST_GRAM / 2**30:g}; use fewer, or split the block"
        )
    return matrix.gram(entity.columns, n_columns, bandwidth if is_banded else None), is_banded


@dataclass(frozen=True, eq=False)
class ReferenceNet:
    """Linear map from the grid and the control points of a boundary to a control net: a coarse copy of the grid."""

    # A control mesh mimics a coarse grid, so least squares are drawn to the grid itself, sampled at the Greville nodes
    # (`bspline_mdao.core.fit.quasi_interpolant.greville_places`). The differences between the boundary's control points
    # and their samples are interpolated transfinitely to the interior, in proportion to lengths along the edges, so
    # thin layers of cells stay layers. Both are fixed linear maps.

    inner: np.ndarray  # int (n_inner,), numbers of the inner control points of a net, in C order
    interpolation: csr_array  # (n_inner, N0 N1 N2), weights with which they follow the boundary
    # samples of the grid at the Greville nodes; None for zero, if the factor has no shift
    sampling: csr_array | None = None  # (N0 N1 N2, n_rows), or None

    @classmethod
    def of(
        cls,
        # place of each control point between the ends of its direction, from 0 to 1
        places: Sequence[np.ndarray],  # each (N_d,)
        sampling: csr_array | None = None,  # see the class
    ) -> ReferenceNet:
        """Set up the interpolation of a net whose control points have given places along its edges."""
        shape = tuple(map(len, places))
        numbers = np.arange(np.prod(shape)).reshape(shape)
        columns, values = boolean_sum(np.stack(np.meshgrid(*places, indexing="ij"), axis=-1))
        inner = numbers[inner_of(shape)].ravel()
        entries = values.ravel(), (np.tile(np.arange(len(inner)), len(columns)), columns.ravel())
        return cls(inner, csr_array(entries, shape=(len(inner), numbers.size)), sampling)

    def net(self, nodes: np.ndarray, net: np.ndarray) -> np.ndarray:
        """Complete a net, shape (N0 N1 N2, 3), with given boundary, from nodes, shape (n_rows, 3)."""
        samples = 0.0 if self.sampling is None else self.sampling @ nodes
        difference = net - samples
        difference[self.inner] = self.interpolation @ difference
        return samples + difference

    def net_transpose(self, bar: np.ndarray, nodes_bar: np.ndarray) -> np.ndarray:
        """Transpose of `net`: return the boundary's cotangent and add the nodes' cotangent to ``nodes_bar``."""
        net_bar = bar.copy()
        net_bar[self.inner] = 0.0
        net_bar += self.interpolation.T @ bar[self.inner]
        if self.sampling is not None:
            nodes_bar += self.sampling.T @ (bar - net_bar)
        return net_bar


def greville_sampling(
    rows: np.ndarray,  # int (m0, m1, m2), rows in the grid vector of all nodes of the section
    # control points and orders of its directions
    n_control: Sequence[int],  # three
    orders: Sequence[int],  # three
    n_rows: int,  # length of the grid vector
) -> csr_array:  # (N0 N1 N2, n_rows)
    """Sample the nodes of a section at the Greville nodes, linearly between them."""
    weights = [_line_weights(*line) for line in zip(rows.shape, n_control, orders)]
    local = kron(kron(weights[0], weights[1]), weights[2], format="csr")
    return csr_array((local.data, rows.ravel()[local.indices], local.indptr), shape=(local.shape[0], n_rows))


def _line_weights(n_nodes: int, n_control: int, order: int) -> coo_array:
    """Linear interpolation at the Greville nodes of a line, shape (n_control, n_nodes)."""
    places = greville_places(n_nodes, n_control, order)
    low = np.clip(places.astype(int), 0, max(n_nodes - 2, 0))
    high = np.minimum(low + 1, n_nodes - 1)
    weight, row = places - low, np.arange(n_control)
    values, columns = np.concatenate([1 - weight, weight]), np.concatenate([low, high])
    return coo_array((values, (np.tile(row, 2), columns)), shape=(n_control, n_nodes))


def places_on_edges(volume: Volume) -> tuple[np.ndarray, ...]:
    """Greville abscissae of the mean edge knots of each direction of a volume, each of shape (N,)."""
    return tuple(greville_means(edge_corners(k).mean(axis=(0, 1)), k.n_control, k.order) for k in volume.knots)


@dataclass(frozen=True, eq=False)
class GramFactor:
    """Cholesky factor of a Gram matrix, ``G + shift I``."""

    lower: np.ndarray  # the factor in LAPACK's form
    is_banded: bool  # whether the storage is banded
    shift: float  # addition to the diagonal: 0 unless the matrix is singular

    @property
    def is_singular(self) -> bool:
        """Whether the matrix needed a shift."""
        return self.shift > 0.0

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution of ``(G + shift I) d = right``; both of shape (n, m)."""
        routine = dpbtrs if self.is_banded else dpotrs
        return routine(self.lower, right, lower=1)[0]


def factorize(
    gram: np.ndarray,  # lower half, stored as from `bspline_mdao.core.fit.design_matrix.DesignMatrix.gram`
    is_banded: bool,  # whether it is stored by bands
    unit: float,  # unit of the shift; it must not depend on the matrix, so a shift has no derivative
) -> GramFactor:
    """Factor a Gram matrix, with a shift if it is singular."""
    factor = _factor(gram, is_banded, 0.0)
    if factor is not None:
        return GramFactor(factor, is_banded, 0.0)
    shift = SHIFT * unit
    # the shift has made the matrix definite: no pivot is too small
    factor = _factor(gram, is_banded, shift, 0.0)
    assert factor is not None, "a Gram matrix is positive semidefinite"
    return GramFactor(factor, is_banded, shift)


def _factor(gram: np.ndarray, is_banded: bool, shift: float, smallest: float = SMALLEST_PIVOT) -> np.ndarray | None:
    """Lower factor of the shifted matrix in LAPACK's column-major storage; None if it is singular."""
    lower = gram.T.copy(order="F")
    diagonal = lower[0] if is_banded else np.einsum("ii->i", lower)
    diagonal += shift
    largest = diagonal.max()
    if is_banded:
        factor, info = dpbtrf(lower, lower=1, overwrite_ab=1)
        pivots = factor[0]
    else:
        factor, info = dpotrf(lower, lower=1, clean=0, overwrite_a=1)
        pivots = factor.diagonal()
    is_singular = info != 0 or (pivots**2).min() <= smallest * largest
    return None if is_singular else factor
