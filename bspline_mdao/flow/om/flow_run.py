"""Run a flow and summarise it: coefficients, time, and convergence."""

from __future__ import annotations

import time

import openmdao.api as om

from ..functionals import numbers
from .euler_flow import EulerFlow
from .euler_state import EulerState

__all__ = ["run_flow"]


def run_flow(problem: om.Problem) -> dict:
    """Run a problem with a flow, such as `EulerFlow` or `LatticeFlow`, and summarise it.

    Parameters
    ----------
    problem : openmdao.api.Problem
        The problem, set up.

    Returns
    -------
    dict
        Lift and drags such as ``CL`` and ``CD_induced``, as far as the flow has them, without those that do not apply
        to a section, and ``seconds`` of wall time, including other components. For the Euler equations also
        ``n_cells``, ``n_steps`` of Newton's method, ``n_products`` with the Jacobian, and the last ``residual``,
        relative to the uniform stream's.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import EulerFlow, fit_grid
    >>> from bspline_mdao.flow import run_flow
    >>> from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0)))
    >>> problem = om.Problem(EulerFlow(model=model, reference_area=1.0, iprint=0), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("Mach_number", 0.5)
    >>> run_flow(problem)["residual"] < 1e-10
    True
    """
    problem.final_setup()
    start = time.perf_counter()
    problem.run_model()
    seconds = time.perf_counter() - start
    names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None, all_procs=True)}
    flows = list(problem.model.system_iter(include_self=True, recurse=True, typ=EulerFlow))
    is_section = bool(flows) and all(flow.is_section for flow in flows)
    wanted = [name for name in numbers("euler", "lift", "drag", is_section=is_section) if name in names]
    summary = {name: problem.get_val(name).item() for name in wanted} | {"seconds": seconds}
    for state in problem.model.system_iter(recurse=True, typ=EulerState):
        history = state.solution.history
        summary |= {
            "n_cells": state.options["flow"].n_cells_of_grid,
            "n_steps": len(history) - 1,
            "n_products": sum(step.n_products for step in history),
            "residual": history[-1].residual,
        }
    return summary
