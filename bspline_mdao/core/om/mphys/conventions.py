"""Names and tags that MPhys and its solvers agree on, in both generations of MPhys.

Version 2 of MPhys renamed variables and gave its modules other places. Solvers follow at their own pace, so both are
served: each component takes a ``generation``, which is that of the installed MPhys unless it is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import mphys

from ....errors import InputError

COORDINATES, COUPLING, INPUT, RESULT = "mphys_coordinates", "mphys_coupling", "mphys_input", "mphys_result"
"""Tags by which the groups of MPhys promote variables."""

VOLUME = "aero_vol_coords"
"""Volume nodes. MPhys has no name for them: this is DAFoam's, ADflow says ``adflow_vol_coords``."""

X_AERO, X_JIG = "x_aero", "x_aero0"
"""Surface nodes that the flow sees, and those at the start of an analysis: alike in both generations."""

F_AERO, U_AERO = "f_aero", "u_aero"
"""Forces on the surface nodes (N) and their displacements (m): alike in both generations."""

X_STRUCT, U_STRUCT = "x_struct0", "u_struct"
"""Nodes of a structure at the start of an analysis and their displacements (m): alike in both generations."""


@dataclass(frozen=True)
class Names:
    """Names of variables that are others in each generation of MPhys."""

    mesh: str  # surface nodes as a solver read them
    # geometry_input, geometry_output: the same before and after the geometry
    geometry_input: str
    geometry_output: str
    # tags of ``geometry_input``: MPhys connects it either where its groups promote it, or in the geometry itself
    input_tags: tuple[str, ...]
    # angle_of_attack, mach_number, dynamic_pressure: conditions of a flow
    angle_of_attack: str
    mach_number: str
    dynamic_pressure: str
    # struct_mesh, struct_loads: nodes of a structure as its solver read them, and the loads on them
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
    """Generation of an MPhys: that of version 2 has a list of its names."""
    return 2 if hasattr(module, "MPhysVariables") else 1


INSTALLED = generation_of(mphys)
"""Generation of the MPhys that is installed."""


def names_of(generation: int | None, pathname: str) -> Names:
    """Names of a generation of MPhys; of the installed one for None."""
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
