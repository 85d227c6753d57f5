"""SU2 meshes: elements, markers and nodes; written back with other coordinates in their places.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

import numpy as np

from ...cells.mixed_cells import MixedMesh, padded
from ...errors import InputError
from ..disk import read_raw
from .layer_of_cells import SectionSpan, layer_of_cells
from .stored_mesh import StoredMesh
from .text_numbers import TextPoints, integers_by_line

__all__ = ["read_su2"]

CELLS = {
    2: {5: ("triangle", 3), 9: ("quad", 4)},
    3: {10: ("tetra", 4), 12: ("hexahedron", 8), 13: ("wedge", 6), 14: ("pyramid", 5)},
}
FACES = {2: {3: 2}, 3: {5: 3, 9: 4}}
"""VTK's numbers of cells and faces in two and three dimensions, and their corners."""

_KEYWORD = re.compile(rb"^[ \t]*([A-Z_]+)[ \t]*=[ \t]*([^\s%]+)[^\n]*\n?", re.M)


def read_su2(path: str | os.PathLike, span: SectionSpan | None = None) -> StoredMesh:
    """Read an SU2 mesh of one zone.

    Parameters
    ----------
    path : path-like
        The file.
    span : SectionSpan, optional
        Planes of the section that a mesh of two dimensions rides along with.

    Returns
    -------
    StoredMesh

    Raises
    ------
    InputError
        If the file is damaged, has several zones or elements of another kind, or two dimensions and there is no span.
    """
    text, source = read_raw(path), str(path)
    found = [(m[1].decode(), m[2].decode(errors="replace"), m.start(), m.end()) for m in _KEYWORD.finditer(text)]
    ends = [start for _, _, start, _ in found[1:]] + [len(text)]
    sections: dict[str, tuple[str, int, int]] = {}
    marked: dict[str, tuple[str, int, int]] = {}
    tag = ""
    for (name, value, _, start), end in zip(found, ends):
        if name == "MARKER_TAG":
            tag = value
        elif name == "MARKER_ELEMS":
            marked[tag] = value, start, end
        elif name in sections:
            raise InputError(
                f"{source}: has {name} twice, so it has several zones; give each zone in a file of its own"
            )
        else:
            sections[name] = value, start, end
    for name in ("NDIME", "NELEM", "NPOIN"):
        if name not in sections:
            raise InputError(f"{source}: has no {name}; give a whole mesh in the format of SU2")
    if sections["NDIME"][0] not in ("2", "3"):
        raise InputError(f"{source}: has NDIME={sections['NDIME'][0]}; only 2 and 3 dimensions are known")
    n_axes = int(sections["NDIME"][0])
    n_points, start, end = _count(sections["NPOIN"][0], "NPOIN", source), *sections["NPOIN"][1:]
    points = TextPoints.of(text, start, end, n_axes, 0, source)
    if len(points.values) != n_points:
        raise InputError(f"{source}: announces {n_points:,} nodes and holds {len(points.values):,}; write it again")
    value, start, end = sections["NELEM"]
    cells = _cells(text[start:end], _count(value, "NELEM", source), CELLS[n_axes], source)
    markers = {
        tag: _marker(text[start:end], _count(value, "MARKER_ELEMS", source), FACES[n_axes], f"{source}: marker '{tag}'")
        for tag, (value, start, end) in marked.items()
    }
    if n_axes == 2:
        return layer_of_cells(points, cells, markers, span, source)
    return StoredMesh(MixedMesh(points.values, cells, markers, source=source), points)


def _count(value: str, name: str, source: str) -> int:
    """Return a number of things."""
    if not value.isdigit():
        raise InputError(f"{source}: {name}={value} is no number; write it again")
    return int(value)


def _rows(text: bytes, n: int, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the lines of elements, and where each line begins."""
    numbers, starts = integers_by_line(re.sub(rb"%[^\n]*", b"", text), what)
    if len(starts) - 1 != n:
        raise InputError(f"{what}: announces {n:,} elements and holds {len(starts) - 1:,}; write it again")
    return numbers, starts


def _corners(numbers: np.ndarray, starts: np.ndarray, n_corners: int, what: str) -> np.ndarray:
    """Corners of elements of one kind by the beginning of their lines."""
    if len(starts) and starts.max() + n_corners >= len(numbers):
        raise InputError(f"{what}: its last element has too few nodes; write it again")
    return numbers[starts[:, None] + 1 + np.arange(n_corners)]


def _cells(text: bytes, n: int, known: Mapping[int, tuple[str, int]], source: str) -> dict[str, np.ndarray]:
    """Corners of the cells of each kind."""
    numbers, starts = _rows(text, n, source)
    kinds = numbers[starts[:-1]]
    unknown = np.setdiff1d(kinds, list(known))
    if len(unknown):
        raise InputError(f"{source}: has elements of kind {unknown[0]}; known are {', '.join(map(str, known))}")
    found = {kind: np.flatnonzero(kinds == kind) for kind in known}
    return {
        name: _corners(numbers, starts[found[kind]], n_corners, source)
        for kind, (name, n_corners) in known.items()
        if len(found[kind])
    }


def _marker(text: bytes, n: int, known: Mapping[int, int], what: str) -> np.ndarray:
    """Faces of a marker, shape (n, 4), or lines, shape (n, 2), in the order of their kinds."""
    numbers, starts = _rows(text, n, what)
    kinds = numbers[starts[:-1]]
    found = {kind: _corners(numbers, starts[np.flatnonzero(kinds == kind)], n, what) for kind, n in known.items()}
    return np.concatenate([padded(corners) if kind in FACES[3] else corners for kind, corners in found.items()])
