"""A folder for compiled kernels if numba finds none, as in containers and on compute nodes.

Numba stores compiled code in ``NUMBA_CACHE_DIR``, next to the source or in the user's cache folder, and refuses to
import a kernel if none of them is writable. This is checked before the first kernel is imported, without importing
numba, so importing the package stays cheap.
"""

from __future__ import annotations

import os
import stat
import sys

VARIABLE = "NUMBA_CACHE_DIR"
PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def ensure_kernel_cache() -> None:
    """Point numba to a private temporary folder if it can write nowhere else, and say so in one line."""
    # The folder is the same in the next session, so kernels are compiled once, unless another user has taken its name:
    # cached kernels are code, and are only read from the user's own folders. It is passed on to child processes.
    if _can_be_made(_folder_of_variable()) or _can_be_made(_user_folder()) or _is_package_writable():
        return
    import warnings

    folder = _private_folder()
    os.environ[VARIABLE] = folder
    if "numba" in sys.modules:  # it reads the environment only once
        sys.modules["numba"].config.CACHE_DIR = folder
    message = (
        f"compiled kernels are kept in {folder}, since neither {PACKAGE} nor your home folder can be written; "
        f"set {VARIABLE} to a folder of yours that lasts"
    )
    warnings.warn_explicit(message, RuntimeWarning, "bspline_mdao", 0)


def kernel_folder() -> str:
    """Folder of all compiled kernels: the user's choice, the package's own, or the user's cache."""
    if folder := _folder_of_variable():
        return folder
    return os.path.join(PACKAGE, "__pycache__") if _is_package_writable() else _user_folder()


def _folder_of_variable() -> str:
    """Folder chosen by the user; empty if none."""
    chosen = os.environ.get(VARIABLE)
    return os.path.abspath(chosen) if chosen else ""


def _user_folder() -> str:
    """Folder of the user's caches, where numba looks for it; relative if the user has no home."""
    if sys.platform == "win32":
        return os.environ.get("LOCALAPPDATA", "")
    caches = "~/Library/Caches" if sys.platform == "darwin" else os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return os.path.join(os.path.expanduser(caches), "numba")


def _is_package_writable() -> bool:
    """Whether compiled files can be written to every source folder."""
    folders = [path for path, _, names in os.walk(PACKAGE) if any(name.endswith(".py") for name in names)]
    return all(_can_be_made(os.path.join(path, "__pycache__")) for path in folders)


def _can_be_made(folder: str) -> bool:
    """Whether a folder is writable, or can be made with its missing parents."""
    if not os.path.isabs(folder):
        return False
    while not os.path.exists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _private_folder() -> str:
    """Make or find a temporary folder that only this user can enter."""
    import tempfile

    user = os.geteuid() if hasattr(os, "geteuid") else 0
    folder = os.path.join(tempfile.gettempdir(), f"bspline_mdao-{user}")
    try:
        os.mkdir(folder, mode=0o700)
    except FileExistsError:
        found = os.lstat(folder)
        is_ours = stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o077
        if not is_ours:
            return _folder_of_session()
    return folder


def _folder_of_session() -> str:
    """Make a folder that is deleted when the process ends."""
    import atexit
    import shutil
    import tempfile

    folder = tempfile.mkdtemp(prefix="bspline_mdao-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
