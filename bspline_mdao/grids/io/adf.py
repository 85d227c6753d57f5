"""CGNS files in ADF, the format before HDF5: their tree of nodes is copied into HDF5, which all readers know.

A file is a header and nodes that point to each other. Pointers, of 12 bytes, are a block of 4096 bytes and an offset in
it: hexadecimal digits in files of version A, binary numbers in version B::

    header   "....ADF Database Version A02011>", dates, "AdF2", byte order, ..., "AdF4", the root, ..., "AdF5"
    node     "NoDe", name, label, number of children, room for them, table of children, type, number of dimensions,
             12 dimensions, number of pieces of data, the data or a table of the pieces, "TaiL"
    children "SNTb", end, then name and pointer of each, "snTE"
    pieces   "DCtb", end, then first and last byte of each, "dcTE"
    data     "DaTa", end, bytes, "dEnD"

CGNS/SIDS File Mapping Manual and ADF User's Guide, https://cgns.github.io.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import h5py
import numpy as np

from ...errors import InputError
from .cgns_nodes import set_attributes, set_root_attributes
from .disk import read_raw
from .formats import ADF

__all__ = ["convert_adf", "copied_cgns", "is_adf", "opened_cgns"]

_BLOCK = 4096
_ROOT = 134  # place of the pointer to the root node in the header
_BYTE_ORDER = 100
_NODE, _TABLE, _CHUNKS, _DATA = b"NoDe", b"SNTb", b"DCtb", b"DaTa"
_TYPES = {"I4": "i4", "I8": "i8", "U4": "u4", "U8": "u8", "R4": "f4", "R8": "f8", "C1": "i1", "B1": "u1"}
"""Types of values by name."""

_MOST_NODES = 10**6


class _Node(NamedTuple):
    """Header of a node."""

    name: str
    label: str
    kind: str
    shape: tuple[int, ...]
    n_children: int
    children: int
    n_chunks: int
    data: int


@dataclass(frozen=True)
class _File:
    """Bytes of a file, and its format of numbers."""

    source: str
    data: bytes
    is_binary: bool
    order: str

    def damaged(self, what: str) -> InputError:
        return InputError(f"{self.source}: damaged or incomplete CGNS/ADF file ({what}); write it again")

    def piece(self, start: int, length: int, what: str) -> bytes:
        """The given number of bytes from a place on."""
        if not (start >= 0 and length >= 0 and start + length <= len(self.data)):
            raise self.damaged(f"{what} at byte {start} is beyond the end, at {len(self.data)}")
        return self.data[start : start + length]

    def tagged(self, start: int, tag: bytes, length: int) -> bytes:
        """The given number of bytes after a tag, which must be there."""
        if self.piece(start, 4, "a tag") != tag:
            raise self.damaged(f"no '{tag.decode()}' at byte {start}")
        return self.piece(start + 4, length, tag.decode())

    def digits(self, text: bytes) -> int:
        """Number of hexadecimal digits."""
        try:
            return int(text, 16)
        except ValueError:
            raise self.damaged(f"'{text.decode('ascii', 'replace')}' is no number") from None

    def pointer(self, stored: bytes) -> int:
        """Place referred to by a pointer, 12 bytes."""
        if self.is_binary:
            parts = (stored[:8], "u8"), (stored[8:], "u4")
            block, offset = (int(np.frombuffer(part, self.order + kind)[0]) for part, kind in parts)
        else:
            block, offset = self.digits(stored[:8]), self.digits(stored[8:])
        return block * _BLOCK + offset

    def node(self, start: int) -> _Node:
        """Header of the node at a place."""
        raw = self.tagged(start, _NODE, 242)
        n_dimensions, stored = self.digits(raw[124:126]), raw[126:222]
        if n_dimensions > 12:
            raise self.damaged(f"{n_dimensions} dimensions of the node at byte {start}")
        if self.is_binary:
            shape = np.frombuffer(stored, self.order + "u8")[:n_dimensions].tolist()
        else:
            shape = [self.digits(stored[8 * d : 8 * d + 8]) for d in range(n_dimensions)]
        name, label, kind = (raw[at : at + 32].decode("ascii", "replace").split("\0")[0].strip() for at in (0, 32, 92))
        return _Node(
            name,
            label,
            kind,
            tuple(shape),
            self.digits(raw[64:72]),
            self.pointer(raw[80:92]),
            self.digits(raw[222:226]),
            self.pointer(raw[226:238]),
        )

    def children(self, node: _Node) -> Iterator[int]:
        """Places of the children of a node, in their order."""
        table = self.tagged(node.children, _TABLE, 12 + 44 * node.n_children)[12:] if node.n_children else b""
        for k in range(node.n_children):
            yield self.pointer(table[44 * k + 32 : 44 * k + 44])

    def bytes_of(self, node: _Node) -> bytes:
        """Data of a node, in one or several pieces."""
        if node.n_chunks == 1:
            starts = [node.data]
        else:
            table = self.tagged(node.data, _CHUNKS, 12 + 24 * node.n_chunks)[12:]
            starts = [self.pointer(table[24 * k : 24 * k + 12]) for k in range(node.n_chunks)]
        pieces = []
        for start in starts:
            end = self.pointer(self.tagged(start, _DATA, 12))
            pieces.append(self.piece(start + 16, end - start - 16, "data"))
        return b"".join(pieces)

    def value(self, node: _Node) -> np.ndarray | None:
        """Value of a node, the first index of CGNS last; None if it has none."""
        if not node.n_chunks or not node.shape or node.kind not in _TYPES:
            return None
        kind, raw = np.dtype(self.order + _TYPES[node.kind]), self.bytes_of(node)
        n_bytes = kind.itemsize
        for size in node.shape:
            n_bytes *= size
        if n_bytes > len(raw):
            raise self.damaged(f"node '{node.name}' of shape {node.shape} has {len(raw)} bytes")
        return np.frombuffer(raw[:n_bytes], kind).reshape(node.shape[::-1]).astype(kind.newbyteorder("="))


def is_adf(path: str | os.PathLike) -> bool:
    """Whether a file is in ADF: it says so after four bytes that are not text."""
    return read_raw(path, 4 + len(ADF))[4:] == ADF


@contextmanager
def opened_cgns(path: str | os.PathLike) -> Iterator[h5py.File]:
    """Open a CGNS file for reading: HDF5 directly, ADF as a copy in memory."""
    if not is_adf(path):
        with h5py.File(path, "r") as file:
            yield file
        return
    with h5py.File(io.BytesIO(), "w", track_order=True) as file:
        convert_adf(str(path), read_raw(path), file)
        yield file


def copied_cgns(path: str | os.PathLike, copy: str | os.PathLike) -> None:
    """Copy a CGNS file; ADF becomes HDF5."""
    if not is_adf(path):
        shutil.copyfile(path, copy)
        return
    with h5py.File(copy, "w", track_order=True) as file:
        convert_adf(str(path), read_raw(path), file)


def convert_adf(
    source: str,  # name of the file for messages
    data: bytes,  # its content
    file: h5py.File,  # the HDF5 file, empty
) -> None:
    """Copy all nodes of a file in ADF into an HDF5 file, in the way of the CGNS library."""
    version, order = data[4 + len(ADF) :][:1], data[_BYTE_ORDER : _BYTE_ORDER + 1]
    if version not in (b"A", b"B") or order not in (b"L", b"B"):
        raise InputError(
            f"{source}: is CGNS in ADF of version {version.decode('ascii', 'replace')!r} with numbers "
            f"{order.decode('ascii', 'replace')!r}; convert it with 'adf2hdf' of the CGNS tools"
        )
    stored = _File(source, data, version == b"B", "<" if order == b"L" else ">")
    set_root_attributes(file)
    seen: set[int] = set()
    waiting = [(stored.pointer(stored.piece(_ROOT, 12, "the root")), file)]
    while waiting:
        place, parent = waiting.pop()
        for child in stored.children(stored.node(place)):
            if child in seen or len(seen) > _MOST_NODES:
                raise stored.damaged(f"the node at byte {child} has two parents")
            seen.add(child)
            waiting.append((child, _copied(stored, stored.node(child), parent)))


def _copied(stored: _File, node: _Node, parent: h5py.Group) -> h5py.Group:
    """Copy of a node without its children."""
    name = node.name
    if not name or "/" in name or name in parent:
        raise stored.damaged(f"a child of {parent.name} is called '{name}'")
    group, value = parent.create_group(name, track_order=True), stored.value(node)
    set_attributes(group, name, node.label, node.kind if value is not None or node.kind == "LK" else "MT")
    if node.kind == "LK":
        file, _, path = stored.bytes_of(node).decode("ascii", "replace").split("\0")[0].partition(">")
        if file.strip():
            raise InputError(
                f"{stored.source}: node {group.name} is a link to the file {file.strip()}; put both into one file"
            )
        group[" link"] = h5py.SoftLink(path.strip())
    elif value is not None:
        group.create_dataset(" data", data=value)
    return group
