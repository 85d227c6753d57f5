"""External solvers, run in a case folder; any failure is one `SolverError` that says what to do.

The output of a program goes to a log in the case while it runs, so it can be followed there.
"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError, SolverError
from ..grids.io.locked_folder import take

__all__ = ["disk_full", "is_there", "locked_case", "run_solver"]

LOCK = ".bspline_mdao-lock"
"""File that is locked while a run uses the folder."""

N_LINES = 12
"""Lines of the log at the end of an error: OpenFOAM's errors take eight to ten, SU2's six to twelve."""

GRACE = 5.0
"""Seconds that a program has to end before it is killed."""

FULL = 2**20
"""Free bytes below which a disk counts as full: no field of a useful mesh fits in."""


def is_there(program: str) -> bool:
    """Whether a program is on the PATH."""
    return shutil.which(program) is not None


@contextmanager
def locked_case(path: Path) -> Iterator[int]:
    """Create a folder if needed, and keep other runs out during the block; yields the open lock.

    A folder with files but no lock belongs to someone else, and a run would overwrite fields and meshes in it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        foreign = None if (path / LOCK).exists() else next(path.iterdir(), None)
        if foreign is not None:
            raise InputError(f"{path}: has files of other programs, such as {foreign.name}; name a new or empty folder")
        lock = os.open(path / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another folder") from error
    try:
        if take(lock) is False:
            raise InputError(f"{path}: another run is at work in it; wait for its end, or name another folder")
        yield lock
    finally:
        os.close(lock)


def run_solver(
    command: Sequence[str],  # the program and its arguments
    case: Path,  # its working folder
    log: Path,  # file for its output
    install: str,  # what to do if it is missing
    reason: Callable[[str], str | None],  # why it stopped, from its output; None: unclear
    *,
    environment: Mapping[str, str] | None = None,  # variables in addition to this process's
    n_processes: int = 1,  # number of processes, by mpirun
    time_limit: float | None = None,  # s
    inherited: Sequence[int] = (),  # open files that it keeps open until it ends, such as the lock of the case
) -> str:  # its output
    """Run a program on a case."""
    program = command[0]
    if n_processes > 1:
        command = ["mpirun", "-n", str(n_processes), *command]
    missing = next((each for each in dict.fromkeys((command[0], program)) if not is_there(each)), None)
    if missing is not None:
        raise SolverError(f"{missing} is not on the PATH; {install}")
    try:
        with open(log, "wb") as file:
            running = subprocess.Popen(
                command,
                cwd=case,
                # OpenFOAM warns, line after line, where PWD is another folder
                env={**os.environ, "PWD": str(case), **(environment or {})},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # with processes of its own, which end with it
                pass_fds=tuple(inherited),
            )
        status = _status_of(running, time_limit)
        text = log.read_text(errors="replace")
    except OSError as error:
        raise disk_full(program, case, error) from error
    if status == 0:
        return text
    raise SolverError(f"{program} in {case}: {_reason(status, text, case, time_limit, reason)}{end_of(text, log)}")


def disk_full(program: str, case: Path, error: OSError) -> SolverError:
    """Return the error of a file of a case that cannot be written or read."""
    what = "free some space" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "check the folder"
    return SolverError(f"{program} in {case}: {error.strerror or error} ({error.filename or case}); {what}")


def end_of(text: str, log: Path) -> str:
    """The last lines of a log, with its path."""
    lines = [line for line in text.splitlines() if line.strip()][-N_LINES:]
    return f"\nThe end of {log}:\n" + "\n".join(f"    {line}" for line in lines) if lines else ""


def _status_of(running: subprocess.Popen, time_limit: float | None) -> int | None:
    """Wait for a program: its status, None if it was stopped at its limit. It also ends with the waiting process."""
    try:
        return running.wait(time_limit)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if running.poll() is None:
            _stop(running)


def _stop(running: subprocess.Popen) -> None:
    """End a program and its child processes."""
    with suppress(ProcessLookupError):
        os.killpg(running.pid, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        running.wait(GRACE)
    with suppress(ProcessLookupError):  # children may continue
        os.killpg(running.pid, signal.SIGKILL)
    running.wait()


def _reason(
    status: int | None, text: str, case: Path, time_limit: float | None, reason: Callable[[str], str | None]
) -> str:
    """Say why a program stopped, and what to do."""
    if status is None:
        return f"stopped at its time limit of {time_limit:g} s; give it more time, fewer iterations or a coarser mesh"
    if "No space left on device" in text or shutil.disk_usage(case).free < FULL:
        return "the disk is full; free some space"
    said = reason(text)
    if said is not None:
        return said
    if status in (-signal.SIGFPE, 128 + signal.SIGFPE):
        return "the flow diverged; take a smaller step, or check the mesh and the relaxation"
    if status < 0:
        name = signal.Signals(-status).name
        return f"was ended by {name}, by a user or for lack of memory; run it again, perhaps with more memory"
    return f"ended with status {status}; check the case or the mesh"
