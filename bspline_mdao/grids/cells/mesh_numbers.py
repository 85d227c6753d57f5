"""Checks of the numbers in meshes of mixed cells: each is an existing node, and each cell has faces.

Kernels index by them unchecked, so these checks alone prevent a wrong number from reaching memory outside the
mesh.
"""

from __future__ import annotations

import numpy as np

from ...errors import InputError

__all__ = ["require_cells", "require_corners"]


def require_corners(
    corners: np.ndarray,  # corners of elements
    width: int,  # number of corners of each
    n_points: int,  # number of nodes
    what: str,  # description of the elements for messages
    # copies of each node of the file among the nodes, see `MixedMesh`: messages count nodes of the file
    n_copies: int = 1,
) -> None:
    """Refuse corners that are not whole numbers of nodes."""
    if not isinstance(corners, np.ndarray) or corners.dtype.kind not in "iu" or corners.shape[1:] != (width,):
        found = f"{getattr(corners, 'dtype', type(corners).__name__)} of shape {np.shape(corners)}"
        raise InputError(f"{what} are {found}; give whole numbers of shape (n, {width})")
    is_wrong = (corners < 0) | (corners >= n_points)
    if is_wrong.any():
        element, n_stored = int(np.argmax(is_wrong.any(axis=1))), n_points // n_copies
        number = int(corners[element][is_wrong[element]][0])
        number -= (n_copies - 1) * n_stored * (number >= n_points)
        raise InputError(f"{what}: number {element + 1} has node {number} of {n_stored:,}, from 0; write it again")


def require_cells(
    faces: np.ndarray,  # (n, 4), corners of the faces
    cells: np.ndarray,  # (n,), their cells, from 0
    n_points: int,  # number of nodes
    what: str,  # their origin, for messages
) -> None:
    """Refuse faces that belong to no cell or have no node, and cells without faces."""
    require_corners(faces, 4, n_points, f"{what}: faces of cells")
    if not isinstance(cells, np.ndarray) or cells.dtype.kind not in "iu" or cells.shape != (len(faces),):
        raise InputError(f"{what}: the cells of faces are not one whole number each; write it again")
    last = int(cells.max(initial=-1))
    if len(cells) and cells.min() < 0:
        raise InputError(f"{what}: a face is of cell {int(cells.min())}; write it again")
    if last >= len(cells):  # before an array of that size is allocated
        raise InputError(f"{what}: a face is of cell {last}, of cells with {len(cells):,} faces in all; write it again")
    counts = np.bincount(cells.astype(np.int64), minlength=last + 1)
    if not counts.all():
        raise InputError(f"{what}: cell {int(np.argmin(counts))} of {last + 1:,}, from 0, has no faces; write it again")
