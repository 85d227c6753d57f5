"""SU2 meshes: elements, markers and nodes; written back with other coordinates in their places.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

import numpy as np

from ....errors import InputError
from ...cells.mixed_cells import MixedMesh, padded
from ..disk import read_raw
from .layer_of_cells import SectionSpan, layer_of_cells
from .stored_mesh import StoredMesh
from .text_numbers import TextPoints, blanked, integers_by_line

__all__ = ["read_su2"]

CELLS = {
    2: {5: ("triangle", 3), 9: ("quad", 4)},
    3: {10: ("tetra", 4), 12: ("hexahedron", 8), 13: ("wedge", 6), 14: ("pyramid", 5)},
}
FACES = {2: {3: 2}, 3: {5: 3, 9: 4}}
"""VTK's numbers of cells and faces in two and three dimensions, and their corners."""

VERTEX = 1
"""VTK's number of a node by itself, of which markers between the parts of a mesh are: it is no face."""

_COMMENTS = re.compile(rb"%[^\n]*")
_KEYWORD = re.compile(rb"^[ \t]*([A-Z_]+)[ \t]*=[ \t]*([^\s%]+)[^\n]*\n?", re.M)


def read_su2(
    path: str | os.PathLike,  # the file
    span: SectionSpan | None = None,  # planes of the section that a mesh of two dimensions rides along with
) -> StoredMesh:
    """Read an SU2 mesh of one zone."""
    text, source = read_raw(path), str(path)
    matches = list(_KEYWORD.finditer(text))
    found = [(m[1].decode(), m[2].decode(errors="backslashreplace"), m.start(), m.end()) for m in matches]
    ends = [start for _, _, start, _ in found[1:]] + [len(text)]
    sections: dict[str, tuple[str, int, int]] = {}
    marked: dict[str, tuple[str, int, int]] = {}
    tag = ""
    for (name, value, _, start), end in zip(found, ends):
        if name == "MARKER_TAG":
            tag = value
        elif name == "MARKER_ELEMS":
            if not tag or tag in marked:
                raise InputError(f"{source}: has elements of marker '{tag}' twice or without a name; write it again")
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
    value, start, end = sections["NELEM"]
    cells = _cells(text[start:end], _count(value, "NELEM", source), CELLS[n_axes], source)
    markers = {
        tag: _marker(text[start:end], _count(value, "MARKER_ELEMS", source), FACES[n_axes], f"{source}: marker '{tag}'")
        for tag, (value, start, end) in marked.items()
    }
    value, start, end = sections["NPOIN"]
    n_points, points = _count(value, "NPOIN", source), _points(text, (start, end), n_axes, source)
    if len(points.values) != n_points:
        raise InputError(f"{source}: announces {n_points:,} nodes and holds {len(points.values):,}; write it again")
    n_markers = _count(sections["NMARK"][0], "NMARK", source) if "NMARK" in sections else len(markers)
    if len(markers) != n_markers:
        raise InputError(f"{source}: announces {n_markers:,} markers and holds {len(markers):,}; write it again")
    if n_axes == 2:
        return layer_of_cells(points, cells, markers, span, source)
    return StoredMesh(MixedMesh(points.values, cells, markers, source=source), points)


def _count(value: str, name: str, source: str) -> int:
    """Return a number of things."""
    if not (value.isascii() and value.isdigit() and len(value) < 19):
        raise InputError(f"{source}: {name}={value[:40]} is no number; write it again")
    return int(value)


def _points(text: bytes, span: tuple[int, int], n_axes: int, source: str) -> TextPoints:
    """Nodes, each on a line, behind which its number may be: where it is for the first one, it is for all."""
    first = blanked(text[slice(*span)], _COMMENTS).lstrip().partition(b"\n")[0].split()
    behind = int(len(first) == n_axes + 1)
    points = TextPoints.of(text, span, n_axes, source, behind=behind, comments=_COMMENTS)
    if behind:
        ids = TextPoints.of(text, span, 1, source, before=n_axes, comments=_COMMENTS).values[:, 0]
        if (ids != np.round(ids)).any():
            node = int(np.argmax(ids != np.round(ids)))
            raise InputError(
                f"{source}: node {node + 1} has {ids[node]} behind its {n_axes} coordinates, which is no number of a "
                f"node; write it again"
            )
    return points


def _elements(text: bytes, n: int, known: Mapping[int, int], what: str) -> dict[int, np.ndarray]:
    """Corners of the elements of each kind that is known; their numbers may be behind these."""
    numbers, starts = integers_by_line(blanked(text, _COMMENTS), what)
    if len(starts) - 1 != n:
        raise InputError(f"{what}: announces {n:,} elements and holds {len(starts) - 1:,}; write it again")
    kinds, n_behind = numbers[starts[:-1]], np.diff(starts) - 1
    found = {}
    for kind, n_corners in known.items():
        rows = np.flatnonzero(kinds == kind)
        is_wrong = (n_behind[rows] < n_corners) | (n_behind[rows] > n_corners + 1)
        if is_wrong.any():
            row = int(rows[np.argmax(is_wrong)])
            raise InputError(
                f"{what}: element {row + 1}, of kind {kind}, has {n_behind[row]} numbers of nodes in the place of "
                f"{n_corners}; write it again"
            )
        found[kind] = numbers[starts[rows][:, None] + 1 + np.arange(n_corners)]
    unknown = np.setdiff1d(kinds, list(known))
    if len(unknown):
        raise InputError(f"{what}: has elements of kind {unknown[0]}; known are {', '.join(map(str, known))}")
    return found


def _cells(text: bytes, n: int, known: Mapping[int, tuple[str, int]], source: str) -> dict[str, np.ndarray]:
    """Corners of the cells of each kind."""
    found = _elements(text, n, {kind: n_corners for kind, (_, n_corners) in known.items()}, source)
    return {known[kind][0]: corners for kind, corners in found.items() if len(corners)}


def _marker(text: bytes, n: int, known: Mapping[int, int], what: str) -> np.ndarray:
    """Faces of a marker, shape (n, 4), or lines, shape (n, 2), in the order of their kinds."""
    found = _elements(text, n, {**known, VERTEX: 1}, what)
    return np.concatenate([padded(found[kind]) if kind in FACES[3] else found[kind] for kind in known])
