"""Programs of OpenFOAM, run in a case folder; whatever goes wrong is one `SolverError` that says what to do.

What a program prints goes to the file ``log.<program>`` of the case while it runs, so that it can be followed there.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ..solver_process import disk_full, is_there, run_solver

__all__ = ["disk_full", "is_there", "log_path", "run_program"]

HOME = "/usr/share/openfoam"
"""Where Debian puts what OpenFOAM looks for in ``WM_PROJECT_DIR``."""

INSTALL = "install OpenFOAM (Debian: apt-get install openfoam), or source the etc/bashrc of the one you have"


def log_path(program: str, case: Path) -> Path:
    """Where a program's log is."""
    return case / f"log.{program}"


def run_program(
    program: str,
    case: Path,
    *arguments: str,
    n_processes: int = 1,  # that it runs on, by mpirun, where the case is dealt out to as many
    time_limit: float | None = None,  # s
    inherited: Sequence[int] = (),  # open files that it keeps open until it ends, such as the lock of the case
) -> str:  # what it printed
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
    """Say what OpenFOAM itself gives as the reason."""
    message = re.search(r"FOAM FATAL (?:IO )?ERROR:?(.*?)(?:\n\s*From |\Z)", text, re.DOTALL)
    return f"{' '.join(message[1].split())}; see to the case or the mesh" if message else None
