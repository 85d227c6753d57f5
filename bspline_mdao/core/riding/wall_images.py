"""Walls beyond periodic sides: images of those within, so that what follows walls sees them on both sides.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine

__all__ = ["WallImages"]


@dataclass(frozen=True, eq=False)
class WallImages(OneLine):
    """Faces of walls beyond periodic sides: their nodes are nodes of the mesh, or images of some."""

    points: np.ndarray  # (n, 3), images (m)
    originals: np.ndarray  # int (n,), nodes of the mesh that they are images of
    turns: np.ndarray  # (n, 3, 3), rotations by which their displacements are turned
    faces: np.ndarray  # int (n_faces, 4), nodes of the mesh, and images behind these, around the normal into the fluid
    marker: np.ndarray  # int (n_faces,), wall that each face is of

    def beyond(self, nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Nodes of a mesh with images of them behind, for nodes at points, both of shape (n_points, 3)."""
        return np.concatenate([nodes, self.points + self.turned((nodes - points)[self.originals])])

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of the images, shape (n, 3), by those of their originals."""
        return np.einsum("nij,nj->ni", self.turns, vectors)

    def turned_back(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `turned`."""
        return np.einsum("nij,ni->nj", self.turns, bar)
