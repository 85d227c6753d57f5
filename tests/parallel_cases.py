"""Scripts on several processes of MPI: started, watched, ended and shown rank by rank.

A script of ``tests/parallel/cases`` runs on every rank of ``mpirun -n N python tests/parallel_rank.py``, which stay and
run the next one, since to start and import takes longer than most scripts. It raises where a claim fails, which ends
all ranks; what it prints comes back, one text for each rank.
"""

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
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


class Ranks:
    """Processes of one mpirun that follow orders for scripts, see ``parallel_rank.py``.

    Parameters
    ----------
    n : int
        Number of ranks.
    """

    def __init__(self, n: int):
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
        idle = {"OMPI_MCA_mpi_yield_when_idle": "1"}  # more ranks than cores: who waits leaves the core to the others
        command = [*launcher(), str(n), sys.executable, str(TESTS / "parallel_rank.py")]
        self.n, self.n_orders = n, 0
        self.folder = tempfile.TemporaryDirectory(prefix="ranks_")
        folder = Path(self.folder.name)
        pipes = [folder / "answers", *(folder / f"orders{rank}" for rank in range(n))]
        for pipe in pipes:
            os.mkfifo(pipe)
        # open for both ways, which waits for no rank and ends with none
        self.answers, *self.orders = (os.open(pipe, os.O_RDWR) for pipe in pipes)
        self.words = (folder / "words.txt").open("w+")
        self.process = subprocess.Popen(
            [*command, str(folder), str(n)],
            env={**os.environ, **threads, **idle},
            stdin=subprocess.DEVNULL,
            stdout=self.words,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def run(self, script: str, arguments: tuple[str, ...], timeout: float) -> tuple[bool, list[str]]:
        """Whether all ranks came to the end of a script, and what each printed."""
        self.n_orders += 1
        files = [Path(self.folder.name) / f"{self.n_orders}_{rank}.txt" for rank in range(self.n)]
        for pipe, file in zip(self.orders, files):
            os.write(pipe, f"{json.dumps([[str(FOLDER / script), *arguments], timeout, str(file)])}\n".encode())
        done = False
        try:
            done = self._answered(timeout + GRACE)
        finally:
            if not done:
                end(self.process)
        return done, [file.read_text(errors="replace") if file.exists() else "(never started)\n" for file in files]

    def _answered(self, timeout: float) -> bool:
        """Whether each rank answers within some time (s), while none ends."""
        n, latest = 0, time.monotonic() + timeout
        while n < self.n:
            if select.select([self.answers], [], [], 0.1)[0]:
                n += os.read(self.answers, 4096).count(b"\n")
            elif self.process.poll() is not None or time.monotonic() > latest:
                return False
        return True

    def end(self) -> str:
        """Give no more orders, so that all ranks end, and return what mpirun said of them."""
        for pipe in (self.answers, *self.orders):
            os.close(pipe)
        try:
            self.process.wait(timeout=GRACE)
        except subprocess.TimeoutExpired:
            end(self.process)
        self.words.seek(0)
        words = self.words.read()
        self.words.close()
        self.folder.cleanup()
        return words


STARTED: dict[int, Ranks] = {}
"""Ranks that wait for the next script, by their number, the latest last; the end of the tests ends them."""

N_KEPT = 3
"""Numbers of ranks that are kept, as each rank holds half a gigabyte: most scripts run on one, two and three."""


def run_ranks(script: str, n: int, *arguments: str, timeout: float = 240.0, afresh: bool = False) -> list[str]:
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
    afresh : bool
        Whether ranks are started for this script alone, with the environment as it is now.

    Returns
    -------
    list of str
        Standard output and error of every rank.
    """
    ranks = None if afresh else STARTED.pop(n, None)
    ranks = ranks or Ranks(n)
    done = False
    try:
        done, printed = ranks.run(script, arguments, timeout)
    finally:
        if done and not afresh:
            STARTED[n] = ranks
            if len(STARTED) > N_KEPT:
                STARTED.pop(next(iter(STARTED))).end()
        else:
            words = ranks.end()
    if not done:
        shown = "\n".join(f"---- rank {rank} of {n}\n{text}" for rank, text in enumerate(printed))
        raise AssertionError(f"{script} ended with {ranks.process.returncode}\n{shown}\n---- mpirun\n{words}")
    return printed


def end(process: subprocess.Popen) -> None:
    """End a launcher, which takes its ranks along, or kill its group where it does not."""
    process.terminate()
    try:
        process.wait(timeout=GRACE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
