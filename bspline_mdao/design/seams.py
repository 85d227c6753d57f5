"""Seams of the surface: where two sides of blocks meet edge to edge, with the control points next to them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from ..mesh.mesh import MovingMesh

__all__ = ["surface_seams"]


def surface_seams(mesh: MovingMesh) -> np.ndarray:
    """Find all seams of the surface.

    Parameters
    ----------
    mesh : MovingMesh
        The mesh.

    Returns
    -------
    ndarray of int, shape (n, 3)
        Rows of ``mesh.surface_ids``: the point next to the seam on one side, on the seam, and on the other side, each
        triple once. Where an edge is collapsed and has no such point, there is no triple.
    """
    sides = defaultdict(list)
    for face in _faces(mesh):
        for edge, inner in _edges(face):
            ahead, back = tuple(edge.tolist()), tuple(edge[::-1].tolist())
            sides[min(ahead, back)].append(inner if ahead <= back else inner[::-1])
    triples = [np.column_stack([pair[0], edge, pair[1]]) for edge, pair in sides.items() if len(pair) == 2]
    triples = np.concatenate([np.zeros((0, 3), dtype=np.int64), *triples])
    a, on, b = np.moveaxis(triples, 1, 0)
    return _once(triples[(a != on) & (on != b) & (a != b)])


def _faces(mesh: MovingMesh) -> Iterator[np.ndarray]:
    """Sides of blocks on the surface, as rows; neither those between two blocks nor those without extent."""
    found = defaultdict(list)
    for ids in mesh.blocks:
        for side in range(6):
            face = mesh.surface_rows[np.take(ids, -(side % 2), axis=side // 2)]
            if (face >= 0).all() and not _has_collapsed(face):
                found[np.unique(face).tobytes()].append(face)
    return (faces[0] for faces in found.values() if len(faces) == 1)


def _has_collapsed(face: np.ndarray) -> bool:
    """Whether all points along one direction are one."""
    return bool((face == face[:1]).all() or (face == face[:, :1]).all())


def _edges(face: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The four edges of a face, each with the line of points next to it."""
    for lines in (face, face.T):
        yield lines[0], lines[1]
        yield lines[-1], lines[-2]


def _once(triples: np.ndarray) -> np.ndarray:
    """Triples without those that are the same, read in either direction."""
    ordered = np.where((triples[:, :1] > triples[:, 2:]), triples[:, ::-1], triples)
    return triples[np.sort(np.unique(ordered, axis=0, return_index=True)[1])]
