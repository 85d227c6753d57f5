"""The folder of a case: one run at a time is in it, and the next one starts from the last solution.

``solution`` in it has the fields of the last run that ended well; a run that fails leaves them, its own fields and its
log where they are.
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
"""File there that says what the solution is of."""

DEALT_OUT = """FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }
numberOfSubdomains %d; method simple; simpleCoeffs { n (%d %d %d); delta 0.001; }
"""
"""How cells are dealt out to processes: in slices of as many cells each. Debian's package has no method but these."""


class CaseFolder:
    """A folder with a case, which is made if need be."""

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path).absolute()
        self._lock: int | None = None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out while the block runs, and as long as a program that it began goes on."""
        with locked_case(self.path) as self._lock:
            try:
                yield
            finally:
                self._lock = None

    def solve(
        self,
        program: str,
        slices: tuple[int, int, int] = (1, 1, 1),  # that cells are cut into along x, y and z, one for each process
        time_limit: float | None = None,  # s
    ) -> str:  # its log
        """Run a solver from time 0, with the folder locked until it ends: its last time is in the folder then."""
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
        """Folders of the times that were written, but for 0, in their order."""
        found = [(_time_of(path), path) for path in self.path.iterdir() if path.is_dir()]
        return [path for time, path in sorted((time, path) for time, path in found if time)]

    @property
    def last(self) -> Path:
        """Folder of the last time."""
        if not self.times:
            raise SolverError(f"{self.path}: no fields were written; see to the logs there")
        return self.times[-1]

    def remove_times(self, but: Iterable[Path] = ()) -> None:
        """Remove the times, and what was written beside them, but for some."""
        kept = set(but)
        for path in self.times:
            if path not in kept:
                shutil.rmtree(path)

    def keep_solution(self, made_for: str) -> None:
        """Take the last time for the solution to start from, which is of what ``made_for`` says."""
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
        """Put the values in cells of the last solution into the fields of time 0; False where there is none to take.

        Boundary conditions stay those of time 0. Fluxes are made anew, since the mesh may have moved.
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
    """Time that a folder is of; 0 for those that are of none."""
    try:
        return float(path.name)
    except ValueError:
        return 0.0
