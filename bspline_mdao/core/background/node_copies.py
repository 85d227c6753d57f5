"""Copies of nodes on periodic sides: how they move equally, rotated if the period is a rotation.

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
    """Nodes that have copies, or are their own, and the averaging that makes them move equally."""

    rows: np.ndarray  # int (n,), the nodes, ascending
    means: csr_array  # (n, n), mean of each node and its copies: symmetric
    directions: Directions | None = None  # directions in which their vectors are equal; Cartesian by default

    @classmethod
    def of(
        cls,
        pairs: np.ndarray,  # int (m, 2), nodes and their copies: themselves on an axis
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
        """Average vectors of all nodes, shape (n_points, 3), over copies, in place. Symmetric."""
        taken = vectors[self.rows]
        if self.directions is None:
            vectors[self.rows] = self.means @ taken
        else:
            vectors[self.rows] = self.directions.space(self.means @ self.directions.local(taken))
        return vectors


def copies_among(pairs: np.ndarray, n: int) -> np.ndarray:
    """For each set of copies among n, pairs of the first and each other, from pairs (m, 2)."""
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    root = first[label]
    others = np.flatnonzero(root != np.arange(n))
    return np.stack([root[others], others], axis=1)
