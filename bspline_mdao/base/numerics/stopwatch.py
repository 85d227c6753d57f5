"""A clock that stops while numba compiles, which it does once on a machine, so it shows the time of the work."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

__all__ = ["compilation_noticed", "working_seconds"]

COMPILES = "numba:compile"
"""Numba's event for compiling a kernel; kernels from the cache have none."""


class _Listener(event.Listener):
    """Reports when the compilation of a kernel begins (1) and ends (-1), with the kernels it calls in between."""

    def __init__(self, notice: Callable[[int], None]):
        self.notice = notice

    def on_start(self, kernel: Any) -> None:
        self.notice(1)

    def on_end(self, kernel: Any) -> None:
        self.notice(-1)


class _Compilation:
    """Seconds of compilation in this process. Numba compiles on one thread at a time."""

    def __init__(self) -> None:
        self.depth, self.began, self.seconds = 0, 0.0, 0.0

    def notice(self, change: int) -> None:
        now = time.perf_counter()
        if self.depth == 0:
            self.began = now
        self.depth += change
        if self.depth == 0:
            self.seconds += now - self.began


_compilation = _Compilation()
event.register(COMPILES, _Listener(_compilation.notice))


def working_seconds() -> float:
    """Seconds of a clock that leaves out the compilation of kernels."""
    return time.perf_counter() - _compilation.seconds


@contextmanager
def compilation_noticed(
    notice: Callable[[int], None],  # called with 1 when the compilation of a kernel begins, and with -1 when it ends
) -> Iterator[None]:
    """Report compilation meanwhile."""
    with event.install_listener(COMPILES, _Listener(notice)):
        yield
