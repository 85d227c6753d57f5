"""Pattern of an incomplete factor with level of fill p.

Block (i, j) of the factor, j < i, is kept where a path of at most p + 1 edges leads from i to j in the graph of the
matrix through points that are all eliminated before j [1]_. A search in breadth from every j therefore gives a column
of the pattern without any levels being stored.

.. [1] Hysom and Pothen, "Level-based incomplete LU factorization: graph model and algorithms", UCRL-JC-150789, 2002.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["fill_pattern"]


def fill_pattern(neighbour_starts, neighbours, order, fill: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the strict lower triangle of the incomplete factor, by rows.

    Parameters
    ----------
    neighbour_starts, neighbours : ndarray
        The graph of the matrix: neighbours of every point, in compressed rows, without the point itself.
    order : ndarray of int, shape (n,)
        Points in the order of elimination.
    fill : int
        Level of fill p; 0 keeps the pattern of the matrix.

    Returns
    -------
    starts : ndarray of int64, shape (n + 1,)
    columns : ndarray of int32
        Columns of each row, ascending; rows and columns are places in the order of elimination.
    """
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    starts = _count(neighbour_starts, neighbours, order, rank, fill)
    return starts, _columns(neighbour_starts, neighbours, order, rank, fill, starts)


@njit(cache=True)
def _count(neighbour_starts, neighbours, order, rank, fill):
    """Where the rows of the factor start."""
    n = len(order)
    starts, queue, seen = np.zeros(n + 1, np.int64), np.empty(n, np.int32), np.full(n, -1, np.int32)
    for column in range(n):
        for place in range(_reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue)):
            if queue[place] > column:
                starts[queue[place] + 1] += 1
    return np.cumsum(starts)


@njit(cache=True)
def _columns(neighbour_starts, neighbours, order, rank, fill, starts):
    """Columns of the rows; they come out ascending because the columns are taken in order."""
    n = len(order)
    columns, ends = np.empty(starts[n], np.int32), starts[:n].copy()
    queue, seen = np.empty(n, np.int32), np.full(n, -1, np.int32)
    for column in range(n):
        for place in range(_reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue)):
            row = queue[place]
            if row > column:
                columns[ends[row]] = column
                ends[row] += 1
    return columns


@njit(cache=True)
def _reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue):
    """Write the ranks that at most ``fill`` points of lower rank separate from ``column`` to ``queue``; their number.

    The search goes on from ranks below ``column`` only.
    """
    seen[column], queue[0] = column, column
    first, last = 0, 1
    for _ in range(fill + 1):
        reached = last
        for place in range(first, last):
            if place > 0 and queue[place] > column:
                continue
            point = order[queue[place]]
            for other in neighbours[neighbour_starts[point] : neighbour_starts[point + 1]]:
                if seen[rank[other]] != column:
                    seen[rank[other]], queue[reached] = column, rank[other]
                    reached += 1
        first, last = last, reached
    return last
