"""Sparse elimination of homogeneous linear equations, one equation after the other.

Every equation is reduced by those before it; what is left of it gives one coordinate in terms of others, or nothing
where it is redundant. Coefficients 0, 1 and -1 stay exact: what cancels but for round-off is zero, and what is one but
for round-off is one.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np
from numba import njit

__all__ = ["INDEPENDENT", "PIVOT", "ROUND_OFF", "reduced_rows"]

INDEPENDENT = 1e-6
"""An equation counts where it leaves the span of those before it by more than this part of its largest coefficient."""

PIVOT = 0.01
"""A preferred coordinate is taken where its coefficient is at least this part of the largest one."""

ROUND_OFF = 8.0 * np.finfo(float).eps
"""A sum that is smaller than this part of its terms is zero."""

Rows = namedtuple("Rows", "starts columns values")
"""Sparse rows one after the other, each without its pivot, whose coefficient is one."""

Work = namedtuple("Work", "values is_in columns n")
"""One row in the making: a value for every column, and the columns that were touched, ``n[0]`` of them."""


@njit(cache=True)
def reduced_rows(indptr, indices, data, n_columns, preferred, is_first):
    """Give dependent coordinates in terms of independent ones.

    Parameters
    ----------
    indptr, indices, data : ndarray
        Equations as rows of a CSR matrix, in the order in which they are to be used; those that share coordinates,
        directly or through others, stand together.
    n_columns : int
        Number of coordinates.
    preferred : ndarray of int, shape (n_equations,)
        The coordinate that each equation would rather give; -1 for none.
    is_first : ndarray of bool, shape (n_equations,)
        Equations that share no coordinate with any before them.

    Returns
    -------
    pivots, sources : ndarray of int, shape (rank,)
        Dependent coordinates, and the equation that gave each.
    starts : ndarray of int, shape (rank + 1,)
        Where each row starts in the other two.
    columns, values : ndarray, shape (n_values,)
        Independent coordinates and their coefficients: ``pivot = - sum(values * columns)``.
    """
    work = _new_work(n_columns)
    order = np.full(n_columns, -1, dtype=np.int64)
    pivots, sources, rows = _forward(indptr, indices, data, preferred, is_first, order, work)
    reduced = _backward(pivots, order, rows, work)
    n_values = reduced.starts[-1]
    return pivots[::-1], sources[::-1], reduced.starts, reduced.columns[:n_values], reduced.values[:n_values]


@njit(cache=True)
def _forward(indptr, indices, data, preferred, is_first, order, work):
    """Reduce each equation by those before it; `order` becomes the number of each pivot."""
    n = len(indptr) - 1
    pivots, sources = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    rows = _new_rows(n, len(indices))
    rank = first = 0
    for row in range(n):
        first = rank if is_first[row] else first
        for at in range(indptr[row], indptr[row + 1]):
            _add(work, indices[at], data[at])
        size = _largest(work)
        for k in range(first, rank):
            _subtract_row(work, rows, k, pivots[k])
        pivot = _pivot(work, size, preferred[row])
        if pivot >= 0:
            rows = _append(rows, rank, work, pivot)
            pivots[rank], sources[rank], order[pivot] = pivot, row, rank
            rank += 1
        _clear(work)
    return pivots[:rank], sources[:rank], rows


@njit(cache=True)
def _backward(pivots, order, rows, work):
    """Replace later pivots in every row by the rows that give them; the last row comes first."""
    last = len(pivots) - 1
    reduced = _new_rows(len(pivots), len(rows.columns))
    for done in range(len(pivots)):
        k = last - done
        for at in range(rows.starts[k], rows.starts[k + 1]):
            _add(work, rows.columns[at], rows.values[at])
        for at in range(rows.starts[k], rows.starts[k + 1]):
            later = order[rows.columns[at]]
            if later >= 0:
                _subtract_row(work, reduced, last - later, pivots[later])
        _add(work, pivots[k], 1.0)
        reduced = _append(reduced, done, work, pivots[k])
        _clear(work)
    return reduced


@njit(cache=True)
def _pivot(work, size, preferred):
    """Column to be given by a row: the preferred, or the largest, the last of equals; -1 where the row is redundant."""
    largest = _largest(work)
    if largest <= INDEPENDENT * size:
        return -1
    if preferred >= 0 and abs(work.values[preferred]) >= PIVOT * largest:
        return preferred
    pivot = -1
    for column in work.columns[: work.n[0]]:
        if abs(work.values[column]) >= (1.0 - ROUND_OFF) * largest and column > pivot:
            pivot = column
    return pivot


@njit(cache=True)
def _subtract_row(work, rows, k, pivot):
    """Take row k as often off as makes its pivot vanish."""
    factor = work.values[pivot]
    if factor == 0.0:
        return
    work.values[pivot] = 0.0
    for at in range(rows.starts[k], rows.starts[k + 1]):
        _add(work, rows.columns[at], -factor * rows.values[at])


@njit(cache=True)
def _append(rows, k, work, pivot):
    """Store row k, its pivot scaled to one and left out."""
    rows = _with_room(rows, rows.starts[k] + work.n[0])
    at, scale = rows.starts[k], work.values[pivot]
    for column in np.sort(work.columns[: work.n[0]]):
        value = work.values[column] / scale
        if column != pivot and value != 0.0:
            rows.columns[at] = column
            rows.values[at] = np.sign(value) if abs(abs(value) - 1.0) <= ROUND_OFF else value
            at += 1
    rows.starts[k + 1] = at
    return rows


@njit(cache=True)
def _with_room(rows, n):
    """The same rows, with room for n values."""
    if n <= len(rows.columns):
        return rows
    columns, values = np.empty(2 * n, dtype=np.int64), np.empty(2 * n)
    columns[: len(rows.columns)] = rows.columns
    values[: len(rows.values)] = rows.values
    return Rows(rows.starts, columns, values)


@njit(cache=True)
def _add(work, column, value):
    """Add to one column; what cancels but for round-off is zero."""
    if not work.is_in[column]:
        work.is_in[column] = True
        work.columns[work.n[0]] = column
        work.n[0] += 1
    old = work.values[column]
    new = old + value
    work.values[column] = 0.0 if abs(new) <= ROUND_OFF * (abs(old) + abs(value)) else new


@njit(cache=True)
def _largest(work):
    """Largest value by size."""
    largest = 0.0
    for column in work.columns[: work.n[0]]:
        largest = max(largest, abs(work.values[column]))
    return largest


@njit(cache=True)
def _clear(work):
    """Make the row empty."""
    for column in work.columns[: work.n[0]]:
        work.values[column] = 0.0
        work.is_in[column] = False
    work.n[0] = 0


@njit(cache=True)
def _new_work(n_columns):
    """Empty row."""
    is_in, columns = np.zeros(n_columns, dtype=np.bool_), np.empty(n_columns, dtype=np.int64)
    return Work(np.zeros(n_columns), is_in, columns, np.zeros(1, dtype=np.int64))


@njit(cache=True)
def _new_rows(n, n_values):
    """No rows yet, with room for n of them."""
    return Rows(np.zeros(n + 1, dtype=np.int64), np.empty(n_values, dtype=np.int64), np.empty(n_values))
