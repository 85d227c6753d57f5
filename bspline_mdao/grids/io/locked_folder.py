"""Folders private to one process, which can be recognised as left behind once it has ended, for whatever reason.

Each has an unpredictable name, and a lock that the system releases when its process ends.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows, where folders left behind stay
    fcntl = None  # type: ignore[assignment]

__all__ = ["LOCK", "is_left_behind", "is_of_this_user", "locked_folder", "take"]

LOCK = "lock"
"""File in the folder that is locked."""


def locked_folder(parent: Path, prefix: str, suffix: str = "") -> tuple[Path, int]:
    """Create a folder that only this user can enter, and lock it; return it and the open lock."""
    # Another process may consider it left behind before it is locked; then another name is tried.
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
    """Lock an open file: False if another process has locked it, None if there are no locks."""
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
    """Whether a folder belongs to the user of this process, and is not a link to one."""
    return not folder.is_symlink() and (fcntl is None or folder.stat().st_uid == os.geteuid())


def is_left_behind(folder: Path, is_certain: bool = False) -> bool:
    """Whether no process has locked a folder of this user, as far as known or, with locks, for certain."""
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
