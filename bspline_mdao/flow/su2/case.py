"""A case of SU2: its folder, with the mesh, configurations, logs and results of the last flow and of its adjoints."""

from __future__ import annotations

import hashlib
import logging
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.display import OneLine
from ...errors import SolverError
from ..solver_process import disk_full, end_of, locked_case, run_solver
from .config import Su2Config
from .mesh_text import Su2Mesh
from .tables import NodeTable, last_of_history

__all__ = ["Gradient", "Su2Case", "Su2Point", "Su2Solution"]

INSTALL = "install SU2 7 or 8 (https://su2code.github.io/download.html) and put its folder bin on the PATH"

INSTALL_ADJOINT = f"{INSTALL}; the adjoint is in a build with -Denable-autodiff=true"

SUFFIXES = {"FORCE": "cf", "MOMENT": "cm"}
"""Suffix of the files of an adjoint, by its objective; the axis follows."""

FLOW, ADJOINT, MESH, SOLUTION = "flow.cfg", "adjoint.cfg", "mesh.su2", "solution_flow.csv"
"""Files of the case: configurations, the mesh, and the start of the next flow."""

FLOWN, STARTED = ".flown", ".solution"
"""Files that identify the flow of the results, and the cells of the solution to start from."""

TABLES = {
    "MESH_FILENAME": MESH,
    "MESH_FORMAT": "SU2",
    "READ_BINARY_RESTART": "NO",
    "TABULAR_FORMAT": "CSV",
    "OUTPUT_PRECISION": 16,
    "HISTORY_WRT_FREQ_INNER": 1,
}
"""Settings of every run: input and output, with all digits."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Su2Point:
    """Conditions of a flow."""

    mach: float
    alpha: float  # deg

    @property
    def settings(self) -> dict[str, object]:
        """Settings of the conditions, exact to the last bit."""
        return {"MACH_NUMBER": repr(float(self.mach)), "AOA": repr(float(self.alpha))}


@dataclass(frozen=True, eq=False)
class Su2Solution(OneLine):
    """Results of a flow."""

    values: dict[str, float]  # last line of its history
    surface: NodeTable  # pressures on the walls


@dataclass(frozen=True, eq=False)
class Gradient(OneLine):
    """Derivatives of a force or moment of SU2."""

    nodes: np.ndarray  # (n_nodes, n_axes), by the nodes, in SU2's axes
    alpha: float  # by the angle of attack of the stream (1/deg)
    mach: float  # by the Mach number


@dataclass(frozen=True, eq=False)
class Su2Case(OneLine):
    """A case."""

    path: Path
    config: Su2Config
    mesh: Su2Mesh
    settings: Mapping[str, object]  # reference values and markers
    program: str = "SU2_CFD"
    adjoint_program: str = "SU2_CFD_AD"
    n_processes: int = 1
    time_limit: float | None = None  # of each run (s)
    needs_convergence: bool = True  # whether a flow or adjoint that ends at its last iteration counts as failed
    starts_warm: bool = True  # whether a flow starts from the last one

    def solve(self, nodes: np.ndarray, point: Su2Point) -> Su2Solution:
        """Solve the flow at nodes, shape (n_nodes, 3), in the grid's axes."""
        with locked_case(self.path) as lock:
            return self._solve(self.mesh.text(nodes), point, lock)

    def gradient(self, nodes: np.ndarray, point: Su2Point, objective: str) -> Gradient:
        """Solve the adjoint of a force or moment, and first the flow if the folder has another one."""
        mesh = self.mesh.text(nodes)
        with locked_case(self.path) as lock:
            flown = self.path / FLOWN
            if not flown.is_file() or flown.read_text() != self._stamp(mesh, point):
                self._solve(mesh, point, lock)
            settings = {
                **TABLES,
                **self.settings,
                **point.settings,
                "MATH_PROBLEM": "DISCRETE_ADJOINT",
                "OBJECTIVE_FUNCTION": objective,
                "OBJECTIVE_WEIGHT": "1.0",
                "SENS_REMOVE_SHARP": "NO",
                "RESTART_SOL": "NO",
                "SOLUTION_FILENAME": "restart_flow",
                "SOLUTION_ADJ_FILENAME": "solution_adj",
                "RESTART_ADJ_FILENAME": "restart_adj",
                "CONV_FIELD": "RMS_ADJ_DENSITY",
                "CONV_FILENAME": "history_adj",
                "HISTORY_OUTPUT": "( ITER, RMS_RES, SENSITIVITY )",
                "VOLUME_OUTPUT": "( COORDINATES, SOLUTION, SENSITIVITY )",
                "OUTPUT_FILES": "( RESTART_ASCII )",
            }
            kind, axis = objective.split("_")
            table = self.path / f"restart_adj_{SUFFIXES[kind]}{axis.lower()}.csv"
            self._run(self.adjoint_program, ADJOINT, settings, lock, (table, self.path / "history_adj.csv"))
            values = last_of_history(self.path / "history_adj.csv")
            n_nodes, n_axes = len(nodes), self.mesh.frame.n_axes
            by_nodes = NodeTable.read(table).vectors("Sensitivity", n_axes, n_nodes)
        missing = next((name for name in ("Sens_AoA", "Sens_Mach") if name not in values), None)
        if missing is not None:
            raise SolverError(f"{self.path / 'history_adj.csv'}: has no {missing}; use SU2 7 or 8")
        return Gradient(by_nodes, values["Sens_AoA"], values["Sens_Mach"])

    def _stamp(self, mesh: str, point: Su2Point) -> str:
        """Text that identifies a flow of a case."""
        return _digest(mesh, self.config.text, repr(self.settings), repr(point))

    def _solve(self, mesh: str, point: Su2Point, lock: int) -> Su2Solution:
        """Write the mesh, and solve the flow."""
        (self.path / FLOWN).unlink(missing_ok=True)
        solution = self.path / SOLUTION
        try:
            (self.path / MESH).write_text(mesh)
        except OSError as error:
            raise disk_full(self.program, self.path, error) from error
        started, cells = self.path / STARTED, _digest(self.mesh.head, self.mesh.tail, self.config.values["SOLVER"])
        is_warm = self.starts_warm and solution.is_file() and started.is_file() and started.read_text() == cells
        settings = {
            **TABLES,
            **self.settings,
            **point.settings,
            "MATH_PROBLEM": "DIRECT",
            "RESTART_SOL": "YES" if is_warm else "NO",
            "SOLUTION_FILENAME": "solution_flow",
            "RESTART_FILENAME": "restart_flow",
            "SURFACE_FILENAME": "surface_flow",
            "CONV_FILENAME": "history",
            "HISTORY_OUTPUT": "( ITER, RMS_RES, AERO_COEFF )",
            "VOLUME_OUTPUT": "( COORDINATES, SOLUTION, PRIMITIVE )",
            "OUTPUT_FILES": "( RESTART_ASCII, SURFACE_CSV )",
        }
        written = tuple(self.path / name for name in ("history.csv", "surface_flow.csv", "restart_flow.csv"))
        try:
            self._run(self.program, FLOW, settings, lock, written)
            values = last_of_history(written[0])
            surface = NodeTable.read(written[1])
        except SolverError:
            if is_warm:  # it may be its own start
                solution.unlink(missing_ok=True)
            raise
        try:
            started.unlink(missing_ok=True)
            shutil.copyfile(written[2], solution)
            started.write_text(cells)
            (self.path / FLOWN).write_text(self._stamp(mesh, point))
        except OSError as error:
            raise disk_full(self.program, self.path, error) from error
        return Su2Solution(values, surface)

    def _run(
        self,
        program: str,
        name: str,  # of the configuration
        settings: Mapping[str, object],
        lock: int,
        written: tuple[Path, ...],  # output files of the run: earlier ones are removed
    ) -> None:
        """Write a configuration, and run a program on it."""
        replaced = self.config.replaced_by(settings)
        if replaced:
            logger.info("%s: %s of %s set for %s", self.path, ", ".join(replaced), self.config.source, name)
        try:
            for path in written:
                path.unlink(missing_ok=True)
            (self.path / name).write_text(self.config.with_settings(settings))
        except OSError as error:
            raise disk_full(program, self.path, error) from error
        log = self.path / f"log.{program}"
        install = INSTALL if program == self.program else INSTALL_ADJOINT
        limits = {"n_processes": self.n_processes, "time_limit": self.time_limit, "inherited": [lock]}
        text = run_solver([program, name], self.path, log, install, _reason, **limits)  # type: ignore[arg-type]
        ended = re.search(r"Maximum number of iterations reached \((\w+) = (\d+)\) before convergence", text)
        if ended and self.needs_convergence:
            raise SolverError(
                f"{program} in {self.path}: not converged in {ended[2]} iterations; raise {ended[1]}, CFL_NUMBER, "
                f"or the limit CONV_RESIDUAL_MINVAL{end_of(text, log)}"
            )


def _digest(*parts: str) -> str:
    """Text that identifies given parts."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _reason(text: str) -> str | None:
    """Return the reason that SU2 itself gives."""
    message = re.search(r"Error in \"[^\n]*\n-+\s*\n(.*?)(?:\n-+ Error Exit|\Z)", text, re.DOTALL)
    if message is None:
        return None
    said = " ".join(message[1].split())
    what = "take a smaller step, or a smaller CFL_NUMBER" if "diverged" in said else "check the configuration"
    return f"{said.rstrip('.')}; {what}"
