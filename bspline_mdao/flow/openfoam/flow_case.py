"""Common parts of all cases about a body: a program, a free stream, and the files made from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ...base.display import OneLine
from ...grids.io.openfoam import CaseField, Planes

__all__ = ["CONTROL", "FlowCase", "FreeStream", "PerfectGas", "SpeedName"]

SpeedName = Literal["Mach_number", "speed"]
"""Input for the speed of a flow: the Mach number, or m/s."""


@dataclass(frozen=True, eq=False)
class FreeStream(OneLine):
    """The flow far from the body, in the units of the fields: kinematic for incompressible flow."""

    velocity: np.ndarray  # (3,), m/s
    pressure: float  # as in the field ``p``: Pa, or m^2/s^2
    dynamic_pressure: float  # in the same unit

    @property
    def speed(self) -> float:
        """Speed (m/s)."""
        return float(np.linalg.norm(self.velocity))

    @property
    def density(self) -> float:
        """Density (kg/m^3); 1 if the fields are kinematic."""
        return 2.0 * self.dynamic_pressure / self.speed**2


@dataclass(frozen=True)
class PerfectGas:
    """A perfect gas far from the body."""

    ratio: float  # of heats
    constant: float  # gas constant (J/(kg K))
    pressure: float  # Pa
    temperature: float  # K

    def stream(self, direction: np.ndarray, mach: float) -> FreeStream:
        """Free stream for a direction, a unit vector, and a Mach number."""
        sound = np.sqrt(self.ratio * self.constant * self.temperature)
        dynamic_pressure = 0.5 * self.ratio * self.pressure * mach**2
        return FreeStream(mach * sound * np.asarray(direction), self.pressure, dynamic_pressure)

    def dictionary(self, viscosity: str, prandtl: float) -> str:
        """Text of ``thermophysicalProperties``, with a dynamic viscosity (Pa s)."""
        return f"""
thermoType
{{
    type hePsiThermo; mixture pureMixture; transport const; thermo hConst; equationOfState perfectGas;
    specie specie; energy sensibleEnthalpy;
}}
mixture
{{
    specie {{ molWeight {8314.47 / self.constant}; }}
    thermodynamics {{ Cp {self.ratio / (self.ratio - 1.0) * self.constant}; Hf 0; }}
    transport {{ mu {viscosity}; Pr {prandtl}; }}
}}
"""


class FlowCase(Protocol):
    """A kind of flow, whatever its mesh."""

    @property
    def program(self) -> str:
        """Program that solves it."""

    @property
    def speed_name(self) -> SpeedName:
        """Input for its speed."""

    @property
    def is_viscous(self) -> bool:
        """Whether there is friction on walls."""

    @property
    def planes(self) -> Planes:
        """Type of patches of kind symmetry."""

    def stream(self, direction: np.ndarray, speed: float) -> FreeStream:
        """Free stream for a direction, a unit vector, and a Mach number or speed."""

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Initial fields, and settings by place, see `write_case`."""


CONTROL = """
application %(program)s; startFrom startTime; startTime 0; stopAt endTime; endTime %(iterations)d; deltaT 1;
writeControl timeStep; writeInterval %(iterations)d; writeFormat ascii; writePrecision 12; timePrecision 8;
"""
"""Text of ``controlDict``, with placeholders for program and iterations."""
