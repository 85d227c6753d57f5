"""The matrix A of ``x = A b``, Eq. (3), for one face, edge or interior, never assembled, and its derivatives.

Nodes are sorted by span triple. Nodes with the same triple form a *group*; they share the ``p_0 p_1 p_2`` control
points. Products with A, its transpose and the Gram matrix ``A^T A`` are small dense products, one for each group.

A depends on the parameters of its nodes and on the knots on the edges of its block (`LiveMatrix`). The basis values of
a direction depend on the node's parameter of this direction and on the local knots. These depend on the edge knots and
on the other two parameters, Eqs. (4) and (5). Spans are fixed.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ..splines.basis import basis_derivatives, find_span
from ..splines.knots import ConstantKnots, bilinear_knots, bilinear_slopes
from ..splines.volume import Volume, basis_products, partial_sums, sort_by_key, sub_net_ids, volume_basis
from .edge_knots import edge_corners

ACROSS = ConstantKnots.uniform(1, 1)
"""Knots across a face or edge: the only function is 1."""

_ROWS = 256
"""Most rows of one dense product, to stay in the cache."""


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """Basis values of nodes, sorted by span."""

    # control points and orders of the three directions; 1 and 1 across a face or edge
    n_control: tuple[int, int, int]
    orders: tuple[int, int, int]
    node_order: np.ndarray  # int (n,), number of each sorted node in the given order of nodes
    values: np.ndarray  # (n, p0 + p1 + p2), basis values of the three directions of each sorted node
    starts: np.ndarray  # int (n_groups + 1,), first sorted node of each group
    firsts: np.ndarray  # int (n_groups, 3), first control point of each group in each direction

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of nodes and of control points."""
        return len(self.node_order), int(np.prod(self.n_control))

    def apply(self, control_points: np.ndarray) -> np.ndarray:
        """Return ``A b``: points, shape (n, 3), from control points, shape (N0 N1 N2, 3)."""
        points = np.empty((self.shape[0], 3))
        _apply(*self._kernel_arguments(), np.ascontiguousarray(control_points), points)
        return points

    def apply_transpose(self, bar: np.ndarray) -> np.ndarray:
        """Return ``A^T r``: shape (N0 N1 N2, 3), from r, shape (n, 3)."""
        result = np.zeros((self.shape[1], 3))
        _apply_transpose(*self._kernel_arguments(), np.ascontiguousarray(bar), result)
        return result

    def bandwidth(self, columns: np.ndarray) -> int:
        """Largest distance of two columns with entries in one row; ``columns`` as in `gram`."""
        return _bandwidth(self.n_control, self.orders, self.starts, self.firsts, columns)

    def gram(
        self,
        columns: np.ndarray,  # int (N0 N1 N2,), column of each control point; -1 if it is not an unknown
        n_columns: int,  # number of columns
        bandwidth: int | None,  # None for a dense result
    ) -> np.ndarray:
        """Gram matrix ``A^T A`` of the unknown control points."""
        # returns (n_columns, n_columns) or (n_columns, bandwidth + 1); entry [j, i] (dense) or [j, i - j] (band) is
        # element (i, j), only for i >= j
        gram = np.zeros((n_columns, n_columns if bandwidth is None else bandwidth + 1))
        _add_gram(self.n_control, self.orders, *self._basis_values(), columns, bandwidth is not None, gram)
        return gram

    def _basis_values(self) -> tuple:
        return self.values, self.starts, self.firsts

    def _kernel_arguments(self) -> tuple:
        return self.n_control, self.orders, *self._basis_values(), self.node_order


def build_design_matrix(
    volume: Volume,  # orders and knots
    parameters: np.ndarray,  # (n, 3), parameters of the nodes
    # false across a face or edge, where all nodes have the parameter 0, or all have 1
    is_free: Sequence[bool] = (True, True, True),
) -> DesignMatrix:
    """Sort nodes by span and evaluate the basis functions of Eq. (4)."""
    section = Volume(tuple(knots if free else ACROSS for knots, free in zip(volume.knots, is_free)))
    firsts, values = volume_basis(section, parameters)
    keys = np.ravel_multi_index(firsts.T, section.n_control)
    used, starts, node_order = sort_by_key(keys, int(np.prod(section.n_control)))
    firsts = np.stack(np.unravel_index(used, section.n_control), axis=1)
    return DesignMatrix(
        section.n_control, section.orders, node_order.astype(np.int32), values[node_order], starts, firsts
    )


@dataclass(frozen=True, eq=False)
class LiveMatrix:
    """A design matrix with its dependence on parameters and knots."""

    matrix: DesignMatrix
    parameters: np.ndarray  # (n, 3), parameters of the nodes, in sorted order
    corners: tuple[np.ndarray, ...]  # each (2, 2, N + p), knots on the edges
    free: tuple[int, ...]  # directions in which the section extends

    @classmethod
    def of(cls, matrix: DesignMatrix, volume: Volume, parameters: np.ndarray, is_free: Sequence[bool]) -> LiveMatrix:
        """Combine a matrix with the parameters and knots that it was built from, see `build_design_matrix`."""
        corners = tuple(edge_corners(knots) for knots in volume.knots)
        return cls(matrix, parameters[matrix.node_order], corners, tuple(np.flatnonzero(is_free).tolist()))

    def jvp(
        self,
        d_parameters: np.ndarray,  # (n, 3), direction in the parameters, in the given order of nodes
        d_corners: Sequence[np.ndarray],  # each (2, 2, N + p), direction in the edge knots
    ) -> list[DesignMatrix]:
        """Differentiate the matrix; the result is a sum of design matrices, one for each free direction."""
        d_parameters, terms = d_parameters[self.matrix.node_order], []
        for d in self.free:
            values = self.matrix.values.copy()
            point, d_point = _cyclic(self.parameters, d), _cyclic(d_parameters, d)
            order = self.matrix.orders[d]
            _values_jvp(self.corners[d], d_corners[d], order, point, d_point, values[:, self._columns(d)])
            terms.append(replace(self.matrix, values=values))
        return terms

    def vjp(
        self,
        # cotangents at the nodes, and the control points that they belong to
        pairs: Sequence[tuple[np.ndarray, np.ndarray]],  # (n, 3) and (N0 N1 N2, 3)
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Cotangents of parameters and edge knots of the sum of ``bar . (A b)`` over pairs of bar and b."""
        # returns parameters_bar (n, 3): in the given order of nodes
        # returns corners_bar each (2, 2, N + p)
        matrix, values_bar = self.matrix, np.zeros_like(self.matrix.values)
        for bar, points in pairs:
            _add_values_bar(
                *(matrix.orders, matrix.values, matrix.starts, matrix.firsts, matrix.node_order),
                *(np.ascontiguousarray(bar), points.reshape(*matrix.n_control, 3), values_bar),
            )
        sorted_bar, corners_bar = np.zeros_like(self.parameters), [np.zeros_like(c) for c in self.corners]
        for d in self.free:
            point_bar = np.zeros_like(self.parameters)
            point, bar = _cyclic(self.parameters, d), values_bar[:, self._columns(d)]
            _values_vjp(self.corners[d], matrix.orders[d], point, bar, point_bar, corners_bar[d])
            sorted_bar += np.roll(point_bar, d, axis=1)
        parameters_bar = np.empty_like(sorted_bar)
        parameters_bar[matrix.node_order] = sorted_bar
        return parameters_bar, corners_bar

    def _columns(self, d: int) -> slice:
        """Columns of the basis values of a direction."""
        start = sum(self.matrix.orders[:d])
        return slice(start, start + self.matrix.orders[d])


def _cyclic(parameters: np.ndarray, d: int) -> np.ndarray:
    """Parameters in the order (d, d + 1, d + 2), as the knots of direction d use them."""
    return np.roll(parameters, -d, axis=1)


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_rows(values, start, stop, orders, rows):
    """Dense rows of A of the nodes ``start .. stop - 1``."""
    for q in range(start, stop):
        basis_products(orders, values[q], rows[q - start])


@njit(cache=True, error_model="numpy", nogil=True)
def _local_points(n_control, orders, first, points):
    """Numbers of the control points of a group."""
    steps = n_control[1] * n_control[2], n_control[2], 1
    sub_net_ids(orders, first[0] * steps[0] + first[1] * steps[1] + first[2], steps, points)


@njit(cache=True, error_model="numpy", nogil=True)
def _apply(n_control, orders, values, starts, firsts, node_order, control_points, out):
    size = orders[0] * orders[1] * orders[2]
    rows, points = np.empty((_ROWS, size)), np.empty(size, dtype=np.int64)
    local, result = np.empty((size, 3)), np.empty((_ROWS, 3))
    for group in range(len(firsts)):
        _local_points(n_control, orders, firsts[group], points)
        for m in range(size):
            for c in range(3):
                local[m, c] = control_points[points[m], c]
        for start in range(starts[group], starts[group + 1], _ROWS):
            n = min(_ROWS, starts[group + 1] - start)
            _fill_rows(values, start, start + n, orders, rows)
            np.dot(rows[:n], local, result[:n])
            for q in range(n):
                for c in range(3):
                    out[node_order[start + q], c] = result[q, c]


@njit(cache=True, error_model="numpy", nogil=True)
def _apply_transpose(n_control, orders, values, starts, firsts, node_order, bar, out):
    size = orders[0] * orders[1] * orders[2]
    rows, points = np.empty((_ROWS, size)), np.empty(size, dtype=np.int64)
    local, result = np.empty((_ROWS, 3)), np.empty((size, 3))
    for group in range(len(firsts)):
        _local_points(n_control, orders, firsts[group], points)
        for start in range(starts[group], starts[group + 1], _ROWS):
            n = min(_ROWS, starts[group + 1] - start)
            _fill_rows(values, start, start + n, orders, rows)
            for q in range(n):
                for c in range(3):
                    local[q, c] = bar[node_order[start + q], c]
            np.dot(rows[:n].T, local[:n], result)
            for m in range(size):
                for c in range(3):
                    out[points[m], c] += result[m, c]


@njit(cache=True, error_model="numpy", nogil=True)
def _add_gram(n_control, orders, values, starts, firsts, columns, is_banded, gram):
    size = orders[0] * orders[1] * orders[2]
    rows, points = np.empty((_ROWS, size)), np.empty(size, dtype=np.int64)
    product = np.empty((size, size))
    for group in range(len(firsts)):
        _local_points(n_control, orders, firsts[group], points)
        for start in range(starts[group], starts[group + 1], _ROWS):
            n = min(_ROWS, starts[group + 1] - start)
            _fill_rows(values, start, start + n, orders, rows)
            np.dot(rows[:n].T, rows[:n], product)
            _scatter(product, points, columns, is_banded, gram)


@njit(cache=True, error_model="numpy", nogil=True)
def _scatter(product, points, columns, is_banded, gram):
    """Add a group's product to the lower half of the Gram matrix."""
    for a in range(len(points)):
        j = columns[points[a]]
        if j < 0:
            continue
        shift = j if is_banded else 0
        for b in range(len(points)):
            i = columns[points[b]]
            if i >= j:
                gram[j, i - shift] += product[a, b]


@njit(cache=True, error_model="numpy", nogil=True)
def _bandwidth(n_control, orders, starts, firsts, columns):
    points = np.empty(orders[0] * orders[1] * orders[2], dtype=np.int64)
    width = 0
    for group in range(len(firsts)):
        _local_points(n_control, orders, firsts[group], points)
        low, high = len(columns), -1
        for m in range(len(points)):
            column = columns[points[m]]
            if column >= 0:
                low, high = min(low, column), max(high, column)
        width = max(width, high - low)
    return width


@njit(cache=True, error_model="numpy")
def _values_jvp(corners, d_corners, order, point, d_point, d_values):
    """Write the change of the basis values of one direction with a single variable that everything depends on."""
    n_knots = corners.shape[2]
    T, slopes, d_T = np.empty(n_knots), np.empty((2, n_knots)), np.empty((n_knots, 1))
    work = np.empty((order, 2))
    for q in range(len(point)):
        xi, s, t = point[q]
        bilinear_knots(corners, s, t, T)
        bilinear_knots(d_corners, s, t, d_T[:, 0])
        span = find_span(T, order, n_knots - order, xi)
        first, end = span - order + 2, span + order
        bilinear_slopes(corners, s, t, first, end, slopes[0], slopes[1])
        for i in range(first, end):
            d_T[i, 0] += slopes[0, i] * d_point[q, 1] + slopes[1, i] * d_point[q, 2]
        basis_derivatives(T, d_T, order, span, xi, (d_point[q, 0],), work)
        for a in range(order):
            d_values[q, a] = work[a, 1]


@njit(cache=True, error_model="numpy")
def _values_vjp(corners, order, point, values_bar, point_bar, corners_bar):
    """Transpose of `_values_jvp`: add to the cotangents of parameters and edge knots."""
    n_knots, n_local = corners.shape[2], 2 * order - 2
    T, slopes, work = np.empty(n_knots), np.empty((2, n_knots)), np.empty((order, 2 + n_local))
    variables = np.eye(1 + n_local)  # the parameter, and the local knots
    for q in range(len(point)):
        xi, s, t = point[q]
        bilinear_knots(corners, s, t, T)
        span = find_span(T, order, n_knots - order, xi)
        first, end = span - order + 2, span + order
        bilinear_slopes(corners, s, t, first, end, slopes[0], slopes[1])
        basis_derivatives(T[first:end], variables[1:], order, order - 2, xi, variables[0], work)
        for a in range(order):
            point_bar[q, 0] += work[a, 1] * values_bar[q, a]
        for i in range(first, end):
            bar = 0.0
            for a in range(order):
                bar += work[a, 2 + i - first] * values_bar[q, a]
            point_bar[q, 1] += slopes[0, i] * bar
            point_bar[q, 2] += slopes[1, i] * bar
            corners_bar[0, 0, i] += (1.0 - s) * (1.0 - t) * bar
            corners_bar[1, 0, i] += s * (1.0 - t) * bar
            corners_bar[0, 1, i] += (1.0 - s) * t * bar
            corners_bar[1, 1, i] += s * t * bar


@njit(cache=True, error_model="numpy")
def _add_values_bar(orders, values, starts, firsts, node_order, bar, points, values_bar):
    """Add the basis values' cotangent for a cotangent of A b, node by node; ``points`` has shape (N0, N1, N2, 3)."""
    sums = np.empty((values.shape[1], 3))
    for group in range(len(firsts)):
        for q in range(starts[group], starts[group + 1]):
            x, y, z = bar[node_order[q]]
            partial_sums(points, firsts[group], orders, values[q], sums)
            for m in range(values.shape[1]):
                values_bar[q, m] += x * sums[m, 0] + y * sums[m, 1] + z * sums[m, 2]
