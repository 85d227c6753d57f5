"""Output streams of a command: text on standard output, warnings and errors on standard error, numbers as requested."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path
from typing import TextIO

import click

from ...base.numerics.progress import say_compilation

__all__ = ["STDOUT", "is_quiet", "numbers_stream", "streams"]

STDOUT = Path("-")
"""File name that stands for standard output."""

_NUMBERS = f"{__name__}.numbers"
"""Key of the stream of numbers in the context of a command."""

_QUIET = f"{__name__}.quiet"
"""Key of whether a command prints only warnings and errors."""


@contextmanager
def streams(
    context: click.Context,  # of the command
    *,
    quiet: bool,  # print only warnings and errors
    has_numbers: bool,  # standard output is reserved for numbers
) -> Iterator[None]:
    """Direct the output of a command to the requested streams."""
    context.meta[_NUMBERS], context.meta[_QUIET] = sys.stdout, quiet
    with ExitStack() as stack:
        if quiet:
            say_compilation(None)
            stack.enter_context(redirect_stdout(stack.enter_context(open(os.devnull, "w", encoding="utf-8"))))
        elif has_numbers:
            stack.enter_context(redirect_stdout(sys.stderr))
        yield


def numbers_stream() -> TextIO:
    """Standard output before text was redirected."""
    return click.get_current_context().meta[_NUMBERS]


def is_quiet() -> bool:
    """Whether the current command prints only warnings and errors."""
    context = click.get_current_context(silent=True)
    return context is not None and context.meta.get(_QUIET, False)
