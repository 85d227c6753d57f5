"""Files on disk: read as a whole, possibly compressed; written so that a reader never sees an incomplete file.

New files are written into a private folder next to the target, flushed to the disk, and renamed into place. A process
that is killed leaves its private folder behind; the next one that writes there removes it. A lock distinguishes the two
cases: the system releases it when its process ends, for whatever reason. HDF5 files are written in memory first, so
that no keyboard interrupt is lost in h5py.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import re
import shutil
import signal
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import h5py

from ...errors import InputError
from .locked_folder import LOCK, is_of_this_user, locked_folder, take

PREFIX, SUFFIX = ".bspline_mdao-", ".part"
_NEW = "new"  # content of a private folder besides its lock


@contextmanager
def replaced_file(
    # file to create or to replace; a symbolic link is followed, and missing folders are created
    path: str | os.PathLike,
) -> Iterator[Path]:
    """Yield a temporary path on the file system of ``path``, which takes its place when the block ends well."""
    # Yields the path to write to. If the block raises, it is removed and ``path`` stays unchanged or is not created.
    target = Path(os.path.realpath(path))
    _check_replaceable(path, target)
    with _os_error_is_input_error(path), _folder(target.parent), _private_folder(target.parent) as folder:
        yield folder / _NEW
        _flush(folder / _NEW)
        _put(folder / _NEW, target)
        _flush_folder(target.parent)


@contextmanager
def replaced_folder(
    # folder to create, with missing folders above it, or to put files into; other files in it stay
    path: str | os.PathLike,
) -> Iterator[Path]:
    """Yield an empty temporary folder, which becomes ``path``, or whose files go there, when the block ends well."""
    # Yields the folder to write files to, also in folders in it. If the block raises, it is removed and ``path`` stays
    # unchanged or is not created.
    target = Path(os.path.realpath(path))
    with _os_error_is_input_error(path), _folder(target.parent), _private_folder(target.parent) as folder:
        new = folder / _NEW
        new.mkdir()
        yield new
        if target.exists():
            put_files(new, path)
        else:
            for file in files_in(new):
                _flush(new / file)
            os.rename(new, target)
            _flush_folder(target)
        _flush_folder(target.parent)


def files_in(folder: Path) -> list[Path]:
    """Files in a folder and its subfolders, relative to it."""
    return sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file())


def put_files(new: Path, path: str | os.PathLike) -> None:
    """Move the files of a folder into another one on the same file system, replacing files of the same name only."""
    target, files = Path(os.path.realpath(path)), files_in(new)
    for file in files:
        _flush(new / file)
        _check_replaceable(Path(path) / file, target / file)
        (target / file.parent).mkdir(exist_ok=True, parents=True)
    for file in files:
        _put(new / file, target / file)
    _flush_folder(target)


@contextmanager
def _folder(folder: Path) -> Iterator[None]:
    """Create a folder and missing folders above it; if the block raises, they are removed again."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # others may have put something there
            for place in missing:
                place.rmdir()
        raise


def _check_replaceable(path: str | os.PathLike, target: Path) -> None:
    """Refuse an existing path that is not a file: root could replace a device, /dev/null for example."""
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: is {'a folder' if target.is_dir() else 'a device'}, not a file; name a file")


@contextmanager
def _os_error_is_input_error(path: str | os.PathLike) -> Iterator[None]:
    """Turn a system error into an `InputError` of one line that names the path."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from error


def _put(file: Path, target: Path) -> None:
    """Put a file in place of another one, with the permissions of the latter."""
    if target.exists():
        shutil.copymode(target, file)
    os.replace(file, target)


@contextmanager
def _private_folder(parent: Path) -> Iterator[Path]:
    """Create a folder that only this user can enter, locked until the block ends and then removed."""
    _remove_left_behind(parent)
    folder, lock = locked_folder(parent, PREFIX, SUFFIX)
    try:
        yield folder
    finally:
        os.close(lock)
        shutil.rmtree(folder, ignore_errors=True)


def _remove_left_behind(parent: Path) -> None:
    """Remove this user's private folders in a folder whose processes have ended."""
    for folder in parent.glob(f"{PREFIX}*{SUFFIX}"):
        with suppress(OSError):
            if is_of_this_user(folder):
                _remove_unlocked(folder)


def _remove_unlocked(folder: Path) -> None:
    """Remove a private folder that no process has locked."""
    try:
        lock = os.open(folder / LOCK, os.O_RDWR)
    except FileNotFoundError:
        folder.rmdir()  # if it is empty
        return
    try:
        if take(lock):
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(lock)


def _flush(file: Path) -> None:
    """Flush a file to the disk."""
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _flush_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, if the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Delay a keyboard interrupt until the block ends."""
    # The first Python code that runs after a call of the HDF5 library is often a callback of one of h5py's weak
    # references, and Python drops exceptions raised there.
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    received = []
    signal.signal(signal.SIGINT, lambda *arguments: received.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if received:
            handler(*received[0])


@contextmanager
def replaced_hdf5_file(
    path: str | os.PathLike,  # file to create or to replace
) -> Iterator[h5py.File]:
    """Yield an empty HDF5 file, which takes the place of ``path`` when the block ends well."""
    # It is kept in memory until then: the HDF5 library crashes the process when a disk is full.
    buffer = io.BytesIO()
    with deferred_interrupts():
        file = h5py.File(buffer, "w", track_order=True)
    try:
        yield file
    finally:
        with deferred_interrupts():
            file.close()
    with replaced_file(path) as temporary:
        temporary.write_bytes(buffer.getvalue())


class Compression(NamedTuple):
    """A format for one compressed file."""

    name: str  # its name
    suffix: str  # suffix of its files
    magic: re.Pattern[bytes]  # beginning of its files
    decompressor: Callable[[], Any]  # makes a decompressor for a member of a file
    # opens a compressor into an open file; the same content gives the same bytes
    sink: Callable[[BinaryIO], Any]


_XZ_MEMORY = 2**28
"""Largest dictionary of xz in bytes: the strongest of its presets takes 64 MiB."""

COMPRESSIONS = (
    Compression(
        "gzip",
        ".gz",
        re.compile(rb"\x1f\x8b"),
        lambda: zlib.decompressobj(wbits=zlib.MAX_WBITS | 16),
        lambda file: gzip.GzipFile("", "wb", 6, file, mtime=0),  # without name and time
    ),
    Compression(
        "bzip2",
        ".bz2",
        re.compile(rb"BZh[1-9](1AY&SY|\x17rE8P\x90)"),
        bz2.BZ2Decompressor,
        partial(bz2.open, mode="wb"),
    ),
    Compression(
        "xz",
        ".xz",
        re.compile(rb"\xfd7zXZ\x00"),
        lambda: lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_XZ_MEMORY),
        partial(lzma.open, mode="wb"),
    ),
)
"""Compression formats of grids."""

_LONGEST_MAGIC = 10

MAX_RATIO = 200
MAX_SMALL = 2**26
"""Decompressed data may be 64 MiB or 200 times the length of the file; grids compress at most about 40 times."""


def read_bytes(
    path: str | os.PathLike,  # the file
) -> tuple[bytes, str, tuple[str, ...]]:
    """Read a file and decompress it if its first bytes say that it is compressed."""
    # Returns data: its content, decompressed; compression: name of one of `COMPRESSIONS`, empty if it was not
    # compressed; ignored: other content of the file, one line each: bytes after the compressed data.
    data = read_raw(path)
    found = _compression_of(data)
    if found is None:
        return data, "", ()
    plain, n_ignored = _decompress(data, found, path)
    note = f"{path}: the {n_ignored} bytes after the compressed data are ignored; is the file whole?"
    return plain, found.name, (note,) * (n_ignored > 0)


def is_compressed(path: str | os.PathLike) -> bool:
    """Whether the first bytes of a file say that it is compressed."""
    return _compression_of(read_raw(path, _LONGEST_MAGIC)) is not None


def _compression_of(data: bytes) -> Compression | None:
    """Compression format of a file, from its first bytes; None if it is not compressed."""
    return next((item for item in COMPRESSIONS if item.magic.match(data)), None)


def read_raw(path: str | os.PathLike, size: int = -1) -> bytes:
    """Read the first ``size`` bytes of a file unchanged, or all of them."""
    if not os.path.isfile(path):
        raise InputError(f"{path}: {'is not a file' if os.path.exists(path) else 'does not exist'}; give a file")
    try:
        with open(path, "rb") as file:
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def _decompress(data: bytes, compression: Compression, path: str | os.PathLike) -> tuple[bytes, int]:
    """Content of all members of a compressed file, and the number of bytes after the last member."""
    limit = max(MAX_SMALL, MAX_RATIO * len(data))
    pieces, size, rest = [], 0, data
    while compression.magic.match(rest):
        member = compression.decompressor()
        try:
            pieces.append(member.decompress(rest, limit + 1 - size))
        except (zlib.error, lzma.LZMAError, OSError) as error:
            raise _damaged(path, compression, error) from error
        size += len(pieces[-1])
        if size > limit:
            raise InputError(
                f"{path}: grows from {len(data)} to more than {limit} bytes; decompress it yourself if it is a grid"
            )
        if not member.eof:
            raise _damaged(path, compression, "it ends in the middle")
        rest = member.unused_data
    return b"".join(pieces), len(rest)


def _damaged(path: str | os.PathLike, compression: Compression, error: Exception | str) -> InputError:
    """Return the error of a compressed file that cannot be decompressed."""
    return InputError(f"{path}: damaged {compression.name} file ({error}); transfer or compress it again")
