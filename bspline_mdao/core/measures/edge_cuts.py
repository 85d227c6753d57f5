"""Cuts of quad edges where a function of the nodes, such as the height above a plane, is zero: sections.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

__all__ = ["EdgeCuts", "cut_edges", "edges_of_quads", "root_end"]

ROOT = 0.5
"""An open edge that extends beyond this fraction of the surface is not a root's: the edge of one side of a wing alone
goes to the tip."""


class EdgeCuts(NamedTuple):
    """Points on edges, as weighted means of their ends."""

    nodes: np.ndarray  # int (n, 2), ends of the edges
    weights: np.ndarray  # (n, 2), weights of the ends, of sum 1

    def at(self, points: np.ndarray) -> np.ndarray:
        """Positions, shape (n, 3), from nodes, shape (n_points, 3)."""
        return np.einsum("nm,nmd->nd", self.weights, points[self.nodes])

    def matrix(self, n_points: int) -> csr_array:
        """The map of nodes to the points, shape (n, n_points)."""
        starts = 2 * np.arange(len(self.nodes) + 1)
        return csr_array((self.weights.ravel(), self.nodes.ravel(), starts), shape=(len(self.nodes), n_points))


def edges_of_quads(quads: np.ndarray) -> np.ndarray:
    """Edges of quads, shape (n_quads, 4), each once, shape (n, 2); without collapsed ones."""
    edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    return np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)


def root_end(
    quads: np.ndarray,  # int (n_quads, 4), corners of the quads of a wing
    places: np.ndarray,  # (n_points,), position of every point along the span, from the root on
) -> float:
    """Position from which on sections are complete: the outboard end of the open edge at which a wing begins."""
    # At a symmetry plane that edge is at one position; at a fuselage it is curved and goes around the root.
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges, counts = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0, return_counts=True)
    used = places[np.unique(quads)]
    low, extent = used.min(), np.ptp(used)
    first, second = edges[counts == 1].T
    n = len(places)
    _, labels = connected_components(coo_array((np.ones(len(first)), (first, second)), shape=(n, n)))
    inboard = first[np.argmin(places[first])] if len(first) else None
    end = low if inboard is None else places[first[labels[first] == labels[inboard]]].max()
    return float(end if end - low <= ROOT * extent else low)


def cut_edges(
    edges: np.ndarray,  # int (n, 2), ends of the edges
    heights: np.ndarray,  # (n_points,), of all nodes; linear on the edges between. Level edges are not cut
    near: float = 0.0,  # absolute height up to which a node counts as at 0
) -> EdgeCuts:
    """Find the points of height 0."""
    first, second = np.where(np.abs(heights) <= near, 0.0, heights)[edges].T
    is_cut = (first * second <= 0.0) & (first != second)
    fraction = first[is_cut] / (first - second)[is_cut]
    return EdgeCuts(edges[is_cut], np.stack([1.0 - fraction, fraction], axis=1))
