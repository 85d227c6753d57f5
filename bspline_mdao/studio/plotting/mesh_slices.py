"""Slices through the cells of an unstructured mesh."""

from __future__ import annotations

import numpy as np

from ...grids.cells.mixed_cells import MixedMesh, face_keys
from ...grids.cells.quads import edges_of
from .cuts import cut

__all__ = ["mesh_slice"]


def mesh_slice(
    mesh: MixedMesh,
    nodes: np.ndarray,  # (n_points, 3), its nodes (m)
    axis: int,  # axis normal to the slice
    place: float,  # where it is (m)
    box: np.ndarray,  # (2, 3), lower and upper corner of the box to show (m)
    of: np.ndarray | None = None,  # bool (n_cells,), cells whose edges are returned; all by default
) -> np.ndarray:  # (n, 2, 3), ends of the edges (m)
    """Edges of the cells in a slice; all edges for a two-dimensional file."""
    faces, cells = mesh.cell_faces
    faces = faces if of is None else faces[of[cells]]
    if mesh.n_copies > 1:
        faces = faces[(faces < mesh.n_stored).all(axis=1)]
        return nodes[edges_of(faces[_reaches(nodes[faces], box)])]
    above = (nodes[:, axis] > place)[faces]
    faces = faces[above.any(axis=1) & ~above.all(axis=1)]
    faces = faces[_reaches(nodes[faces], box)]
    _, first = np.unique(face_keys(faces, mesh.n_points), return_index=True)
    return cut(nodes, faces[first], axis, place)


def _reaches(corners: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Whether the boxes of faces, shape (n, 4, 3), reach into a box."""
    return ((corners.max(axis=1) >= box[0]) & (corners.min(axis=1) <= box[1])).all(axis=1)
