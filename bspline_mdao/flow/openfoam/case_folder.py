"""The folder of a case: one run at a time is in it, and the next one starts from the last solution.

``solution`` in it has the fields of the last run that ended well; a run that fails leaves them, its own fields and its
log where they are.
"""

from __future__ import annotations

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

    def run(self, program: str, *arguments: str, time_limit: float | None = None) -> str:  # its log
        """Run a program of OpenFOAM, with the folder locked until it ends."""
        assert self._lock is not None
        return run_program(program, self.path, *arguments, time_limit=time_limit, inherited=[self._lock])

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
