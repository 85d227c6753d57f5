"""Write files and folders so that a reader never sees half of one.

What is new is written into a private folder beside its target, flushed to the disk, and put in its place by renaming. A
process that is killed leaves its private folder behind; the next one that writes there removes it. A lock tells the two
apart: the system gives it back when its process ends, however that comes about.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError

try:
    import fcntl
except ImportError:  # Windows, where what is left behind stays
    fcntl = None

__all__ = ["replaced_file", "replaced_folder"]

PREFIX, SUFFIX = ".bspline_mdao-", ".part"
_LOCK, _NEW = "lock", "new"  # what is in a private folder


@contextmanager
def replaced_file(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path on the file system of ``path``, which takes its place when the block ends well.

    Parameters
    ----------
    path : path-like
        File to make or to replace; a symbolic link is followed.

    Yields
    ------
    Path
        Path to write to. When the block raises, it is removed and ``path`` stays as it was.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written to, or when ``path`` is a device or a pipe.
    """
    target = Path(os.path.realpath(path))
    _check_replaceable(path, target)
    with _os_error_is_input_error(path), _private_folder(target.parent) as folder:
        yield folder / _NEW
        _flush(folder / _NEW)
        _put(folder / _NEW, target)
        _flush_folder(target.parent)


@contextmanager
def replaced_folder(path: str | os.PathLike) -> Iterator[Path]:
    """Give an empty temporary folder, which becomes ``path``, or whose files go there, when the block ends well.

    Parameters
    ----------
    path : path-like
        Folder to make, with those above it that are missing, or to put files into; other files in it stay.

    Yields
    ------
    Path
        Folder to write files to. When the block raises, it is removed and ``path`` stays as it was or is not made.

    Raises
    ------
    InputError
        When the folder cannot be made or written to, or has a folder by the name of one of the files.
    """
    target = Path(os.path.realpath(path))
    with _os_error_is_input_error(path):
        target.parent.mkdir(parents=True, exist_ok=True)
        with _private_folder(target.parent) as folder:
            new = folder / _NEW
            new.mkdir()
            yield new
            files = sorted(new.iterdir())
            for file in files:
                _flush(file)
            if target.exists():
                for file in files:
                    _check_replaceable(Path(path) / file.name, target / file.name)
                for file in files:
                    _put(file, target / file.name)
            else:
                os.rename(new, target)
            _flush_folder(target)
            _flush_folder(target.parent)


def _check_replaceable(path: str | os.PathLike, target: Path) -> None:
    """Refuse what is there and no file: root could replace a device, /dev/null for example."""
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: is {'a folder' if target.is_dir() else 'a device'}, not a file; name a file")


@contextmanager
def _os_error_is_input_error(path: str | os.PathLike) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from error


def _put(file: Path, target: Path) -> None:
    """Put a file in the place of another one, whose permissions it takes."""
    if target.exists():
        shutil.copymode(target, file)
    os.replace(file, target)


@contextmanager
def _private_folder(parent: Path) -> Iterator[Path]:
    """Make a folder that this user alone can enter, locked until the block ends and removed then."""
    _remove_left_behind(parent)
    folder, lock = _locked_folder(parent)
    try:
        yield folder
    finally:
        os.close(lock)
        shutil.rmtree(folder, ignore_errors=True)


def _locked_folder(parent: Path) -> tuple[Path, int]:
    """Make a folder with a name that nobody can foresee, and lock it.

    Another process may take it for left behind before it is locked; there is another name then.
    """
    while True:
        folder = Path(tempfile.mkdtemp(SUFFIX, PREFIX, parent))
        try:
            lock = os.open(folder / _LOCK, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        except FileNotFoundError:
            continue
        except OSError:
            folder.rmdir()
            raise
        if _take(lock) is not False and (folder / _LOCK).exists():
            return folder, lock
        os.close(lock)


def _take(lock: int) -> bool | None:
    """Lock an open file: False where another process has locked it, None where there are no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _remove_left_behind(parent: Path) -> None:
    """Remove the private folders of this user in a folder whose processes have ended."""
    for folder in parent.glob(f"{PREFIX}*{SUFFIX}"):
        with suppress(OSError):
            if folder.is_symlink() or (fcntl and folder.stat().st_uid != os.geteuid()):
                continue
            _remove_unlocked(folder)


def _remove_unlocked(folder: Path) -> None:
    """Remove a private folder that no process has locked."""
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR)
    except FileNotFoundError:
        folder.rmdir()  # if it is empty
        return
    try:
        if _take(lock):
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(lock)


def _flush(file: Path) -> None:
    """Have a file written to the disk."""
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _flush_folder(folder: Path) -> None:
    """Have the names in a folder written to the disk, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
