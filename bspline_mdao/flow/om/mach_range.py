"""Mach numbers at which flows were validated, and a warning for others.

The comparisons are in ``docs/validation.rst``, ``docs/flow.rst`` and ``docs/theory``.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...errors import MachNumberWarning

__all__ = ["EULER", "LATTICE", "MachRange", "MachWatch", "warn_of_mach_number"]


class MachRange(NamedTuple):
    """Mach numbers of the free stream at which a flow was validated against exact solutions, codes or measurements."""

    lowest: float
    highest: float

    def fault(self, mach: float) -> str:
        """Say that a Mach number is outside; empty if it is not."""
        if self.lowest <= mach <= self.highest:
            return ""
        return (
            f"Mach_number is {mach:g}; results were compared with others only from {self.lowest:g} to "
            f"{self.highest:g}, see Validation in the documentation"
        )


EULER = MachRange(0.1, 0.84)
"""Of `EulerFlow`: from potential flow about NACA 0012 (``docs/theory/euler.rst``) to measurements about the ONERA M6 at
0.8395 (``docs/validation.rst``)."""

LATTICE = MachRange(0.0, 0.5)
"""Of the vortex lattice: from OpenAeroStruct's own incompressible flow to the ellipse of a wing at 0.5
(``docs/theory/vortex_lattice.rst``). The Prandtl-Glauert rule has no shocks."""


def warn_of_mach_number(
    path: str,  # path of a component of the flow
    mach: float,
    known: MachRange,
) -> bool:
    """Warn if a Mach number is outside a range, and return whether it is."""
    fault = known.fault(mach)
    if fault:
        warnings.warn(f"{path.rpartition('.')[0] or 'flow'}: {fault}", MachNumberWarning, stacklevel=2)
    return bool(fault)


class MachWatch(om.ExplicitComponent):
    """Checks the Mach number of a flow whose components belong to other packages."""

    # ===============  =====  =====  =====  =====================
    # name             role   shape  units  meaning
    # ===============  =====  =====  =====  =====================
    # ``Mach_number``  input  (1,)          of the free stream
    # ===============  =====  =====  =====  =====================

    def setup(self) -> None:
        """Declare the input."""
        self._is_said = False
        self.add_input("Mach_number", val=0.0, desc="of the free stream")

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Warn once."""
        if not self._is_said and self.comm.rank == 0:
            mach = float(inputs["Mach_number"][0].real)
            self._is_said = warn_of_mach_number(self.pathname.rpartition(".")[0], mach, LATTICE)
