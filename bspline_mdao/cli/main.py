"""Entry point of the command line: runs a command and turns whatever stops it into an exit status and one line."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from io import TextIOWrapper

import click

from ..errors import InputError, MovementError
from ..numerics.processes import from_first, world
from .commands import PROGRAM, bspline_mdao

FAILED, INTERRUPTED = 2, 130


def main() -> None:
    """Run the command of ``sys.argv`` and exit.

    Raises
    ------
    SystemExit
        With 0 when all went well; with 2 after one line on standard error that says what, where and what to do; with
        130 when the user interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names that the terminal cannot show
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status.

    Of several processes the first one does what the command does, and all end with its status.

    Parameters
    ----------
    arguments : sequence of str
        The command and its arguments, without the name of the program.

    Returns
    -------
    int
        Exit status, see `main`.
    """
    try:
        processes = world()
    except ImportError as error:
        _say(str(error))
        return FAILED
    return from_first(processes, _run(arguments) if processes.rank == 0 else None)


def _run(arguments: Sequence[str]) -> int:
    """Run a command on this process and return its exit status."""
    try:
        bspline_mdao.main(args=list(arguments), prog_name=PROGRAM, standalone_mode=False)
        sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort):
        _say("interrupted; each output is complete or as it was before")
        return INTERRUPTED
    except BrokenPipeError:
        _close_stdout()  # the reader of a pipe had seen enough
    except Exception as error:
        if os.environ.get("BSPLINE_MDAO_TRACEBACK"):
            traceback.print_exc()
        _say(describe(error))
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
    if isinstance(error, MemoryError):
        return "out of memory; use fewer control points, or a smaller grid"
    return (
        f"unexpected {type(error).__name__}: {error}; please report it with what "
        f"BSPLINE_MDAO_TRACEBACK=1 prints before this line"
    )


def _say(message: str) -> None:
    """Print one line on standard error, whatever the message holds."""
    print(f"{PROGRAM}: {' '.join(message.split())}", file=sys.stderr)


def _close_stdout() -> None:
    """Let the interpreter flush into nowhere at exit instead of failing again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
