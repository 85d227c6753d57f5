"""Faces with marked corners: faces on walls, and faces adjacent to them, of meshes with millions of faces.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.rows import copy_row

__all__ = ["faces_at", "faces_on"]


def faces_on(faces: np.ndarray, is_marked: np.ndarray) -> np.ndarray:
    """Numbers of the faces, shape (n, 4), all of whose corners are marked, ascending."""
    return _chosen(faces, is_marked, True)


def faces_at(faces: np.ndarray, is_marked: np.ndarray) -> np.ndarray:
    """Numbers of the faces, shape (n, 4), some of whose corners are marked, but not all, ascending."""
    return _chosen(faces, is_marked, False)


@njit(cache=True, error_model="numpy")
def _chosen(faces, is_marked, is_all):
    found, n = np.empty(64, dtype=np.int64), 0
    for f in range(len(faces)):
        first = is_marked[faces[f, 0]]
        if is_all and not first:
            continue
        is_same = True
        for k in range(1, 4):
            is_same = is_same and is_marked[faces[f, k]] == first
        if is_same != is_all:
            continue
        if n == len(found):
            longer = np.empty(2 * n, dtype=np.int64)
            copy_row(found, longer)
            found = longer
        found[n] = f
        n += 1
    return found[:n].copy()
