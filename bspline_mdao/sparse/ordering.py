"""Fill-reducing order by nested dissection."""

from __future__ import annotations

import numpy as np

from .graph import Graph

__all__ = ["nested_dissection"]


def nested_dissection(graph: Graph, points: np.ndarray) -> np.ndarray:
    """Order in which to eliminate the points of a graph.

    Parameters
    ----------
    graph : Graph
        Who couples with whom.
    points : ndarray, shape (n, 3)
        Coordinates.

    Returns
    -------
    ndarray of int32, shape (n,)
        Points in the order of their elimination.
    """
    side = np.zeros(len(points), np.int8)

    def dissect(ids):
        if len(ids) < 40:
            return ids
        span = np.ptp(points[ids], axis=0)
        x = points[ids, np.argmax(span)]
        low = x < np.median(x)
        if not low.any():
            return ids
        side[ids] = np.where(low, 1, 2)
        separator = [i for i in ids[low] if (side[graph.neighbours[graph.starts[i] : graph.starts[i + 1]]] == 2).any()]
        side[ids] = 0
        rest = np.setdiff1d(ids[low], separator)
        return np.concatenate((dissect(rest), dissect(ids[~low]), np.array(separator, ids.dtype)))

    return dissect(np.arange(len(points), dtype=np.int32))
