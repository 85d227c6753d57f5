"""From elements to a block pattern: which points meet, and where each pair of an element's corners is stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from .blocks import BlockPattern

__all__ = ["slots"]


def slots(pattern: BlockPattern, element_points: np.ndarray) -> np.ndarray:
    """Where the blocks of element matrices go.

    Parameters
    ----------
    pattern : BlockPattern
        Pattern that holds all pairs of an element's points, as `BlockPattern.of_elements` makes it.
    element_points : ndarray of int32, shape (n_elements, m)
        Block row of every corner; -1 where a point has no freedom.

    Returns
    -------
    ndarray of int32, shape (n_elements, m (m + 1) / 2)
        Place in ``data`` of the pair of corners (a, b), b <= a, in column ``a (a + 1) / 2 + b``; -1 where one of them
        has no freedom. With p = ``element_points[e]`` and the element's block ``K_ab``, what is to be added there is

        - ``K_ab`` where ``p[a] > p[b]`` or a = b,
        - ``K_ab^T`` where ``p[a] < p[b]``, because only the lower triangle is stored,
        - ``K_ab + K_ab^T`` where ``p[a] == p[b]`` but a > b, in an element with a collapsed edge.
    """
    return _slots(pattern.indptr, pattern.indices, np.ascontiguousarray(element_points, np.int32))


@njit(cache=True)
def _slots(indptr, indices, element_points):
    """Look every pair up by bisection in its row."""
    n_elements, m = element_points.shape
    found = np.full((n_elements, m * (m + 1) // 2), -1, np.int32)
    for element in range(n_elements):
        for a in range(m):
            for b in range(a + 1):
                row = max(element_points[element, a], element_points[element, b])
                column = min(element_points[element, a], element_points[element, b])
                if column >= 0:
                    place = np.searchsorted(indices[indptr[row] : indptr[row + 1]], column)
                    found[element, a * (a + 1) // 2 + b] = indptr[row] + place
    return found


@njit(cache=True)
def lower_pattern(element_points, n):
    """Lower triangle by rows: rows are counted first, then filled, so that no pair is held twice."""
    starts, elements = _elements_of_points(element_points, n)
    indptr = np.zeros(n + 1, np.int64)
    seen = np.full(n, -1, np.int32)
    for row in range(n):
        indptr[row + 1] = indptr[row] + _gather_row(row, starts, elements, element_points, seen, seen[:0])
    indices = np.empty(indptr[n], np.int32)
    seen[:] = -1
    for row in range(n):
        columns = indices[indptr[row] : indptr[row + 1]]
        _gather_row(row, starts, elements, element_points, seen, columns)
        columns.sort()
    return indptr, indices


@njit(cache=True)
def _elements_of_points(element_points, n):
    """Elements around every point, in compressed rows; an element that holds a point twice is listed twice."""
    starts = np.zeros(n + 1, np.int64)
    for point in element_points.ravel():
        if point >= 0:
            starts[point + 1] += 1
    starts = np.cumsum(starts)
    elements, ends = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for element in range(len(element_points)):
        for point in element_points[element]:
            if point >= 0:
                elements[ends[point]] = element
                ends[point] += 1
    return starts, elements


@njit(cache=True)
def _gather_row(row, starts, elements, element_points, seen, columns):
    """Count the columns of a row, itself included, and write them to ``columns`` unless that is empty."""
    seen[row] = row
    if len(columns):
        columns[0] = row
    n_columns = 1
    for element in elements[starts[row] : starts[row + 1]]:
        for point in element_points[element]:
            if 0 <= point < row and seen[point] != row:
                seen[point] = row
                if len(columns):
                    columns[n_columns] = point
                n_columns += 1
    return n_columns
