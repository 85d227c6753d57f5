"""Names, tags and sizes that MPhys and its solvers agree on."""

from __future__ import annotations

from mphys import MPhysVariables

from ...errors import InputError

_SURFACE = MPhysVariables.Aerodynamics.Surface
_CONDITIONS = MPhysVariables.Aerodynamics.FlowConditions

X_MESH = _SURFACE.Mesh.COORDINATES
"""Surface nodes as a solver read them."""

X_INPUT = _SURFACE.Geometry.COORDINATES_INPUT
"""Surface nodes before the geometry."""

X_OUTPUT = _SURFACE.Geometry.COORDINATES_OUTPUT
"""Surface nodes after the geometry."""

X_JIG = _SURFACE.COORDINATES_INITIAL
"""Surface nodes at the start of an analysis."""

X_AERO = _SURFACE.COORDINATES
"""Surface nodes that the flow sees."""

ANGLE_OF_ATTACK = _CONDITIONS.ANGLE_OF_ATTACK
MACH_NUMBER = _CONDITIONS.MACH_NUMBER

VOLUME = "aero_vol_coords"
"""Volume nodes. MPhys has no name for them: this is DAFoam's, ADflow says ``adflow_vol_coords``."""

COORDINATES, COUPLING, INPUT, RESULT = "mphys_coordinates", "mphys_coupling", "mphys_input", "mphys_result"
"""Tags by which the groups of MPhys promote variables."""


def require_one_process(comm, pathname: str) -> None:
    """Refuse more than one process: grid and movement are in the memory of one, and threads share their work.

    Raises
    ------
    InputError
        If there are more.
    """
    if comm.size > 1:
        raise InputError(f"{pathname}: {comm.size} processes; give it one, in a group of its own communicator")
