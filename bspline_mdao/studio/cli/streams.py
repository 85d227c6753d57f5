"""Where a command prints: text on standard output, warnings and errors on standard error, numbers where asked."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path
from typing import TextIO

import click

from ...base.numerics.progress import say_compilation

__all__ = ["STDOUT", "numbers_stream", "streams"]

STDOUT = Path("-")
"""Name of a file that is standard output."""

_NUMBERS = f"{__name__}.numbers"
"""Key of the stream of numbers in the context of a command."""


@contextmanager
def streams(
    context: click.Context,  # of the command
    *,
    is_quiet: bool,  # print warnings and errors alone
    has_numbers: bool,  # standard output is for numbers alone
) -> Iterator[None]:
    """Let a command print where it is asked to."""
    context.meta[_NUMBERS] = sys.stdout
    with ExitStack() as stack:
        if is_quiet:
            say_compilation(None)
            stack.enter_context(redirect_stdout(stack.enter_context(open(os.devnull, "w", encoding="utf-8"))))
        elif has_numbers:
            stack.enter_context(redirect_stdout(sys.stderr))
        yield


def numbers_stream() -> TextIO:
    """Standard output as it was before text went elsewhere."""
    return click.get_current_context().meta[_NUMBERS]
