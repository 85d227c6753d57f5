"""Programs of OpenFOAM, run in a case folder; whatever goes wrong is one `SolverError` that says what to do.

What a program prints goes to the file ``log.<program>`` of the case while it runs, so that it can be followed there.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ...errors import SolverError

__all__ = ["disk_full", "is_there", "log_path", "run_program"]

HOME = "/usr/share/openfoam"
"""Where Debian puts what OpenFOAM looks for in ``WM_PROJECT_DIR``."""

INSTALL = "install OpenFOAM (Debian: apt-get install openfoam), or source the etc/bashrc of the one you have"

N_LINES = 12
"""Lines of the log that an error ends with: OpenFOAM's own errors take eight to ten."""

GRACE = 5.0
"""Seconds that a program has to end by itself before it is killed."""

FULL = 2**20
"""Bytes that are free on a disk that counts as full: no field of a mesh worth a solution fits in."""


def is_there(program: str) -> bool:
    """Whether a program is on the PATH."""
    return shutil.which(program) is not None


def log_path(program: str, case: Path) -> Path:
    """Where a program's log is."""
    return case / f"log.{program}"


def run_program(
    program: str,
    case: Path,
    *arguments: str,
    time_limit: float | None = None,  # s
    inherited: Sequence[int] = (),  # open files that it keeps open until it ends, such as the lock of the case
) -> str:  # what it printed
    """Run a program on a case."""
    if not is_there(program):
        raise SolverError(f"{program} is not on the PATH; {INSTALL}")
    environment = {**os.environ, "WM_PROJECT_DIR": os.environ.get("WM_PROJECT_DIR", HOME)}
    place = log_path(program, case)
    try:
        with open(place, "wb") as log:
            running = subprocess.Popen(
                [program, "-case", str(case), *arguments],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # with processes of its own, which end with it
                pass_fds=tuple(inherited),
            )
        status = _status_of(running, time_limit)
        text = place.read_text(errors="replace")
    except OSError as error:
        raise disk_full(program, case, error) from error
    if status == 0:
        return text
    raise SolverError(f"{program} in {case}: {_reason(status, text, case, time_limit)}{_end_of(text, place)}")


def disk_full(program: str, case: Path, error: OSError) -> SolverError:
    """Return the error of a file of a case that cannot be written or read."""
    what = "free some space" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "see to the folder"
    return SolverError(f"{program} in {case}: {error.strerror or error} ({error.filename or case}); {what}")


def _status_of(running: subprocess.Popen, time_limit: float | None) -> int | None:
    """Wait for a program: its status, None where it was stopped at its limit. It ends with whoever waits, too."""
    try:
        return running.wait(time_limit)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if running.poll() is None:
            _stop(running)


def _stop(running: subprocess.Popen) -> None:
    """End a program and the processes that it began."""
    with suppress(ProcessLookupError):
        os.killpg(running.pid, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        running.wait(GRACE)
    with suppress(ProcessLookupError):  # what it began may go on
        os.killpg(running.pid, signal.SIGKILL)
    running.wait()


def _reason(status: int | None, text: str, case: Path, time_limit: float | None) -> str:
    """Say why a program stopped, and what to do."""
    if status is None:
        return f"stopped at its time limit of {time_limit:g} s; give it more time, fewer iterations or a coarser mesh"
    message = re.search(r"FOAM FATAL (?:IO )?ERROR:?(.*?)(?:\n\s*From |\Z)", text, re.DOTALL)
    if "No space left on device" in text or shutil.disk_usage(case).free < FULL:
        return "the disk is full; free some space"
    if message:
        return f"{' '.join(message[1].split())}; see to the case or the mesh"
    if status in (-signal.SIGFPE, 128 + signal.SIGFPE):
        return "the flow diverged; take a smaller step, or see to the mesh and the relaxation"
    if status < 0:
        name = signal.Signals(-status).name
        return f"was ended by {name}, by somebody or for want of memory; run it again, with more memory perhaps"
    return f"ended with status {status}; see to the case or the mesh"


def _end_of(text: str, place: Path) -> str:
    """The last lines of a log, with their place."""
    lines = [line for line in text.splitlines() if line.strip()][-N_LINES:]
    return f"\nThe end of {place}:\n" + "\n".join(f"    {line}" for line in lines) if lines else ""
