"""Lists in OpenFOAM's files, in ASCII or binary, possibly compressed: whole numbers, faces and points.

In binary a list is its length in ASCII and, between brackets, the bytes of its numbers, whose sizes and order the
header gives (``arch "LSB;label=32;scalar=64"``). Faces are then two lists: their starts, and their corners.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ....errors import InputError
from ..disk import read_bytes
from .stored_mesh import StoredPoints
from .text_numbers import TextPoints, blanked, integers, words_of

__all__ = ["FoamFile"]

ARCH = "LSB;label=32;scalar=64"
"""Byte order, and bits of whole numbers and reals, of files that do not state them."""

COMPACT = "faceCompactList"
"""Class of faces stored as two lists."""

_HEAD = re.compile(rb"FoamFile\s*\{(.*?)\}", re.S)
_ENTRY = re.compile(r"(\w+)\s+(\"[^\"]*\"|[^\s;]+)\s*;")
_LIST = re.compile(rb"(\d+)\s*(\(?)")
_COMMENTS = re.compile(rb"/\*.*?(?:\*/|\Z)|//[^\n]*", re.S)
_GAP = re.compile(rb"\s+|/\*.*?\*/|//[^\n]*", re.S)
_BRACKETS = bytes.maketrans(b"()", b"  ")


@dataclass(frozen=True, eq=False)
class FoamFile:
    """A file of OpenFOAM with a list."""

    path: Path  # the file, with the suffix ``.gz`` if it has one
    data: bytes  # its content, decompressed
    is_compressed: bool  # whether it was compressed

    @classmethod
    def read(cls, folder: Path, name: str) -> FoamFile:
        """Read a file of a folder, or the compressed one if it is missing."""
        path, packed = folder / name, folder / f"{name}.gz"
        path = packed if packed.is_file() and not path.is_file() else path
        data, compression, _ = read_bytes(path)
        return cls(path, data, bool(compression))

    @cached_property
    def head(self) -> dict[str, str]:
        """Entries of its header."""
        found = _HEAD.match(self.data, self._behind_gaps(0))
        entries = _ENTRY.findall(_COMMENTS.sub(b"", found[1]).decode(errors="replace")) if found else []
        return {name: value.strip('"') for name, value in entries}

    @property
    def is_binary(self) -> bool:
        """Whether its numbers are in binary."""
        return self.head.get("format") == "binary"

    def labels(self) -> np.ndarray:
        """Whole numbers of the list."""
        values, end = self._labels(self._start)
        self._require_end(end)
        return values

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of all faces in sequence, and the number of corners of each."""
        if self.head.get("class") == COMPACT:
            starts, end = self._labels(self._start)
            corners, end = self._labels(end)
            self._require_end(end)
            sizes = np.diff(starts)
            if not len(starts) or starts[0] != 0 or starts[-1] != len(corners) or (sizes < 0).any():
                raise InputError(f"{self.path}: its faces do not end with their corners; write it again")
            return corners, sizes
        if self.is_binary:
            raise InputError(
                f"{self.path}: is binary, of class {self.head.get('class')}; write it as {COMPACT}, as OpenFOAM 2.0 "
                f"and later do, or in ASCII"
            )
        n, start, _ = self._list(self._start)
        body = blanked(self.data[start:], _COMMENTS)
        _, ends, _ = words_of(body, str(self.path))
        numbers = integers(body.translate(_BRACKETS), len(ends), str(self.path))
        opened, closed = (np.flatnonzero(np.frombuffer(body, np.uint8) == ord(bracket)) for bracket in "()")
        firsts, lasts = (np.searchsorted(ends, at, side="right") - 1 for at in (opened, closed))
        sizes = numbers[firsts[firsts >= 0]]
        if len(opened) != n or len(closed) != n + 1 or (firsts < 0).any():
            raise InputError(f"{self.path}: announces {n:,} faces and holds {len(opened):,}; write it again")
        ordinal = np.cumsum(np.append(0, sizes + 1))
        if (firsts != ordinal[:-1]).any() or (lasts != np.append(ordinal[1:], ordinal[-1]) - 1).any():
            raise InputError(f"{self.path}: announces corners of faces and holds another number; write it again")
        is_corner = np.ones(len(numbers), dtype=bool)
        is_corner[firsts] = False
        return numbers[is_corner], sizes

    def points(self) -> StoredPoints:
        """Points of the list, in ASCII one per line."""
        n, start, _ = self._list(self._start)
        if self.is_binary:
            kind = self._kind("scalar")
            self._require_end(self._end_of_binary(start, 3 * n * kind.itemsize))
            return _BinaryPoints(self.data, start, n, kind)
        end = blanked(self.data[start:], _COMMENTS).rfind(b")")
        points = TextPoints.of(self.data, (start, start + max(end, 0)), 3, str(self.path), comments=_COMMENTS)
        self._require_end(start + end + 1)
        if end < 0 or len(points.values) != n:
            raise InputError(
                f"{self.path}: announces {n:,} points and holds {len(points.values):,}, one a line; write it again"
            )
        return points

    def dictionaries(self) -> tuple[str, int | None]:
        """Text after the opening bracket of a list of dictionaries (always ASCII), without comments, and their number.

        The number is None if the file has none, as OpenFOAM allows in lists written by hand.
        """
        at = self._behind_gaps(self._start)
        n, start = (None, at + 1) if self.data[at : at + 1] == b"(" else self._list(at)[:2]
        return _COMMENTS.sub(b"", self.data[start:]).decode(errors="backslashreplace"), n

    @property
    def _start(self) -> int:
        """Byte after the header."""
        found = _HEAD.match(self.data, self._behind_gaps(0))
        return found.end() if found else 0

    def _behind_gaps(self, at: int) -> int:
        """Byte after the blanks and comments at a place."""
        while gap := _GAP.match(self.data, at):
            at = gap.end()
        return at

    def _require_end(self, at: int) -> None:
        """Refuse text at a place, after a list."""
        if self._behind_gaps(at) < len(self.data):
            raise InputError(f"{self.path}: has other text behind its list; write it again")

    def _list(self, at: int) -> tuple[int, int, bool]:
        """Length of the list at a place, the byte after its opening bracket, and whether it has one."""
        found = _LIST.match(self.data, self._behind_gaps(at))
        if not found or (not found[2] and int(found[1])):
            raise InputError(f"{self.path}: holds no list; write it again")
        n = int(found[1]) if len(found[1]) < 19 else len(self.data) + 1
        if n > len(self.data):
            raise InputError(f"{self.path}: announces a list longer than the file; write it again")
        return n, found.end(), bool(found[2])

    def _labels(self, at: int) -> tuple[np.ndarray, int]:
        """Whole numbers of the list at a place, and the byte after it."""
        n, start, has_bracket = self._list(at)
        if not has_bracket:
            return np.zeros(0, dtype=np.int64), start
        if self.is_binary:
            kind = self._kind("label")
            end = self._end_of_binary(start, n * kind.itemsize)
            return np.frombuffer(self.data, kind, n, start).astype(np.int64), end
        body, bracket, _ = blanked(self.data[start:], _COMMENTS).partition(b")")
        if not bracket:
            raise InputError(f"{self.path}: its list does not end; write it again")
        return integers(body, n, str(self.path)), start + len(body) + 1

    def _end_of_binary(self, start: int, size: int) -> int:
        """Byte after the closing bracket of numbers in binary."""
        if self.data[start + size : start + size + 1] != b")":
            raise InputError(
                f"{self.path}: is binary, and its numbers do not end where '{self.head.get('arch', ARCH)}' says; write "
                f"it again"
            )
        return start + size + 1

    def _kind(self, name: str) -> np.dtype:
        """Type of whole numbers, ``"label"``, or reals, ``"scalar"``, in binary."""
        arch = self.head.get("arch", ARCH)
        found = re.search(rf"\b{name}=(32|64)\b", arch)
        if not found or arch[:3] not in ("LSB", "MSB"):
            raise InputError(
                f"{self.path}: is binary of an unknown arch '{arch}'; write it in ASCII (foamFormatConvert)"
            )
        letter = "i" if name == "label" else "f"
        return np.dtype(f"{'<' if arch.startswith('LSB') else '>'}{letter}{int(found[1]) // 8}")


@dataclass(frozen=True, eq=False)
class _BinaryPoints:
    """Points in binary."""

    data: bytes  # the whole file
    # start, n: first byte of the points, and their number
    start: int
    n: int
    kind: np.dtype  # type of their coordinates

    @property
    def values(self) -> np.ndarray:
        """The points, shape (n, 3)."""
        return np.frombuffer(self.data, self.kind, 3 * self.n, self.start).reshape(-1, 3).astype(float)

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the file with new points, shape (n, 3), at its precision."""
        end = self.start + 3 * self.n * self.kind.itemsize
        return self.data[: self.start] + np.ascontiguousarray(values, self.kind).tobytes() + self.data[end:]
