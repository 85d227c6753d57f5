"""Nodes that are copies of others on periodic sides: what moves them alike, turned where sides repeat by a rotation.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from .lattice_frame import CylindricalFrame, Directions, LatticeFrame

__all__ = ["TiedNodes", "copies_among"]


@dataclass(frozen=True, eq=False)
class TiedNodes(OneLine):
    """Nodes that have copies, or are their own, and what makes them move alike."""

    rows: np.ndarray  # int (n,), the nodes, ascending
    means: csr_array  # (n, n), gives each the mean of itself and its copies: symmetric
    directions: Directions | None = None  # directions in which their vectors are alike; those of space by default

    @classmethod
    def of(
        cls,
        pairs: np.ndarray,  # int (m, 2), nodes and copies of them: themselves on an axis
        points: np.ndarray,  # (n_points, 3), all nodes (m)
        frame: LatticeFrame,
    ) -> TiedNodes:
        """Gather all copies of each node."""
        copies = copies_among(pairs, len(points))
        itself = pairs[pairs[:, 0] == pairs[:, 1]] if isinstance(frame, CylindricalFrame) else copies[:0]
        rows = np.unique(np.concatenate([copies, itself]))
        root = rows.copy()
        root[np.searchsorted(rows, copies[:, 1])] = copies[:, 0]
        _, group = np.unique(root, return_inverse=True)
        shape = (int(group.max(initial=-1)) + 1, len(rows))
        members = csr_array((np.ones(len(rows)), (group, np.arange(len(rows)))), shape=shape)
        counts = np.asarray(members.sum(axis=1)).ravel()
        means = csr_array((members.T @ members).multiply(1.0 / counts[group][:, None]))
        directions = None
        if isinstance(frame, CylindricalFrame):
            directions = frame.directions_of_copies(points[rows], points[root])
        return cls(rows, means, directions)

    def alike(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of all nodes, shape (n_points, 3), in place: those of copies are their mean. Symmetric."""
        taken = vectors[self.rows]
        if self.directions is None:
            vectors[self.rows] = self.means @ taken
        else:
            vectors[self.rows] = self.directions.space(self.means @ self.directions.local(taken))
        return vectors


def copies_among(pairs: np.ndarray, n: int) -> np.ndarray:
    """Pairs of the first of all that are copies of each other, among n, and each other one, from pairs (m, 2)."""
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    root = first[label]
    others = np.flatnonzero(root != np.arange(n))
    return np.stack([root[others], others], axis=1)
