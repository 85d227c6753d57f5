"""Gmsh (.msh) and VTK (.vtu) meshes: meshio reads them; they are written back with other nodes in their places.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...cells.mixed_cells import MixedMesh, padded
from ...errors import InputError
from ...extras import library
from ..disk import read_raw
from .gmsh_nodes import find_gmsh_nodes
from .layer_of_cells import SectionSpan, layer_of_cells
from .stored_mesh import StoredMesh, StoredPoints
from .vtu_points import find_vtu_points

__all__ = ["read_msh", "read_vtu"]

CELLS = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
FACES = {"triangle": 3, "quad": 4}
LINES = {"line": 2}
"""Corners of cells, faces and lines by meshio's names, to which the number of nodes is added where there are more."""


def read_msh(path: str | os.PathLike, span: SectionSpan | None = None) -> StoredMesh:
    """Read a mesh of Gmsh, format 2.2 or 4.1, in ASCII or binary.

    Parameters
    ----------
    path : path-like
        The file.
    span : SectionSpan, optional
        Planes of the section that a mesh of two dimensions rides along with.

    Returns
    -------
    StoredMesh
        Its markers are physical surfaces.

    Raises
    ------
    InputError
        If meshio is missing, the file cannot be used, or it is of two dimensions and there is no span.
    """
    stored = find_gmsh_nodes(read_raw(path), str(path))
    return _file(path, span, stored, "gmsh")


def read_vtu(path: str | os.PathLike, span: SectionSpan | None = None) -> StoredMesh:
    """Read an unstructured grid of VTK in one piece.

    Parameters
    ----------
    path : path-like
        The file.
    span : SectionSpan, optional
        Planes of the section that a mesh of two dimensions rides along with.

    Returns
    -------
    StoredMesh
        It has no markers.

    Raises
    ------
    InputError
        If meshio is missing, the file cannot be used, or it is of two dimensions and there is no span.
    """
    found = _read(path, "vtu")
    return _file(path, span, find_vtu_points(read_raw(path), np.asarray(found.points), str(path)), "vtu", found)


def _read(path: str | os.PathLike, form: str) -> Any:
    """Let meshio read a file."""
    meshio = library("meshio", f"{path}: needs meshio", "gmsh")
    try:
        return getattr(meshio, form).read(path)  # its own reader: meshio.read prints why it fails, and exits
    except Exception as error:  # whatever meshio makes of a damaged file
        cause: BaseException = error
        while not str(cause) and cause.__context__ is not None:  # an error without words, raised where others were met
            cause = cause.__context__
        reason = str(cause) or type(cause).__name__
        raise InputError(f"{path}: meshio cannot read it ({reason}); write it again") from error


def _file(
    path: str | os.PathLike, span: SectionSpan | None, stored: StoredPoints, form: str, found: Any = None
) -> StoredMesh:
    """Make the mesh of what meshio read."""
    found = _read(path, form) if found is None else found
    points = np.asarray(found.points)
    if not np.array_equal(points, stored.values.astype(points.dtype)):
        raise InputError(f"{path}: its nodes are not those that meshio reads; save it again, as version 4.1 or 2.2")
    if cells := _elements(found, CELLS):
        return StoredMesh(MixedMesh(stored.values, cells, _marked(found, FACES, 2), source=str(path)), stored)
    if cells := _elements(found, FACES):
        return layer_of_cells(stored, cells, _marked(found, LINES, 1), span, str(path))
    raise InputError(f"{path}: has no cells of a volume or of a plane; give a mesh of one")


def _kind(block: Any) -> str:
    """Kind of elements without the number of their nodes."""
    return block.type.rstrip("0123456789")


def _elements(found: Any, known: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Corners of the elements of each known kind."""
    elements: dict[str, list[np.ndarray]] = {}
    for block in found.cells:
        if (kind := _kind(block)) in known:
            elements.setdefault(kind, []).append(np.asarray(block.data)[:, : known[kind]].astype(np.int64))
    return {kind: np.concatenate(parts) for kind, parts in elements.items()}


def _marked(found: Any, known: Mapping[str, int], dimension: int) -> dict[str, np.ndarray]:
    """Elements of physical surfaces or lines by their names, or numbers where they have none."""
    names = {int(number): name for name, (number, of) in found.field_data.items() if of == dimension}
    markers: dict[str, list[np.ndarray]] = {}
    for block, ids in zip(found.cells, found.cell_data.get("gmsh:physical", [])):
        if (kind := _kind(block)) in known:
            corners = np.asarray(block.data)[:, : known[kind]].astype(np.int64)
            faces = padded(corners) if dimension == 2 else corners
            for number in np.unique(ids).tolist():
                markers.setdefault(names.get(number, str(number)), []).append(faces[np.asarray(ids) == number])
    return {name: np.concatenate(parts) for name, parts in markers.items()}
