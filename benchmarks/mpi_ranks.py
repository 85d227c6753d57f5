"""Scripts that are run on some ranks of MPI, for benchmarks of several layers."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT = 3600
"""Time (s) after which ranks are ended."""


def start_ranks(n: int, words: list[str], script: str) -> list[dict]:
    """Run a script on some ranks of MPI, each with one thread, and return what they measured.

    It gets the name of the file for that behind ``--json``.

    Raises
    ------
    RuntimeError
        If there is no ``mpirun``, or a rank fails.
    """
    launcher = shutil.which("mpirun") or shutil.which("mpiexec")
    if launcher is None:
        raise RuntimeError("there is no mpirun; install an MPI, such as the packages openmpi-bin or mpich")
    is_open_mpi = "Open" in subprocess.run([launcher, "--version"], capture_output=True, text=True).stdout
    options = ["--oversubscribe", "--bind-to", "none"] if is_open_mpi else []
    options += ["--allow-run-as-root"] if is_open_mpi and os.geteuid() == 0 else []
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "ranks.json"
        command = [launcher, *options, "-n", str(n), sys.executable, script, *words, "--json", str(result)]
        idle = {"OMPI_MCA_mpi_yield_when_idle": "1"}  # a rank that waits leaves its core to others
        done = subprocess.run(command, env={**os.environ, **threads, **idle, "OPENMDAO_REPORTS": "0"}, timeout=LIMIT)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}")
        return json.loads(result.read_text())
