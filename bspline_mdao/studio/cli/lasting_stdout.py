"""Standard output that may end before a command does: what a run writes to files is worth more than what it prints."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["drop_stdout", "lasting_stdout"]


@contextmanager
def lasting_stdout() -> Iterator[None]:
    """Let a command go on where standard output is closed, as by ``| head``, or its disk is full; one line says so."""
    before = sys.stdout
    sys.stdout = _Lasting(before)  # type: ignore[assignment]
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout = before


def drop_stdout() -> None:
    """Let whatever else is printed, and what the interpreter flushes at its exit, go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno())  # type: ignore[union-attr]


class _Lasting:
    """A stream whose errors are no errors of what is printed to it."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, or drop it."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._drop(error)
            return len(text)

    def flush(self) -> None:
        """Write what was kept back, or drop it."""
        try:
            self._stream.flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        drop_stdout()
        words = "was closed" if isinstance(error, BrokenPipeError) else f"cannot be written ({error.strerror})"
        print(f"standard output {words}; the run continues, and writes its results", file=sys.stderr)
