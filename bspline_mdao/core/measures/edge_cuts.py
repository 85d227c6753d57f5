"""Cuts of the edges of quads where a function of the nodes, such as the height above a plane, is zero: sections.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

__all__ = ["EdgeCuts", "cut_edges", "edges_of_quads"]


class EdgeCuts(NamedTuple):
    """Points on edges, as weighted means of their ends."""

    nodes: np.ndarray  # int (n, 2), ends of the edges
    weights: np.ndarray  # (n, 2), weights of the ends, of sum 1

    def at(self, points: np.ndarray) -> np.ndarray:
        """Places, shape (n, 3), of nodes, shape (n_points, 3)."""
        return np.einsum("nm,nmd->nd", self.weights, points[self.nodes])

    def matrix(self, n_points: int) -> csr_array:
        """The map of nodes to the points, shape (n, n_points)."""
        starts = 2 * np.arange(len(self.nodes) + 1)
        return csr_array((self.weights.ravel(), self.nodes.ravel(), starts), shape=(len(self.nodes), n_points))


def edges_of_quads(quads: np.ndarray) -> np.ndarray:
    """Edges of quads, shape (n_quads, 4), each once, shape (n, 2); without collapsed ones."""
    edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    return np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)


def cut_edges(
    edges: np.ndarray,  # int (n, 2), ends of the edges
    heights: np.ndarray,  # (n_points,), of all nodes; linear on the edges between. Edges of one height are not cut
    near: float = 0.0,  # height, up or down, up to which a node counts as at 0
) -> EdgeCuts:
    """Find the points of height 0."""
    first, second = np.where(np.abs(heights) <= near, 0.0, heights)[edges].T
    is_cut = (first * second <= 0.0) & (first != second)
    fraction = first[is_cut] / (first - second)[is_cut]
    return EdgeCuts(edges[is_cut], np.stack([1.0 - fraction, fraction], axis=1))
