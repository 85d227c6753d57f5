"""Designs of a plan, run, judged and written to one file, one after the other or by several processes.

A design is refused, with the reason, if a component raises `openmdao.api.AnalysisError`, or if a cell of its grid is
inverted which was valid on the baseline. No design depends on earlier ones, so a stopped run can be continued, and
several processes give the same results as one, to rounding.

If only this package's geometry comes before the movement, the control meshes of several designs move together, which is
faster than one after the other: runs up to the movement find where each surface goes. Then every design is run as a
whole, so only one grid is in memory at a time.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numba
import numpy as np
import openmdao.api as om
from openmdao.core.component import Component

from .... import __version__
from ....base.numerics.progress import Progress, no_progress, progress_bar
from ....base.numerics.threads import thread_count
from ....base.text import counted, reason_of
from ....errors import InputError
from ....grids.cells.cell_judge import CellJudge
from ....names import CONTROL_POINTS, GRID
from ...model.movable import Movable
from ...movement.moved_together import TOGETHER
from ..control_mesh_move import ControlMeshMove
from ..drivers.scaled_model import ScaledModel
from ..fit import Fit
from ..surface_control import SurfaceControl
from ..surface_evaluate import SurfaceEvaluate
from ..surface_measure import SurfaceMeasure
from .designs import NODES, PENDING, Column, Designs, Rows, make_designs, opened

__all__ = ["sample"]

STORED = (NODES, "control_points", "")

SAME = 1e-12
"""Tolerance for equal grids, as a fraction of the size of the control mesh."""

LIGHT = (om.IndepVarComp, om.ExecComp, Fit, SurfaceControl, SurfaceEvaluate, SurfaceMeasure)
"""Components that are cheap compared with a movement, and may run twice for a design; a fit caches its last grid."""

WAIT = 0.2
"""Seconds between checks on the progress of other processes."""


def sample(
    problem: om.Problem,
    model: Movable,
    plan: Any,
    file: str | os.PathLike,
    *,
    outputs: Sequence[str] = (),
    store: Literal["nodes", "control_points", ""] = "nodes",
    single: bool = False,
    restart: bool = False,
    processes: int = 1,
) -> Designs:
    """Run a problem at many designs, and write grids, quality and outputs of all of them to one file.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been set up, with bounded design variables and with ``control_points`` and ``grid`` promoted
        to the top, as `bspline_mdao.GridMovement` does. With ``GridMovement(quality=False, require_valid=False)`` only
        this function judges the cells, instead of doing it twice.
    model : FittedModel or MeshModel
        The model whose grid moves.
    plan : openmdao DOEGenerator
        The designs: `LatinHypercube`, `Sobol` or `Table`, or any OpenMDAO generator, which gets bounds in the units of
        the design variables.
    file : path-like
        File to make (``.h5``), see `Designs`.
    outputs : sequence of str
        Outputs of the problem to write in addition to objectives and constraints.
    store : {"nodes", "control_points", ""}
        What is stored of a grid: its nodes, 24 bytes each; the control points, from which `Designs.grid` regenerates
        the nodes; or nothing.
    single : bool
        Store them in single precision.
    restart : bool
        Continue an existing file of the same plan with its missing designs.
    processes : int
        Number of processes that share the designs and the threads.

    Returns
    -------
    Designs
        The designs that were made.

    Raises
    ------
    InputError
        If the problem lacks such variables or outputs, the file exists or is of another plan, the disk has no room, or
        the control points do not determine the grid.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.sampling import Sobol, sample
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> twist = Twist("twist", wing.axis, stations=2)
    >>> problem = om.Problem(wing.grid_movement([twist], quality=False, require_valid=False), reports=None)
    >>> problem.model.add_design_var("twist", lower=-5.0, upper=5.0, units="deg")
    >>> _ = problem.setup()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     designs = sample(problem, wing.model, Sobol(4), f"{folder}/designs.h5")
    ...     values, nodes = designs[2]
    >>> len(designs), values.shape, nodes.shape
    (4, (2,), (1500, 3))
    """
    if store not in STORED:
        raise InputError(f"sample: store='{store}'; give one of {', '.join(map(repr, STORED))}")
    if processes < 1:
        raise InputError(f"sample: {processes} processes; give at least 1")
    if problem.comm.size > 1:
        raise InputError("sample: runs on one process of MPI; give the number of others by 'processes'")
    problem.final_setup()
    run = _Run.of(problem, model, outputs, store)
    variables = run.scaled.design_variables()
    values = _planned(plan, variables, problem)
    about = {
        "package": f"bspline_mdao {__version__}",
        "plan": repr(plan),
        "model": model.checksum,
        "source": model.source,
        "stored": store,
        "variables": json.dumps({name: meta["units"] for name, meta in variables.items()}),
    }
    if restart and os.path.exists(file):
        _check_same(file, values, about)
    else:
        make_designs(file, variables, values, run.columns(single), about)
    _make_pending(run, values, file, processes)
    return Designs(file)


@dataclass(frozen=True)
class _Run:
    """A problem that is run at designs, and what is stored of each."""

    problem: om.Problem
    model: Movable
    scaled: ScaledModel
    judge: CellJudge
    outputs: tuple[str, ...]  # besides objectives and constraints
    store: str
    move: ControlMeshMove | None  # whose moves are made together

    @classmethod
    def of(cls, problem: om.Problem, model: Movable, outputs: Sequence[str], store: str) -> _Run:
        """Check the problem and run it at the start: if that fails, every design would."""
        driver = problem.driver
        for name in (CONTROL_POINTS, GRID, *outputs):
            try:
                problem.get_val(name)
            except KeyError:
                raise InputError(f"sample: the problem has no output '{name}' at its top; promote it") from None
        problem.run_model()
        judge = model.judge(None, problem.comm, rho=100.0, p=64, rho_height=1000.0)
        return cls(problem, model, ScaledModel(driver), judge, tuple(outputs), store, _together(problem.model))

    def columns(self, single: bool) -> list[Column]:
        """What is stored of a design."""
        units = self._units()
        return [
            Column(
                name,
                np.shape(value),
                np.float32 if single and name == self.store else np.asarray(value).dtype,
                "m" if name == self.store else units.get(name.partition("/")[2], ""),
            )
            for name, value in self.kept().items()
        ]

    def kept(self) -> dict[str, Any]:
        """What is stored of the problem's current design, by column."""
        nodes = self.problem.get_val(GRID).reshape(-1, 3)
        numbers = self.judge.summary(nodes)
        if numbers.pop("n_newly_inverted"):
            raise om.AnalysisError(self.judge.newly_inverted(nodes))
        found: dict[str, Any] = {f"quality/{name}": number for name, number in numbers.items()}
        found |= {f"outputs/{name}": np.ravel(value) for name, value in self._responses().items()}
        if self.store:
            found[self.store] = nodes if self.store == NODES else self.problem.get_val(CONTROL_POINTS).reshape(-1, 3)
        return found

    def make(self, rows: np.ndarray, values: Mapping[str, np.ndarray], written: Rows, progress: Progress) -> None:
        """Make designs, given by their positions in the plan."""
        is_checked = self.store != CONTROL_POINTS
        for number, row in enumerate(rows):
            if number % TOGETHER == 0:
                self._move_ahead(rows[number : number + TOGETHER], values)
            self.scaled.set_values({name: of[row] for name, of in values.items()})
            try:
                self.problem.run_model()
                kept = self.kept()
            except om.AnalysisError as error:
                written.refuse(row, reason_of(error))
            else:
                if not is_checked:
                    self._require_regenerated()
                    is_checked = True
                written.write(row, kept)
            progress((number + 1) / len(rows), "")

    def _move_ahead(self, rows: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        """Move the control meshes of designs together; what fails before its move fails again when it is run."""
        if self.move is None or len(rows) == 1:
            return
        with self.move.noting() as requests:
            for row in rows:
                self.scaled.set_values({name: of[row] for name, of in values.items()})
                with suppress(om.AnalysisError):
                    self.problem.run_model()
        self.move.move_ahead(requests)

    def _require_regenerated(self) -> None:
        """Refuse to store only control points if they do not determine the grid."""
        nodes = self.model.node_map.at(self.problem.get_val(CONTROL_POINTS).reshape(-1, 3)).nodes
        off = np.abs(nodes - self.problem.get_val(GRID).reshape(-1, 3)).max()
        if off > SAME * np.ptp(self.model.control_points):
            raise InputError(
                f"sample: control points alone give a grid that is {off:.2g} m off: nodes of walls are given, or slide "
                f"on surfaces; take store='nodes'"
            )

    def _responses(self) -> dict[str, np.ndarray]:
        """Objectives, constraints and other outputs."""
        driver = self.problem.driver
        found = {
            **driver.get_objective_values(driver_scaling=False),
            **driver.get_constraint_values(driver_scaling=False),
        }
        return found | {name: self.problem.get_val(name) for name in self.outputs if name not in found}

    def _units(self) -> dict[str, str]:
        """Units of these, empty if they have none."""
        model, driver = self.problem.model, self.problem.driver
        of_sources = model.get_io_metadata(metadata_keys=("units",), get_remote=True)
        asked = {name: meta.get("units") for metas in (driver._objs, driver._cons) for name, meta in metas.items()}
        sources = {name: meta["source"] for metas in (driver._objs, driver._cons) for name, meta in metas.items()}
        sources |= {name: model.get_source(name) for name in self.outputs}
        return {name: asked.get(name) or of_sources[source]["units"] or "" for name, source in sources.items()}


def _together(model: om.Group) -> ControlMeshMove | None:
    """The component that moves control meshes, if it can move several together and all before it may be run again."""
    components = list(model.system_iter(recurse=True, typ=Component))
    places = [n for n, component in enumerate(components) if isinstance(component, ControlMeshMove)]
    if len(places) != 1 or not all(isinstance(component, LIGHT) for component in components[: places[0]]):
        return None
    move = components[places[0]]
    return move if move.moves_together else None


def _planned(plan: Any, variables: Mapping[str, Mapping[str, Any]], problem: om.Problem) -> dict[str, np.ndarray]:
    """Values of all variables at all designs of a plan, each (n, size)."""
    start = {name: np.ravel(meta["value"]) for name, meta in variables.items()}
    cases = [{**start, **{name: np.ravel(value) for name, value in case}} for case in plan(variables, problem.model)]
    if not cases:
        raise InputError("sample: the plan has no design")
    for number, case in enumerate(cases, start=1):
        wrong = next((name for name in case if name not in start or case[name].shape != start[name].shape), None)
        if wrong is not None:
            raise InputError(f"sample: design {number} of the plan has no such values of '{wrong}' as the problem has")
    return {name: np.array([case[name] for case in cases]) for name in start}


def _check_same(file: str | os.PathLike, values: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """Refuse to continue a file of other designs."""
    with opened(file) as found:
        for name in ("model", "stored", "variables"):
            if found.attrs[name] != about[name]:
                raise InputError(f"{file}: is of another {name} than this run; name another file")
        there = found["variables"]
        if any(not np.array_equal(there[name][:], of) for name, of in values.items()):
            raise InputError(f"{file}: is of another plan than this run; name another file")


def _make_pending(run: _Run, values: Mapping[str, np.ndarray], file: str | os.PathLike, processes: int) -> None:
    """Make the pending designs with several forked processes."""
    written = Rows(file)
    pending = np.flatnonzero(np.asarray(written.states) == PENDING)
    processes = max(1, min(processes, len(pending)))
    with progress_bar(f"{counted(len(pending), 'design')}") as progress:
        if processes == 1:
            run.make(pending, values, written, progress)
            return
        if "fork" not in multiprocessing.get_all_start_methods():
            raise InputError("sample: this system cannot copy a process; take processes=1")
        context: Any = multiprocessing.get_context("fork")
        n_threads = max(1, thread_count(None) // processes)

        def work(part: int) -> None:
            numba.config.NUMBA_NUM_THREADS = n_threads
            run.make(pending[part::processes], values, written, no_progress)

        others = [context.Process(target=work, args=(part,), daemon=True) for part in range(processes)]
        try:
            for other in others:
                other.start()
            _wait(others, written, len(pending), progress)
        finally:
            for other in others:
                if other.pid:  # if this process was interrupted, some may not have begun
                    other.terminate()
    if any(other.exitcode for other in others):
        raise InputError(f"{file}: a process ended before its designs were made; restart continues with those")


def _wait(others: Sequence[Any], written: Rows, n_pending: int, progress: Progress) -> None:
    """Wait for processes and report their progress."""
    while any(other.is_alive() for other in others):
        for other in others:
            other.join(WAIT)
        left = int(np.count_nonzero(np.asarray(written.states) == PENDING))
        progress(1.0 - left / n_pending, "")
