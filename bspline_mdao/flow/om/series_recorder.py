"""A recorder that writes what an optimisation makes of a grid, iteration by iteration, for ParaView."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import openmdao.api as om
from openmdao.core.driver import Driver
from openmdao.recorders.case_recorder import CaseRecorder
from openmdao.solvers.solver import Solver
from openmdao.utils.om_warnings import CaseRecorderWarning, issue_warning

from ...base.numerics.processes import on_first
from ...errors import InputError
from ...grids.io.disk import replaced_file
from .snapshots import Snapshot

__all__ = ["SeriesRecorder"]

WHICH = ("major", "all")
"""Choices of iterations."""


class SeriesRecorder(CaseRecorder):
    """Write grid, walls and control mesh at iterations of a driver, and a series of them that ParaView plays.

    Added to a driver by ``add_recorder``, it needs nothing else: it finds the fitted grid and the flow of the problem.
    ``wing.pvd`` is the series; the folder ``wing`` has the files of each iteration, by its number: the grid with the
    quality and the place of its cells and the flow, the walls, and the control mesh; for an unstructured mesh its
    cells, walls and lattice. The series is complete after every iteration, so it can be viewed during the run.

    A major iteration is one at which the driver requests derivatives, where an algorithm takes a new direction; with
    drivers without derivatives, it is each run of the model. To be notified, the recorder sets the recording option
    ``record_derivatives`` of the driver. The last run of the model is written in ``Problem.cleanup``, which OpenMDAO
    calls at the end of the program at the latest. With several processes, the first writes for all of them. A failure
    to write, for example on a full disk, is a warning and does not end the run.

    Parameters
    ----------
    path : path-like
        ``something.pvd``.
    which : {"major", "all"}
        Major iterations, or every run of the model.

    Raises
    ------
    InputError
        If the suffix is different, the folder does not exist, or ``which`` is unknown.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import NLoptDriver
    >>> from bspline_mdao.flow import SeriesRecorder
    >>> problem = om.Problem(driver=NLoptDriver(), reports=None)
    >>> problem.driver.add_recorder(SeriesRecorder("wing.pvd"))
    """

    def __init__(self, path: str | os.PathLike, which: str = "major"):
        super().__init__(record_viewer_data=False)
        self.path, self.which = Path(path), which
        if self.path.suffix.lower() != ".pvd":
            raise InputError(f"{path}: a series is a .pvd file; name it {self.path.with_suffix('.pvd').name}")
        if not self.path.absolute().parent.is_dir():
            raise InputError(f"{path}: there is no folder '{self.path.parent}'; make it first")
        if which not in WHICH:
            raise InputError(f"which={which!r}: no such iterations; give one of {', '.join(WHICH)}")
        self._lines: list[str] = []
        self._last: tuple[int, Snapshot] | None = None
        self._n_written = -1
        self._is_major_known = self._is_failing = False

    def startup(self, recording_requester: Any, comm: Any = None) -> None:
        """Start a new series; called by OpenMDAO."""
        super().startup(recording_requester, comm)
        self._lines, self._last, self._n_written = [], None, -1
        supports = getattr(recording_requester, "supports", {})
        options = recording_requester.recording_options
        self._is_major_known = self.which == "major" and "gradients" in supports and bool(supports["gradients"])
        if self._is_major_known and "record_derivatives" in options:
            options["record_derivatives"] = True

    def record_metadata_system(self, system: om.System, run_number: int | None = None) -> None:
        """Nothing: options of systems are not recorded."""

    def record_metadata_solver(self, solver: Solver, run_number: int | None = None) -> None:
        """Nothing: options of solvers are not recorded."""

    def record_iteration_driver(self, recording_requester: Driver, data: dict, metadata: dict[str, Any]) -> None:
        """Keep the current values of the model, and write them if every run is requested."""
        problem = recording_requester._problem()
        self._last = self._counter, Snapshot.of(problem, f"iteration {self._counter}")
        if not self._is_major_known:
            self._write(problem.comm)

    def record_derivatives_driver(self, recording_requester: Driver, data: dict, metadata: dict[str, Any]) -> None:
        """Write the last run of the model: the driver has requested its derivatives."""
        self._write(recording_requester._problem().comm)

    def shutdown(self) -> None:
        """Write the last run of the model, if not yet written; called by ``Problem.cleanup``."""
        if self._last is not None and self._record_on_proc is not False:
            self._try(self._write_files)

    def _write(self, comm: Any) -> None:
        """Write the last run of the model, once; with several processes the first one does."""
        if self._last is not None and self._last[0] != self._n_written:
            self._try(lambda: on_first(comm, self._write_files))
            self._n_written = self._last[0]

    def _try(self, write: Callable[[], None]) -> None:
        """Write something; the first failure is a warning."""
        try:
            write()
            self._is_failing = False
        except (InputError, OSError) as error:
            if not self._is_failing:
                issue_warning(
                    f"{self.path}: an iteration is missing ({error}); the run continues, and tries again",
                    category=CaseRecorderWarning,
                )
            self._is_failing = True

    def _write_files(self) -> None:
        """Write the files of an iteration, and the updated series."""
        number, state = self._last or (0, None)
        if state is None or number == self._n_written:
            return
        folder = self.path.with_suffix("")
        folder.mkdir(exist_ok=True)
        for part, (name, file) in enumerate(state.write(folder / f"{number:04d}{state.suffix}").items()):
            where = quoteattr(f"{folder.name}/{file.name}")
            self._lines.append(f'<DataSet timestep="{number}" part="{part}" name={quoteattr(name)} file={where}/>')
        self._n_written = number
        head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "<Collection>"]
        with replaced_file(self.path) as part_file:
            lines = [*head, *self._lines, "</Collection>", "</VTKFile>", ""]
            part_file.write_text("\n".join(lines), encoding="utf-8")
