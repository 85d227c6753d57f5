"""Derivatives of the design matrix in the parameters of its nodes and in the knots on the edges of its block.

The basis values of a direction depend on the node's parameter of that direction and on the local knots, which depend on
the edge knots and on the other two parameters, Eqs. (4) and (5). Spans stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ..splines.basis import basis_derivatives, find_span
from ..splines.knots import BilinearKnots, Knots, bilinear_knots, bilinear_slopes
from ..splines.volume import Volume, partial_sums
from .design_matrix import DesignMatrix


@dataclass(frozen=True, eq=False)
class LiveMatrix:
    """A design matrix that knows how it depends on parameters and knots.

    Parameters
    ----------
    matrix : DesignMatrix
        The matrix.
    parameters : ndarray, shape (n, 3)
        Parameters of the nodes, in sorted order.
    corners : tuple of three ndarray, each of shape (2, 2, N + p)
        Knots on the edges.
    free : tuple of int
        Directions in which the section extends.
    """

    matrix: DesignMatrix
    parameters: np.ndarray
    corners: tuple[np.ndarray, ...]
    free: tuple[int, ...]

    @classmethod
    def of(cls, matrix: DesignMatrix, volume: Volume, parameters: np.ndarray, is_free) -> LiveMatrix:
        """Join a matrix and what it was built from, see `bspline_mdao.fit.design_matrix.build_design_matrix`."""
        corners = tuple(edge_corners(knots) for knots in volume.knots)
        return cls(matrix, parameters[matrix.node_order], corners, tuple(np.flatnonzero(is_free).tolist()))

    def jvp(self, d_parameters: np.ndarray, d_corners) -> list[DesignMatrix]:
        """Differentiate the matrix; the result is a sum of design matrices: one for each free direction.

        Parameters
        ----------
        d_parameters : ndarray, shape (n, 3)
            Direction in the parameters, in the order in which the nodes were given.
        d_corners : sequence of three ndarray, each of shape (2, 2, N + p)
            Direction in the edge knots.

        Returns
        -------
        list of DesignMatrix
        """
        d_parameters, terms = d_parameters[self.matrix.node_order], []
        for d in self.free:
            values = self.matrix.values.copy()
            point, d_point = _cyclic(self.parameters, d), _cyclic(d_parameters, d)
            order = self.matrix.orders[d]
            _values_jvp(self.corners[d], d_corners[d], order, point, d_point, values[:, self._columns(d)])
            terms.append(replace(self.matrix, values=values))
        return terms

    def vjp(self, pairs) -> tuple[np.ndarray, list[np.ndarray]]:
        """Cotangents of parameters and edge knots of the sum of ``bar . (A b)`` over pairs of bar and b.

        Parameters
        ----------
        pairs : sequence of (ndarray of shape (n, 3), ndarray of shape (N0 N1 N2, 3))
            Cotangents at the nodes and the control points that they multiply.

        Returns
        -------
        parameters_bar : ndarray, shape (n, 3)
            In the order in which the nodes were given.
        corners_bar : list of three ndarray, each of shape (2, 2, N + p)
        """
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


def edge_corners(knots: Knots) -> np.ndarray:
    """Knots on the four edges, shape (2, 2, N + p)."""
    if isinstance(knots, BilinearKnots):
        return knots.corners
    ends = np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0])
    return knots.values(*ends).reshape(2, 2, -1)


def _cyclic(parameters: np.ndarray, d: int) -> np.ndarray:
    """Parameters in the order (d, d + 1, d + 2) that the knots of direction d use."""
    return np.roll(parameters, -d, axis=1)


@njit(cache=True, error_model="numpy")
def _values_jvp(corners, d_corners, order, point, d_point, d_values):
    """Write the change of the basis values of one direction, in the one variable that all moves with."""
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
    """Add the cotangent of the basis values for that of A b, node by node; ``points`` has shape (N0, N1, N2, 3)."""
    sums = np.empty((values.shape[1], 3))
    for run in range(len(firsts)):
        for q in range(starts[run], starts[run + 1]):
            x, y, z = bar[node_order[q]]
            partial_sums(points, firsts[run], orders, values[q], sums)
            for m in range(values.shape[1]):
                values_bar[q, m] += x * sums[m, 0] + y * sums[m, 1] + z * sums[m, 2]
