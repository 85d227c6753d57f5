"""The matrix A of ``x = A b`` for one face, edge or interior, never assembled: basis values sorted by span.

Nodes with the same span triple form a *run*; they share the ``p_0 p_1 p_2`` control points. Products with A, its
transpose and the Gram matrix ``A^T A`` are small dense products, one for each run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..splines.knots import ConstantKnots
from ..splines.volume import Volume, basis_products, sort_by_key, sub_net_ids, volume_basis

ACROSS = ConstantKnots.uniform(1, 1)
"""Knots across a face or edge: the one function is 1."""

_ROWS = 256  # most rows of one dense product


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """Basis values of nodes, sorted by span.

    Parameters
    ----------
    n_control, orders : tuple of int
        Control points and orders of the three directions; 1 and 1 across a face or edge.
    node_order : ndarray of int, shape (n,)
        Number of each sorted node in the order in which the nodes were given.
    values : ndarray, shape (n, p0 + p1 + p2)
        Basis values of the three directions of each sorted node.
    starts : ndarray of int, shape (n_runs + 1,)
        First sorted node of each run.
    firsts : ndarray of int, shape (n_runs, 3)
        First control point of each run in each direction.
    """

    n_control: tuple[int, int, int]
    orders: tuple[int, int, int]
    node_order: np.ndarray
    values: np.ndarray
    starts: np.ndarray
    firsts: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of nodes and of control points."""
        return len(self.node_order), int(np.prod(self.n_control))

    def apply(self, control_points: np.ndarray) -> np.ndarray:
        """Return ``A b``: points, shape (n, 3), of control points, shape (N0 N1 N2, 3)."""
        points = np.empty((self.shape[0], 3))
        _apply(*self._kernel_arguments(), np.ascontiguousarray(control_points), points)
        return points

    def apply_transpose(self, bar: np.ndarray) -> np.ndarray:
        """Return ``A^T r``: shape (N0 N1 N2, 3), of r, shape (n, 3)."""
        result = np.zeros((self.shape[1], 3))
        _apply_transpose(*self._kernel_arguments(), np.ascontiguousarray(bar), result)
        return result

    def bandwidth(self, columns: np.ndarray) -> int:
        """Largest distance of two columns that meet in one node; ``columns`` as in `gram`."""
        return _bandwidth(self.n_control, self.orders, self.starts, self.firsts, columns)

    def gram(self, columns: np.ndarray, n_columns: int, bandwidth: int | None) -> np.ndarray:
        """Gram matrix ``A^T A`` of the unknown control points.

        Parameters
        ----------
        columns : ndarray of int, shape (N0 N1 N2,)
            Column of each control point; -1 where it is known.
        n_columns : int
            Number of columns.
        bandwidth : int or None
            None for a dense result.

        Returns
        -------
        ndarray, shape (n_columns, n_columns) or (n_columns, bandwidth + 1)
            Entry [j, i] (dense) or [j, i - j] (band) holds element (i, j), for i >= j alone.
        """
        gram = np.zeros((n_columns, n_columns if bandwidth is None else bandwidth + 1))
        _add_gram(self.n_control, self.orders, *self._runs(), columns, bandwidth is not None, gram)
        return gram

    def _runs(self):
        return self.values, self.starts, self.firsts

    def _kernel_arguments(self):
        return self.n_control, self.orders, *self._runs(), self.node_order


def build_design_matrix(volume: Volume, parameters: np.ndarray, is_free=(True, True, True)) -> DesignMatrix:
    """Sort nodes by span and evaluate the basis functions of Eq. (4).

    Parameters
    ----------
    volume : Volume
        Orders and knots.
    parameters : ndarray, shape (n, 3)
        Parameters of the nodes.
    is_free : sequence of three bool
        False across a face or edge, where all nodes have the parameter 0 or all have 1.

    Returns
    -------
    DesignMatrix
    """
    section = Volume(tuple(knots if free else ACROSS for knots, free in zip(volume.knots, is_free)))
    firsts, values = volume_basis(section, parameters)
    keys = np.ravel_multi_index(firsts.T, section.n_control)
    used, starts, node_order = sort_by_key(keys, int(np.prod(section.n_control)))
    firsts = np.stack(np.unravel_index(used, section.n_control), axis=1)
    return DesignMatrix(
        section.n_control, section.orders, node_order.astype(np.int32), values[node_order], starts, firsts
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_rows(values, start, stop, orders, rows):
    """Dense rows of A of the nodes ``start .. stop - 1``."""
    for q in range(start, stop):
        basis_products(orders, values[q], rows[q - start])


@njit(cache=True, error_model="numpy", nogil=True)
def _local_points(n_control, orders, first, points):
    """Numbers of the control points of a run."""
    steps = n_control[1] * n_control[2], n_control[2], 1
    sub_net_ids(orders, first[0] * steps[0] + first[1] * steps[1] + first[2], steps, points)


@njit(cache=True, error_model="numpy", nogil=True)
def _apply(n_control, orders, values, starts, firsts, node_order, control_points, out):
    size = orders[0] * orders[1] * orders[2]
    rows, points = np.empty((_ROWS, size)), np.empty(size, dtype=np.int64)
    local, result = np.empty((size, 3)), np.empty((_ROWS, 3))
    for run in range(len(firsts)):
        _local_points(n_control, orders, firsts[run], points)
        for m in range(size):
            for c in range(3):
                local[m, c] = control_points[points[m], c]
        for start in range(starts[run], starts[run + 1], _ROWS):
            n = min(_ROWS, starts[run + 1] - start)
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
    for run in range(len(firsts)):
        _local_points(n_control, orders, firsts[run], points)
        for start in range(starts[run], starts[run + 1], _ROWS):
            n = min(_ROWS, starts[run + 1] - start)
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
    for run in range(len(firsts)):
        _local_points(n_control, orders, firsts[run], points)
        for start in range(starts[run], starts[run + 1], _ROWS):
            n = min(_ROWS, starts[run + 1] - start)
            _fill_rows(values, start, start + n, orders, rows)
            np.dot(rows[:n].T, rows[:n], product)
            _scatter(product, points, columns, is_banded, gram)


@njit(cache=True, error_model="numpy", nogil=True)
def _scatter(product, points, columns, is_banded, gram):
    """Add a run's product to the lower half of the Gram matrix."""
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
    for run in range(len(firsts)):
        _local_points(n_control, orders, firsts[run], points)
        low, high = len(columns), -1
        for m in range(len(points)):
            column = columns[points[m]]
            if column >= 0:
                low, high = min(low, column), max(high, column)
        width = max(width, high - low)
    return width
