"""VTK's unstructured grids (.vtu): points and cells; written back with new points.

Numbers in ASCII are replaced in place. Others, encoded or appended after the grid, are written where the array is
declared, encoded and compressed as the file says; for appended ones the old bytes stay unused, so that the places of
all other arrays stay the same.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import base64
import os
import zlib
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from ....errors import InputError
from ..disk import read_raw
from .layer_of_cells import SectionSpan, volume_or_layer
from .stored_mesh import StoredMesh, StoredPoints
from .text_numbers import TextPoints
from .vtu_arrays import VtuArray, VtuFile

__all__ = ["read_vtu"]

BLOCK = 2**15
"""Bytes that are compressed at once, VTK's default."""

CELLS = {
    "tetra": (4, {10: 4, 24: 10, 71: 0}),
    "pyramid": (5, {14: 5, 27: 13, 37: 19, 74: 0}),
    "wedge": (6, {13: 6, 26: 15, 31: 12, 32: 18, 73: 0}),
    "hexahedron": (8, {12: 8, 25: 20, 29: 27, 33: 24, 72: 0}),
}
FACES = {"triangle": (3, {5: 3, 22: 6, 34: 7, 69: 0}), "quad": (4, {9: 4, 23: 8, 28: 9, 30: 6, 70: 0})}
OTHERS = (1, 2, 3, 4, 21, 35, 68)
"""Corners of cells and faces, which come first, and the nodes of each of VTK's types of them, 0 for any number; types
of nodes and lines, which are neither."""


def read_vtu(
    path: str | os.PathLike,  # the file
    span: SectionSpan | None = None,  # the two planes of a two-dimensional mesh; its own by default
) -> StoredMesh:  # it has no markers
    """Read an unstructured grid of VTK in one piece."""
    file = VtuFile.of(read_raw(path), str(path))
    n_points, n_cells = file.count("NumberOfPoints"), file.count("NumberOfCells")
    stored = _points(file, n_points)
    offsets, types = (_whole(file, name, n_cells) for name in ("offsets", "types"))
    sizes = np.diff(offsets, prepend=0)
    if (sizes < 0).any():
        cell = int(np.argmax(sizes < 0))
        raise InputError(f"{path}: cell {cell + 1} ends before it begins, at {offsets[cell]}; write it again")
    corners = _whole(file, "connectivity", int(offsets[-1]) if n_cells else 0)
    known = {number for _, numbers in (*CELLS.values(), *FACES.values()) for number in numbers} | {*OTHERS}
    unknown = np.setdiff1d(types, list(known))
    if len(unknown):
        raise InputError(f"{path}: has cells of type {unknown[0]}; known are {', '.join(map(str, sorted(known)))}")
    starts = offsets - sizes
    cells, faces = (
        {
            kind: corners[starts[rows][:, None] + np.arange(n_corners)]
            for kind, (n_corners, numbers) in kinds.items()
            if len(rows := _rows(types, sizes, n_corners, numbers, str(path)))
        }
        for kinds in (CELLS, FACES)
    )
    return volume_or_layer(stored, (cells, {}), (faces, {}), span, str(path))


def _rows(types: np.ndarray, sizes: np.ndarray, n_corners: int, numbers: dict[int, int], source: str) -> np.ndarray:
    """Cells of some types, which have equal numbers of nodes."""
    for number, n_nodes in numbers.items():
        of_type = types == number
        is_wrong = of_type & ((sizes != n_nodes) if n_nodes else (sizes < n_corners))
        if is_wrong.any():
            cell = int(np.argmax(is_wrong))
            raise InputError(f"{source}: cell {cell + 1}, of type {number}, has {sizes[cell]} nodes; write it again")
    return np.flatnonzero(np.isin(types, list(numbers)))


def _whole(file: VtuFile, name: str, n: int) -> np.ndarray:
    """Whole numbers of an array."""
    found = file.numbers(name, n)
    if found.dtype.kind == "f":
        raise InputError(f"{file.source}: array {name} is of reals, instead of whole numbers; write it again")
    return found.astype(np.int64)


def _points(file: VtuFile, n_points: int) -> StoredPoints:
    """Points with their places."""
    attributes = file.arrays["Points"].attributes
    kind, n_axes = attributes.get("type", "none"), attributes.get("NumberOfComponents", "none")
    if kind not in ("Float32", "Float64") or n_axes != "3":
        raise InputError(
            f"{file.source}: points are of type {kind[:40]} with {n_axes[:40]} coordinates each; write three reals each"
        )
    if attributes.get("format") != "ascii":
        values = file.numbers("Points", 3 * n_points).reshape(-1, 3).astype(float)
        return _EncodedPoints(file, values, file.arrays["Points"])
    points = TextPoints.of_words(file.data, *file.text("Points"), 3, file.source)
    if len(points.values) != n_points:
        raise InputError(
            f"{file.source}: announces {n_points:,} points and holds {len(points.values):,}; write it again"
        )
    return points


@dataclass(frozen=True, eq=False)
class _EncodedPoints:
    """Encoded points."""

    file: VtuFile  # the file
    values: np.ndarray  # (n, 3), the points
    array: VtuArray  # their declaration

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the file with new points, shape (n, 3), at their precision in the file."""
        data, attributes = self.file.data, self.array.attributes
        kind = "<f4" if attributes["type"] == "Float32" else "<f8"
        if (values.astype(kind) == self.values.astype(kind)).all():
            return data
        kept = {name: value for name, value in attributes.items() if name not in ("format", "offset")}
        for name, value in kept.items():
            if name in ("RangeMin", "RangeMax"):
                lengths = np.linalg.norm(values, axis=1)
                kept[name] = (
                    repr(float(lengths.min() if name == "RangeMin" else lengths.max())) if len(values) else value
                )
        words = " ".join(f"{name}={quoteattr(value)}" for name, value in kept.items())
        text = _encoded(values.astype(kind).tobytes(), self.file.header, self.file.is_compressed)
        array = f'<DataArray {words} format="binary">'.encode() + text + b"</DataArray>"
        return data[: self.array.start] + array + data[self.array.stop :]


def _encoded(raw: bytes, header: str, is_compressed: bool) -> bytes:
    """Sizes and numbers in base 64."""
    if not is_compressed:
        return base64.b64encode(np.array([len(raw)], header).tobytes() + raw)
    blocks = [zlib.compress(raw[at : at + BLOCK]) for at in range(0, len(raw), BLOCK)]
    sizes = [len(blocks), BLOCK, len(raw) % BLOCK, *map(len, blocks)]
    return base64.b64encode(np.array(sizes, header).tobytes()) + base64.b64encode(b"".join(blocks))
