"""Sections of Gmsh's files, and the numbers in them, in ASCII or binary: never more than the section contains.

Format: the reference manual of Gmsh, section "Gmsh file formats".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ....errors import InputError
from .text_numbers import LONGEST, words_of

__all__ = ["BinaryNumbers", "GmshFile", "TextNumbers"]

_HEAD = re.compile(rb"\s*(\d+(?:\.\d+)?)\s+([01])\s+(\d+)[ \t\r]*\n")
_BEGIN = re.compile(rb"\s*\$(\w+)[ \t\r]*\n")

KINDS = {"int": "<i4", "size": "<u8", "real": "<f8"}
"""Types of numbers in binary."""


class BinaryNumbers:
    """Numbers of a section in binary, taken in sequence."""

    def __init__(
        self,
        file: GmshFile,  # the file
        at: int,  # at, stop: first byte of the section and the one after it
        stop: int,
    ) -> None:
        self.data, self.at, self.stop = file.data, at, stop

    def take(self, kind: str, n: int) -> np.ndarray:
        """Take ``n`` numbers; ValueError if there are fewer."""
        form = np.dtype(KINDS[kind])
        first = self.skip(n, form.itemsize)
        found = np.frombuffer(self.data, form, n, first)
        return found if kind == "real" else found.astype(np.int64)

    def skip(self, n: int, size: int) -> int:
        """Skip ``n`` items of ``size`` bytes, and return the first byte; ValueError if there are fewer."""
        if not 0 <= n * size <= self.stop - self.at:
            raise ValueError(f"it announces {n} numbers and ends before")
        first = self.at
        self.at += n * size
        return first

    def require_end(self) -> None:
        """Raise ValueError if there is more."""
        if self.data[self.at : self.stop].strip():
            raise ValueError("there is more than it announces")


class TextNumbers:
    """Numbers of a section in ASCII, taken in sequence."""

    def __init__(
        self,
        file: GmshFile,  # the file
        start: int,  # start, stop: first byte of the section and the one after it
        stop: int,
    ) -> None:
        self.data, self.at = file.data, 0
        starts, ends, _ = words_of(file.data[start:stop], file.source)
        self.spans = start + np.stack([starts, ends], axis=1)
        if len(starts) and (ends - starts).max() > LONGEST:
            raise ValueError("a number is too long")

    def take(self, kind: str, n: int) -> np.ndarray:
        """Take ``n`` numbers; ValueError if there are fewer, or other words."""
        places = self.places(n)
        words = self.data[places[0, 0] : places[-1, 1]].split() if n else []
        if len(words) != n:
            raise ValueError("brackets are no numbers")
        return np.array(words).astype(float) if kind == "real" else np.array(words, dtype=np.int64)

    def places(self, n: int) -> np.ndarray:
        """Skip ``n`` numbers, and return the first byte of each and the one after it, shape (n, 2)."""
        if not 0 <= n <= len(self.spans) - self.at:
            raise ValueError(f"it announces {n} numbers and ends before")
        self.at += n
        return self.spans[self.at - n : self.at]

    def require_end(self) -> None:
        """Raise ValueError if there is more."""
        if self.at < len(self.spans):
            raise ValueError("there is more than it announces")


@dataclass(frozen=True, eq=False)
class GmshFile:
    """A file of Gmsh and its sections."""

    data: bytes  # the file
    source: str  # its name, for messages
    is_old: bool  # whether it is of version 2.2, not 4.1
    is_binary: bool  # whether it is in binary
    sections: dict[str, tuple[int, int]]  # first byte after the name of each section, and the byte of its end

    @classmethod
    def of(cls, data: bytes, source: str) -> GmshFile:
        """Find the sections; text inside a section, such as ``$Comments``, does not start another."""
        sections: dict[str, tuple[int, int]] = {}
        at = 0
        while begin := _BEGIN.match(data, at):
            name = begin[1].decode()
            stop = data.find(b"\n$End" + begin[1], begin.end() - 1) + 1
            if not stop:
                raise InputError(f"{source}: section ${name[:40]} does not end; save it again")
            if name in sections and name in ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements"):
                raise InputError(f"{source}: has ${name} twice; save it again")
            sections[name] = begin.end(), stop
            at = stop + len(name) + 4
        if data[at:].strip() or "MeshFormat" not in sections:
            raise InputError(f"{source}: is no file of Gmsh, or there is other text after {at:,} bytes; save it again")
        head = _HEAD.match(data, sections["MeshFormat"][0])
        if not head or head[1] not in (b"2.2", b"4.1") or head[3] != b"8":
            version = head[1].decode() if head else "none"
            raise InputError(f"{source}: is a file of Gmsh of version {version}; save it as version 4.1 or 2.2")
        is_binary = head[2] == b"1"
        if is_binary and data[head.end() : head.end() + 4] != b"\1\0\0\0":
            raise InputError(f"{source}: is binary of another byte order; save it in ASCII")
        if "PartitionedEntities" in sections:
            raise InputError(f"{source}: is a mesh in several parts; save it in one")
        for name in ("Nodes", "Elements"):
            if name not in sections:
                raise InputError(f"{source}: has no ${name}; save it again")
        return cls(data, source, head[1] == b"2.2", is_binary, sections)

    def numbers(self, name: str) -> BinaryNumbers | TextNumbers:
        """Numbers of a section."""
        return (BinaryNumbers if self.is_binary else TextNumbers)(self, *self.sections[name])

    def counted(self, name: str) -> tuple[int, int]:
        """Number in the first line of a section, and the byte after it; ValueError if there is none."""
        start, stop = self.sections[name]
        line, newline, _ = self.data[start:stop].partition(b"\n")
        n = int(line[:LONGEST])
        if n < 0 or not newline:
            raise ValueError(f"it announces {n}")
        return n, start + len(line) + 1
