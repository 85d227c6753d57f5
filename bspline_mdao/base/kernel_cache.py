"""A place for compiled kernels: for where numba finds none, as in containers and on compute nodes.

Numba keeps what it compiles in ``NUMBA_CACHE_DIR``, beside the source or in the cache folder of the user, and refuses
to import a kernel if none of them can be written. The place is checked before the first kernel is imported, without
importing numba, so that importing the package stays cheap.
"""

from __future__ import annotations

import os
import stat
import sys

VARIABLE = "NUMBA_CACHE_DIR"
PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def ensure_kernel_cache() -> None:
    """Point numba to a private folder under the temporary one if it can write nowhere else, and say so in one line."""
    # The folder is the same in the next session, so that kernels are compiled once, unless somebody else has taken its
    # name: cached kernels are code, and come from folders of the user alone. It is passed on to child processes.
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
    """Folder of compiled kernels as a whole: the user's choice, that of the package's own module, or the user's."""
    if folder := _folder_of_variable():
        return folder
    return os.path.join(PACKAGE, "__pycache__") if _is_package_writable() else _user_folder()


def _folder_of_variable() -> str:
    """Folder that the user has chosen; empty where there is none."""
    chosen = os.environ.get(VARIABLE)
    return os.path.abspath(chosen) if chosen else ""


def _user_folder() -> str:
    """Folder in which the user's caches are, where numba looks for it; relative where the user has no home."""
    if sys.platform == "win32":
        return os.environ.get("LOCALAPPDATA", "")
    caches = "~/Library/Caches" if sys.platform == "darwin" else os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return os.path.join(os.path.expanduser(caches), "numba")


def _is_package_writable() -> bool:
    """Whether every folder with sources takes compiled files."""
    folders = [path for path, _, names in os.walk(PACKAGE) if any(name.endswith(".py") for name in names)]
    return all(_can_be_made(os.path.join(path, "__pycache__")) for path in folders)


def _can_be_made(folder: str) -> bool:
    """Whether a folder can be written, or made with those above it that are missing."""
    if not os.path.isabs(folder):
        return False
    while not os.path.exists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _private_folder() -> str:
    """Make or find a folder under the temporary one that this user alone can enter."""
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
    """Make a folder that goes when the process ends."""
    import atexit
    import shutil
    import tempfile

    folder = tempfile.mkdtemp(prefix="bspline_mdao-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
