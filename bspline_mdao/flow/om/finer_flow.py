"""A solved flow, solved again on a finer member of its grid's family."""

from __future__ import annotations

import openmdao.api as om

from ...errors import InputError
from ...names import GRID
from ..euler.gas import N_STATES
from ..functionals import numbers
from .error_estimate import finer_member
from .euler_flow import EulerFlow

__all__ = ["solved_on_finer_grid"]

KEPT = (
    "reference_area",
    "reference_chord",
    "moment_reference",
    "axes",
    "shock_threshold",
    "trim",
    "tolerance",
    "linear_tolerance",
    "max_steps",
)
"""Options of the flow that also apply on the finer member."""


def solved_on_finer_grid(
    flow: EulerFlow,  # a flow that has been run
    factor: float,  # cells per direction of the finer member, relative to the grid; more than 1
) -> dict[str, float]:
    """Coefficients of a flow on a finer member of its grid, moved alike: at its lift with trim, else at its angle.

    It starts from the prolonged states of the grid: if there are several solutions, it finds the corresponding one.
    """
    if not factor > 1.0:
        raise InputError(f"a finer member of factor {factor!r}; give a number above 1, such as 2")
    if flow.comm.size > 1:
        raise InputError("a flow on a finer grid on several processes; run it on one")
    grid, forces, model = flow.state.options["flow"], flow.state.options["forces"], flow.options["model"]
    nodes, alpha = flow.get_val(GRID).reshape(-1, 3), flow.get_val("alpha", units="deg").item()
    member = finer_member(model, grid, forces, nodes, flow.options["axes"], factor)
    again = EulerFlow(model=model.member(factor), iprint=0, **{name: flow.options[name] for name in KEPT})
    problem = om.Problem(again, reports=None)
    problem.setup()
    problem.set_val(GRID, member.nodes_at(nodes).ravel(), units="m")
    problem.set_val("Mach_number", flow.get_val("Mach_number"))
    if flow.options["trim"]:
        problem.set_val("CL_target", flow.get_val("CL_target"))
    else:
        problem.set_val("alpha", alpha, units="deg")
    states = member.cells.prolong(flow.get_val("states").reshape(-1, N_STATES))
    again.start_from(states, alpha)
    problem.run_model()
    found = numbers("euler", is_section=flow.is_section)
    return {name: problem.get_val(name).item() for name in (*found, "alpha")}
