"""Files that may be compressed with gzip, held in memory as a whole."""

from __future__ import annotations

import gzip
import io
import os
import zlib

from ..errors import InputError

__all__ = ["MAX_RATIO", "MAX_SMALL", "read_bytes", "read_raw"]

MAX_RATIO = 200
MAX_SMALL = 2**26
"""What is compressed may grow to 64 MiB or 200 times its file's length; grids compress at most about 40 times."""


def read_bytes(path: str | os.PathLike) -> tuple[bytes, bool]:
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

    Raises
    ------
    InputError
        When it cannot be read, is damaged, or grows beyond what a grid does.
    """
    data = read_raw(path)
    is_gzipped = data[:2] == b"\x1f\x8b"
    return (_decompress(data, path) if is_gzipped else data), is_gzipped


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


def _decompress(data: bytes, path) -> bytes:
    limit = max(MAX_SMALL, MAX_RATIO * len(data))
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            plain = file.read(limit + 1)
    except (EOFError, OSError, zlib.error) as error:
        raise InputError(f"{path}: damaged gzip file ({error}); transfer or compress it again") from error
    if len(plain) > limit:
        raise InputError(
            f"{path}: grows from {len(data)} to more than {limit} bytes; decompress it yourself if it is a grid"
        )
    return plain
