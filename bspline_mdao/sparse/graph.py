"""The graph of a block pattern: who couples with whom, both ways, without the diagonal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse

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
    """Graph of a `BlockPattern`; neighbours come out ascending."""
    lower = scipy.sparse.csr_array(
        (np.ones(len(pattern.indices), np.int8), pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n)
    )
    strict = scipy.sparse.tril(lower, k=-1, format="csr")
    both = (strict + strict.T).tocsr()
    both.sort_indices()
    return Graph(both.indptr.astype(np.int64), both.indices.astype(np.int32))
