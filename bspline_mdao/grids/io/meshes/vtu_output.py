"""Unstructured meshes for ParaView: unstructured grids of VTK (``.vtu``) with fields, as new files.

A two-dimensional mesh is written as the cells of its plane, and polyhedra by their faces.

Format: the VTK file formats, section "XML file formats", appended raw data.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from ....errors import InputError
from ...cells.mixed_cells import MixedMesh
from ..disk import replaced_file

__all__ = ["write_vtu", "write_vtu_faces"]

TYPES = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
TRIANGLE, QUAD, POLYHEDRON = 5, 9, 42
"""VTK's numbers of kinds of cells."""

_NAMES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}

Fields = Mapping[str, np.ndarray]
"""Values by the names of fields, for every node or cell: shape (n,) or (n, n_components)."""


class _Cells(NamedTuple):
    """Cells in the form of VTK."""

    connectivity: np.ndarray  # int, nodes of all cells in sequence
    sizes: np.ndarray  # int (n_cells,), number of nodes of each
    types: np.ndarray  # uint8 (n_cells,)
    faces: np.ndarray | None = None  # int, for polyhedra: number of faces; for each its number of nodes, and these
    face_ends: np.ndarray | None = None  # int (n_cells,), end of each cell's entries; -1 for cells of other kinds


def write_vtu(
    path: str | os.PathLike,
    mesh: MixedMesh,
    node_fields: Fields | None = None,  # of its nodes
    cell_fields: Fields | None = None,  # of its cells
) -> None:
    """Write a mesh; for a two-dimensional one, its plane."""
    node_fields = dict(node_fields or {})
    if mesh.n_copies > 1:
        faces, _ = mesh.cell_faces  # in the order of their cells
        cells = _faces(faces[(faces < mesh.n_stored).all(axis=1)])
        node_fields = {name: np.asarray(values)[: mesh.n_stored] for name, values in node_fields.items()}
    else:
        cells = _volumes(mesh)
    _write(path, mesh.points[: mesh.n_stored], cells, node_fields, cell_fields or {})


def write_vtu_faces(
    path: str | os.PathLike,
    points: np.ndarray,  # (n_points, 3), nodes (m)
    faces: np.ndarray,  # int (n, 4), their corners; triangles repeat the last one
    node_fields: Fields | None = None,  # of the nodes
    cell_fields: Fields | None = None,  # of the faces
) -> None:
    """Write faces, and their nodes."""
    used, corners = np.unique(faces, return_inverse=True)
    node_fields = {name: np.asarray(values)[used] for name, values in (node_fields or {}).items()}
    _write(path, points[used], _faces(corners.reshape(-1, 4)), node_fields, cell_fields or {})


def _faces(faces: np.ndarray) -> _Cells:
    """Triangles and quads, shape (n, 4), as cells."""
    is_corner = np.ones(faces.shape, dtype=bool)
    is_corner[:, 3] = faces[:, 3] != faces[:, 2]
    sizes = is_corner.sum(axis=1)
    return _Cells(faces[is_corner], sizes, np.where(sizes == 3, TRIANGLE, QUAD))


def _volumes(mesh: MixedMesh) -> _Cells:
    """Cells of a mesh in their order."""
    nodes = [corners.ravel() for corners in mesh.cells.values()]
    sizes = [np.full(len(corners), corners.shape[1]) for corners in mesh.cells.values()]
    types = [np.full(len(corners), TYPES[kind]) for kind, corners in mesh.cells.items()]
    if mesh.polyhedra is None:
        return _Cells(*map(_joined, (nodes, sizes, types)))
    faces, cells = mesh.polyhedra
    order = np.argsort(cells, kind="stable")
    faces, cells = faces[order], cells[order]
    n_cells = int(cells.max(initial=-1)) + 1
    pairs = np.unique(np.stack([np.repeat(cells, 4), faces.ravel()], axis=1), axis=0)
    nodes.append(pairs[:, 1])
    sizes.append(np.bincount(pairs[:, 0], minlength=n_cells))
    types.append(np.full(n_cells, POLYHEDRON))
    # for each face its number of nodes and its nodes, and before the first of a cell the number of its faces
    of_face = _faces(faces)
    starts = np.cumsum(of_face.sizes) - of_face.sizes
    words = np.insert(of_face.connectivity, starts, of_face.sizes)
    counts = np.bincount(cells, minlength=n_cells)
    lengths = np.bincount(cells, 1 + of_face.sizes, minlength=n_cells).astype(int)
    words = np.insert(words, np.cumsum(lengths) - lengths, counts)
    rest = np.full(sum(len(corners) for corners in mesh.cells.values()), -1)
    ends = np.concatenate([rest, np.cumsum(lengths + 1)])
    return _Cells(_joined(nodes), _joined(sizes), _joined(types), words, ends)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0, dtype=int), *parts])


def _write(
    path: str | os.PathLike, points: np.ndarray, cells: _Cells, node_fields: Fields, cell_fields: Fields
) -> None:
    """Write an XML head, and then every array as its length in bytes and its bytes."""
    appended: list[np.ndarray] = []

    def declare(name: str, values: np.ndarray, n: int | None = None) -> str:
        array = np.ascontiguousarray(values)
        if array.dtype.str[1:] not in _NAMES or (n is not None and len(array) != n):
            raise InputError(f"{path}: field '{name}' has {array.shape} values of type {array.dtype}; give {n} reals")
        offset = sum(8 + each.nbytes for each in appended)
        appended.append(array)
        n_components = array.shape[1] if array.ndim == 2 else 1
        return (
            f'<DataArray type="{_NAMES[array.dtype.str[1:]]}" Name={quoteattr(name)} '
            f'NumberOfComponents="{n_components}" format="appended" offset="{offset}"/>'
        )

    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    arrays: dict[str, np.ndarray] = {
        "connectivity": cells.connectivity.astype(np.int64),
        "offsets": np.cumsum(cells.sizes).astype(np.int64),
        "types": cells.types.astype(np.uint8),
    }
    if cells.faces is not None and cells.face_ends is not None:
        arrays |= {"faces": cells.faces.astype(np.int64), "faceoffsets": cells.face_ends.astype(np.int64)}
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt64">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells.sizes)}">',
        "<PointData>",
        *(declare(name, np.asarray(values), len(points)) for name, values in node_fields.items()),
        "</PointData>",
        "<CellData>",
        *(declare(name, np.asarray(values), len(cells.sizes)) for name, values in cell_fields.items()),
        "</CellData>",
        "<Points>",
        declare("Points", points),
        "</Points>",
        "<Cells>",
        *(declare(name, values) for name, values in arrays.items()),
        "</Cells>",
        "</Piece>",
        "</UnstructuredGrid>",
        '<AppendedData encoding="raw">',
    ]
    with replaced_file(path) as part, open(part, "wb") as file:
        file.write("\n".join(lines).encode() + b"\n_")
        for array in appended:
            file.write(np.uint64(array.nbytes).tobytes())
            file.write(array.tobytes())
        file.write(b"\n</AppendedData>\n</VTKFile>\n")
