"""Nodes of Gmsh's files, format 2.2 and 4.1, in ASCII and binary: found, and replaced in their places.

Format: the reference manual of Gmsh, section "Gmsh file formats".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from .text_numbers import TextPoints

__all__ = ["find_gmsh_nodes"]

_HEAD = re.compile(rb"\$MeshFormat\s+(\d+(?:\.\d+)?)\s+([01])\s+(\d+)[^\n]*\n")


@dataclass(frozen=True, eq=False)
class _BinaryNodes:
    """Nodes in binary.

    Parameters
    ----------
    data : bytes
        The whole file.
    parts : tuple of tuple of int
        First byte of the nodes of each part, how many there are, and the bytes from one to the next.
    """

    data: bytes
    parts: tuple[tuple[int, int, int], ...]

    @property
    def values(self) -> np.ndarray:
        """The nodes, shape (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(self._view(self.data, *part) for part in self.parts)])

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the file with other nodes, shape (n, 3)."""
        new, first = bytearray(self.data), 0
        for start, n, step in self.parts:
            self._view(new, start, n, step)[:] = values[first : first + n]
            first += n
        return bytes(new)

    @staticmethod
    def _view(data: bytes | bytearray, start: int, n: int, step: int) -> np.ndarray:
        return np.ndarray((n, 3), dtype="<f8", buffer=data, offset=start, strides=(step, 8))


def find_gmsh_nodes(data: bytes, source: str) -> TextPoints | _BinaryNodes:
    """Find the nodes of a file.

    Parameters
    ----------
    data : bytes
        The file.
    source : str
        Its name, for messages.

    Raises
    ------
    InputError
        If the file is of another version or damaged.
    """
    head = _HEAD.search(data)
    if not head or head[1] not in (b"2.2", b"4.1") or head[3] != b"8":
        version = head[1].decode() if head else "none"
        raise InputError(f"{source}: is a file of Gmsh of version {version}; save it as version 4.1 or 2.2")
    is_binary, is_old = head[2] == b"1", head[1] == b"2.2"
    if is_binary and data[head.end() : head.end() + 4] != b"\1\0\0\0":
        raise InputError(f"{source}: is binary of another byte order; save it in ASCII")
    begin = re.search(rb"\$Nodes[ \t\r]*\n", data)
    if not begin:
        raise InputError(f"{source}: has no $Nodes; save it again")
    try:
        if is_binary:
            return _BinaryNodes(data, _old_binary(data, begin.end()) if is_old else _binary(data, begin.end()))
        return _text(data, begin.end(), is_old, source)
    except (ValueError, IndexError, TypeError) as error:
        raise InputError(f"{source}: its nodes are damaged ({error}); save it again") from error


def _old_binary(data: bytes, at: int) -> tuple[tuple[int, int, int], ...]:
    """Place of the nodes of version 2.2: a number and three reals each."""
    end = data.index(b"\n", at) + 1
    n = int(data[at:end])
    if data[end + 28 * n :].lstrip()[:9] != b"$EndNodes":
        raise ValueError("they do not end where they should")
    return ((end + 4, n, 28),)


def _binary(data: bytes, at: int) -> tuple[tuple[int, int, int], ...]:
    """Places of the nodes of every entity of version 4.1: numbers, then reals, with parameters behind them."""
    n_entities = int(np.frombuffer(data, "<u8", 1, at)[0])
    at, parts = at + 32, []
    for _ in range(n_entities):
        dimension, _, is_parametric = np.frombuffer(data, "<i4", 3, at).tolist()
        n = int(np.frombuffer(data, "<u8", 1, at + 12)[0])
        step = 8 * (3 + dimension * is_parametric)
        parts.append((at + 20 + 8 * n, n, step))
        at += 20 + (8 + step) * n
    if data[at:].lstrip()[:9] != b"$EndNodes":
        raise ValueError("they do not end where they should")
    return tuple(parts)


def _text(data: bytes, at: int, is_old: bool, source: str) -> TextPoints:
    """Nodes in ASCII."""
    stop = data.index(b"$EndNodes", at)
    first = data.index(b"\n", at) + 1
    if is_old:
        return TextPoints.of(data, (first, stop), 3, source, before=1)
    newlines = np.flatnonzero(np.frombuffer(data, np.uint8)[first:stop] == ord("\n")) + first
    lines, line, parts = np.concatenate([[first], newlines + 1]), 0, []
    for _ in range(int(data[at:first].split()[0])):
        n = int(data[lines[line] : lines[line + 1]].split()[3])
        if n:
            parts.append(TextPoints.of(data, (int(lines[line + 1 + n]), int(lines[line + 1 + 2 * n])), 3, source))
        line += 1 + 2 * n
    joined = [np.concatenate([getattr(part, name) for part in parts]) for name in ("spans", "values")]
    return TextPoints(data, *joined)
