"""The command ``warm-up``: it runs usual commands in several processes, so that their kernels are compiled."""

from __future__ import annotations

import hashlib
import json as json_format
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ...base.kernel_cache import PACKAGE, kernel_folder
from ...base.numerics.progress import COMPILING, Progress, is_terminal, progress_bar
from ...base.shared_compilation import HAS_LOCKS
from ...base.text import counted
from ...errors import InputError
from .output import check_outputs, print_lines, written_json
from .warm_up_chains import CHAINS, chains
from .words import PROGRAM


@dataclass(frozen=True)
class WarmUp:
    """The kernels that usual commands need, and how many of them were compiled."""

    needed: frozenset[tuple[str, str]]  # index file and signature of each specialisation
    n_compiled: int  # specialisations that were missing
    n_processes: int
    seconds: float

    @property
    def n_kernels(self) -> int:
        """Number of functions that are compiled, each for one or several signatures."""
        return len({index for index, _ in self.needed})


def warm_up(processes: int | None, json: Path | None) -> None:
    """Compile the kernels that usual commands need, and report what was done."""
    check_outputs([json])
    folder, key = Path(kernel_folder()), _key()
    stamp = folder / f"warm-up-{key}.json"
    done = _read(stamp)
    if done is None:
        with progress_bar("kernels") as progress:
            done = compile_kernels(chains(), processes, progress)
        _write(stamp, done)
    numbers = {
        "folder": str(folder),
        "n_kernels": done.n_kernels,
        "n_specialisations": len(done.needed),
        "n_compiled": done.n_compiled,
        "processes": done.n_processes,
        "seconds": done.seconds,
        "commands": {name: [" ".join(command) for command in CHAINS[name]] for name in chains()},
    }
    with written_json(json, numbers):
        pass
    kept = f"{counted(len(done.needed), 'specialisation')} of {counted(done.n_kernels, 'kernel')}"
    if not done.n_processes:
        print_lines([f"nothing to compile: {kept} that usual commands need are in {folder}"])
        return
    how = f"{counted(done.n_processes, 'process', 'processes')}, {done.seconds:.0f} s"
    if not done.n_compiled:
        print_lines([f"all were compiled before: {kept} that usual commands need are in {folder}", f"checked in {how}"])
        return
    print_lines(
        [
            f"compiled {done.n_compiled:,} kernels for one signature each, in {how}",
            f"usual commands need {kept}, which are in {folder}",
        ]
    )


def compile_kernels(
    names: Sequence[str],  # chains of commands, see `CHAINS`
    processes: int | None,  # how many run at a time; by default one per core
    progress: Progress,
) -> WarmUp:
    """Run chains of commands in processes that share their compiled kernels."""
    began, wanted = time.monotonic(), processes or _n_cores()
    n_processes = min(wanted, len(names)) if HAS_LOCKS else 1
    n_commands, n_ran, n_compiled = sum(len(CHAINS[name]) for name in names), 0, 0
    needed: set[tuple[str, str]] = set()
    waiting: list[str] = list(names)
    running: dict[str, subprocess.Popen] = {}
    lines: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()  # name of the chain and a line of its process
    with tempfile.TemporaryDirectory() as scratch:
        locks = Path(scratch, "locks")
        locks.mkdir()
        try:
            while waiting or running:
                while waiting and len(running) < n_processes:
                    name = waiting.pop(0)
                    running[name] = _start(name, Path(scratch, name), locks, lines)
                name, line = lines.get()
                word, _, rest = line.strip().partition(" ")
                if not line:
                    _end(running.pop(name), name, Path(scratch, name))
                elif word == "needs":
                    needed |= {(index, signature) for index, signature in json_format.loads(rest)}
                else:
                    if word == "compiles" and not n_compiled and not is_terminal():
                        print(f"{PROGRAM}: {COMPILING}", file=sys.stderr, flush=True)
                    n_ran, n_compiled = n_ran + (word == "ran"), n_compiled + (word == "compiles")
                    progress(n_ran / n_commands, f"{n_compiled} compiled, {COMPILING}" if n_compiled else "checking")
        finally:
            for worker in running.values():
                worker.kill()
                worker.wait()
    return WarmUp(frozenset(needed), n_compiled, n_processes, time.monotonic() - began)


def _start(name: str, folder: Path, locks: Path, lines: queue.SimpleQueue) -> subprocess.Popen:
    """Start the process of a chain in a folder of its own, and pass on its lines, the last of which is empty."""
    folder.mkdir()
    paths = os.pathsep.join(filter(None, (str(Path(PACKAGE).parent), os.environ.get("PYTHONPATH"))))
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    environment = {**os.environ, **one, "PYTHONPATH": paths, "OPENMDAO_REPORTS": "0", "OPENMDAO_WORKDIR": str(folder)}
    arguments = [sys.executable, "-m", "bspline_mdao.studio.cli.warm_up_worker", name, str(locks)]
    with open(folder / "stderr.txt", "w") as said:
        streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": said, "text": True}
        worker = subprocess.Popen(arguments, cwd=folder, env=environment, **streams)

    def read(pipe: IO[str]) -> None:
        with pipe:
            for line in pipe:
                lines.put((name, line))
        lines.put((name, ""))

    assert worker.stdout is not None
    threading.Thread(target=read, args=(worker.stdout,), daemon=True).start()
    return worker


def _end(worker: subprocess.Popen, name: str, folder: Path) -> None:
    """Wait for the process of a chain, and report its output if it failed."""
    if worker.wait():
        said = (folder / "stderr.txt").read_text(errors="replace").strip().splitlines()
        reason = said[-1] if said else f"status {worker.returncode}"
        raise InputError(f"the commands '{name}' of {PROGRAM} warm-up failed: {reason}; kernels are compiled when used")


def _n_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _key() -> str:
    """Hash of all that determines the compiled code: sources, versions, processor and environment."""
    import llvmlite.binding as llvm
    import numba

    host = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    chosen = [item for item in sorted(os.environ.items()) if item[0].startswith(("NUMBA_C", "BSPLINE_MDAO_PLAIN"))]
    state = hashlib.sha256(repr((sys.version, numba.__version__, host, chosen, chains())).encode())
    for source in sorted(Path(PACKAGE).rglob("*.py")):
        state.update(source.relative_to(PACKAGE).as_posix().encode())
        state.update(source.read_bytes())
    return state.hexdigest()[:20]


def _read(stamp: Path) -> WarmUp | None:
    """Result of an earlier call, if all of its files still exist."""
    try:
        needed = json_format.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not all(os.path.exists(index) for index in {index for index, _ in needed}):
        return None
    return WarmUp(frozenset((index, signature) for index, signature in needed), 0, 0, 0.0)


def _write(stamp: Path, done: WarmUp) -> None:
    """Record what was done; if nothing can be written, it is determined again next time."""
    try:
        for old in stamp.parent.glob("warm-up-*.json"):
            old.unlink()
        stamp.write_text(json_format.dumps(sorted(done.needed)), encoding="utf-8")
    except OSError:
        pass
