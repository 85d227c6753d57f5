"""Derivatives of the design matrix in the parameters of its nodes and in the knots on the edges of its block.

The basis values of a direction depend on the node's parameter of that direction and on the local knots, which depend on
the edge knots and on the other two parameters, Eqs. (4) and (5). Spans stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ..splines.basis import basis_jacobian, find_span
from ..splines.knots import BilinearKnots, Knots, bilinear_knots
from ..splines.volume import Volume
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
                *(matrix.n_control, matrix.orders, matrix.values, matrix.starts, matrix.firsts, matrix.node_order),
                *(np.ascontiguousarray(bar), np.ascontiguousarray(points), values_bar),
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
def _knot_slopes(c, i, s, t):
    """Differentiate knot i in s and t."""
    by_s = (1.0 - t) * (c[1, 0, i] - c[0, 0, i]) + t * (c[1, 1, i] - c[0, 1, i])
    by_t = (1.0 - s) * (c[0, 1, i] - c[0, 0, i]) + s * (c[1, 1, i] - c[1, 0, i])
    return by_s, by_t


@njit(cache=True, error_model="numpy")
def _values_jvp(corners, d_corners, order, point, d_point, d_values):
    n_knots = corners.shape[2]
    T, dT, work = np.empty(n_knots), np.empty(n_knots), np.empty((order, 2 * order - 1))
    for q in range(len(point)):
        xi, s, t = point[q]
        bilinear_knots(corners, s, t, T)
        bilinear_knots(d_corners, s, t, dT)
        span = find_span(T, order, n_knots - order, xi)
        basis_jacobian(T, order, span, xi, work)
        for a in range(order):
            d_values[q, a] = work[a, 0] * d_point[q, 0]
        for m in range(2 * order - 2):
            i = span - order + 2 + m
            by_s, by_t = _knot_slopes(corners, i, s, t)
            change = dT[i] + by_s * d_point[q, 1] + by_t * d_point[q, 2]
            for a in range(order):
                d_values[q, a] += work[a, 1 + m] * change


@njit(cache=True, error_model="numpy")
def _values_vjp(corners, order, point, values_bar, point_bar, corners_bar):
    n_knots = corners.shape[2]
    T, work = np.empty(n_knots), np.empty((order, 2 * order - 1))
    for q in range(len(point)):
        xi, s, t = point[q]
        bilinear_knots(corners, s, t, T)
        span = find_span(T, order, n_knots - order, xi)
        basis_jacobian(T, order, span, xi, work)
        for a in range(order):
            point_bar[q, 0] += work[a, 0] * values_bar[q, a]
        for m in range(2 * order - 2):
            bar = 0.0
            for a in range(order):
                bar += work[a, 1 + m] * values_bar[q, a]
            i = span - order + 2 + m
            by_s, by_t = _knot_slopes(corners, i, s, t)
            point_bar[q, 1] += by_s * bar
            point_bar[q, 2] += by_t * bar
            corners_bar[0, 0, i] += (1.0 - s) * (1.0 - t) * bar
            corners_bar[1, 0, i] += s * (1.0 - t) * bar
            corners_bar[0, 1, i] += (1.0 - s) * t * bar
            corners_bar[1, 1, i] += s * t * bar


@njit(cache=True, error_model="numpy")
def _add_values_bar(n_control, orders, values, starts, firsts, node_order, bar, points, values_bar):
    """Add the cotangent of the basis values for that of A b, node by node."""
    p_0, p_1, p_2 = orders
    for run in range(len(firsts)):
        i, j, k = firsts[run]
        for q in range(starts[run], starts[run + 1]):
            x, y, z = bar[node_order[q]]
            for a in range(p_0):
                for b in range(p_1):
                    first = ((i + a) * n_control[1] + j + b) * n_control[2] + k
                    v_0, v_1 = values[q, a], values[q, p_0 + b]
                    sum_2 = 0.0
                    for c in range(p_2):
                        point = points[first + c]
                        weight = x * point[0] + y * point[1] + z * point[2]
                        values_bar[q, p_0 + p_1 + c] += v_0 * v_1 * weight
                        sum_2 += values[q, p_0 + p_1 + c] * weight
                    values_bar[q, a] += v_1 * sum_2
                    values_bar[q, p_0 + b] += v_0 * sum_2
