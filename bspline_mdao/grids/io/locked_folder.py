"""Folders of one process alone, which are known as left behind once it has ended, however that came about.

Each has a name that nobody can foresee, and a lock, which the system gives back when its process ends.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows, where what is left behind stays
    fcntl = None  # type: ignore[assignment]

__all__ = ["LOCK", "is_left_behind", "is_of_this_user", "locked_folder", "take"]

LOCK = "lock"
"""File in the folder that is locked."""


def locked_folder(parent: Path, prefix: str, suffix: str = "") -> tuple[Path, int]:
    """Make a folder that this user alone can enter, and lock it; returns it and the open lock."""
    # Another process may take it for left behind before it is locked; there is another name then.
    while True:
        folder = Path(tempfile.mkdtemp(suffix, prefix, parent))
        try:
            lock = os.open(folder / LOCK, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        except FileNotFoundError:
            continue
        except OSError:
            folder.rmdir()
            raise
        if take(lock) is not False and (folder / LOCK).exists():
            return folder, lock
        os.close(lock)


def take(lock: int) -> bool | None:
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


def is_of_this_user(folder: Path) -> bool:
    """Whether a folder is of the user of this process, and no link to one."""
    return not folder.is_symlink() and (fcntl is None or folder.stat().st_uid == os.geteuid())


def is_left_behind(folder: Path, is_certain: bool = False) -> bool:
    """Whether a folder of this user is locked by no process, as far as is known or, with locks, for certain."""
    if not is_of_this_user(folder):
        return False
    try:
        lock = os.open(folder / LOCK, os.O_RDWR)
    except FileNotFoundError:
        return True
    try:
        is_free = take(lock)
        return is_free is True or (is_free is None and not is_certain)
    finally:
        os.close(lock)
