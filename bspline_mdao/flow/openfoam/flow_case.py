"""What every case about a body has: a program, a free stream, and the files that are made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ...base.display import OneLine
from ...grids.io.openfoam import CaseField, Planes

__all__ = ["FlowCase", "FreeStream", "SpeedName"]

SpeedName = Literal["Mach_number", "speed"]
"""What the speed of a flow is given by: the Mach number, or m/s."""


@dataclass(frozen=True, eq=False)
class FreeStream(OneLine):
    """The flow far from the body, in the units of the fields: kinematic where the flow is incompressible."""

    velocity: np.ndarray  # (3,), m/s
    pressure: float  # as the field ``p`` has it: Pa, or m^2/s^2
    dynamic_pressure: float  # in the same unit

    @property
    def speed(self) -> float:
        """Speed (m/s)."""
        return float(np.linalg.norm(self.velocity))

    @property
    def density(self) -> float:
        """Density (kg/m^3); 1 where the fields are kinematic."""
        return 2.0 * self.dynamic_pressure / self.speed**2


class FlowCase(Protocol):
    """A kind of flow, whatever its mesh."""

    @property
    def program(self) -> str:
        """Program that solves it."""

    @property
    def speed_name(self) -> SpeedName:
        """What its speed is given by."""

    @property
    def is_viscous(self) -> bool:
        """Whether there is friction on walls."""

    @property
    def planes(self) -> Planes:
        """Type of patches of kind symmetry."""

    def stream(self, direction: np.ndarray, speed: float) -> FreeStream:
        """Free stream of a direction, a unit vector, and a Mach number or speed."""

    def files(self, stream: FreeStream) -> tuple[dict[str, CaseField], dict[str, str]]:
        """Fields to start from, and settings by their places, see `write_case`."""
