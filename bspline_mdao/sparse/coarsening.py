"""Smaller copies of a weighted graph: points joined in pairs along their heaviest edges.

A separator of the copy is one of the graph, and moving one point of the copy moves many of the graph: what a local
search cannot do on the graph itself, it can do there [Hendrickson and Leland, Proc. Supercomputing '95; Karypis and
Kumar, SIAM J. Sci. Comput. 20 (1998)].
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["coarsen", "common_neighbours"]


@njit(cache=True)
def coarsen(starts, neighbours, edge_weights, weights, heaviest):
    """Join the points of a graph in pairs.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.
    edge_weights, weights : ndarray of int32
        Weights of its edges (at both ends) and of its points.
    heaviest : int
        No pair is heavier than this.

    Returns
    -------
    starts, neighbours, edge_weights, weights
        The smaller graph.
    coarse : ndarray of int32, shape (n,)
        Its point that each point went into.
    """
    partner = _match(starts, neighbours, edge_weights, weights, heaviest)
    coarse, n_coarse = _number_pairs(partner)
    return (*_contract(starts, neighbours, edge_weights, weights, partner, coarse, n_coarse), coarse)


@njit(cache=True)
def common_neighbours(starts, neighbours):
    """Weights of edges for the first level: one, and one for each common neighbour of the ends.

    In a mesh of hexahedra this tells neighbours along a mesh line from those across a diagonal, so that the pairs, and
    the pairs of pairs, are boxes of the mesh.
    """
    weights, seen_by = np.ones(len(neighbours), np.int32), np.full(len(starts) - 1, -1, np.int32)
    for point in range(len(starts) - 1):
        for other in neighbours[starts[point] : starts[point + 1]]:
            seen_by[other] = point
        for edge in range(starts[point], starts[point + 1]):
            other = neighbours[edge]
            if other < point:
                continue
            for third in neighbours[starts[other] : starts[other + 1]]:
                weights[edge] += seen_by[third] == point
            mirrored = starts[other] + np.searchsorted(neighbours[starts[other] : starts[other + 1]], point)
            weights[mirrored] = weights[edge]
    return weights


@njit(cache=True)
def _match(starts, neighbours, edge_weights, weights, heaviest):
    """Partner of every point over its heaviest edge to a point that is still free; itself if there is none."""
    n = len(weights)
    partner = np.full(n, -1, np.int32)
    for point in range(n):
        if partner[point] != -1:
            continue
        best, best_weight = point, 0
        for edge in range(starts[point], starts[point + 1]):
            other = neighbours[edge]
            is_free = partner[other] == -1 and weights[point] + weights[other] <= heaviest
            if is_free and edge_weights[edge] > best_weight:
                best, best_weight = other, edge_weights[edge]
        partner[point] = best
        partner[best] = point
    return partner


@njit(cache=True)
def _number_pairs(partner):
    """Number of the pair of every point, and the number of pairs."""
    coarse, n_coarse = np.empty(len(partner), np.int32), 0
    for point in range(len(partner)):
        if partner[point] >= point:
            coarse[point] = coarse[partner[point]] = n_coarse
            n_coarse += 1
    return coarse, n_coarse


@njit(cache=True)
def _contract(starts, neighbours, edge_weights, weights, partner, coarse, n_coarse):
    """The graph of the pairs: parallel edges become one of their total weight, edges within a pair vanish."""
    new_starts, new_weights = np.zeros(n_coarse + 1, np.int64), np.zeros(n_coarse, np.int32)
    new_neighbours, new_edge_weights = np.empty_like(neighbours), np.empty_like(edge_weights)
    place = np.full(n_coarse, -1, np.int64)
    end = 0
    for point in range(len(partner)):
        if partner[point] < point:
            continue
        pair, first = coarse[point], end
        for member in range(2 if partner[point] > point else 1):
            node = partner[point] if member else point
            new_weights[pair] += weights[node]
            for edge in range(starts[node], starts[node + 1]):
                other = coarse[neighbours[edge]]
                if other == pair:
                    continue
                if place[other] < first:
                    place[other] = end
                    new_neighbours[end], new_edge_weights[end] = other, 0
                    end += 1
                new_edge_weights[place[other]] += edge_weights[edge]
        new_starts[pair + 1] = end
    return new_starts, new_neighbours[:end].copy(), new_edge_weights[:end].copy(), new_weights
