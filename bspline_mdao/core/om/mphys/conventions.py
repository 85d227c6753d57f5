"""Names and tags used by MPhys and its solvers, in both generations of MPhys.

Version 2 of MPhys renamed variables and moved its modules. Solvers follow at their own pace, so both are supported:
each component takes a ``generation``, by default the installed MPhys's.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import mphys

from ....errors import InputError

COORDINATES, COUPLING, INPUT, RESULT = "mphys_coordinates", "mphys_coupling", "mphys_input", "mphys_result"
"""Tags by which the groups of MPhys promote variables."""

VOLUME = "aero_vol_coords"
"""Volume nodes. MPhys has no name for them: this is DAFoam's; ADflow uses ``adflow_vol_coords``."""

X_AERO, X_JIG = "x_aero", "x_aero0"
"""Surface nodes seen by the flow, and surface nodes at the start of an analysis: the same in both generations."""

F_AERO, U_AERO = "f_aero", "u_aero"
"""Forces on the surface nodes (N) and their displacements (m): the same in both generations."""

X_STRUCT, U_STRUCT = "x_struct0", "u_struct"
"""Structural nodes at the start of an analysis and their displacements (m): the same in both generations."""


@dataclass(frozen=True)
class Names:
    """Names of variables that differ between the generations of MPhys."""

    mesh: str  # surface nodes as read by a solver
    # geometry_input, geometry_output: these nodes before and after the geometry
    geometry_input: str
    geometry_output: str
    # tags of ``geometry_input``: MPhys connects it either at the level its groups promote it to, or in the geometry
    # itself
    input_tags: tuple[str, ...]
    # angle_of_attack, mach_number, dynamic_pressure: conditions of a flow
    angle_of_attack: str
    mach_number: str
    dynamic_pressure: str
    # struct_mesh, struct_loads: structural nodes as read by their solver, and the loads on them
    struct_mesh: str
    struct_loads: str


GENERATIONS = {
    1: Names(
        mesh="x_aero0",
        geometry_input="x_aero_in",
        geometry_output="x_aero0",
        input_tags=(),
        angle_of_attack="aoa",
        mach_number="mach",
        dynamic_pressure="q_inf",
        struct_mesh="x_struct0",
        struct_loads="f_struct",
    ),
    2: Names(
        mesh="x_aero0_mesh",
        geometry_input="x_aero0_geometry_input",
        geometry_output="x_aero0_geometry_output",
        input_tags=(COORDINATES,),
        angle_of_attack="angle_of_attack",
        mach_number="mach_number",
        dynamic_pressure="dynamic_pressure",
        struct_mesh="x_struct0_mesh",
        struct_loads="f_aero_struct",
    ),
}
"""Names of MPhys 1.x and of MPhys 2.x."""


def generation_of(module: ModuleType) -> int:
    """Generation of an MPhys module: version 2 has a list of its names."""
    return 2 if hasattr(module, "MPhysVariables") else 1


INSTALLED = generation_of(mphys)
"""Generation of the installed MPhys."""


def names_of(generation: int | None, pathname: str) -> Names:
    """Names of a generation of MPhys; the installed one for None."""
    if generation is None:
        generation = INSTALLED
    if generation not in GENERATIONS:
        raise InputError(
            f"{pathname}: there is no generation {generation!r} of MPhys; give 1 (MPhys 1.x), 2 (MPhys 2.x), or None "
            f"for the installed one"
        )
    return GENERATIONS[generation]


def point_set_names(name: str, generation: int | None, pathname: str) -> tuple[str, str]:
    """Names of the points of another discipline, such as ``x_struct0``, before and after the geometry."""
    if names_of(generation, pathname) is GENERATIONS[1]:
        return f"{name.removesuffix('0')}_in", name
    return f"{name}_geometry_input", f"{name}_geometry_output"
