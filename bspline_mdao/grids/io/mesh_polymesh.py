"""Unstructured meshes as OpenFOAM's ``polyMesh``: faces in its order, from cells that were read from other files.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...errors import InputError
from ..cells.cell_faces import BoundaryFaces
from ..cells.mixed_cells import MixedMesh, face_keys
from .openfoam import PolyMesh, foam_name

__all__ = ["polymesh_of"]

PLANES = ("plane_1", "plane_2")
"""Patches for the two planes of a mesh from a two-dimensional file."""

UNASSIGNED = "unassigned"
"""Patch for boundary without a marker."""


def polymesh_of(
    mesh: MixedMesh,
    kinds: Mapping[str, str],  # kinds of its markers
) -> PolyMesh:
    """Order the faces of a mesh: inner ones by the lower and then the higher cell, then marker after marker."""
    quads, cells = mesh.cell_faces
    keys = face_keys(quads, mesh.n_points)
    order = np.argsort(keys, kind="stable")
    is_same = keys[order][1:] == keys[order][:-1]
    if (is_same[1:] & is_same[:-1]).any():
        raise InputError(f"{mesh.source}: a face has three cells; check the mesh")
    pairs = np.stack([order[:-1][is_same], order[1:][is_same]], axis=1)
    is_higher = cells[pairs[:, 0]] > cells[pairs[:, 1]]
    pairs[is_higher] = pairs[is_higher][:, ::-1]  # the face as seen from the lower cell points out of it
    pairs = pairs[np.lexsort((cells[pairs[:, 1]], cells[pairs[:, 0]]))]
    is_edge = np.ones(len(keys), dtype=bool)
    is_edge[pairs] = False
    edge, patches = _patches(mesh, kinds, quads, keys, np.flatnonzero(is_edge), len(pairs))
    chosen = np.concatenate([pairs[:, 0], edge])
    used, numbers = np.unique(quads[chosen], return_inverse=True)
    corners = numbers.reshape(-1, 4)
    return PolyMesh(
        points=mesh.points[used],
        corners=corners,
        is_corner=corners != np.roll(corners, -1, axis=1),
        owner=cells[chosen],
        neighbour=cells[pairs[:, 1]],
        boundary=patches,
        rows=used,
    )


def _patches(
    mesh: MixedMesh, kinds: Mapping[str, str], quads: np.ndarray, keys: np.ndarray, edge: np.ndarray, n_inner: int
) -> tuple[np.ndarray, tuple[BoundaryFaces, ...]]:
    """Faces of the boundary patch after patch, and the patches."""
    of_patch = np.full(len(edge), -1)
    names = list(mesh.markers or {})
    for number, faces in enumerate((mesh.markers or {}).values()):
        of_patch[np.isin(keys[edge], face_keys(faces, mesh.n_points))] = number
    of_kind = {name: kinds.get(name) for name in names}
    if mesh.n_copies == 2:
        is_second = (quads[edge] >= mesh.n_stored).sum(axis=1)
        for name, n_second in zip(PLANES, (0, 4)):
            of_patch[(of_patch < 0) & (is_second == n_second)] = len(names)
            names.append(name)
            of_kind[name] = "symmetry"
    if (of_patch < 0).any():
        of_patch[of_patch < 0] = len(names)
        names.append(UNASSIGNED)
        of_kind[UNASSIGNED] = None
    turned = np.argsort(of_patch, kind="stable")
    starts = n_inner + np.searchsorted(of_patch[turned], np.arange(len(names) + 1))
    foam_names = [foam_name(name) for name in names]
    for name, word in zip(names, foam_names):
        if foam_names.count(word) > 1:
            raise InputError(f"{mesh.source}: marker {name}: another is '{word}' to OpenFOAM, too; rename one of them")
    patches = (
        BoundaryFaces(word, of_kind[name], int(start), int(stop))
        for name, word, start, stop in zip(names, foam_names, starts, starts[1:])
    )
    return edge[turned], tuple(patch for patch in patches if patch.stop > patch.start)
