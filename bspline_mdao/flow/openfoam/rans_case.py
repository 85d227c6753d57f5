"""RANS cases of OpenFOAM: initial fields and settings of ``simpleFoam`` and ``rhoSimpleFoam``.

Convection of momentum and energy is ``linearUpwind`` and of turbulence ``limitedLinear``, all else is central: second
order throughout. SIMPLEC couples velocity and pressure. Turbulence is relaxed by 0.5: its production is explicit in
OpenFOAM, and with 0.7 cells at walls oscillate between two values from one iteration to the next if y+ is 2 or more.

References
----------
C. L. Rumsey, "Turbulence Modeling Resource", NASA Langley, https://turbmodels.larc.nasa.gov: turbulence far from the
body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.wall_spacing import flat_plate_y_plus
from ...grids.io.openfoam import CaseField, Planes
from .flow_case import CONTROL, FreeStream, PerfectGas, SpeedName

__all__ = ["RansCase"]

GAS = PerfectGas(1.4, 287.05, 101325.0, 288.15)
"""Ratio of heats, gas constant (J/(kg K)), and free stream (Pa, K) of compressible cases."""

LOWEST, HIGHEST = GAS.temperature / 2.0, 2.0 * GAS.temperature
"""Limits of temperatures (K), which are only reached in the first iterations."""

PRANDTL = 0.72
"""Prandtl number of air."""

FARFIELD_NU_TILDA = 3.0
"""Spalart-Allmaras variable far from the body, relative to the viscosity: fully turbulent."""

FARFIELD_ENERGY, FARFIELD_EDDIES = 4e-7, 0.009
"""SST model far from the body: k relative to the square of the speed, eddy viscosity relative to the viscosity."""

TURBULENCE_TOLERANCE = 10.0
"""Tolerance of turbulence relative to the flow: on an O-grid of 192 x 96 cells the limiter of its convection holds the
residual at 2e-6, while the residual of pressure falls to 1e-9."""

Turbulence = Literal["SpalartAllmaras", "kOmegaSST"]
WallTreatment = Literal["resolved", "functions"]

TRANSPORTED: dict[str, tuple[str, ...]] = {"SpalartAllmaras": ("nuTilda",), "kOmegaSST": ("k", "omega")}
"""Variables that each model transports."""

LENGTH_SQUARED_PER_TIME = "[0 2 -1 0 0 0 0]"


@dataclass(frozen=True, eq=False)
class RansCase(OneLine):
    """Turbulent flow by simpleFoam or rhoSimpleFoam: no slip at walls, the free stream far from the body.

    Parameters
    ----------
    reynolds_number : float
        By the speed and `length`; it stays fixed if the speed changes.
    length : float
        Reference length of the Reynolds number (m): usually the chord.
    compressible : bool
        False: ``simpleFoam``, with the speed in m/s. True: ``rhoSimpleFoam`` for a perfect gas of constant viscosity,
        with the speed given by the Mach number.
    turbulence : {"SpalartAllmaras", "kOmegaSST"}
        Turbulence model. The flow is turbulent everywhere.
    walls : {"resolved", "functions"}
        Boundary layers are resolved to the wall, for y+ of 1 or less, or start with Spalding's law of the wall, for y+
        up to 300.
    planes : {"symmetry", "symmetryPlane", "empty"}
        OpenFOAM's type of the patches of kind symmetry. Sections, whose grid is one cell deep, need ``empty``: with
        ``symmetry``, the velocity along the span is also solved for, and its residual never falls.
    max_iterations : int
        Iterations after which it ends in any case.
    tolerance : float
        For the initial residuals, as OpenFOAM scales them; those of turbulence may be ten times as large.

    Raises
    ------
    InputError
        If a number is not positive, or a name is unknown.

    Examples
    --------
    >>> from bspline_mdao.flow import RansCase
    >>> case = RansCase(6e6, planes="empty")
    >>> case.program, case.expected_y_plus([6e-6]).round(2).tolist()
    ('simpleFoam', [0.69])
    """

    reynolds_number: float
    length: float = 1.0
    compressible: bool = False
    turbulence: Turbulence = "SpalartAllmaras"
    walls: WallTreatment = "resolved"
    planes: Planes = "symmetry"
    max_iterations: int = 3000
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        for name in ("reynolds_number", "length", "max_iterations", "tolerance"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"RansCase: {name} {getattr(self, name)}; give a positive number")
        for name, kinds in (("turbulence", Turbulence), ("walls", WallTreatment), ("planes", Planes)):
            if getattr(self, name) not in get_args(kinds):
                raise InputError(f"RansCase: {name} '{getattr(self, name)}'; give one of {', '.join(get_args(kinds))}")

    @property
    def program(self) -> str:
        """Program that solves it."""
        return "rhoSimpleFoam" if self.compressible else "simpleFoam"

    @property
    def speed_name(self) -> SpeedName:
        """Input for its speed."""
        return "Mach_number" if self.compressible else "speed"

    @property
    def is_viscous(self) -> bool:
        """Whether there is friction on walls."""
        return True

    def stream(self, direction: np.ndarray, speed: float) -> FreeStream:
        """Free stream for a direction, a unit vector, and a speed (m/s), or a Mach number."""
        if not self.compressible:
            return FreeStream(speed * np.asarray(direction), 0.0, 0.5 * speed**2)
        return GAS.stream(direction, speed)

    def viscosity(self, stream: FreeStream) -> float:
        """Kinematic viscosity of the free stream (m^2/s)."""
        return stream.speed * self.length / self.reynolds_number

    def expected_y_plus(self, heights: np.ndarray) -> np.ndarray:
        """Estimate y+ at the centres of first cells, from their heights (m), by a flat plate of the case's length."""
        per_metre = self.reynolds_number / self.length
        return np.array([flat_plate_y_plus(0.5 * height, per_metre, self.length) for height in np.ravel(heights)])

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Initial fields, and settings by place, see `write_case`."""
        field = _Conditions(self.planes).field
        fields = self._flow_fields(field, stream) | self._turbulence_fields(field, stream)
        return fields, self._settings(stream)

    def _flow_fields(self, field: Callable[..., CaseField], stream: FreeStream) -> dict[str, CaseField]:
        velocity, pressure = stream.velocity.tolist(), stream.pressure
        unit = "[1 -1 -2 0 0 0 0]" if self.compressible else "[0 2 -2 0 0 0 0]"
        fields = {
            "U": field(
                "[0 1 -1 0 0 0 0]",
                velocity,
                "type noSlip;",
                f"type freestreamVelocity; freestreamValue uniform ({' '.join(map(repr, velocity))});",
            ),
            "p": field(
                unit, pressure, "type zeroGradient;", f"type freestreamPressure; freestreamValue uniform {pressure!r};"
            ),
        }
        if self.compressible:
            fields["T"] = field("[0 0 0 1 0 0 0]", GAS.temperature, "type zeroGradient;", _incoming(GAS.temperature))
        return fields

    def _turbulence_fields(self, field: Callable[..., CaseField], stream: FreeStream) -> dict[str, CaseField]:
        viscosity, is_resolved = self.viscosity(stream), self.walls == "resolved"
        nothing = "type fixedValue; value uniform 0;"
        if self.turbulence == "SpalartAllmaras":
            variable = FARFIELD_NU_TILDA * viscosity
            eddies = variable * FARFIELD_NU_TILDA**3 / (FARFIELD_NU_TILDA**3 + 7.1**3)  # f_v1 of the model
            fields = {"nuTilda": field(LENGTH_SQUARED_PER_TIME, variable, nothing, _incoming(variable))}
        else:
            energy, eddies = FARFIELD_ENERGY * stream.speed**2, FARFIELD_EDDIES * viscosity
            rate = energy / eddies
            energy_at_wall = nothing if is_resolved else f"type kqRWallFunction; value uniform {energy!r};"
            fields = {
                "k": field("[0 2 -2 0 0 0 0]", energy, energy_at_wall, _incoming(energy)),
                "omega": field(
                    "[0 0 -1 0 0 0 0]", rate, f"type omegaWallFunction; value uniform {rate!r};", _incoming(rate)
                ),
            }
        eddies_at_wall = "nutLowReWallFunction" if is_resolved else "nutUSpaldingWallFunction"
        at_wall = f"type {eddies_at_wall}; value uniform 0;"
        fields["nut"] = field(LENGTH_SQUARED_PER_TIME, eddies, at_wall, f"type calculated; value uniform {eddies!r};")
        if self.compressible:
            fields["alphat"] = field(
                "[1 -1 -1 0 0 0 0]",
                0.0,
                "type compressible::alphatWallFunction; value uniform 0;",
                "type calculated; value uniform 0;",
            )
        return fields

    def _settings(self, stream: FreeStream) -> dict[str, str]:
        """Texts of the dictionaries."""
        turbulence = TRANSPORTED[self.turbulence]
        numbers = {
            "program": self.program,
            "iterations": self.max_iterations,
            "tolerance": self.tolerance,
            "turbulence_tolerance": TURBULENCE_TOLERANCE * self.tolerance,
            "turbulence": "|".join(turbulence),
            "model": self.turbulence,
            "viscosity": repr(self.viscosity(stream)),
        }
        convection = "\n    ".join(f"div(phi,{name}) bounded Gauss limitedLinear 1;" for name in turbulence)
        texts = {name: text % {**numbers, "convection": convection} for name, text in COMMON.items()}
        if not self.compressible:
            return texts | {name: text % numbers for name, text in INCOMPRESSIBLE.items()}
        gas = {"mu": repr(stream.density * self.viscosity(stream))}
        return texts | {name: text % {**numbers, **gas} for name, text in COMPRESSIBLE.items()}


@dataclass(frozen=True)
class _Conditions:
    """Conditions of all fields on planes."""

    planes: Planes

    def field(self, unit: str, value: float | list[float], at_wall: str, far: str) -> CaseField:
        """A field with the free stream's value, and its conditions at walls and far from them."""
        return CaseField(unit, value, {"wall": at_wall, "symmetry": f"type {self.planes};", "other": far})


def _incoming(value: float) -> str:
    """Condition far from walls: a value at inflow, no gradient at outflow."""
    return f"type inletOutlet; inletValue uniform {value!r}; value uniform {value!r};"


COMMON = {
    "constant/turbulenceProperties": "simulationType RAS;\nRAS { RASModel %(model)s; turbulence on; }\n",
    "system/controlDict": CONTROL,
    "system/fvSchemes": """
ddtSchemes { default steadyState; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default none;
    div(phi,U) bounded Gauss linearUpwind grad(U);
    div(phi,h) bounded Gauss linearUpwind grad(h);
    div(phi,K) bounded Gauss linearUpwind grad(K);
    %(convection)s
    div((nuEff*dev2(T(grad(U))))) Gauss linear;
    div(((rho*nuEff)*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
wallDist { method meshWave; }
""",
}
"""Files of settings of all cases, by name."""

INCOMPRESSIBLE = {
    "constant/transportProperties": "transportModel Newtonian;\nnu %(viscosity)s;\n",
    "system/fvSolution": """
solvers
{
    p { solver GAMG; smoother DICGaussSeidel; tolerance 1e-12; relTol 0.05; }
    "(U|%(turbulence)s)" { solver PBiCGStab; preconditioner DILU; tolerance 1e-14; relTol 0.1; }
}
SIMPLE
{
    nNonOrthogonalCorrectors 0; consistent yes;
    residualControl { "(p|U)" %(tolerance)g; "(%(turbulence)s)" %(turbulence_tolerance)g; }
}
relaxationFactors { equations { U 0.9; "(%(turbulence)s)" 0.5; } }
""",
}
"""Files of settings of simpleFoam."""

COMPRESSIBLE = {
    "constant/thermophysicalProperties": GAS.dictionary("%(mu)s", PRANDTL),
    "system/fvSolution": """
solvers
{
    p { solver GAMG; smoother DICGaussSeidel; tolerance 1e-12; relTol 0.05; }
    "(U|h|%(turbulence)s)" { solver PBiCGStab; preconditioner DILU; tolerance 1e-14; relTol 0.1; }
}
SIMPLE
{
    nNonOrthogonalCorrectors 0; consistent yes; transonic no;
    pMinFactor 0.1; pMaxFactor 2;
    residualControl { "(p|U|h)" %(tolerance)g; "(%(turbulence)s)" %(turbulence_tolerance)g; }
}
relaxationFactors { equations { U 0.9; h 0.9; "(%(turbulence)s)" 0.5; } }
""",
    "system/fvOptions": f"""
limits {{ type limitTemperature; active yes; selectionMode all; min {LOWEST}; max {HIGHEST}; }}
""",
}
"""Files of settings of rhoSimpleFoam. Pressures and temperatures only reach their limits in the first iterations, which
would otherwise give negative ones from the uniform stream."""
