"""Fill-reducing orders: minimum degree for small graphs, nested dissection for the others.

In nested dissection, a separator cuts the graph in two; it is eliminated last, and each side before it, in the same
way. Eliminating one side does not touch the other [George, SIAM J. Numer. Anal. 10 (1973)].
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numba import njit
from scipy.sparse.linalg import spilu

from .coarsening import common_neighbours
from .minimum_degree import by_minimum_degree
from .separator_search import SEPARATOR
from .separators import find_separator

__all__ = ["fill_reducing_order", "minimum_degree", "nested_dissection"]

LARGEST_FOR_MINIMUM_DEGREE = 4000
"""Graphs of at most so many points are ordered by SciPy's minimum degree. It fills the factor 1.1 to 1.3 times as much,
which costs less there than it takes to dissect the graph, and nothing is to be compiled for it."""

N_LEAF = 100
"""Pieces of at most so many points are not cut any more."""


def fill_reducing_order(starts: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Order in which to eliminate the points of a graph, so that the factor stays sparse.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.

    Returns
    -------
    ndarray of int32, shape (n,)
        Points in the order of their elimination.
    """
    is_small = len(starts) - 1 <= LARGEST_FOR_MINIMUM_DEGREE
    return minimum_degree(starts, neighbours) if is_small else nested_dissection(starts, neighbours)


def minimum_degree(starts: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Order by multiple minimum degree [Liu, ACM Trans. Math. Softw. 11 (1985)], as SuperLU in SciPy has it.

    SuperLU tells the order with a factor alone. Its incomplete factor without any fill is the cheapest one.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.

    Returns
    -------
    ndarray of int32, shape (n,)
        Points in the order of their elimination.
    """
    n = len(starts) - 1
    if n < 2:
        return np.arange(n, dtype=np.int32)
    edges = scipy.sparse.csc_array((np.full(len(neighbours), -1.0), neighbours, starts), shape=(n, n))
    dominant = (edges + scipy.sparse.diags_array(np.diff(starts) + 1.0)).tocsc()
    factor = spilu(
        dominant,
        drop_tol=1.0,
        fill_factor=1.0,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(factor.perm_c).astype(np.int32)


@njit(cache=True)
def nested_dissection(starts, neighbours):
    """Order in which to eliminate the points of a graph.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.

    Returns
    -------
    ndarray of int32, shape (n,)
        Points in the order of their elimination.
    """
    n = len(starts) - 1
    order, place = np.arange(n).astype(np.int32), np.full(n, -1, np.int32)
    edge_weights = common_neighbours(starts, neighbours)
    pieces = [(0, n)]
    while pieces:
        first, last = pieces.pop()
        points = np.sort(order[first:last])
        if len(points) <= N_LEAF:
            order[first:last] = by_minimum_degree(starts, neighbours, points, place)
            continue
        parts = find_separator(*_piece(starts, neighbours, edge_weights, points, place))
        middle, end = first + np.sum(parts == 0), last - np.sum(parts == SEPARATOR)
        order[first:middle], order[middle:end], order[end:last] = (
            points[parts == 0],
            points[parts == 1],
            points[parts == SEPARATOR],
        )
        if end < last or first < middle < end:
            pieces.append((first, middle))
            pieces.append((middle, end))
    return order


@njit(cache=True)
def _piece(starts, neighbours, edge_weights, points, place):
    """Graph of some points alone; ``place`` is -1 everywhere, and again afterwards."""
    for number in range(len(points)):
        place[points[number]] = number
    n_edges = 0
    for point in points:
        n_edges += starts[point + 1] - starts[point]
    new_starts, end = np.zeros(len(points) + 1, np.int64), 0
    new_neighbours, new_weights = np.empty(n_edges, np.int32), np.empty(n_edges, np.int32)
    for number in range(len(points)):
        point = points[number]
        for edge in range(starts[point], starts[point + 1]):
            if place[neighbours[edge]] != -1:
                new_neighbours[end], new_weights[end] = place[neighbours[edge]], edge_weights[edge]
                end += 1
        new_starts[number + 1] = end
    for point in points:
        place[point] = -1
    return new_starts, new_neighbours[:end].copy(), new_weights[:end].copy()
