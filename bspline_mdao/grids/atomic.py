"""Write files so that a reader never sees half of one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError

__all__ = ["replaced_file"]


@contextmanager
def replaced_file(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path in the folder of ``path``, which takes its place when the block ends well.

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
    if target.exists() and not target.is_file():  # root could replace a device, /dev/null for example
        raise InputError(f"{path}: is {'a folder' if target.is_dir() else 'a device'}, not a file; name a file")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
