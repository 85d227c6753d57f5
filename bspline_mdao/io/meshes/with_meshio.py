"""Gmsh (.msh) and VTK (.vtu) meshes: meshio reads them; they are written back with other nodes in their places.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ...cells.mixed_cells import MixedMesh, padded
from ...errors import InputError
from ...extras import library
from ..disk import read_raw
from .gmsh_nodes import find_gmsh_nodes
from .stored_mesh import StoredMesh, StoredPoints
from .vtu_points import find_vtu_points

__all__ = ["read_msh", "read_vtu"]

CELLS = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
FACES = {"triangle": 3, "quad": 4}
"""Corners of cells and faces by meshio's names, to which the number of nodes is added where there are more."""


def read_msh(path: str | os.PathLike) -> StoredMesh:
    """Read a mesh of Gmsh, format 2.2 or 4.1, in ASCII or binary.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    StoredMesh
        Its markers are physical surfaces.

    Raises
    ------
    InputError
        If meshio is missing, or the file cannot be used.
    """
    stored = find_gmsh_nodes(read_raw(path), str(path))
    return _file(path, stored, "gmsh")


def read_vtu(path: str | os.PathLike) -> StoredMesh:
    """Read an unstructured grid of VTK in one piece.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    StoredMesh
        It has no markers.

    Raises
    ------
    InputError
        If meshio is missing, or the file cannot be used.
    """
    found = _read(path, "vtu")
    return _file(path, find_vtu_points(read_raw(path), np.asarray(found.points), str(path)), "vtu", found)


def _read(path: str | os.PathLike, form: str) -> Any:
    """Let meshio read a file."""
    meshio = library("meshio", f"{path}: needs meshio", "gmsh")
    try:
        return meshio.read(path, file_format=form)
    except (Exception, SystemExit) as error:  # whatever meshio makes of a damaged file; it exits where it knows why
        raise InputError(
            f"{path}: meshio cannot read it ({str(error) or type(error).__name__}); write it again"
        ) from error


def _file(path: str | os.PathLike, stored: StoredPoints, form: str, found: Any = None) -> StoredMesh:
    """Make the mesh of what meshio read."""
    found = _read(path, form) if found is None else found
    points = np.asarray(found.points)
    if not np.array_equal(points, stored.values.astype(points.dtype)):
        raise InputError(f"{path}: its nodes are not those that meshio reads; save it again, as version 4.1 or 2.2")
    cells: dict[str, list[np.ndarray]] = {}
    for block in found.cells:
        name = block.type.rstrip("0123456789")
        if name in CELLS:
            cells.setdefault(name, []).append(np.asarray(block.data)[:, : CELLS[name]].astype(np.int64))
    if not cells:
        raise InputError(f"{path}: has no tetrahedra, pyramids, wedges or hexahedra; give a mesh of a volume")
    joined = {name: np.concatenate(parts) for name, parts in cells.items()}
    return StoredMesh(MixedMesh(stored.values, joined, _markers(found), source=str(path)), stored)


def _markers(found: Any) -> dict[str, np.ndarray]:
    """Faces of physical surfaces by their names, or numbers where they have none."""
    names = {int(number): name for name, (number, dimension) in found.field_data.items() if dimension == 2}
    markers: dict[str, list[np.ndarray]] = {}
    for block, ids in zip(found.cells, found.cell_data.get("gmsh:physical", [])):
        kind = block.type.rstrip("0123456789")
        if kind in FACES:
            faces = padded(np.asarray(block.data)[:, : FACES[kind]].astype(np.int64))
            for number in np.unique(ids).tolist():
                markers.setdefault(names.get(number, str(number)), []).append(faces[np.asarray(ids) == number])
    return {name: np.concatenate(parts) for name, parts in markers.items()}
