"""Small sets of points that cut a graph in two: the multilevel way.

The graph is coarsened until few points are left; there separators are grown from several starting points and improved;
the best one is carried back to the graph, level by level, and improved on each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .coarsening import coarsen
from .separator_search import SEPARATOR, improve

__all__ = ["find_separator"]

N_COARSEST = 80
"""Points at which coarsening ends."""

N_STARTS = 4
"""Separators that are grown on the coarsest graph."""

LARGEST_SIDE = 0.58
"""Largest share of the weight that one side may have."""


@njit(cache=True)
def find_separator(starts, neighbours, edge_weights):
    """Cut a graph in two.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.
    edge_weights : ndarray of int32
        How closely the ends of its edges belong together.

    Returns
    -------
    ndarray of int8, shape (n,)
        Part of every point: side 0, side 1 or `SEPARATOR`. No edge joins the two sides.
    """
    n = len(starts) - 1
    weights = np.ones(n, np.int32)
    heaviest = max(1, int(LARGEST_SIDE * n))
    levels = [(starts, neighbours, weights)]
    maps = [np.empty(0, np.int32)]
    while len(weights) > N_COARSEST:
        starts, neighbours, edge_weights, weights, coarse = coarsen(
            starts, neighbours, edge_weights, weights, 3 * n // (2 * N_COARSEST) + 1
        )
        if len(weights) > 0.95 * len(coarse):
            break
        levels.append((starts, neighbours, weights))
        maps.append(coarse)
    starts, neighbours, weights = levels[-1]
    parts = _best_grown(starts, neighbours, weights, heaviest)
    for level in range(len(levels) - 2, -1, -1):
        parts = parts[maps[level + 1]]
        starts, neighbours, weights = levels[level]
        improve(starts, neighbours, weights, parts, heaviest, 4, 40)
    return parts


@njit(cache=True)
def _best_grown(starts, neighbours, weights, heaviest):
    """Smallest of several separators, grown from points spread over the numbering."""
    n = len(weights)
    best, best_parts = np.inf, np.zeros(n, np.int8)
    for number in range(min(n, N_STARTS)):
        parts = _grow(starts, neighbours, weights, number * n // min(n, N_STARTS))
        score = improve(starts, neighbours, weights, parts, heaviest, 4, 25)
        if score < best:
            best, best_parts = score, parts
    return best_parts


@njit(cache=True)
def _grow(starts, neighbours, weights, first):
    """Side 0: half of the weight, breadth first from a point; separator: its neighbours; side 1: the rest."""
    n, half = len(weights), np.sum(weights) // 2
    parts = np.ones(n, np.int8)
    queue, head, tail, total, unseen = np.empty(n, np.int32), 0, 1, 0, 0
    is_seen = np.zeros(n, np.bool_)
    queue[0] = first
    is_seen[first] = True
    while total < half:
        if head == tail:
            while is_seen[unseen]:
                unseen += 1
            queue[tail] = unseen
            is_seen[unseen] = True
            tail += 1
        point = queue[head]
        head += 1
        parts[point] = 0
        total += weights[point]
        for other in neighbours[starts[point] : starts[point + 1]]:
            if not is_seen[other]:
                is_seen[other] = True
                queue[tail] = other
                tail += 1
    for point in queue[head:tail]:
        parts[point] = SEPARATOR
    return parts
