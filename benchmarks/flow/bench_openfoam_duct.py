"""OpenFOAM's own shape optimisation next to this package's: the losses of its tutorial's S-bend.

``python benchmarks/flow/bench_openfoam_duct.py [--case BFGS | SD | SQP | turbulent] [--cycles N] [--iterations N]
[--only slsqp nlopt] [--json FILE]``

The tutorials are those in ``shapeOptimisation/sbend`` of ``adjointOptimisationFoam``: the total pressure that a flow
loses in a bend, of which two walls move with a box of volumetric B-splines. A laminar flow is optimised by BFGS, by
steepest descent (``SD``), and by sequential quadratic programming with the volume between the walls kept (``SQP``), a
turbulent one (Spalart and Allmaras, ``opt/BFGS/op1``) by BFGS. The peer and ours run as in ``bench_openfoam_shape.py``:
its optimiser, and SLSQP of SciPy and NLopt by the adjoint's sensitivities of points, with the same free points, bounded
by the largest displacement that one of the peer's had. Ours solves flow and adjoint by the peer's program as well, with
its schemes, on the mesh that the lattice has moved. Losses are those that this program finds. Volumes are a third of
the points of both walls along their areas, as the peer measures them (``partialVolume``), by that at the start.

``--only`` with no name runs the peer alone.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmdao.api as om
from bench_openfoam_shape import (
    DRIVERS,
    Tutorial,
    beside,
    cells_of,
    control_points,
    fly_peer,
    moved_points,
    peer_gradient,
    run,
    show,
    spent,
)
from openmdao.core.driver import Driver
from openmdao.vectors.vector import Vector

from bspline_mdao import DesignSurface
from bspline_mdao.design import FreeForm
from bspline_mdao.errors import MovementError, SolverError
from bspline_mdao.flow.openfoam.adjoint import AdjointRun, AdjointSolution, FlowFunction
from bspline_mdao.flow.openfoam.case_mesh import CaseMesh
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
from bspline_mdao.meshes import MeshModel, fit_mesh
from bspline_mdao.names import GRID

FOLDER, MESH = "shapeOptimisation/sbend", "resources/meshes/sbend/polyMesh"

CASES = {
    "BFGS": "laminar/opt/unconstrained/BFGS",
    "SD": "laminar/opt/unconstrained/SD",
    "SQP": "laminar/opt/constrained/SQP",
    "turbulent": "turbulent/opt/BFGS/op1",
}
"""Folders of the tutorials by the names of ours."""

LOSSES = FlowFunction.pressure_losses("losses", ["Inlet", "Outlet"])
WALLS = ("lower", "upper", "sideWall")
"""All of them: what of the straight walls is in the box moves, too."""

BEND = ("lower", "upper")
"""Walls with a volume between them."""

FIELDS = ("U", "p", "nuTilda", "nut")
"""What a flow starts from, as far as it has them."""


class Duct:
    """A flow through the bend and its adjoint, in a copy of the tutorial's case."""

    def __init__(self, tutorial: Tutorial, mesh: CaseMesh, folder: Path, tolerance: float):
        self.mesh, self.folder, self.n_solved = mesh, folder, 0
        self.history: list[float] = []
        for name in ("constant", "system"):
            shutil.copytree(tutorial.folder / name, folder / name)
        self.flow = folder / "flow"
        self.flow.mkdir()
        self._keep(tutorial.folder / "0")
        self.run = AdjointRun(WALLS, {"Inlet": "inlet", "Outlet": "outlet"}, tolerance)

    def solve(self, nodes: np.ndarray) -> AdjointSolution:
        """Solve both on a mesh, from the last solution."""
        self.n_solved += 1
        self.mesh.write(self.folder, nodes, "empty")
        found = self.run.solve(self.folder, self.flow, LOSSES)
        times = [path for path in (self.folder / "adjoint_losses").iterdir() if re.fullmatch(r"\d+", path.name)]
        self._keep(max(times, key=lambda path: int(path.name)))
        self.history.append(found.value)
        print(f"losses {found.value:.5g}, {found.n_flow} and {found.n_adjoint} iterations", flush=True)
        return found

    def _keep(self, time: Path) -> None:
        for name in FIELDS:
            if (time / name).is_file():
                shutil.copyfile(time / name, self.flow / name)


class Losses(om.ExplicitComponent):
    """Losses of a mesh (m^5/s^3)."""

    def initialize(self) -> None:
        """Declare the option."""
        self.options.declare("duct", types=Duct)

    def setup(self) -> None:
        """Declare the variables."""
        self.add_input(GRID, val=self.options["duct"].mesh.baseline.ravel(), units="m")
        self.add_output("losses")
        self._at: tuple[np.ndarray, AdjointSolution] | None = None

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Solve flow and adjoint."""
        outputs["losses"] = self._found(inputs).value

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the gradient."""
        if mode == "rev" and GRID in d_inputs:
            d_inputs[GRID] += d_outputs["losses"] * self._found(inputs).gradient.ravel()

    def _found(self, inputs: Vector) -> AdjointSolution:
        nodes = np.array(inputs[GRID])
        if self._at is None or not np.array_equal(self._at[0], nodes):
            try:
                self._at = nodes, self.options["duct"].solve(nodes.reshape(-1, 3))
            except (SolverError, MovementError) as error:
                raise om.AnalysisError(str(error)) from error
        return self._at[1]


def fly_ours(
    driver: Driver,
    model: MeshModel,
    duct: Duct,
    volume: EnclosedVolume | None,  # that is to stay
    variables: FreeForm,
    reach: float,  # bound of all variables (m)
    gain: float,  # of the losses by the peer, which they are scaled by
) -> tuple[dict, np.ndarray]:
    """Optimise by our adjoint; numbers, and the points of the mesh that was found (m)."""
    start = spent()
    problem = om.Problem(driver=driver, reports=None)
    group = problem.model
    measures = [] if volume is None else [volume]
    movement = DesignSurface.of(model).grid_movement([variables], measures=measures)
    group.add_subsystem("movement", movement, promotes=["*"])
    group.add_subsystem("flow", Losses(duct=duct), promotes=["*"])
    group.add_design_var("shape", lower=-reach, upper=reach, ref=reach)
    group.add_objective("losses", ref=gain)
    for kept in measures:
        group.add_constraint(kept.name, equals=1.0)
    problem.setup(mode="rev")
    problem.run_model()
    gradient = problem.compute_totals(["losses"], ["shape"])["losses", "shape"].ravel()
    problem.run_driver()
    nodes = problem.get_val(GRID).reshape(-1, 3).copy()
    found = {"losses": problem.get_val("losses").item(), "flows": duct.n_solved, "adjoints": duct.n_solved}
    found |= {"seconds": spent() - start, "history": duct.history}
    return found | {"gradient": gradient, "shape": problem.get_val("shape")}, nodes


def volume_of(surface: SurfaceGrid) -> EnclosedVolume:
    """Measure what the peer calls a partial volume of walls that are open at their ends, by that at the start."""
    origin = np.zeros(3)
    volume = EnclosedVolume(surface, surface.quads, np.zeros((0, 3)), origin, 1.0, None, "volume")
    return replace(volume, scale=volume.evaluate(surface.points).item())


def measure(
    tutorials: Path, name: str, folder: Path, only: list[str], n_cycles: int, n_iterations: int, tolerance: float
) -> dict:
    """Run all that is asked for of a case."""
    tutorial = Tutorial.copied(tutorials / FOLDER / CASES[name], tutorials / MESH, folder / "peer")
    model = fit_mesh(tutorial.folder / "constant" / "polyMesh")
    volume = volume_of(DesignSurface.of(model, BEND).surface)
    is_kept = "isConstraint" in tutorial.text("system/optimisationDict")
    mesh = CaseMesh.of(model)
    checked = Duct(tutorial, mesh, folder / "checked", tolerance)

    def cells(points: np.ndarray) -> dict[str, float]:
        mesh.write(checked.folder, points, "empty")
        relative = volume.evaluate(points[volume.surface.rows]).item()
        return {"volume": relative, **cells_of(checked.folder, model, points)}

    peer = fly_peer(tutorial, "losses", n_cycles)
    rows = {"start": {"losses": peer["history"][0]} | cells(mesh.baseline)}
    show("start", rows["start"])
    start, is_free = control_points(tutorial.folder, 0)
    reach = float(np.abs(control_points(tutorial.folder, n_cycles)[0] - start).max())
    last = moved_points(tutorial.folder, n_cycles, folder / "moved")
    rows["peer"] = {"losses": peer["history"][-1]} | peer | cells(last)
    show("peer", rows["peer"])
    gain = rows["start"]["losses"] - rows["peer"]["losses"]
    for ours in only:
        duct, variables = Duct(tutorial, mesh, folder / ours, tolerance), tutorial.box(start, is_free)
        driver = DRIVERS[ours](maxiter=n_iterations)
        found, points = fly_ours(driver, model, duct, volume if is_kept else None, variables, reach, gain)
        rows[ours] = found | cells(points) | beside(found["gradient"], peer_gradient(tutorial))
        show(ours, rows[ours])
    return {"reach": reach, "rows": rows}


def main() -> None:
    """Measure what is asked for."""
    run(__doc__, measure, CASES, n_cycles=4)


if __name__ == "__main__":
    main()
