"""Walls beyond periodic sides: images of the walls within, so the layer sees walls on both sides.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...grids.topology.periodic_pair import Motion

__all__ = ["WallImages"]


@dataclass(frozen=True, eq=False)
class WallImages(OneLine):
    """Faces of walls beyond periodic sides: their nodes are nodes of the mesh, or images of some."""

    points: np.ndarray  # (n, 3), images (m)
    originals: np.ndarray  # int (n,), nodes of the mesh that the images belong to
    turns: np.ndarray  # (n, 3, 3), rotations by which their displacements are turned
    faces: np.ndarray  # int (n_faces, 4), nodes of the mesh, then images, around the normal into the fluid
    marker: np.ndarray  # int (n_faces,), wall that each face belongs to

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n, 3), nodes of the mesh (m)
        faces: np.ndarray,  # int (n_faces, 4), walls within
        marker: np.ndarray,  # int (n_faces,), wall that each face belongs to
        reach: np.ndarray,  # (n_faces,), distance from a side up to which the image of a face counts (m)
        # each Motion, nodes of a side, int (n_side,), and the nodes that the motion maps them to
        sides: Iterable[tuple[Motion, np.ndarray, np.ndarray]],
    ) -> WallImages | None:
        """Place walls beyond both sides of periodic pairs; None if there are none."""
        found: list[tuple[np.ndarray, ...]] = []
        for ahead, first, second in sides:
            for motion, near, beyond in ((ahead, first, second), (ahead.inverse(), second, first)):
                corners = points[faces].reshape(-1, 3)
                distances, _ = cKDTree(points[near]).query(corners, distance_upper_bound=reach.max(initial=0.0))
                kept = np.flatnonzero((distances.reshape(-1, 4) <= reach[:, None]).any(axis=1))
                partner = np.full(len(points), -1)
                partner[near] = beyond
                is_in = np.isin(faces[kept], near)
                kept = kept[(~is_in | np.isin(partner[faces[kept]], faces)).all(axis=1)]
                originals = np.setdiff1d(faces[kept], near)
                numbers = len(points) + sum(len(images) for images, *_ in found)
                partner[originals] = numbers + np.arange(len(originals))
                turns = np.tile(motion.turn(np.eye(3)).T, (len(originals), 1, 1))
                found.append((motion.move(points[originals]), originals, turns, partner[faces[kept]], marker[kept]))
        if not any(len(of_faces) for *_, of_faces, _ in found):
            return None
        return cls(*(np.concatenate(parts) for parts in zip(*found)))

    def beyond(self, nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Nodes of a mesh followed by their images, for nodes at points, both of shape (n_points, 3)."""
        return np.concatenate([nodes, self.points + self.turned((nodes - points)[self.originals])])

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of the images, shape (n, 3), from vectors of their originals."""
        return np.einsum("nij,nj->ni", self.turns, vectors)

    def turned_back(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `turned`."""
        return np.einsum("nij,ni->nj", self.turns, bar)

    def changes(self, changes: np.ndarray) -> np.ndarray:
        """Changes of nodes, followed by changes of their images."""
        return np.concatenate([changes, self.turned(changes[self.originals])])

    def changes_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `changes`."""
        found = bar[: len(bar) - len(self.points)].copy()
        np.add.at(found, self.originals, self.turned_back(bar[len(found) :]))
        return found
