"""Entry point of the command line: runs a command and turns any error into an exit status and one line."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import TextIOWrapper
from typing import Any

import click

from ...base.numerics.processes import from_first, n_launched, world
from ...base.numerics.progress import say_compilation
from ...errors import InputError, MovementError
from .commands import bspline_mdao
from .lasting_stdout import drop_stdout
from .termination import interrupt_when_terminated
from .words import PROGRAM

FAILED, INTERRUPTED = 2, 130

SHARED = {"fit", "optimize", "quality"}
"""Commands that can run on several processes."""

WITH_OPENMDAO = {"report"}
"""Commands of the first process that import OpenMDAO. PETSc must be initialised on all processes together."""

EXPECTED = (click.ClickException, InputError, MovementError, OSError)
"""What commands raise on all processes together."""


def main() -> None:
    """Run the command of ``sys.argv`` and exit."""
    if n_launched() < 2:
        interrupt_when_terminated()
    say_compilation(_say)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names that the terminal cannot show
    sys.exit(run(sys.argv[1:]))


def run(
    arguments: Sequence[str],  # the command and its arguments, without the name of the program
) -> int:  # exit status, see `main`
    """Run a command and return its exit status."""
    # Several processes share the work of the commands in `SHARED`; only the first one does others. It alone prints, and
    # all end with the same status.
    try:
        processes = world()
    except ImportError as error:
        _say(str(error))
        return FAILED
    if processes.size > 1 and not WITH_OPENMDAO.isdisjoint(arguments[:1]):
        importlib.import_module("openmdao.api")
    if processes.rank > 0 and SHARED.isdisjoint(arguments[:1]):
        return from_first(processes, None)
    if processes.rank > 0:
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
            return from_first(processes, _run(arguments, processes))
    return from_first(processes, _run(arguments, processes))


def _run(arguments: Sequence[str], processes: Any) -> int:
    """Run a command on this process and return its exit status."""
    try:
        bspline_mdao.main(args=list(arguments), prog_name=PROGRAM, standalone_mode=False)
        sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort) as error:
        _say(str(error.__cause__ or error) or "interrupted; each output is complete or as it was before")
        return INTERRUPTED
    except BrokenPipeError:
        drop_stdout()  # the reader of a pipe has closed it
    except Exception as error:
        _say(describe(error))
        if processes.size > 1 and not isinstance(error, EXPECTED):
            print(f"{PROGRAM}: process {processes.rank}: {describe(error)}", file=sys.__stderr__, flush=True)
            processes.Abort(FAILED)  # otherwise the other processes might wait forever
        return FAILED
    return 0


def describe(error: Exception) -> str:
    """Say in one line what is wrong, where and what to do."""
    if isinstance(error, click.UsageError):
        command = error.ctx.command_path if error.ctx else PROGRAM
        return f"{error.format_message()} Try '{command} --help'."
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, InputError | MovementError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'a file'}: {error.strerror or error}; check the file, its folder and the free space"
    if _is_of_memory(error):
        return "out of memory; use fewer control points (fit --n-control, or a wider --spacing), or a smaller grid"
    return f"unexpected {type(error).__name__}: {error}; please report it with what --verbose prints before this line"


def _is_of_memory(error: BaseException | None) -> bool:
    """Whether memory ran out, also if reporting it failed in turn, as OpenMDAO does for NumPy's errors."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _say(message: str) -> None:
    """Print one line on standard error, whatever characters the message contains."""
    print(f"{PROGRAM}: {' '.join(message.split())}", file=sys.stderr)
