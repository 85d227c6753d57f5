"""The folder of a case: one run at a time uses it, and the next one starts from the last solution.

Its subfolder ``solution`` has the fields of the last successful run; a run that fails leaves them, its own fields and
its log in place.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ...errors import SolverError
from ..solver_process import locked_case
from .case_fields import WrittenField
from .program import disk_full, run_program

__all__ = ["CaseFolder"]

SOLUTION = "solution"
"""Folder in the case for the fields of the last solution."""

MADE_FOR = "made_for"
"""File there that identifies the solution's case."""

DEALT_OUT = """FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }
numberOfSubdomains %d; method simple; simpleCoeffs { n (%d %d %d); delta 0.001; }
"""
"""Distribution of cells to processes: in slices of equal size. Debian's package has no other methods."""


class CaseFolder:
    """A folder with a case, which is created if needed."""

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path).absolute()
        self._lock: int | None = None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out during the block, and as long as a program that it started runs."""
        with locked_case(self.path) as self._lock:
            try:
                yield
            finally:
                self._lock = None

    def solve(
        self,
        program: str,
        slices: tuple[int, int, int] = (1, 1, 1),  # number of slices of cells along x, y and z, one per process
        time_limit: float | None = None,  # s
    ) -> str:  # its log
        """Run a solver from time 0, with the folder locked until it ends; its last time is then in the folder."""
        n_processes = math.prod(slices)
        if n_processes == 1:
            return self._run(program, time_limit=time_limit)
        try:
            (self.path / "system" / "decomposeParDict").write_text(DEALT_OUT % (n_processes, *slices))
        except OSError as error:
            raise disk_full("decomposePar", self.path, error) from error
        self._run("decomposePar", "-force")
        log = self._run(program, n_processes=n_processes, time_limit=time_limit)
        self._run("reconstructPar", "-latestTime")
        for path in self.path.glob("processor*"):
            shutil.rmtree(path, ignore_errors=True)
        return log

    def _run(self, program: str, *arguments: str, n_processes: int = 1, time_limit: float | None = None) -> str:
        """Run a program of OpenFOAM."""
        assert self._lock is not None
        limits = {"n_processes": n_processes, "time_limit": time_limit}
        return run_program(program, self.path, *arguments, inherited=[self._lock], **limits)  # type: ignore[arg-type]

    @property
    def times(self) -> list[Path]:
        """Folders of the written times, except 0, in order."""
        found = [(_time_of(path), path) for path in self.path.iterdir() if path.is_dir()]
        return [path for time, path in sorted((time, path) for time, path in found if time)]

    @property
    def last(self) -> Path:
        """Folder of the last time."""
        if not self.times:
            raise SolverError(f"{self.path}: no fields were written; check the logs there")
        return self.times[-1]

    def remove_times(self, but: Iterable[Path] = ()) -> None:
        """Remove the times, and other output, except for some."""
        kept = set(but)
        for path in self.times:
            if path not in kept:
                shutil.rmtree(path)

    def keep_solution(self, made_for: str) -> None:
        """Keep the last time as the solution to start from, labelled by ``made_for``."""
        new = self.path / f"{SOLUTION}.new"
        try:
            shutil.rmtree(new, ignore_errors=True)
            shutil.copytree(self.last, new, ignore=shutil.ignore_patterns("uniform"))
            (new / MADE_FOR).write_text(made_for)
            shutil.rmtree(self.path / SOLUTION, ignore_errors=True)
            os.replace(new, self.path / SOLUTION)
        except OSError as error:
            raise disk_full("solution", self.path, error) from error

    def start_from_solution(self, made_for: str) -> bool:
        """Put the last solution's cell values into the fields of time 0; False if there is no usable one.

        Boundary conditions stay as at time 0. Fluxes are computed again, since the mesh may have moved.
        """
        solution = self.path / SOLUTION
        if not (solution / MADE_FOR).is_file() or (solution / MADE_FOR).read_text() != made_for:
            return False
        fields = sorted((self.path / "0").iterdir())
        if not all((solution / field.name).is_file() for field in fields):
            return False
        for field in fields:
            values = WrittenField.read(solution, field.name).internal_entry
            field.write_text(WrittenField.read(field.parent, field.name).with_internal(values))
        return True


def _time_of(path: Path) -> float:
    """Time of a folder; 0 if it is not a time."""
    try:
        return float(path.name)
    except ValueError:
        return 0.0
