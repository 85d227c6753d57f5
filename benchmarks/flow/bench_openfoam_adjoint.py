"""How far the derivatives of OpenFOAM's continuous adjoint are from central differences of its own flow.

NACA 0012 at an angle of attack of 3 deg on an O-grid; variables are the heights of a free-form box around it, both ends
of the span together, and the angle. The grid is moved by the lattice that is fitted to it, as in an optimisation::

    python benchmarks/flow/bench_openfoam_adjoint.py [laminar | functions | resolved] [--cells N] [--meshed]

The laminar flow is of a Reynolds number of 100, the others are of 10^6 by the model of Spalart and Allmaras, with wall
functions or resolved to the wall. ``--cells`` are those around the section, ``--meshed`` moves the same cells as a mesh
without structure. It needs OpenFOAM's adjointOptimisationFoam on the PATH.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import FreeForm, Lattice
from bspline_mdao.files import CaseField
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.flow.openfoam.case_mesh import CaseMesh
from bspline_mdao.flow.openfoam.flow_adjoint import FlowAdjoint
from bspline_mdao.flow.openfoam.flow_case import FreeStream
from bspline_mdao.flow.openfoam.flow_run import CaseFlow
from bspline_mdao.flow.openfoam.rans_case import RansCase
from bspline_mdao.generators import naca_section, section_o_grid
from bspline_mdao.grids.io.openfoam import PolyMesh
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.meshes import fit_mesh

ALPHA, SPEED, TOLERANCE, STEP = np.radians(3.0), 1.0, 1e-7, 5e-4
"""Angle (rad), speed (m/s), residuals of flow and adjoint, and step of the differences (chords, rad)."""

STATIONS = 6
"""Points of the box along the chord."""

COEFFICIENTS = ("CL", "CD", "CMz")


@dataclass(frozen=True, eq=False)
class LaminarCase(RansCase):
    """The same solver without turbulence."""

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Fields and settings, without those of turbulence."""
        fields, settings = super().files(stream)
        kept = {name: fields[name] for name in ("U", "p")}
        return kept, {**settings, "constant/turbulenceProperties": "simulationType laminar;\n"}


def make_case(kind: str, cells: int):
    """Grid and case of a kind of flow."""
    section, options = naca_section(0.12), {"planes": "empty", "tolerance": TOLERANCE, "max_iterations": 8000}
    if kind == "laminar":
        return section_o_grid(section, n_around=cells, far=8.0), LaminarCase(100.0, **options)
    height = {"functions": 2e-3, "resolved": 2e-5}[kind]
    grid = section_o_grid(section, n_around=cells, n_away=cells // 2, far=20.0, off_wall=height)
    return grid, RansCase(1e6, walls=kind, **options)


def fitted(grid, folder: Path, is_meshed: bool):
    """Fit a lattice to the blocks of a grid, or to its cells as those of any other mesh."""
    if not is_meshed:
        return bm.fit_grid(grid)
    place = folder / "mesh" / "constant" / "polyMesh"
    place.parent.mkdir(parents=True)
    PolyMesh.of(find_topology(grid), grid.to_vector().reshape(-1, 3)).write(place, "empty")
    return fit_mesh(place)


def coefficients(flow: CaseFlow, nodes: np.ndarray, alpha: float) -> np.ndarray:
    """CL, CD and the moment about z, started from the solution of the baseline."""
    loads = flow.solve(nodes, alpha, SPEED, is_kept=False).loads
    return np.array([loads.CL, loads.CD, loads.CM[2]])


def measure(kind: str, cells: int, is_meshed: bool, folder: Path) -> None:
    """Print derivatives of all coefficients by all variables."""
    grid, case = make_case(kind, cells)
    model = fitted(grid, folder, is_meshed)
    surface = bm.DesignSurface.of(model, "wing")
    box = Lattice.box(surface.mesh, n=(STATIONS, 2, 2))
    problem = om.Problem(surface.grid_movement([FreeForm("shape", box, direction="y")]), reports=None)
    problem.setup()
    flow = CaseFlow(
        case, CaseMesh.of(model), CaseFolder(folder / "case"), np.eye(3)[[0, 2, 1]], (1.0, 1.0, (0.25, 0, 0))
    )

    def nodes_at(shape: np.ndarray) -> np.ndarray:
        problem.set_val("shape", shape)
        problem.run_model()
        return problem.get_val("grid").reshape(-1, 3).copy()

    zero = np.zeros(problem.get_val("shape").size)
    start = time.perf_counter()
    found = flow.solve(nodes_at(zero), ALPHA, SPEED)
    print(
        f"{kind}, {grid.shapes[0]} nodes: {found.convergence.n_iterations} iterations, y+ {found.y_plus[1]:.2g}", end=""
    )
    print(f", {time.perf_counter() - start:.1f} s")
    adjoint = FlowAdjoint.of(flow)
    gradients = {}
    for name in COEFFICIENTS:
        start = time.perf_counter()
        gradients[name] = adjoint.gradient(name, ALPHA, SPEED, found.loads)
        print(f"  adjoint of {name}: {time.perf_counter() - start:.1f} s")
    base = nodes_at(zero)
    slopes = [coefficients(flow, base, ALPHA + side * STEP) for side in (1, -1)]
    rows = [("angle", [g.alpha for g in gradients.values()], (slopes[0] - slopes[1]) / (2.0 * STEP))]
    for station in range(STATIONS):
        for side, word in enumerate(("lower", "upper")):
            shape = zero.reshape(STATIONS, 2, 2).copy()
            shape[station, side] = STEP
            ahead, behind = nodes_at(shape.ravel()), nodes_at(-shape.ravel())
            move = (ahead - behind) / (2.0 * STEP)
            exact = (coefficients(flow, ahead, ALPHA) - coefficients(flow, behind, ALPHA)) / (2.0 * STEP)
            rows.append((f"{word} {station}", [np.sum(g.nodes * move) for g in gradients.values()], exact))
    of_box = [np.array([row[part] for row in rows[1:]]) for part in (1, 2)]
    rows.append(("all heights", *(part.sum(axis=0) for part in of_box)))  # which shift the section as a whole
    print("  variable   " + "".join(f"{name:>9} adjoint  difference" for name in COEFFICIENTS))
    for label, ours, exact in rows:
        print(f"  {label:11s}" + "".join(f"{a:17.5f}{b:12.5f}" for a, b in zip(ours, exact)))
    a, b = of_box
    for k, name in enumerate(COEFFICIENTS):
        off, cosine = np.linalg.norm(a[:, k] - b[:, k]) / np.linalg.norm(b[:, k]), a[:, k] @ b[:, k]
        cosine /= np.linalg.norm(a[:, k]) * np.linalg.norm(b[:, k])
        turned = np.degrees(np.arccos(cosine))
        print(f"  {name}: off by {100 * off:.1f} % of the gradient by the box, which is turned by {turned:.1f} deg")


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", nargs="?", default="laminar", choices=("laminar", "functions", "resolved"))
    parser.add_argument("--cells", type=int, default=64)
    parser.add_argument("--meshed", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(arguments.kind, arguments.cells, arguments.meshed, Path(folder))


if __name__ == "__main__":
    main()
