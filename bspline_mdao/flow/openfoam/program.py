"""Programs of OpenFOAM, run in a case folder; any failure is one `SolverError` that says what to do.

The output of a program goes to the file ``log.<program>`` of the case while it runs, so it can be followed there.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ..solver_process import disk_full, is_there, run_solver

__all__ = ["disk_full", "is_there", "log_path", "run_program"]

HOME = "/usr/share/openfoam"
"""Debian's place for what OpenFOAM expects in ``WM_PROJECT_DIR``."""

INSTALL = "install OpenFOAM (Debian: apt-get install openfoam), or source the etc/bashrc of the one you have"


def log_path(program: str, case: Path) -> Path:
    """Path of a program's log."""
    return case / f"log.{program}"


def run_program(
    program: str,
    case: Path,
    *arguments: str,
    n_processes: int = 1,  # number of processes, by mpirun, if the case is decomposed for as many
    time_limit: float | None = None,  # s
    inherited: Sequence[int] = (),  # open files that it keeps open until it ends, such as the lock of the case
) -> str:  # its output
    """Run a program on a case."""
    parallel = ["-parallel"] if n_processes > 1 else []
    return run_solver(
        [program, "-case", str(case), *arguments, *parallel],
        case,
        log_path(program, case),
        INSTALL,
        _reason,
        environment={"WM_PROJECT_DIR": os.environ.get("WM_PROJECT_DIR", HOME)},
        n_processes=n_processes,
        time_limit=time_limit,
        inherited=inherited,
    )


def _reason(text: str) -> str | None:
    """Return the reason that OpenFOAM itself gives."""
    message = re.search(r"FOAM FATAL (?:IO )?ERROR:?(.*?)(?:\n\s*From |\Z)", text, re.DOTALL)
    return f"{' '.join(message[1].split())}; check the case or the mesh" if message else None
