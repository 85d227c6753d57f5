"""Files that may be compressed with gzip, held in memory as a whole."""

from __future__ import annotations

import os
import zlib

from ..errors import InputError

__all__ = ["MAX_RATIO", "MAX_SMALL", "read_bytes", "read_raw"]

_MAGIC = b"\x1f\x8b"

MAX_RATIO = 200
MAX_SMALL = 2**26
"""What is compressed may grow to 64 MiB or 200 times its file's length; grids compress at most about 40 times."""


def read_bytes(path: str | os.PathLike) -> tuple[bytes, bool, tuple[str, ...]]:
    """Read a file and decompress it where its first bytes say gzip.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    data : bytes
        Its content, decompressed.
    is_gzipped : bool
        Whether it was compressed.
    ignored : tuple of str
        What is in the file besides, one line each: bytes after the compressed data.

    Raises
    ------
    InputError
        When it cannot be read, is damaged, or grows beyond what a grid does.
    """
    data = read_raw(path)
    if not data.startswith(_MAGIC):
        return data, False, ()
    plain, n_ignored = _decompress(data, path)
    note = f"{path}: the {n_ignored} bytes after the compressed data are ignored; is the file whole?"
    return plain, True, (note,) * (n_ignored > 0)


def read_raw(path: str | os.PathLike, size: int = -1) -> bytes:
    """Read the first ``size`` bytes of a file as they are, or all of them.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    if not os.path.isfile(path):
        raise InputError(f"{path}: {'is not a file' if os.path.exists(path) else 'does not exist'}; give a grid file")
    try:
        with open(path, "rb") as file:
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def _decompress(data: bytes, path) -> tuple[bytes, int]:
    """Content of all members of a gzip file, and how many bytes follow that belong to none."""
    limit = max(MAX_SMALL, MAX_RATIO * len(data))
    pieces, size, rest = [], 0, data
    while rest.startswith(_MAGIC):
        member = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
        try:
            pieces.append(member.decompress(rest, limit + 1 - size))
        except zlib.error as error:
            raise _damaged(path, error) from error
        size += len(pieces[-1])
        if size > limit:
            raise InputError(
                f"{path}: grows from {len(data)} to more than {limit} bytes; decompress it yourself if it is a grid"
            )
        if not member.eof:
            raise _damaged(path, "it ends in the middle")
        rest = member.unused_data
    return b"".join(pieces), len(rest)


def _damaged(path, error) -> InputError:
    return InputError(f"{path}: damaged gzip file ({error}); transfer or compress it again")
