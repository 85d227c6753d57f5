"""Derivatives of forces by the points of walls, from OpenFOAM's continuous adjoint (``adjointOptimisationFoam``).

The adjoint equations are solved on the mesh of a solved flow, one solution for each function: in a folder of its own in
the case, from the fields of the flow. If the flow uses the Spalart-Allmaras model, so does the adjoint: turbulence is
not frozen, and the adjoint of the distance to the walls is solved as well.

The derivatives are the sensitivity map ``surfacePoints``: a vector for every point of a wall, by the enhanced surface
integrals, which include the adjoint of a Laplacian that would move the mesh. They belong to the shape of the walls, so
inner points have none. They are derivatives of the equations and not of the scheme: on finer meshes both converge where
walls are smooth, but not at sharp trailing edges, nor for a body that moves as a whole. For their accuracy see
``docs/howto/openfoam_flow.rst``.

The derivative by the velocity of the free stream is computed from the fluxes through the inflow faces of the far field,
with adjoint pressure and velocity in the cells behind them. Friction there is left out.

References
----------
I. S. Kavvadias, E. M. Papoutsis-Kiachagias and K. C. Giannakoglou, "On the proper treatment of grid sensitivities in
continuous adjoint methods for shape optimization", J. Computational Physics 301 (2015), 1-18: the integrals.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.display import OneLine
from ...errors import InputError, SolverError
from ...grids.io.formats import POLYMESH
from ...grids.io.meshes.foam_lists import FoamFile
from .case_fields import WrittenField
from .case_folder import CaseFolder
from .wall_loads import CaseWalls

__all__ = ["AdjointRun", "AdjointSolution", "FlowFunction", "Opening"]

PROGRAM = "adjointOptimisationFoam"

Opening = Literal["farfield", "inlet", "outlet"]

_ZERO, _NONE = "value uniform 0;", "value uniform (0 0 0);"

CONDITIONS = {
    "Ua": {
        "wall": f"type adjointWallVelocity; {_NONE}",
        "farfield": f"type adjointFarFieldVelocity; {_NONE}",
        "inlet": f"type adjointInletVelocity; {_NONE}",
        "outlet": f"type adjointOutletVelocity; {_NONE}",
    },
    "pa": {
        "wall": "type zeroGradient;",
        "farfield": f"type adjointFarFieldPressure; {_ZERO}",
        "inlet": "type zeroGradient;",
        "outlet": f"type adjointOutletPressure; {_ZERO}",
    },
    "nuaTilda": {
        "wall": f"type fixedValue; {_ZERO}",
        "farfield": f"type adjointFarFieldNuaTilda; {_ZERO}",
        "inlet": f"type adjointInletNuaTilda; {_ZERO}",
        "outlet": f"type adjointOutletNuaTilda; {_ZERO}",
    },
}
"""Conditions of the adjoint fields on walls and openings."""

UNITS = {"Ua": "[0 1 -1 0 0 0 0]", "pa": "[0 2 -2 0 0 0 0]", "nuaTilda": "[0 0 -1 0 0 0 0]"}
"""Units of the adjoint fields, as OpenFOAM writes them."""

_TYPES = re.compile(r"([^\s{}()]+)\s*\{[^}]*?\btype\s+(\w+)\s*;")
_MODEL = re.compile(r"\b(?:RASModel|model)\s+(\w+)\s*;")
_VALUE = re.compile(r"^(\S+) : (\S+)\s*$", re.MULTILINE)
_ENDED = re.compile(r"^(primal|adjoint) solution converged in (\d+) iterations", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class FlowFunction(OneLine):
    """A function of a flow with an adjoint in OpenFOAM: its name, also of its folder, and entry in ``objectiveNames``.

    Examples
    --------
    >>> from bspline_mdao.flow.openfoam.adjoint import FlowFunction
    >>> FlowFunction.pressure_losses("losses", ["inlet", "outlet"]).entry
    'type PtLosses; patches (inlet outlet);'
    """

    name: str
    entry: str

    def __post_init__(self) -> None:
        if not re.fullmatch(r"\w+", self.name):
            raise InputError(f"adjoint: '{self.name}' is no name of a function; give letters and digits")

    @classmethod
    def force(cls, name: str, walls: Sequence[str], direction: ArrayLike, speed: float, area: float) -> FlowFunction:
        """Force on walls along a direction, divided by the dynamic pressure and an area (m^2)."""
        words = f"direction {_words(direction)}; Aref {float(area)!r}; rhoInf 1; UInf {float(speed)!r};"
        return cls(name, f"type force; patches ({' '.join(walls)}); {words}")

    @classmethod
    def moment(
        cls,
        name: str,
        walls: Sequence[str],
        axis: ArrayLike,
        speed: float,
        references: tuple[float, float, ArrayLike],  # area (m^2), chord (m) and point (m)
    ) -> FlowFunction:
        """Moment on walls about an axis through a point, divided by the dynamic pressure, an area and a chord."""
        area, chord, point = references
        words = (
            f"direction {_words(axis)}; rotationCenter {_words(point)}; Aref {float(area)!r}; lRef {float(chord)!r}; "
            f"rhoInf 1; UInf {float(speed)!r};"
        )
        return cls(name, f"type moment; patches ({' '.join(walls)}); {words}")

    @classmethod
    def pressure_losses(cls, name: str, openings: Sequence[str]) -> FlowFunction:
        """Loss of total pressure between openings, weighted by the flux through them: OpenFOAM's ``PtLosses``."""
        return cls(name, f"type PtLosses; patches ({' '.join(openings)});")


@dataclass(frozen=True, eq=False)
class AdjointSolution(OneLine):
    """A function of a flow, and its derivatives."""

    value: float  # of the function, from OpenFOAM
    gradient: np.ndarray  # (n_points, 3), by the points of the case (1/m); zero for points that are on no wall
    by_velocity: np.ndarray  # (3,), by the velocity of the free stream (s/m); zero without far field
    n_flow: int  # iterations for the flow to converge again
    n_adjoint: int  # iterations of the adjoint


@dataclass(frozen=True, eq=False)
class AdjointRun(OneLine):
    """Settings for adjoints of a flow."""

    walls: Sequence[str]  # patches whose points have derivatives
    openings: Mapping[str, Opening]  # roles of the other patches that are neither walls nor planes
    tolerance: float = 1e-6  # for the initial residuals of flow and adjoint
    max_iterations: int = 5000  # of each of them
    time_limit: float | None = None  # s
    slices: tuple[int, int, int] = (1, 1, 1)  # number of parts of cells along x, y and z, one part per process

    def solve(
        self,
        case: Path,  # the case of the flow
        time: Path,  # folder of the time of its solution
        function: FlowFunction,
    ) -> AdjointSolution:
        """Solve the adjoint of one function, from the last adjoint in the same case if it has as many cells.

        Raises `InputError` if a patch of the case is neither wall nor plane nor among the openings, or the turbulence
        model has no adjoint; `SolverError` if OpenFOAM is missing, fails, or does not converge.
        """
        folder = CaseFolder(case / f"adjoint_{function.name}")
        with folder.locked():
            before = {name: WrittenField.read(folder.last, name) for name in UNITS if _has(folder, name)}
            self._write(folder.path, case, time, function, before)
            folder.remove_times()
            log = folder.solve(PROGRAM, self.slices, self.time_limit)
            return self._read(folder, log)

    def _write(
        self, place: Path, case: Path, time: Path, function: FlowFunction, before: Mapping[str, WrittenField]
    ) -> None:
        """Write the case of the adjoint."""
        shutil.rmtree(place / "0", ignore_errors=True)
        shutil.copytree(time, place / "0", ignore=shutil.ignore_patterns("uniform", "*.gz"))
        shutil.copytree(case / "constant", place / "constant", dirs_exist_ok=True)
        model = self._model(case)
        boundary = FoamFile.read(case / "constant" / POLYMESH, "boundary").data.decode()
        kinds = dict(_TYPES.findall(boundary))
        names = ["Ua", "pa"] + ["nuaTilda"] * (model == "SpalartAllmaras")
        for name in names:
            text = self._field(name, kinds)
            if name in before:
                start = WrittenField(place / "0" / name, text)
                text = start.with_internal(before[name].internal_entry)
            (place / "0" / name).write_text(text)
        adjoint = {"laminar": "adjointLaminar"}.get(model, f"adjoint{model}")
        files = {
            "constant/adjointRASProperties": f"adjointRASModel {adjoint}; adjointTurbulence on; printCoeffs off;",
            "system/controlDict": DICTIONARIES["controlDict"] % {"n": 2 * self.max_iterations + 1},
            **{
                f"system/{name}": (case / "system" / name).read_text() + DICTIONARIES[name]
                for name in ("fvSchemes", "fvSolution")
            },
            "system/optimisationDict": DICTIONARIES["optimisationDict"]
            % {
                "n": self.max_iterations,
                "tolerance": self.tolerance,
                "function": function.entry,
                "walls": " ".join(self.walls),
            },
        }
        (place / "system").mkdir(exist_ok=True)
        for name, text in files.items():
            head = "" if text.lstrip().startswith(("FoamFile", "/*")) else _head("dictionary", Path(name).name)
            (place / name).write_text(head + text + "\n")

    def _model(self, case: Path) -> str:
        """Turbulence model of a case, or ``laminar``."""
        text = (case / "constant" / "turbulenceProperties").read_text()
        if re.search(r"simulationType\s+laminar\s*;", text):
            return "laminar"
        found = _MODEL.search(text)
        if found is None or found[1] != "SpalartAllmaras":
            name = found[1] if found else "none"
            raise InputError(
                f"{case}: OpenFOAM has no adjoint of the turbulence model '{name}'; take SpalartAllmaras, or laminar"
            )
        return found[1]

    def _field(self, name: str, kinds: Mapping[str, str]) -> str:
        """Text of an adjoint field that is zero in cells."""
        entries = []
        for patch, kind in kinds.items():
            role = "wall" if kind == "wall" else self.openings.get(patch, "") if kind == "patch" else None
            if role == "":
                raise InputError(
                    f"adjoint: nothing says whether patch '{patch}' is an inlet, an outlet or a far field; name it "
                    f"among the openings"
                )
            entries.append(f"    {patch} {{ {CONDITIONS[name][role] if role else f'type {kind};'} }}\n")
        zero = "uniform (0 0 0)" if name == "Ua" else "uniform 0"
        kind = "volVectorField" if name == "Ua" else "volScalarField"
        body = f"dimensions {UNITS[name]};\ninternalField {zero};\nboundaryField\n{{\n{''.join(entries)}}}\n"
        return _head(kind, name) + body

    def _read(self, folder: CaseFolder, log: str) -> AdjointSolution:
        """Read the results of OpenFOAM."""
        ended = {name: int(n) for name, n in _ENDED.findall(log)}
        for name, what in (("primal", "flow"), ("adjoint", "adjoint")):
            if name not in ended:
                raise SolverError(
                    f"{PROGRAM} in {folder.path}: the {what} did not come below {self.tolerance:g} in "
                    f"{self.max_iterations} iterations; allow more, or relax it more"
                )
        n_points = len(CaseWalls.of(folder.path / "constant" / POLYMESH, self.walls).points)
        values = [float(value) for name, value in _VALUE.findall(log) if name == "function"]
        gradient = WrittenField.read(folder.last, "pointSensVecadjointESI").internal(n_points)
        by_velocity = self._by_velocity(folder)
        if not (np.isfinite(gradient).all() and np.isfinite(by_velocity).all()):
            raise SolverError(f"{PROGRAM} in {folder.path}: derivatives are not finite; check the mesh")
        return AdjointSolution(values[-1], gradient, by_velocity, ended["primal"], ended["adjoint"] - ended["primal"])

    def _by_velocity(self, folder: CaseFolder) -> np.ndarray:
        """Derivative by the velocity of the free stream."""
        far = CaseWalls.of(
            folder.path / "constant" / POLYMESH, [name for name, role in self.openings.items() if role == "farfield"]
        )
        if far.n_faces == 0:
            return np.zeros(3)
        _, areas = far.geometry()
        pa, Ua, U = (
            WrittenField.read(folder.last, name).internal(far.n_cells)[far.cells] for name in ("pa", "Ua", "U")
        )
        flux = np.minimum(np.sum(U * areas, axis=1), 0.0)  # inflow only
        comes_in = flux < 0.0
        return np.sum(flux[:, None] * Ua, axis=0) - pa[comes_in] @ areas[comes_in]


def _has(folder: CaseFolder, name: str) -> bool:
    """Whether a folder has a field at a last time."""
    return bool(folder.times) and (folder.last / name).is_file()


def _words(vector: ArrayLike) -> str:
    """Three numbers in OpenFOAM's syntax."""
    return f"({' '.join(map(repr, np.asarray(vector, dtype=float).tolist()))})"


def _head(kind: str, name: str) -> str:
    """Header of a file."""
    return f"FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"


DICTIONARIES = {
    "controlDict": """
application adjointOptimisationFoam; startFrom startTime; startTime 0; stopAt endTime; endTime %(n)d; deltaT 1;
writeControl timeStep; writeInterval %(n)d; writeFormat ascii; writePrecision 16; timePrecision 8;
""",
    "fvSchemes": """
gradSchemes { gradUaConv Gauss linear; gradNuaTildaConv Gauss linear; }
divSchemes
{
    default Gauss linear;
    div(-phi,Ua) bounded Gauss linearUpwind gradUaConv;
    div(-phi,nuaTilda) bounded Gauss linearUpwind gradNuaTildaConv;
    div(-yPhi,da) Gauss linearUpwind grad(da);
}
""",
    # the program needs relaxation as for SIMPLE: with the factors of SIMPLEC it diverges
    "fvSolution": """
solvers
{
    "pa|ma" { solver PCG; preconditioner DIC; tolerance 1e-12; relTol 0.01; }
    "Ua|nuaTilda|da" { solver PBiCGStab; preconditioner DILU; tolerance 1e-12; relTol 0.1; }
}
SIMPLE { consistent no; }
relaxationFactors
{
    fields { p 0.3; pa 0.3; }
    equations { U 0.7; nuTilda 0.5; Ua 0.7; nuaTilda 0.5; da 0.7; }
}
""",
    # derivatives by points, not by areas, with the adjoint of the movement, and of the distance if a model uses one
    "optimisationDict": """
optimisationManager singleRun;
primalSolvers
{
    primal
    {
        active true; type incompressible; solver simple;
        solutionControls { nIters %(n)d; residualControl { "(p|U|nuTilda).*" %(tolerance)g; } }
    }
}
adjointManagers
{
    manager
    {
        primalSolver primal;
        adjointSolvers
        {
            adjoint
            {
                active true; type incompressible; solver adjointSimple; computeSensitivities true;
                objectives { type incompressible; objectiveNames { function { weight 1; %(function)s } } }
                ATCModel { ATCModel standard; }
                solutionControls { nIters %(n)d; residualControl { "(pa|Ua|nuaTilda).*" %(tolerance)g; } }
            }
        }
    }
}
optimisation
{
    sensitivities
    {
        type surfacePoints; patches (%(walls)s);
        includeSurfaceArea true; includeMeshMovement true; writeAllSurfaceFiles true;
        adjointMeshMovementSolver { iters 1000; tolerance 1e-8; }
        adjointEikonalSolver { iters 1000; tolerance 1e-6; epsilon 0.1; }
    }
}
""",
}
"""Additions to the schemes and solvers of the flow, which come first in their files: later entries win."""
