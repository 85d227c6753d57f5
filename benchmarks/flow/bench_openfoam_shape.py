"""OpenFOAM's own shape optimisation next to this package's: lift or drag of its tutorial's NACA 0012, whose area stays.

``python benchmarks/flow/bench_openfoam_shape.py [--case lift | drag] [--cycles N] [--iterations N]
[--only slsqp nlopt] [--json FILE]``

The tutorial is ``shapeOptimisation/naca0012/lift/opt/constraintProjection`` of ``adjointOptimisationFoam``: a laminar
flow at a Reynolds number of 1000 and 2 degrees; lift is to grow, and the area of the section is to stay. Of drag the
tutorials have no optimisation, but a flow and its adjoint in ``naca0012/drag/primalAdjoint``: with ``--case drag`` the
objective of that one, which is to fall, stands in place of the lift, and all else is the same; so are the fields of
both. Variables are the free points of a box of volumetric B-splines. The peer runs as the tutorial has it, but in one
process, for a number of flows (``--cycles``). Ours has the same mesh, moved by a lattice without structure, the same
box with the same free points, the same schemes and conditions, and OpenFOAM's adjoint by `OpenFoamFlow`, with SLSQP of
SciPy and of NLopt (``--iterations``).

The peer has no bounds but a length of its first step; ours are bounded by the largest displacement that a control point
of the peer's had, and the objective is scaled by what the peer has gained, so that their first step is about as long as
that. The area counts as kept to a ten thousandth.

At the end all meshes are solved by the same solver to the same tolerance and assessed by ``checkMesh``. CPU seconds are
those of all processes. It needs ``adjointOptimisationFoam`` on the PATH, and its tutorials (Debian:
``openfoam-examples``), or ``--tutorials`` with the folder of others.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver
from openmdao.vectors.vector import Vector

from bspline_mdao import DesignSurface, NLoptDriver, ScipyDriver
from bspline_mdao.design import FreeForm, Lattice
from bspline_mdao.files import CaseField, read_mesh
from bspline_mdao.flow import OpenFoamFlow
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.flow.openfoam.case_mesh import CaseMesh
from bspline_mdao.flow.openfoam.flow_case import FreeStream
from bspline_mdao.flow.openfoam.flow_run import CaseFlow, CaseResult
from bspline_mdao.flow.openfoam.program import log_path, run_program
from bspline_mdao.flow.openfoam.rans_case import RansCase
from bspline_mdao.flow.openfoam.wall_loads import WallLoads
from bspline_mdao.measures import EnclosedVolume
from bspline_mdao.meshes import MeshModel, fit_mesh

TUTORIALS = Path("/usr/share/doc/openfoam-examples/examples/incompressible/adjointOptimisationFoam")
CASE, MESH = "shapeOptimisation/naca0012/lift/opt/constraintProjection", "resources/meshes/naca0012/polyMesh"
DRAG = "shapeOptimisation/naca0012/drag/primalAdjoint"

OUTPUTS = {"lift": ("CL", -1.0), "drag": ("CD", 1.0)}
"""Of ours by what the peer calls its objective, and their sign there."""

OBJECTIVE = r"(?<=objectiveNames)\s*\{\s*\w+\s*\{[^}]*\}"
"""The first objective in a case's dictionary, with its name."""

PROGRAM = "adjointOptimisationFoam"

AXES, REFERENCES = np.eye(3)[[0, 2, 1]], (1.0, 1.0, (0.25, 0.0, 0.0))
"""Directions downstream, along the span and up; area (m^2) of the section, which is 1 m deep, chord and its quarter."""

MOTION = "constant/dynamicMeshDict"
"""The tutorial's file with the box."""

DERIVATIVES = "optimisation/volumetricBSplinesFIDerivatives"
"""Folder for the derivatives that the peer writes, by solvers and cycles."""

PRINTED = {
    "non-orthogonality": r"non-orthogonality Max: (\S+)",
    "average": r"average: (\S+)",
    "skewness": r"[Mm]ax skewness = ([^\s,]+)",
    "wrong faces": r"(\d+) faces with incorrect orientation",
}
"""What ``checkMesh`` prints; counts only where they are not zero."""

KEPT = 1e-4
"""What volumes may be off, by themselves: a first step along the bend's gradient leaves 4e-5 of what is not linear."""

DRIVERS: dict[str, Callable[..., Driver]] = {
    "slsqp": partial(ScipyDriver, optimizer="SLSQP", tol=1e-2, constraint_tolerance=KEPT, disp=False),
    "nlopt": partial(NLoptDriver, optimizer="LD_SLSQP", tol=1e-2, constraint_tolerance=KEPT, disp=False),
}


@dataclass(frozen=True, eq=False)
class Tutorial:
    """A copy of the tutorial's case, none of its files compressed."""

    folder: Path

    @classmethod
    def copied(cls, case: Path, mesh: Path, folder: Path) -> Tutorial:
        """Copy a case and its mesh, unless they are there."""
        if folder.is_dir():
            return cls(folder)
        shutil.copytree(case, folder)
        shutil.copytree(mesh, folder / "constant" / "polyMesh")
        for file in folder.rglob("*.gz"):
            file.with_suffix("").write_bytes(gzip.decompress(file.read_bytes()))
            file.unlink()
        return cls(folder)

    def aim_at(self, other: Path) -> None:
        """Take the objective of another case of the tutorials."""
        (objective,) = re.findall(OBJECTIVE, read_text(other / "system" / "optimisationDict"))
        file = self.folder / "system" / "optimisationDict"
        file.write_text(re.sub(OBJECTIVE, objective, file.read_text(), count=1))

    def text(self, name: str) -> str:
        """Text of a file, without its head."""
        return re.sub(r"FoamFile\s*\{.*?\}", "", (self.folder / name).read_text(), count=1, flags=re.DOTALL)

    def found(self, name: str, pattern: str) -> str:
        """What stands in a file."""
        (match,) = re.findall(pattern, self.text(name), re.DOTALL)
        return match

    @property
    def velocity(self) -> np.ndarray:
        """Of the free stream (m/s)."""
        return np.array(self.found("0/U", r"internalField\s+uniform \(([^)]*)\)").split(), dtype=float)

    @property
    def alpha(self) -> float:
        """Angle of attack (rad)."""
        return float(np.arctan2(self.velocity[1], self.velocity[0]))

    @property
    def viscosity(self) -> float:
        """Kinematic viscosity (m^2/s)."""
        return float(self.found("constant/transportProperties", r"nu\s+nu\s+\[[^\]]*\]\s*([^;\s]+)"))

    @property
    def coefficient_of_objective(self) -> float:
        """Coefficient by the peer's objective, but for the sign."""
        area, speed = (float(self.found("system/optimisationDict", rf"{x}\s+([^;\s]+)")) for x in ("Aref", "UInf"))
        return area * speed**2 / (REFERENCES[0] * self.velocity @ self.velocity)

    def box(self, points: np.ndarray, is_free: np.ndarray) -> FreeForm:
        """Variables of the peer, by the control points that it has written."""
        orders = [int(self.found(MOTION, rf"degree{x}\s+(\d+)")) + 1 for x in "UVW"]
        where = self.as_net(is_free)
        axes = "".join(axis for axis, moves in zip("xyz", where.reshape(-1, 3).any(axis=0).tolist()) if moves)
        lattice = Lattice(self.as_net(points), orders=orders, continuity=-1)
        return FreeForm("shape", lattice, where=where.any(axis=3), direction=axes)

    def as_net(self, values: np.ndarray) -> np.ndarray:
        """Values of control points, of which OpenFOAM numbers the first direction first, in the shape of the box."""
        shape = [int(self.found(MOTION, rf"nCPs{x}\s+(\d+)")) for x in "WVU"]
        return values.reshape(*shape, 3).transpose(2, 1, 0, 3)


@dataclass(frozen=True, eq=False)
class TutorialCase(RansCase):
    """simpleFoam with the fields and schemes of the tutorial."""

    tutorial: Tutorial = field(kw_only=True)

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Fields and settings; those of the solution of linear systems are ours."""
        fields, settings = super().files(stream)
        taken = {}
        for name in ("U", "p"):
            wall, far = (self.tutorial.found(f"0/{name}", rf"{patch}\s*\{{(.*?)\}}") for patch in ("suction", "inlet"))
            conditions = {"wall": wall, "symmetry": f"type {self.planes};", "other": far}
            taken[name] = CaseField(fields[name].dimensions, fields[name].value, conditions)
        own = ("constant/turbulenceProperties", "constant/transportProperties", "system/fvSchemes")
        return taken, {**settings, **{name: self.tutorial.text(name) for name in own}}


class CountedFlow(OpenFoamFlow):
    """The flow, which counts its solutions."""

    def setup(self) -> None:
        """Begin to count."""
        super().setup()
        self.loads: list[WallLoads] = []
        self.n_flows = self.n_adjoints = 0

    def _solve(self, *state: np.ndarray) -> CaseResult:
        self.n_flows += 1
        found = super()._solve(*state)
        self.loads.append(found.loads)
        return found

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Count adjoints that were not there before."""
        n_before = len(self._gradients)
        super().compute_jacvec_product(inputs, d_inputs, d_outputs, mode)
        self.n_adjoints += len(self._gradients) - n_before


def read_text(path: Path) -> str:
    """Text of a file of the tutorials, some of which are compressed."""
    packed = path.with_name(f"{path.name}.gz")
    return gzip.decompress(packed.read_bytes()).decode() if packed.is_file() else path.read_text()


def spent() -> float:
    """CPU seconds of this process and of those that have ended."""
    return sum(os.times()[:4])


def control_points(case: Path, cycle: int) -> tuple[np.ndarray, np.ndarray]:
    """Control points of the peer (m) in one of its cycles, and which of their coordinates are free."""
    (file,) = (case / "optimisation" / "controlPoints").glob(f"*cpsBsplines{cycle}.csv")
    values = np.loadtxt(file, delimiter=",", skiprows=1)
    return values[:, :3], values[:, 6:] > 0.0


def peer_gradient(tutorial: Tutorial) -> np.ndarray:
    """Derivatives of the objective by the free coordinates of the control points, of the peer's first cycle."""
    text = (tutorial.folder / DERIVATIVES / "volumetricBSplinesFIas11").read_text()
    values = np.array([line.split() for line in text.splitlines()[1:] if line.strip()], dtype=float)
    _, is_free = control_points(tutorial.folder, 0)
    total = np.zeros(is_free.shape)
    total[values[:, 0].astype(int)] = values[:, 1:4]
    return tutorial.as_net(total)[tutorial.as_net(is_free)]


def moved_points(case: Path, cycle: int, folder: Path) -> np.ndarray:
    """Points of the mesh of a cycle (m)."""
    place = folder / "polyMesh"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(case / "constant" / "polyMesh", place)
    (place / "points").write_bytes(gzip.decompress((case / str(cycle) / "polyMesh" / "points.gz").read_bytes()))
    return read_mesh(place).mesh.points


def fly_peer(tutorial: Tutorial, objective: str, n_cycles: int) -> dict:
    """Run the tutorial, unless it has run; its control points and meshes stay in its folder."""
    case = tutorial.folder
    if not (case / DERIVATIVES / f"volumetricBSplinesFIas1{n_cycles}").is_file():
        control = case / "system" / "controlDict"
        control.write_text(re.sub(r"endTime\s+\d+;", f"endTime {n_cycles};", control.read_text()))
        run_program(PROGRAM, case)
    cycles = re.split(r"^Optimisation cycle \d+$", log_path(PROGRAM, case).read_text(), flags=re.MULTILINE)
    log = "".join(cycles[: n_cycles + 1])
    solved = re.findall(r"^Solving equations for solver (\w+)$", log, re.MULTILINE)
    flows = re.findall(r"Solving equations for solver p1\n(.*?)Solving equations for", log, re.DOTALL)
    history = [float(re.findall(rf"^{objective} : (\S+)", flow, re.MULTILINE)[-1]) for flow in flows]
    return {
        "flows": solved.count("p1"),
        "adjoints": len(solved) - solved.count("p1"),
        "seconds": float(re.findall(r"^ExecutionTime = (\S+) s", log, re.MULTILINE)[-1]),
        "history": history,
    }


def fly_ours(
    driver: Driver,
    model: MeshModel,
    case: TutorialCase,
    variables: FreeForm,
    output: str,
    reach: float,  # bound of all variables (m)
    gain: float,  # of the output by the peer, which it is scaled by
    folder: Path,
) -> tuple[dict, np.ndarray]:
    """Optimise by our adjoint; numbers, and the points of the mesh that was found (m)."""
    start = spent()
    surface = DesignSurface.of(model)
    volume = EnclosedVolume.of(surface.surface, relative=True, name="volume")
    problem = om.Problem(driver=driver, reports=None)
    group = problem.model
    group.add_subsystem("movement", surface.grid_movement([variables], measures=[volume]), promotes=["*"])
    flow = CountedFlow(model=model, folder=folder, case=case, reference_area=1.0, derivatives="adjoint", iprint=1)
    group.add_subsystem("flow", flow, promotes=["*"])
    group.add_design_var("shape", lower=-reach, upper=reach, ref=reach)
    group.add_objective(output, ref=-gain)
    group.add_constraint("volume", equals=1.0)
    problem.setup(mode="rev")
    problem.set_val("alpha", case.tutorial.alpha, units="rad")
    problem.set_val("speed", np.linalg.norm(case.tutorial.velocity))
    problem.run_model()
    gradient = problem.compute_totals([output], ["shape"])[output, "shape"].ravel()  # its adjoint serves the driver
    problem.run_driver()
    history = [getattr(loads, output) for loads in flow.loads]
    found = {"flows": flow.n_flows, "adjoints": flow.n_adjoints, "seconds": spent() - start, "history": history}
    found |= {"gradient": gradient, "shape": problem.get_val("shape")}
    return found, problem.get_val("grid").reshape(-1, 3).copy()


def beside(ours: np.ndarray, theirs: np.ndarray) -> dict[str, float]:
    """How far our first gradient is from the peer's (%), and how far it is turned (deg)."""
    size = np.linalg.norm(theirs)
    turned = np.degrees(np.arccos(ours @ theirs / (np.linalg.norm(ours) * size)))
    return {"gradient off": float(100.0 * np.linalg.norm(ours - theirs) / size), "turned": float(turned)}


def cells_of(case: Path, model: MeshModel, points: np.ndarray) -> dict[str, float]:
    """What ``checkMesh`` finds of the mesh of a case, and how far its walls have moved (m)."""
    log = run_program("checkMesh", case, "-constant")
    matches = {name: re.search(pattern, log) for name, pattern in PRINTED.items()}
    moves = np.linalg.norm(points - model.mesh.points, axis=1)[model.wall_rows]
    return {"wall": float(moves.max())} | {name: float(match[1]) if match else 0.0 for name, match in matches.items()}


def judged(flow: CaseFlow, tutorial: Tutorial, model: MeshModel, points: np.ndarray) -> dict[str, float]:
    """What a mesh gives: its flow, the area of its section by that at the start, and its cells."""
    loads = flow.solve(points, tutorial.alpha, float(np.linalg.norm(tutorial.velocity))).loads
    area = EnclosedVolume.of(DesignSurface.of(model).surface, relative=True)
    relative = area.evaluate(points[area.surface.rows]).item()
    return {"CL": loads.CL, "CD": loads.CD, "area": relative, **cells_of(flow.folder.path, model, points)}


def measure(
    tutorials: Path, name: str, folder: Path, only: list[str], n_cycles: int, n_iterations: int, tolerance: float
) -> dict:
    """Run all that is asked for of an objective."""
    tutorial = Tutorial.copied(tutorials / CASE, tutorials / MESH, folder / "peer")
    if name == "drag":
        tutorial.aim_at(tutorials / DRAG)
    output, sign = OUTPUTS[name]
    factor = sign * tutorial.coefficient_of_objective
    model = fit_mesh(tutorial.folder / "constant" / "polyMesh")
    speed = float(np.linalg.norm(tutorial.velocity))
    reynolds_number = speed / tutorial.viscosity
    case = TutorialCase(reynolds_number, planes="empty", tolerance=tolerance, max_iterations=5000, tutorial=tutorial)
    flow = CaseFlow(case, CaseMesh.of(model), CaseFolder(folder / "judge"), AXES, REFERENCES)
    rows = {"start": judged(flow, tutorial, model, model.mesh.points)}
    show("start", rows["start"])
    peer = fly_peer(tutorial, name, n_cycles)
    peer["history"] = [factor * objective for objective in peer["history"]]
    start, is_free = control_points(tutorial.folder, 0)
    reach = float(np.abs(control_points(tutorial.folder, n_cycles)[0] - start).max())
    rows["peer"] = peer | judged(flow, tutorial, model, moved_points(tutorial.folder, n_cycles, folder / "moved"))
    show("peer", rows["peer"])
    variables = tutorial.box(start, is_free)
    gain = rows["peer"][output] - rows["start"][output]
    for ours in only:
        driver = DRIVERS[ours](maxiter=n_iterations)
        found, points = fly_ours(driver, model, case, variables, output, reach, gain, folder / ours)
        rows[ours] = found | judged(flow, tutorial, model, points)
        rows[ours] |= beside(found["gradient"], factor * peer_gradient(tutorial))
        show(ours, rows[ours])
    return {"reach": reach, "rows": rows}


def show(name: str, row: dict) -> None:
    """Print a row."""
    print(name, *(f"{what} {value:.5g}" for what, value in row.items() if np.isscalar(value)), sep="  ", flush=True)
    if "history" in row:
        print("    of each flow", *(f"{value:.5g}" for value in row["history"]), flush=True)


def run(doc: str | None, measured: Callable[..., dict], cases: Iterable[str], n_cycles: int) -> None:
    """Measure what the command line requests, by default the first case after as many flows of the peer."""
    first, *others = cases
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tutorials", type=Path, default=TUTORIALS, help="folder of adjointOptimisationFoam's")
    parser.add_argument("--case", choices=(first, *others), default=first, help="what is optimised")
    parser.add_argument("--cycles", type=int, default=n_cycles, help="flows of the peer")
    parser.add_argument("--iterations", type=int, default=3, help="of SLSQP")
    parser.add_argument("--only", nargs="*", choices=tuple(DRIVERS), default=list(DRIVERS), help="optimisers of ours")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="residuals of our flows and adjoints")
    parser.add_argument("--folder", type=Path, help="keep the cases there; a run of the peer that is there counts")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        numbers = options.cycles, options.iterations, options.tolerance
        found = measured(options.tutorials, options.case, folder, options.only, *numbers)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2, default=np.ndarray.tolist) + "\n")


def main() -> None:
    """Measure what is asked for."""
    run(__doc__, measure, OUTPUTS, n_cycles=3)


if __name__ == "__main__":
    main()
