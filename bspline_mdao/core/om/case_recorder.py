"""A recorder of cases that leaves out what is long, goes on behind other cases, and outlasts a full disk."""

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
    """OpenMDAO's recorder of cases in an SQLite file, without long arrays.

    A driver's own records hold design variables, objective and constraints, which are short. Those of a problem, a
    model or a solver, and of a driver that is told to include ``"*"``, hold every variable as text, and with them the
    grid and the states of a flow, over and over. `NLoptDriver` and `ScipyDriver` leave these out of their records and
    of those of their problem, whichever recorder writes them. This recorder, attached to whatever, leaves out what has
    more values than ``longest``, unless it is asked for or is a design variable or a response.

    A case that cannot be written, since the disk is full for example, is a warning and not the end of the run.

    Parameters
    ----------
    filepath : path-like
        File to write, in the folder of OpenMDAO's outputs unless it is absolute.
    longest : int
        Number of values up to which an array is recorded.
    keep : sequence of str
        Names, or patterns of names, of long variables that are recorded all the same, such as ``"surface"``: the part
        of the absolute name behind the last dot, or all of it.
    earlier : path-like, optional
        Case file of another run of the same problem, whose cases of the driver come first: see `load_best`.
    **options : dict
        Those of `openmdao.api.SqliteRecorder`.

    Attributes
    ----------
    left_out : set of str
        What was left out so far, by names.

    Raises
    ------
    InputError
        When the run begins, if the file cannot be made, or the cases of the earlier one cannot be taken over.

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
        """Begin a file, or go on behind the cases of the earlier one; called by OpenMDAO."""
        is_new, self._is_alone = not self._database_initialized, comm is None or comm.size == 1
        self._begin(super().startup, recording_requester, comm)
        if is_new and self._earlier is not None:
            with together(comm or ONE):
                if self.connection:
                    self._n_cases, self._n_iterations = take_over(self.connection, self._earlier)
        self._counter = self._n_cases

    def _initialize_database(self, comm: Any) -> None:
        """Make the file, in whose place the earlier one is not; called by OpenMDAO, which removes what is there."""
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
        """Record an iteration of a driver: its design variables and responses, and what else is short."""
        self._number_on()
        self._write(super().record_iteration_driver, driver, self._short(data, sources_of(driver)), metadata)

    def record_derivatives_driver(self, recording_requester: Driver, data: dict, metadata: dict[str, Any]) -> None:
        """Record the derivatives of a driver."""
        self._number_on()
        self._write(super().record_derivatives_driver, recording_requester, data, metadata)

    def record_iteration_problem(self, problem: om.Problem, data: dict, metadata: dict[str, Any]) -> None:
        """Record a case of a problem: its design variables and responses, and what else is short."""
        self._write(super().record_iteration_problem, problem, self._short(data, sources_of(problem.driver)), metadata)

    def record_iteration_system(self, system: om.System, data: dict, metadata: dict[str, Any]) -> None:
        """Record a run of a system, as far as it is short."""
        self._write(super().record_iteration_system, system, self._short(data), metadata)

    def record_iteration_solver(self, solver: Solver, data: dict, metadata: dict[str, Any]) -> None:
        """Record an iteration of a solver, as far as it is short."""
        self._write(super().record_iteration_solver, solver, self._short(data), metadata)

    def _number_on(self) -> None:
        """Number an iteration of the driver behind those of the earlier file."""
        head, _, number = self._iteration_coordinate.rpartition("|")
        self._iteration_coordinate = f"{head}|{int(number) + self._n_iterations}"

    def _begin(self, record: Callable, *what: Any) -> None:
        """Write what a file begins with, without which nobody can read it."""
        try:
            record(*what)
        except sqlite3.Error as error:
            if not self._is_alone:  # the other processes wait for this one: the error ends them
                raise
            raise InputError(f"{self._filepath}: cannot be written ({error}); choose another place") from error

    def _write(self, record: Callable, *case: Any) -> None:
        """Write a case; the first of some that cannot be written is a warning."""
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
        """What is recorded of the inputs, outputs and residuals of a case."""
        kinds = {kind: data[kind] for kind in ("input", "output", "residual") if data.get(kind)}
        short = {kind: {k: v for k, v in of.items() if self._is_kept(k, v, wanted)} for kind, of in kinds.items()}
        self.left_out |= {name for kind, of in kinds.items() for name in of.keys() - short[kind].keys()}
        return {**data, **short}

    def _is_kept(self, name: str, value: Any, wanted: frozenset[str]) -> bool:
        names = name, name.rpartition(".")[2]
        is_asked = any(fnmatchcase(each, pattern) for pattern in self.keep for each in names)
        return np.size(value) <= self.longest or name in wanted or is_asked
