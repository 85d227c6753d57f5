"""Numbers of a file that stays on disk: any range of them is read on request.

A file is seen as its bytes (`StoredBytes`). The numbers are either in consecutive pieces of these bytes
(`BinaryNumbers`: all of a raw file, or the payloads of its Fortran records), or in text (`TextNumbers`), which is
scanned once to find the numbers in each part of it. All of them can be sent to other processes, without the data that
they have in memory.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...errors import InputError
from .disk import is_compressed, read_bytes

__all__ = ["BinaryNumbers", "Numbers", "StoredBytes", "TextNumbers"]

TEXT_PART = 2**24
"""Bytes of a text that are converted to numbers at a time."""


class Numbers(Protocol):
    """Consecutive numbers, addressed by bytes as in a binary file."""

    @property
    def nbytes(self) -> int:
        """Bytes of all numbers."""

    def take(self, dtype: np.dtype, count: int, start: int) -> np.ndarray:
        """Read ``count`` numbers from byte ``start`` on."""


class StoredBytes:
    """Bytes of a file, or of its decompressed content; slices are read on request."""

    def __init__(
        self,
        # the file; a compressed one is decompressed as a whole by every process that reads from it, and kept
        path: str | os.PathLike,
    ):
        self.path = os.fspath(path)
        self.compression = ""
        self.ignored: tuple[str, ...] = ()
        self._bytes: bytes | None = None
        if is_compressed(path):
            self._bytes, self.compression, self.ignored = read_bytes(path)
        self._size = os.path.getsize(path) if self._bytes is None else len(self._bytes)

    def __getstate__(self) -> dict:
        return self.__dict__ | {"_held": None}

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, part: slice) -> bytes:
        start, stop, _ = part.indices(self._size)
        if self.compression and self._bytes is None:
            self._bytes = read_bytes(self.path)[0]
        if self._bytes is not None:
            return self._bytes[start:stop]
        try:
            with open(self.path, "rb") as file:
                file.seek(start)
                data = file.read(max(stop - start, 0))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror or error})") from error
        if len(data) < stop - start:
            raise InputError(f"{self.path}: has become shorter since it was opened; read it again")
        return data


@dataclass(frozen=True, eq=False)
class BinaryNumbers:
    """Numbers in consecutive pieces of bytes."""

    data: Any  # the file
    starts: np.ndarray  # (n,) of int, start of each piece in it
    ends: np.ndarray  # (n,) of int, bytes of all pieces up to the end of each

    @classmethod
    def whole(cls, data: Any) -> BinaryNumbers:
        """All bytes of a file, or the numbers of an array."""
        data = data.view(np.uint8).data if isinstance(data, np.ndarray) else data
        return cls(data, np.array([0]), np.array([len(data)]))

    @property
    def nbytes(self) -> int:
        """Bytes of all pieces."""
        return int(self.ends[-1])

    def take(self, dtype: np.dtype, count: int, start: int) -> np.ndarray:
        """Read ``count`` numbers from byte ``start`` of the pieces on, shape (count,)."""
        stop = start + count * dtype.itemsize
        first, last = np.searchsorted(self.ends, [start, stop - 1], side="right") if count else (0, 0)
        parts = []
        for piece in range(first, last + 1):
            begin = int(self.ends[piece - 1]) if piece else 0
            shift = int(self.starts[piece]) - begin
            parts.append(self.data[max(start, begin) + shift : min(stop, int(self.ends[piece])) + shift])
        return np.frombuffer(parts[0] if len(parts) == 1 else b"".join(parts), dtype, count)

    def __bytes__(self) -> bytes:
        return self.take(np.dtype(np.uint8), self.nbytes, 0).tobytes()


@dataclass(frozen=True, eq=False)
class TextNumbers:
    """Numbers of a text, as reals of 8 bytes. Made by `bspline_mdao.grids.io.fortran.scan_text`."""

    parse: Any  # converts the bytes of a part to numbers, given the number of lines before it
    data: Any  # the text
    starts: np.ndarray  # (n + 1,) of int, start of each part in it, and the end of the last one
    lines: np.ndarray  # (n,) of int, lines before each part
    ends: np.ndarray  # (n,) of int, numbers up to the end of each part
    n_comments: int = 0  # comments in the text

    @property
    def nbytes(self) -> int:
        """Bytes of all numbers."""
        return 8 * int(self.ends[-1])

    def take(self, dtype: np.dtype, count: int, start: int) -> np.ndarray:
        """Read ``count`` numbers from byte ``start`` of the numbers on, shape (count,)."""
        if not count:
            return np.empty(0)
        first, last = start // 8, start // 8 + count
        low, high = np.searchsorted(self.ends, [first, last - 1], side="right")
        parts = [
            self.parse(self.data[int(self.starts[n]) : int(self.starts[n + 1])], int(self.lines[n]))
            for n in range(low, high + 1)
        ]
        first -= int(self.ends[low - 1]) if low else 0
        return np.concatenate(parts)[first : first + count]
