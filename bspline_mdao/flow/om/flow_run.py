"""A flow that is run and summed up: coefficients, time, and how it converged."""

from __future__ import annotations

import time

import openmdao.api as om

from .euler_state import EulerState

__all__ = ["run_flow"]

COEFFICIENTS = ("CL", "CD", "CD_induced", "CD_entropy")
"""Outputs of a summary, where there are any."""


def run_flow(problem: om.Problem) -> dict:
    """Run a problem with a flow, such as `EulerFlow` or `LatticeFlow`, and sum it up.

    Parameters
    ----------
    problem : openmdao.api.Problem
        The problem, set up.

    Returns
    -------
    dict
        ``CL``, ``CD``, ``CD_induced`` and ``CD_entropy``, as far as the flow has them, and ``seconds`` of wall time,
        those of other components included. By the Euler equations also ``n_cells``, ``n_steps`` of Newton's method,
        ``n_products`` with the Jacobian, and the last ``residual``, relative to that of the uniform stream.
    """
    problem.final_setup()
    start = time.perf_counter()
    problem.run_model()
    seconds = time.perf_counter() - start
    names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None, all_procs=True)}
    summary = {name: problem.get_val(name).item() for name in COEFFICIENTS if name in names} | {"seconds": seconds}
    for state in problem.model.system_iter(recurse=True, typ=EulerState):
        history = state.solution.history
        summary |= {
            "n_cells": state.options["flow"].n_cells_of_grid,
            "n_steps": len(history) - 1,
            "n_products": sum(step.n_products for step in history),
            "residual": history[-1].residual,
        }
    return summary
