"""SU2 meshes: elements, markers and nodes; written back with new coordinates in place.

A file may have several zones, each after ``IZONE=`` with its own nodes, counted from 0. They form one mesh, in which
the nodes of a zone follow the nodes of the previous zone; markers of the same name are one marker.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ....errors import InputError
from ...cells.mesh_numbers import require_corners
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
"""VTK's number of a single node, which occurs in markers between the parts of a mesh: it is not a face."""

MOST_NUMBERS = 2
"""Largest number of integers after the coordinates of a node: its own number and, in files that older versions divided,
its number in the whole mesh."""

NO_BOUNDARY = "SEND_RECEIVE"
"""Name of the markers of nodes that older versions wrote, as many as there are, where parts or periodic sides meet."""

ONCE = ("NDIME", "NELEM", "NPOIN", "NMARK")
"""Keywords that occur once in a zone."""

_COMMENTS = re.compile(rb"%[^\n]*")
_KEYWORD = re.compile(rb"^[ \t]*([A-Z_]+)[ \t]*=([^\n%]*)[^\n]*\n?", re.M)


class _Section(NamedTuple):
    """Contents of a keyword: its value, and the first byte of the lines below and the one after them."""

    value: str
    start: int
    stop: int


@dataclass(eq=False)
class _Zone:
    """Sections of a zone."""

    source: str  # name of the file, and of the zone if there are several, for messages
    sections: dict[str, _Section] = field(default_factory=dict)  # the sections of `ONCE`
    markers: dict[str, _Section] = field(default_factory=dict)  # elements of the markers
    n_others: int = 0  # markers that are not boundary
    tag: str = ""  # marker that is being read

    def take(self, name: str, section: _Section) -> None:
        """Add the contents of a keyword; keywords unrelated to meshes are kept and ignored."""
        if name == "MARKER_TAG":
            self.tag = section.value.strip()
            self.n_others += self.tag == NO_BOUNDARY
        elif name == "MARKER_ELEMS" and self.tag != NO_BOUNDARY:
            if not self.tag or self.tag in self.markers:
                raise InputError(
                    f"{self.source}: has elements of marker '{self.tag}' twice or without a name; write it again"
                )
            self.markers[self.tag] = section
        elif name == "SEND_TO" and self.tag in self.markers:  # between the number of elements and the elements
            self.markers[self.tag] = section._replace(value=self.markers[self.tag].value)
        elif name in ONCE:
            if name in self.sections:
                raise InputError(
                    f"{self.source}: has {name} twice, as if there were several zones; write IZONE= 1, 2 and so on "
                    f"before each"
                )
            self.sections[name] = section

    @property
    def n_axes(self) -> int:
        """Dimensions, two or three."""
        for name in ("NDIME", "NELEM", "NPOIN"):
            if name not in self.sections:
                raise InputError(f"{self.source}: has no {name}; give a whole mesh in the format of SU2")
        found = _word(self.sections["NDIME"].value)
        if found not in ("2", "3"):
            raise InputError(f"{self.source}: has NDIME={found[:40]}; only 2 and 3 dimensions are known")
        return int(found)

    def count(self, name: str) -> int:
        """Return a count."""
        return _count(self.sections[name].value, name, self.source)

    def points(self, text: bytes, n_axes: int) -> TextPoints:
        """Nodes of the zone."""
        points = _points(text, self.sections["NPOIN"][1:], n_axes, self.source)
        if len(points.values) != self.count("NPOIN"):
            raise InputError(
                f"{self.source}: announces {self.count('NPOIN'):,} nodes and holds {len(points.values):,}; write it "
                f"again"
            )
        return points

    def cells(self, text: bytes, n_axes: int) -> dict[str, np.ndarray]:
        """Corners of the cells of each kind."""
        known = CELLS[n_axes]
        numbers = {kind: n_corners for kind, (_, n_corners) in known.items()}
        found = _elements(text[slice(*self.sections["NELEM"][1:])], self.count("NELEM"), numbers, self.source)
        return {known[kind][0]: corners for kind, corners in found.items() if len(corners)}

    def faces(self, text: bytes, n_axes: int) -> dict[str, np.ndarray]:
        """Faces of each marker, shape (n, 4), or lines, shape (n, 2), in the order of their kinds."""
        n_found = len(self.markers) + self.n_others
        n_markers = self.count("NMARK") if "NMARK" in self.sections else n_found
        known, faces = FACES[n_axes], {}
        for tag, (value, start, stop) in self.markers.items():
            what = f"{self.source}: marker '{tag}'"
            n = _count(value, "MARKER_ELEMS", self.source)
            found = _elements(text[start:stop], n, {**known, VERTEX: 1}, what)
            parts = (padded(found[kind]) if kind in FACES[3] else found[kind] for kind in known)
            faces[tag] = np.concatenate(list(parts))
        if n_found != n_markers:
            raise InputError(f"{self.source}: announces {n_markers:,} markers and holds {n_found:,}; write it again")
        return faces


def read_su2(
    path: str | os.PathLike,  # the file
    span: SectionSpan | None = None,  # the two planes of a two-dimensional mesh; its own by default
) -> StoredMesh:
    """Read an SU2 mesh of one or several zones, which form one mesh."""
    text, source = read_raw(path), str(path)
    zones = _zones(text, source)
    n_axes = zones[0].n_axes
    parts: list[TextPoints] = []
    cells: dict[str, list[np.ndarray]] = {}
    markers: dict[str, list[np.ndarray]] = {}
    first = 0
    for zone in zones:
        if zone.n_axes != n_axes:
            raise InputError(f"{source}: has zones of {n_axes} and of {zone.n_axes} dimensions; give each in a file")
        of_zone, marked, points = zone.cells(text, n_axes), zone.faces(text, n_axes), zone.points(text, n_axes)
        for kind, corners in of_zone.items():
            if len(zones) > 1:  # a wrong number would belong to a node of another zone
                require_corners(corners, corners.shape[1], len(points.values), f"{zone.source}: cells '{kind}'")
            cells.setdefault(kind, []).append(corners + first)
        for tag, faces in marked.items():
            if len(zones) > 1:
                require_corners(faces, faces.shape[1], len(points.values), f"{zone.source}: marker '{tag}'")
            markers.setdefault(tag, []).append(faces + first)
        parts.append(points)
        first += len(points.values)
    joined, joined_markers = ({name: np.concatenate(p) for name, p in found.items()} for found in (cells, markers))
    stored = TextPoints(
        text, np.concatenate([part.spans for part in parts]), np.concatenate([part.values for part in parts])
    )
    if n_axes == 2:
        return layer_of_cells(stored, joined, joined_markers, span, source)
    return StoredMesh(MixedMesh(stored.values, joined, joined_markers, source=source), stored)


def _zones(text: bytes, source: str) -> list[_Zone]:
    """Find the zones and their sections."""
    found = list(_KEYWORD.finditer(text))
    n_zones = sum(match[1] == b"IZONE" for match in found)
    zones: list[_Zone] = [] if n_zones else [_Zone(source)]
    for match, stop in zip(found, [*(match.start() for match in found[1:]), len(text)]):
        name, section = match[1].decode(), _Section(_value(match), match.end(), stop)
        if name == "NZONE" and _count(section.value, name, source) != max(n_zones, 1):
            raise InputError(f"{source}: announces {_word(section.value)} zones and holds {n_zones}; write it again")
        if name == "IZONE":
            number = _count(section.value, name, source)
            if number != len(zones) + 1:
                raise InputError(f"{source}: has IZONE={number} instead of {len(zones) + 1}; number the zones so")
            zones.append(_Zone(f"{source}: zone {number}" if n_zones > 1 else source))
        elif zones:
            zones[-1].take(name, section)
        elif name in ONCE:
            raise InputError(f"{source}: has {name} before the first IZONE; write it behind")
    return zones


def _value(match: re.Match[bytes]) -> str:
    return match[2].decode(errors="backslashreplace")


def _word(value: str) -> str:
    """First word after a keyword; empty if there is none."""
    return next(iter(value.split()), "")


def _count(value: str, name: str, source: str) -> int:
    """Return a count; further text, such as the number of nodes without copies, is ignored."""
    word = _word(value)
    if not (word.isascii() and word.isdigit() and len(word) < 19):
        raise InputError(f"{source}: {name}={word[:40]} is no number; write it again")
    return int(word)


def _points(text: bytes, span: tuple[int, int], n_axes: int, source: str) -> TextPoints:
    """Nodes, one per line, possibly followed by their numbers: as many as for the first one, see `MOST_NUMBERS`."""
    first = blanked(text[slice(*span)], _COMMENTS).lstrip().partition(b"\n")[0].split()
    n_behind = len(first) - n_axes
    behind = n_behind if 0 <= n_behind <= MOST_NUMBERS else 0
    points = TextPoints.of(text, span, n_axes, source, behind=behind, comments=_COMMENTS)
    if behind:
        ids = TextPoints.of(text, span, behind, source, before=n_axes, comments=_COMMENTS).values
        is_wrong = ids != np.round(ids)
        if is_wrong.any():
            node = int(np.argmax(is_wrong.any(axis=1)))
            raise InputError(
                f"{source}: node {node + 1} has {ids[node][is_wrong[node]][0]} behind its {n_axes} coordinates, which "
                f"is no number of a node; write it again"
            )
    return points


def _elements(text: bytes, n: int, known: Mapping[int, int], what: str) -> dict[int, np.ndarray]:
    """Corners of the elements of each known kind, possibly followed by their numbers."""
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
                f"{what}: element {row + 1}, of kind {kind}, has {n_behind[row]} numbers of nodes instead of "
                f"{n_corners}; write it again"
            )
        found[kind] = numbers[starts[rows][:, None] + 1 + np.arange(n_corners)]
    unknown = np.setdiff1d(kinds, list(known))
    if len(unknown):
        raise InputError(f"{what}: has elements of kind {unknown[0]}; known are {', '.join(map(str, known))}")
    return found
