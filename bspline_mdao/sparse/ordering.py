"""Fill-reducing order by nested dissection.

A separator cuts the graph in two; it is eliminated last, and each side before it, in the same way. Eliminating one side
does not touch the other [George, SIAM J. Numer. Anal. 10 (1973)].
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .coarsening import common_neighbours
from .minimum_degree import by_minimum_degree
from .separator_search import SEPARATOR
from .separators import find_separator

__all__ = ["nested_dissection"]

N_LEAF = 100
"""Pieces of at most so many points are not cut any more."""


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
