"""Standard output that may end before a command does: the files that a run writes are worth more than its output."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["drop_stdout", "lasting_stdout"]


@contextmanager
def lasting_stdout() -> Iterator[None]:
    """Let a command continue if standard output is closed, as by ``| head``, or its disk is full; one line says so."""
    before = sys.stdout
    sys.stdout = _Lasting(before)  # type: ignore[assignment]
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout = before


def drop_stdout() -> None:
    """Discard further output, including what the interpreter flushes at its exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno())  # type: ignore[union-attr]


class _Lasting:
    """A stream that ignores errors of writing."""

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
        """Flush the buffer, or drop it."""
        try:
            self._stream.flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        drop_stdout()
        words = "was closed" if isinstance(error, BrokenPipeError) else f"cannot be written ({error.strerror})"
        print(f"standard output {words}; the run continues, and writes its results", file=sys.stderr)
