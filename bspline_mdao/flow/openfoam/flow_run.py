"""A flow about a model by OpenFOAM: the case of a design is written, solved from the last solution, and read."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ...base.display import OneLine
from ...errors import InputError, SolverError
from ...grids.io.openfoam import case_texts, put_texts
from ..loads.stream import stream_axes
from .case_fields import WrittenField
from .case_folder import CaseFolder
from .case_mesh import CaseMesh
from .flow_case import FlowCase, FreeStream
from .printed_forces import functions_text, pitch_axis, printed_coefficients
from .program import disk_full
from .reference_check import doubts_about_axes_and_area, doubts_about_forces
from .solver_log import Convergence
from .wall_loads import CaseWalls, WallLoads, wall_loads

__all__ = ["CaseFlow", "CaseResult"]


@dataclass(frozen=True, eq=False)
class CaseResult(OneLine):
    """Results of OpenFOAM for a design."""

    loads: WallLoads
    y_plus: tuple[float, float]  # lowest and highest on walls; zeros without friction
    convergence: Convergence
    seconds: float  # wall time of the solver
    doubts: list[str]  # what looks wrong in the references


@dataclass(frozen=True, eq=False)
class CaseFlow(OneLine):
    """A flow in a folder of its own, for one design after another."""

    case: FlowCase
    mesh: CaseMesh
    folder: CaseFolder
    axes: np.ndarray  # (3, 3), rows are the directions downstream, along the span, and up
    references: tuple[float, float, Sequence[float]]  # area (m^2), chord (m) and reference point of moments (m)
    time_limit: float | None = None  # of the solver (s)
    # whether to accept a solution that is not converged; `SolverError` if not
    takes_unconverged: bool = False
    n_processes: int = 1  # for the solver

    def solve(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the model (m)
        alpha: float,  # angle of attack (rad)
        speed: float,  # Mach number, or m/s
        is_kept: bool = True,  # whether the next design starts from this one
    ) -> CaseResult:
        """Solve the flow about a design; `SolverError` or `MovementError` if that is not possible."""
        directions, points = stream_axes(alpha, self.axes), self.mesh.points(nodes)
        stream = self.case.stream(directions[0], speed)
        with self.folder.locked():
            self._write(nodes, stream, directions)
            self.folder.start_from_solution(self._made_for)
            start = time.perf_counter()
            log = self.folder.solve(self.case.program, self.slices, self.time_limit)
            seconds = time.perf_counter() - start
            convergence = self._converged(log)
            last = self.folder.last
            walls = replace(self.walls, points=points)
            loads = wall_loads(walls, last, stream, alpha, self.axes, self.references)
            y_plus = self._y_plus(walls, last)
            if is_kept:
                self.folder.keep_solution(self._made_for)
            self.folder.remove_times(but=[last])
            theirs = printed_coefficients(self.folder.path)
        ours = {"CL": loads.CL, "CD": loads.CD, "CM_pitch": float(loads.CM @ pitch_axis(self.axes))}
        doubts = self._doubts(points, directions[0]) + doubts_about_forces(ours, theirs)
        return CaseResult(loads, y_plus, convergence, seconds, doubts)

    @cached_property
    def walls(self) -> CaseWalls:
        """Faces of walls, on the baseline."""
        return self.mesh.patches_of("wall")

    @cached_property
    def planes(self) -> CaseWalls:
        """Faces of planes of symmetry, on the baseline."""
        return self.mesh.patches_of("symmetry")

    @cached_property
    def slices(self) -> tuple[int, int, int]:
        """Slices of cells along x, y and z, one per process, across the longest side of walls."""
        longest = int(np.argmax(np.ptp(self.walls.points[self.walls.corners], axis=0)))
        return tuple(self.n_processes if axis == longest else 1 for axis in range(3))  # type: ignore[return-value]

    @cached_property
    def _made_for(self) -> str:
        """The conditions under which a run may start from a solution."""
        return f"{self.case.program} {self.mesh.digest}"

    def _write(self, nodes: np.ndarray, stream: FreeStream, directions: np.ndarray) -> None:
        """Write the case of a design, starting from the last run's files."""
        fields, settings = self.case.files(stream)
        functions = functions_text(self.case, stream, self.mesh.walls, directions, self.axes, self.references)
        control = "system/controlDict"
        texts = case_texts(fields, {**settings, control: settings[control] + functions}, self.mesh.boundary)
        try:
            self.mesh.write(self.folder.path, nodes, self.case.planes)
            self.folder.remove_times()
            for name in ("0", "postProcessing"):
                shutil.rmtree(self.folder.path / name, ignore_errors=True)
            put_texts(self.folder.path, texts)
        except InputError as error:
            if isinstance(error.__cause__, OSError):  # a full disk fails a design, not the optimisation
                raise disk_full(self.case.program, self.folder.path, error.__cause__) from error
            raise

    def _converged(self, log: str) -> Convergence:
        """Convergence of the solver; `SolverError` if it is not sufficient."""
        found = Convergence.of(self.case.program, log)
        if found.is_converged or self.takes_unconverged:
            return found
        raise SolverError(
            f"{self.case.program} in {self.folder.path}: not converged after {found.n_iterations} iterations, last "
            f"residuals {found.last}; give it more iterations, a larger tolerance, or check the mesh"
        )

    def _y_plus(self, walls: CaseWalls, last: Path) -> tuple[float, float]:
        """Lowest and highest y+ on walls."""
        if not self.case.is_viscous:
            return 0.0, 0.0
        values = walls.values(WrittenField.read(last, "yPlus"))
        return float(values.min()), float(values.max())

    def _doubts(self, points: np.ndarray, direction: np.ndarray) -> list[str]:
        """Doubts about axes and area."""
        walls, planes = (replace(faces, points=points) for faces in (self.walls, self.planes))
        return doubts_about_axes_and_area(walls, planes, self.axes, direction, self.references[0])
