"""Faces of cells of one kind, for meshes with millions of cells.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .pyramids import middle_and_area

__all__ = ["write_faces"]


def write_faces(
    points: np.ndarray,  # (n, 3), nodes (m)
    corners: np.ndarray,  # int (n_cells, n_corners), corners of the cells
    pattern: np.ndarray,  # int (n_faces, 4), corners of the faces of one cell, around the outward normal
    faces: np.ndarray,  # int (n_cells * n_faces, 4), faces of all cells, written in place
) -> None:
    """Write the faces of cells, around their outward normals, as most of the cells define it."""
    n_negative = _write(np.ascontiguousarray(points), np.ascontiguousarray(corners, faces.dtype), pattern, faces)
    if n_negative > 0.5 * len(corners):
        faces[:] = faces[:, ::-1].copy()


@njit(cache=True, error_model="numpy")
def _write(points, corners, pattern, faces):
    """Write faces; return the number of cells that have a negative volume."""
    f, n_negative = 0, 0
    for cell in range(len(corners)):
        first, volume = corners[cell, 0], 0.0
        for side in range(len(pattern)):
            for k in range(4):
                faces[f, k] = corners[cell, pattern[side, k]]
            m0, m1, m2, a0, a1, a2 = middle_and_area(points, faces, f)
            volume += a0 * (m0 - points[first, 0]) + a1 * (m1 - points[first, 1]) + a2 * (m2 - points[first, 2])
            f += 1
        if volume < 0.0:
            n_negative += 1
    return n_negative
