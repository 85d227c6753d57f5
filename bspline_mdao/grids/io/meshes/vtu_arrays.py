"""Arrays of VTK's XML files: located through the XML itself, and decoded to the requested numbers.

Arrays in comments are ignored. Nothing is decompressed beyond the size of the array.

Format: the VTK file formats, section "XML file formats".
"""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np

from ....base.text import reason_of
from ....errors import InputError
from ..disk import MAX_RATIO, MAX_SMALL
from .text_numbers import LONGEST

__all__ = ["VtuArray", "VtuFile"]

ZLIB = "vtkZLibDataCompressor"
PIECE = ("VTKFile", "UnstructuredGrid", "Piece")
IN_ARRAY = len(PIECE) + 3
"""Names of the elements from the file to the piece, and the number of open elements within an array."""

TYPES = {f"{name}{8 * size}": f"{code}{size}" for name, code in (("Int", "i"), ("UInt", "u")) for size in (1, 2, 4, 8)}
TYPES |= {"Float32": "f4", "Float64": "f8"}
"""Types of numbers by VTK's names."""

_TAG = re.compile(rb"<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*(/?)>")


@dataclass
class VtuArray:
    """An element ``DataArray``."""

    attributes: dict[str, str]  # its attributes
    # start, stop: first byte of the element and the one after it
    start: int
    stop: int = -1
    # first byte, and the one after, of each text between its tags and comments
    texts: list[list[int]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class VtuFile:
    """A file with an unstructured grid of one piece."""

    data: bytes  # the file
    source: str  # its name, for messages
    # head, piece: attributes of the file and of the piece
    head: dict[str, str]
    piece: dict[str, str]
    arrays: dict[str, VtuArray]  # arrays of the points and cells: ``"Points"`` or their names
    appended: tuple[int, str] | None  # first byte of the appended data, and its encoding

    @classmethod
    def of(cls, data: bytes, source: str) -> VtuFile:
        """Find the arrays of a file."""
        scan = _Scan(data, source)
        try:
            scan.run()
        except expat.ExpatError as error:
            raise InputError(f"{source}: is no XML of VTK ({reason_of(error)}); write it again") from error
        kind = scan.head.get("type", "no VTKFile")
        if kind != "UnstructuredGrid":
            raise InputError(f"{source}: is no unstructured grid of VTK (found {kind[:40]}); write it again")
        if len(scan.pieces) != 1:
            raise InputError(f"{source}: has {len(scan.pieces)} pieces; merge them into one")
        if scan.head.get("byte_order", "LittleEndian") not in ("LittleEndian", "BigEndian"):
            raise InputError(f"{source}: is of an unknown byte order; write it again")
        if missing := {"Points", "connectivity", "offsets", "types"} - scan.arrays.keys():
            raise InputError(f"{source}: has no array {min(missing)} in its piece; write it again")
        return cls(data, source, scan.head, scan.pieces[0], scan.arrays, scan.appended)

    @property
    def header(self) -> str:
        """Type of the sizes before encoded numbers."""
        return "<u8" if self.head.get("header_type") == "UInt64" else "<u4"

    @property
    def is_compressed(self) -> bool:
        """Whether encoded numbers are compressed."""
        return "compressor" in self.head

    def count(self, name: str) -> int:
        """Whole number in an attribute of the piece."""
        text = self.piece.get(name, "")
        if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) <= self._most):
            raise InputError(f"{self.source}: {name}='{text[:40]}' is no number of its size; write it again")
        return int(text)

    def numbers(self, name: str, n: int) -> np.ndarray:
        """The ``n`` numbers of an array."""
        array = self.arrays[name]
        kind = TYPES.get(array.attributes.get("type", ""))
        if kind is None:
            raise InputError(f"{self.source}: array {name} has no type of numbers; write it again")
        if n * int(kind[1]) > self._most:
            raise InputError(f"{self.source}: array {name} of {n:,} numbers is larger than the file; write it again")
        try:
            if array.attributes.get("format") == "ascii":
                values = self._of_text(self.data[slice(*self.text(name))], kind)
            else:
                stream = self._stream(name)
                raw = _decoded(stream, n * int(kind[1]), np.dtype(self.header), self.is_compressed)
                if array.attributes["format"] == "binary" and n and stream.at < len(stream.data):
                    raise ValueError("there is more than it announces")
                values = np.frombuffer(raw, f"<{kind}")
        except (ValueError, OverflowError, zlib.error) as error:
            raise InputError(f"{self.source}: array {name} is damaged ({reason_of(error)}); write it again") from error
        if len(values) != n:
            raise InputError(f"{self.source}: array {name} has {len(values):,} numbers, not {n:,}; write it again")
        return values

    def text(self, name: str) -> tuple[int, int]:
        """First byte of the text of an array, and the one after it."""
        array = self.arrays[name]
        found = [(a, b) for a, b in array.texts if self.data[a:b].strip()]
        if len(found) > 1:
            raise InputError(f"{self.source}: array {name} is cut by comments or others; write it again")
        return found[0] if found else (array.stop, array.stop)

    @property
    def _most(self) -> int:
        """Largest number of bytes of an array."""
        return max(MAX_SMALL, MAX_RATIO * len(self.data))

    @staticmethod
    def _of_text(text: bytes, kind: str) -> np.ndarray:
        words = text.split()
        if max(map(len, words), default=0) > LONGEST:
            raise ValueError("a number is too long")
        return np.array(words).astype(kind) if kind[0] == "f" else np.array(words, dtype=np.int64)

    def _stream(self, name: str) -> _Stream:
        """Bytes of an encoded array."""
        order, compressor = self.head.get("byte_order", "LittleEndian"), self.head.get("compressor", ZLIB)
        if order != "LittleEndian" or compressor != ZLIB:
            raise InputError(f"{self.source}: is in {order} and {compressor}; save it with zlib or in ASCII")
        attributes = self.arrays[name].attributes
        if attributes.get("format") == "binary":
            return _Stream(b"".join(self.data[slice(*self.text(name))].split()), 0, True)
        if attributes.get("format") != "appended" or self.appended is None:
            raise ValueError("it is neither in ASCII nor binary nor appended")
        start, encoding = self.appended
        offset = int(attributes.get("offset", "none"))
        if not 0 <= offset <= len(self.data):
            raise ValueError(f"its offset is {offset}")
        return _Stream(self.data, start + offset, encoding != "raw")


class _Scan:
    """A walk through the XML of a file, up to the appended data."""

    def __init__(self, data: bytes, source: str) -> None:
        self.data, self.source = data, source
        self.head: dict[str, str] = {}
        self.pieces: list[dict[str, str]] = []
        self.arrays: dict[str, VtuArray] = {}
        self.appended: tuple[int, str] | None = None
        self._path: list[str] = []
        self._array: VtuArray | None = None
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler, self._parser.EndElementHandler = self._start, self._end
        self._parser.CommentHandler, self._parser.StartDoctypeDeclHandler = self._comment, self._doctype

    def run(self) -> None:
        """Walk."""
        with suppress(_AtAppendedError):  # no XML after it
            self._parser.Parse(self.data, True)

    def _start(self, name: str, attributes: Mapping[str, str]) -> None:
        at = self._parser.CurrentByteIndex
        tag = _TAG.match(self.data, at)
        if tag is None:
            raise InputError(f"{self.source}: is no XML of one byte a character; write it again")
        self._path.append(name)
        path = tuple(self._path)
        if self._array is not None and len(path) == IN_ARRAY:
            self._array.texts[-1][1] = at
        if path == PIECE[:1]:
            self.head = dict(attributes)
        elif path == PIECE:
            self.pieces.append(dict(attributes))
        elif path == ("VTKFile", "AppendedData"):
            start = self.data.find(b"_", tag.end()) + 1
            self.appended = (start or len(self.data), attributes.get("encoding", ""))
            raise _AtAppendedError
        elif path[:3] == PIECE and path[3:] in (("Points", "DataArray"), ("Cells", "DataArray")):
            key = "Points" if path[3] == "Points" else attributes.get("Name", "")
            if key in self.arrays:
                raise InputError(f"{self.source}: has array {key[:40]} twice in its piece; write it again")
            self._array = self.arrays[key] = VtuArray(dict(attributes), at)
            self._array.texts.append([tag.end(), tag.end()])

    def _end(self, _: str) -> None:
        at, depth = self._parser.CurrentByteIndex, len(self._path)
        self._path.pop()
        if self._array is None:
            return
        tag = _TAG.match(self.data, at)
        stop = tag.end() if tag else self.data.find(b">", at) + 1  # one tag may be both, the first and the last
        if depth == IN_ARRAY - 1:
            self._array.texts[-1][1] = max(at, self._array.texts[-1][0])
            self._array.stop = stop
            self._array = None
        elif depth == IN_ARRAY:
            self._array.texts.append([stop, stop])

    def _comment(self, _: str) -> None:
        if self._array is not None and len(self._path) == IN_ARRAY - 1:
            at = self._parser.CurrentByteIndex
            stop = self.data.find(b"-->", at) + 3
            self._array.texts[-1][1] = at
            self._array.texts.append([stop, stop])

    def _doctype(self, *_: object) -> None:
        raise InputError(f"{self.source}: declares a type of document, which no file of VTK does; write it again")


class _AtAppendedError(Exception):
    """The appended data begin."""


@dataclass
class _Stream:
    """Bytes, possibly in base 64, taken in groups."""

    data: bytes
    at: int
    is_text: bool

    def take(self, n: int) -> bytes:
        """Take ``n`` bytes."""
        size = -(-n // 3) * 4 if self.is_text else n
        part = self.data[self.at : self.at + size]
        if len(part) < size:
            raise ValueError("it ends early")
        self.at += size
        return base64.b64decode(part, validate=True)[:n] if self.is_text else part


def _decoded(stream: _Stream, n: int, header: np.dtype, is_compressed: bool) -> bytes:
    """The ``n`` bytes of a stream, after their sizes."""
    begin, size = stream.at, header.itemsize
    first = int(np.frombuffer(stream.take(size), header)[0])
    if not is_compressed:
        if first != n:
            raise ValueError(f"it announces {first} bytes instead of {n}")
        if stream.is_text and b"=" not in stream.data[begin : stream.at]:  # sizes and numbers in one
            stream.at = begin
            return stream.take(size + n)[size:]
        return stream.take(n)
    if not n:
        return b""
    if first > len(stream.data):
        raise ValueError(f"it announces {first} blocks")
    stream.at = begin
    _, whole, last, *packed = np.frombuffer(stream.take(size * (3 + first)), header).tolist()
    sizes = [whole] * (first - bool(last)) + [last] * bool(last)
    if len(sizes) != first or sum(sizes) != n:
        raise ValueError(f"it announces {sum(sizes)} bytes instead of {n}")
    raw, at, blocks = stream.take(sum(packed)), 0, []
    for n_packed, n_plain in zip(packed, sizes):
        worker = zlib.decompressobj()
        blocks.append(worker.decompress(raw[at : at + n_packed], n_plain + 1))
        if len(blocks[-1]) != n_plain or not worker.eof:
            raise ValueError(f"a block is not of the {n_plain} bytes that it announces")
        at += n_packed
    return b"".join(blocks)
