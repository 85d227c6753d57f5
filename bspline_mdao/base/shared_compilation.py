"""Several processes that compile kernels into one folder: each kernel once, by the process that first needs it.

With numba alone, processes that miss a kernel at the same time all compile it, and each overwrites the others' index.
Here one locks the kernel, and the others wait and read the result. This is for processes started to compile
(`bspline-mdao warm-up`); working processes do not wait for each other.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["HAS_LOCKS", "shared_compilation"]

PATIENCE = 120.0
"""Seconds that a process waits for another before it compiles a kernel itself."""

try:
    import fcntl

    HAS_LOCKS = True
except ImportError:  # Windows
    HAS_LOCKS = False
"""Whether processes can lock kernels; otherwise only one may compile at a time."""


@contextmanager
def shared_compilation(
    locks: Path,  # folder of the locks, the same for all processes
    # called with the index and signature of each specialisation needed, and whether it must be compiled
    noted: Callable[[str, str, bool], None],
) -> Iterator[None]:
    """Share compilation with other processes that do the same, and note which cache entries are needed."""
    from numba.core.caching import FunctionCache  # takes a while to import

    load, save, owned = FunctionCache.load_overload, FunctionCache.save_overload, _Locks(locks)

    def load_overload(self: Any, signature: Any, target: Any) -> Any:
        found, index = load(self, signature, target), self._cache_file._index_path
        if found is None:
            owned.take(index)
            found = load(self, signature, target)  # another process may have compiled it in the meantime
            if found is not None:
                owned.drop(index)
        shipped = getattr(self, "_shipped", None)  # from a wheel, see `shipped_kernels`
        if found is not None and shipped is not None and not os.path.exists(index):
            index = shipped._index_path
        noted(index, str(signature), found is None)
        return found

    def save_overload(self: Any, *arguments: Any) -> Any:
        try:
            return save(self, *arguments)
        finally:
            owned.drop(self._cache_file._index_path)

    FunctionCache.load_overload, FunctionCache.save_overload = load_overload, save_overload
    try:
        yield
    finally:
        FunctionCache.load_overload, FunctionCache.save_overload = load, save
        owned.drop_all()


class _Locks:
    """Locks of kernels that this process compiles; the system releases them when it ends."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.taken: dict[str, tuple[int, int]] = {}  # descriptor of the file, and how often it was requested

    def take(self, index: str) -> None:
        """Wait until no other process compiles a kernel, and lock it."""
        if not HAS_LOCKS:
            return
        if index in self.taken:  # a kernel that calls itself
            descriptor, n = self.taken[index]
            self.taken[index] = descriptor, n + 1
            return
        name = hashlib.sha256(index.encode()).hexdigest()[:24]
        descriptor = os.open(self.folder / name, os.O_CREAT | os.O_RDWR, 0o600)
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                time.sleep(0.02)
        self.taken[index] = descriptor, 1

    def drop(self, index: str) -> None:
        """Release a kernel."""
        descriptor, n = self.taken.pop(index, (-1, 0))
        if n > 1:
            self.taken[index] = descriptor, n - 1
        elif n == 1:
            os.close(descriptor)

    def drop_all(self) -> None:
        """Release all kernels."""
        for descriptor, _ in self.taken.values():
            os.close(descriptor)
        self.taken.clear()
