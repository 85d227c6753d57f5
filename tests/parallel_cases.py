"""Scripts on several processes of MPI: started, watched, ended and shown rank by rank.

A script of ``tests/parallel/cases`` runs on every rank as ``mpirun -n N python tests/parallel_rank.py ... script``.
It raises where a claim fails, which ends all ranks; what it prints comes back, one text for each rank.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
FOLDER = TESTS / "parallel"
GRACE = 10.0
"""Time (s) in which ranks that have come to their limit end, and mpirun after them."""


def launcher() -> list[str]:
    """Words that start ranks here, up to their number; the test is skipped where there are none.

    That of the environment of this Python comes first, as a wheel of Open MPI or MPICH brings one.
    """
    folders = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    program = shutil.which("mpirun", path=folders) or shutil.which("mpiexec", path=folders)
    packages = ("mpi4py", "petsc4py")  # OpenMDAO has its distributed vectors from PETSc
    missing = [*(name for name in packages if not find_spec(name)), *(() if program else ("mpirun",))]
    if missing:
        pytest.skip(f"needs MPI, and there is no {' and no '.join(missing)}")
    version = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=30).stdout
    if "Open MPI" in version or "OpenRTE" in version:
        as_root = ["--allow-run-as-root"] if os.geteuid() == 0 else []
        return [program, "--oversubscribe", "--bind-to", "none", *as_root, "-n"]
    return [program, "-n"]


def run_ranks(script: str, n: int, *arguments: str, timeout: float = 240.0, fails: bool = False) -> list[str]:
    """Run a script on ``n`` ranks and return what each of them printed.

    Parameters
    ----------
    script : str
        File, relative to ``tests/parallel``.
    n : int
        Number of ranks.
    *arguments : str
        What the script finds in ``sys.argv[1:]``.
    timeout : float
        Time limit (s): a rank that is still there then shows where it stands, and all end.
    fails : bool
        Whether the script is expected to end with an error.

    Returns
    -------
    list of str
        Standard output and error of every rank.
    """
    with tempfile.TemporaryDirectory(prefix="ranks_") as folder:
        rank = [sys.executable, str(TESTS / "parallel_rank.py"), folder, str(n), str(timeout)]
        returncode, words = watched([*launcher(), str(n), *rank, str(FOLDER / script), *arguments], timeout + GRACE)
        files = [Path(folder) / f"{rank}.txt" for rank in range(n)]
        printed = [file.read_text(errors="replace") if file.exists() else "(never started)\n" for file in files]
    shown = "\n".join(f"---- rank {rank} of {n}\n{text}" for rank, text in enumerate(printed))
    assert (returncode != 0) == fails, f"{script} ended with {returncode}\n{shown}\n---- mpirun\n{words}"
    return printed


def watched(command: list[str], timeout: float) -> tuple[int, str]:
    """Exit status and output of a command, which is killed with all its group when its time is over.

    Ranks that are in groups of their own end themselves, see ``parallel_rank.py``.
    """
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    idle = {"OMPI_MCA_mpi_yield_when_idle": "1"}  # more ranks than cores: who waits leaves the core to the others
    process = subprocess.Popen(
        command,
        env={**os.environ, **threads, **idle},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        words, _ = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        words = end(process) + f"\n(killed after {timeout:.0f} s)"
    except BaseException:
        end(process)
        raise
    return process.returncode, words


def end(process: subprocess.Popen) -> str:
    """End a launcher, which takes its ranks along, or kill its group where it does not; return its output."""
    process.terminate()
    try:
        return process.communicate(timeout=GRACE)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.communicate()[0]
