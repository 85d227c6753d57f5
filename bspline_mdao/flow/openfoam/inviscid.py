"""OpenFOAM's rhoSimpleFoam on the project's grids: the solution of another code on the same cells.

The case is steady, compressible and inviscid (no viscosity, no conduction; perfect gas, ratio of heats 1.4): slip at
walls, symmetry, ``freestreamPressure`` and ``freestreamVelocity`` on all other patches. Gradients are ``Gauss linear``,
convection of momentum, enthalpy and kinetic energy is ``linearUpwind`` (second order), and SIMPLEC couples velocity and
pressure, relaxed by 0.9. The pressure at a wall equals the pressure of the cell next to it (``zeroGradient``), and the
forces are its integral. A run ends when the initial residuals of all equations are below `TOLERANCE`.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ...base.checks import as_axes
from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.quads import area_vectors
from ...grids.io.openfoam import CaseField, Planes, PolyMesh
from ...grids.topology.topology import Topology
from ..loads.stream import stream_axes
from .case_fields import WrittenField
from .case_folder import CaseFolder
from .flow_case import CONTROL, FreeStream, PerfectGas, SpeedName
from .program import is_there, run_program
from .solver_log import Convergence

__all__ = ["Forces", "InviscidCase", "openfoam_forces"]

TOLERANCE = 1e-6
"""For the initial residuals, as OpenFOAM scales them."""

GAS = PerfectGas(1.4, 8314.47 / 28.9, 1e5, 300.0)
"""Ratio of heats, gas constant (J/(kg K)), and free stream (Pa, K). Coefficients do not depend on the last three."""


@dataclass(frozen=True, eq=False)
class Forces(OneLine):
    """Results of OpenFOAM."""

    # CL, CD: lift and drag coefficients
    CL: float
    CD: float
    # (n_wall,), pressure coefficient on the faces of walls, in the order of ``CellFaces.faces_of("wall")``
    Cp: np.ndarray
    # dict of ndarray, shape (n_iterations,), initial residual of every equation over the iterations
    residuals: dict[str, np.ndarray]
    is_converged: bool  # whether all of them fell below the tolerance
    seconds: float  # wall time of the solver

    @property
    def n_iterations(self) -> int:
        """Iterations of SIMPLE."""
        return len(self.residuals["p"])


@dataclass(frozen=True)
class InviscidCase(OneLine):
    """Compressible inviscid flow by rhoSimpleFoam: slip at walls, the free stream far from the body.

    Parameters
    ----------
    max_iterations : int
        Iterations after which it ends in any case.
    tolerance : float
        For the initial residuals, as OpenFOAM scales them.
    planes : {"symmetry", "symmetryPlane", "empty"}
        OpenFOAM's type of the patches of kind symmetry. Sections, whose grid is one cell deep, need ``empty``: with
        ``symmetry``, the velocity along the span is also solved for, and its residual never falls.

    Examples
    --------
    >>> from bspline_mdao.flow import InviscidCase
    >>> InviscidCase(max_iterations=200)
    InviscidCase(max_iterations=200, tolerance=1e-06, planes='symmetry')
    """

    max_iterations: int = 1000
    tolerance: float = TOLERANCE
    planes: Planes = "symmetry"

    program: ClassVar[str] = "rhoSimpleFoam"
    speed_name: ClassVar[SpeedName] = "Mach_number"
    is_viscous: ClassVar[bool] = False

    def stream(self, direction: np.ndarray, speed: float) -> FreeStream:
        """Free stream for a direction, a unit vector, and a Mach number."""
        return GAS.stream(direction, speed)

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Initial fields, and settings by place."""
        return _fields(stream, self.planes), _settings(self.max_iterations, self.tolerance)


def openfoam_forces(
    topology: Topology,
    nodes: np.ndarray,
    mach: float,
    alpha: float,
    reference_area: float,
    axes: str = "xzy",
    max_iterations: int = 1000,
) -> Forces | None:
    """Solve the flow about a body with OpenFOAM.

    Parameters
    ----------
    topology : Topology
        The topology of the grid, with its patches.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of the grid (m).
    mach, alpha : float
        Mach number and angle of attack (deg).
    reference_area : float
        Of the half in the grid, if it is a half (m^2).
    axes : str
        Axes of the grid that point downstream, along the span and up.
    max_iterations : int
        Iterations after which it ends in any case.

    Returns
    -------
    Forces or None
        None, after a line that says so, if OpenFOAM is not installed.

    Raises
    ------
    InputError
        If no patch is a wall.
    SolverError
        If OpenFOAM stops with an error, or the flow diverges.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.flow import openfoam_forces
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((9, 8, 7)))
    >>> nodes = model.regenerate().to_vector().reshape(-1, 3)
    >>> forces = openfoam_forces(model.topology, nodes, 0.5, 3.0, reference_area=0.75)  # doctest: +SKIP
    """
    if not is_there("rhoSimpleFoam"):
        print("OpenFOAM is not installed; skipped")
        return None
    cells, case = CellFaces.of(topology, nodes), InviscidCase(max_iterations)
    drag, lift = stream_axes(np.radians(alpha), as_axes(axes, "OpenFOAM"))
    stream = case.stream(drag, mach)
    wall = cells.faces_of("wall")
    if len(wall) == 0:
        raise InputError(f"{topology.source}: no patch is of kind wall; declare patches")
    with tempfile.TemporaryDirectory() as folder:
        PolyMesh.of(topology, nodes).write_case(folder, *case.files(stream))
        start = time.perf_counter()
        log = run_program("rhoSimpleFoam", Path(folder))
        seconds = time.perf_counter() - start
        found = Convergence.of("rhoSimpleFoam", log)
        pressure = WrittenField.read(CaseFolder(folder).last, "p").internal(cells.n_cells)
    Cp = (pressure[cells.left[wall]] - stream.pressure) / stream.dynamic_pressure
    force = Cp @ area_vectors(nodes[cells.corners[wall]]) / reference_area
    return Forces(float(force @ lift), float(force @ drag), Cp, found.residuals, found.is_converged, seconds)


def _settings(max_iterations: int, tolerance: float) -> dict[str, str]:
    """Settings by place."""
    numbers = {"program": InviscidCase.program, "iterations": max_iterations, "tolerance": tolerance}
    return {name: text % numbers for name, text in SETTINGS.items()}


def _fields(stream: FreeStream, planes: Planes) -> dict[str, CaseField]:
    """Fields: slip at walls, the free stream on all patches except symmetry."""
    velocity = stream.velocity.tolist()
    pressure, temperature, vector = (
        f"uniform {text}" for text in (GAS.pressure, GAS.temperature, f"({' '.join(map(str, velocity))})")
    )
    mirror = {"symmetry": f"type {planes};"}
    return {
        "p": CaseField(
            "[1 -1 -2 0 0 0 0]",
            GAS.pressure,
            {**mirror, "wall": "type zeroGradient;", "other": f"type freestreamPressure; freestreamValue {pressure};"},
        ),
        "T": CaseField(
            "[0 0 0 1 0 0 0]",
            GAS.temperature,
            {
                **mirror,
                "wall": "type zeroGradient;",
                "other": f"type inletOutlet; inletValue {temperature}; value {temperature};",
            },
        ),
        "U": CaseField(
            "[0 1 -1 0 0 0 0]",
            velocity,
            {**mirror, "wall": "type slip;", "other": f"type freestreamVelocity; freestreamValue {vector};"},
        ),
    }


SETTINGS = {
    "constant/thermophysicalProperties": GAS.dictionary("0", 1),
    "constant/turbulenceProperties": "simulationType laminar;\n",
    "system/controlDict": CONTROL,
    "system/fvSchemes": """
ddtSchemes { default steadyState; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default Gauss linear;
    div(phi,U) bounded Gauss linearUpwind grad(U);
    div(phi,h) bounded Gauss linearUpwind grad(h);
    div(phi,K) bounded Gauss linearUpwind grad(K);
}
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
""",
    "system/fvSolution": """
solvers
{
    p { solver GAMG; smoother DICGaussSeidel; tolerance 1e-12; relTol 0.05; }
    "(U|h)" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-14; relTol 0.1; }
}
SIMPLE
{
    nNonOrthogonalCorrectors 0; consistent yes; transonic no;
    residualControl { "(p|U|h)" %(tolerance)g; }
}
relaxationFactors { equations { U 0.9; h 0.9; } }
""",
}
"""Files of settings by name."""
