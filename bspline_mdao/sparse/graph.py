"""The graph of a block pattern: who couples with whom, both ways, without the diagonal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["Graph", "graph_of"]


class Graph(NamedTuple):
    """Undirected graph in compressed rows.

    Parameters
    ----------
    starts : ndarray of int64, shape (n + 1,)
        Where the neighbours of each point start.
    neighbours : ndarray of int32, shape (n_edges,)
        Neighbours of every point, each edge at both ends, no point its own neighbour.
    """

    starts: np.ndarray
    neighbours: np.ndarray


def graph_of(pattern) -> Graph:
    """Graph of a `BlockPattern`."""
    return Graph(*_both_ways(pattern.indptr, pattern.indices))


@njit(cache=True)
def _both_ways(indptr, indices):
    """Mirror the lower triangle; neighbours come out ascending."""
    n = len(indptr) - 1
    starts = np.zeros(n + 1, np.int64)
    for row in range(n):
        starts[row + 1] += indptr[row + 1] - indptr[row] - 1
        for column in indices[indptr[row] : indptr[row + 1] - 1]:
            starts[column + 1] += 1
    starts = np.cumsum(starts)
    neighbours, ends = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for row in range(n):
        for column in indices[indptr[row] : indptr[row + 1] - 1]:
            neighbours[ends[row]] = column
            neighbours[ends[column]] = row
            ends[row] += 1
            ends[column] += 1
    return starts, neighbours
