"""A case recorder that leaves out long arrays, continues the cases of an earlier run, and survives a full disk."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver
from openmdao.solvers.solver import Solver

from ...base.numerics.processes import ONE, together
from ...errors import InputError
from ...grids.io.disk import deferred_interrupts
from .drivers.case_file import take_over
from .drivers.short_records import LONGEST, sources_of

__all__ = ["CaseRecorder"]


class CaseRecorder(om.SqliteRecorder):
    """OpenMDAO's SQLite case recorder, without long arrays.

    A driver's own records hold design variables, objective and constraints, which are short. The records of a problem,
    a model or a solver, and of a driver set to include ``"*"``, hold every variable as text, and so the grid and the
    flow states over and over. `NLoptDriver` and `ScipyDriver` leave long arrays out of their own records and their
    problem's, whichever recorder writes them. This recorder does so wherever it is attached: it leaves out any array of
    more than ``longest`` values, unless the array is listed in ``keep`` or is a design variable or a response.

    If a case cannot be written, for example because the disk is full, a warning is issued and the run continues.

    Parameters
    ----------
    filepath : path-like
        File to write, in OpenMDAO's output folder unless the path is absolute.
    longest : int
        Largest number of values that an array may have to be recorded.
    keep : sequence of str
        Names, or name patterns, of long variables to record nevertheless, such as ``"surface"``: the part of the
        absolute name after the last dot, or the whole name.
    earlier : path-like, optional
        Case file of an earlier run of the same problem, whose driver cases come first: see `load_best`.
    **options : dict
        Options of `openmdao.api.SqliteRecorder`.

    Attributes
    ----------
    left_out : set of str
        Names of the variables left out so far.

    Raises
    ------
    InputError
        When the run begins, if the file cannot be created, or the cases of the earlier file cannot be copied.

    Examples
    --------
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("copy", om.ExecComp("y = 2 * x", shape=1000), promotes=["*"])
    >>> recorder = CaseRecorder("cases.sql", longest=999)
    >>> problem.model.add_recorder(recorder)
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> "copy.y" in recorder.left_out
    True
    """

    _iteration_coordinate: str

    def __init__(
        self,
        filepath: str | os.PathLike,
        longest: int = LONGEST,
        keep: Sequence[str] = (),
        earlier: str | os.PathLike | None = None,
        **options: Any,
    ):
        super().__init__(filepath, **options)
        self.longest, self.keep = longest, (keep,) if isinstance(keep, str) else tuple(keep)
        self.left_out: set[str] = set()
        self._earlier, self._is_failing, self._is_alone = earlier, False, True
        self._n_cases = self._n_iterations = 0  # of the earlier file

    def startup(self, recording_requester: Any, comm: Any = None) -> None:
        """Begin a file, or append to a copy of the earlier one; called by OpenMDAO."""
        is_new, self._is_alone = not self._database_initialized, comm is None or comm.size == 1
        self._begin(super().startup, recording_requester, comm)
        if is_new and self._earlier is not None:
            with together(comm or ONE):
                if self.connection:
                    self._n_cases, self._n_iterations = take_over(self.connection, self._earlier)
        self._counter = self._n_cases

    def _initialize_database(self, comm: Any) -> None:
        """Create the file, unless the earlier file is at that path; called by OpenMDAO, which removes what is there."""
        if self._earlier is not None and os.path.realpath(self._earlier) == os.path.realpath(self._filepath):
            raise InputError(f"{self._filepath}: is the file of the earlier run; record into another one")
        super()._initialize_database(comm)

    def record_viewer_data(self, model_viewer_data: dict[str, Any], key: str = "Driver") -> None:
        """Record the diagram of the model."""
        self._begin(super().record_viewer_data, model_viewer_data, key)

    def record_metadata_system(self, system: om.System, run_number: int | None = None) -> None:
        """Record the options of a system."""
        self._begin(super().record_metadata_system, system, run_number)

    def record_metadata_solver(self, solver: Solver, run_number: int | None = None) -> None:
        """Record the options of a solver."""
        self._begin(super().record_metadata_solver, solver, run_number)

    def record_iteration_driver(self, driver: Driver, data: dict, metadata: dict[str, Any]) -> None:
        """Record an iteration of a driver: its design variables and responses, and other short arrays."""
        self._number_on()
        self._write(super().record_iteration_driver, driver, self._short(data, sources_of(driver)), metadata)

    def record_derivatives_driver(self, recording_requester: Driver, data: dict, metadata: dict[str, Any]) -> None:
        """Record the derivatives of a driver."""
        self._number_on()
        self._write(super().record_derivatives_driver, recording_requester, data, metadata)

    def record_iteration_problem(self, problem: om.Problem, data: dict, metadata: dict[str, Any]) -> None:
        """Record a case of a problem: its design variables and responses, and other short arrays."""
        self._write(super().record_iteration_problem, problem, self._short(data, sources_of(problem.driver)), metadata)

    def record_iteration_system(self, system: om.System, data: dict, metadata: dict[str, Any]) -> None:
        """Record the short arrays of a run of a system."""
        self._write(super().record_iteration_system, system, self._short(data), metadata)

    def record_iteration_solver(self, solver: Solver, data: dict, metadata: dict[str, Any]) -> None:
        """Record the short arrays of an iteration of a solver."""
        self._write(super().record_iteration_solver, solver, self._short(data), metadata)

    def _number_on(self) -> None:
        """Continue the earlier file's numbering of the driver's iterations."""
        head, _, number = self._iteration_coordinate.rpartition("|")
        self._iteration_coordinate = f"{head}|{int(number) + self._n_iterations}"

    def _begin(self, record: Callable, *what: Any) -> None:
        """Write the head of a file, without which it cannot be read."""
        try:
            record(*what)
        except sqlite3.Error as error:
            if not self._is_alone:  # the other processes wait for this one: the error ends them
                raise
            raise InputError(f"{self._filepath}: cannot be written ({error}); choose another place") from error

    def _write(self, record: Callable, *case: Any) -> None:
        """Write a case; issue a warning for the first of a series that cannot be written."""
        try:
            # OpenMDAO counts a case before it writes it, so that half of one makes the file unreadable
            with deferred_interrupts():
                record(*case)
            self._is_failing = False
        except sqlite3.Error as error:
            if not self._is_failing:
                om.issue_warning(
                    f"{self._filepath}: cases cannot be recorded ({error}); the run continues, and tries again",
                    category=om.CaseRecorderWarning,
                )
            self._is_failing = True

    def _short(self, data: dict, wanted: frozenset[str] = frozenset()) -> dict:
        """The part of a case's inputs, outputs and residuals that is recorded."""
        kinds = {kind: data[kind] for kind in ("input", "output", "residual") if data.get(kind)}
        short = {kind: {k: v for k, v in of.items() if self._is_kept(k, v, wanted)} for kind, of in kinds.items()}
        self.left_out |= {name for kind, of in kinds.items() for name in of.keys() - short[kind].keys()}
        return {**data, **short}

    def _is_kept(self, name: str, value: Any, wanted: frozenset[str]) -> bool:
        names = name, name.rpartition(".")[2]
        is_asked = any(fnmatchcase(each, pattern) for pattern in self.keep for each in names)
        return np.size(value) <= self.longest or name in wanted or is_asked
