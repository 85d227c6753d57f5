"""Flows about the grids of fitted models: how they are posed, run and told."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from openfoam import openfoam_forces

from bspline_mdao import EulerFlow, FittedModel, InputError
from bspline_mdao.cells.cell_faces import CellFaces
from bspline_mdao.flow.euler.newton import FlowSolution
from bspline_mdao.names import GRID

OPTIONS = {
    "quick": {"action": "store_true", "help": "a variant of some seconds"},
    "openfoam": {"action": "store_true", "help": "ask OpenFOAM as well, where it is installed"},
    "iprint": {"type": int, "default": 0, "help": "1 for a line a flow, 2 for one a Newton step"},
}
"""Options of the command line."""

COEFFICIENTS = ("CL", "CD", "CD_induced", "CD_entropy")
"""What is told of a flow, where there is such an output."""


class Condition(NamedTuple):
    """Mach number, angle of attack (deg), reference area of what the grid shows (m^2), and axes as in `EulerFlow`."""

    mach: float
    alpha: float
    area: float
    axes: str = "xzy"


def flow_problem(
    model: FittedModel,
    condition: Condition,
    make_flow: type[om.Group] = EulerFlow,
    geometry: om.Group | None = None,
    **options,
) -> om.Problem:
    """Set up a flow as the subsystem ``flow``, behind the ``geometry`` that moves its grid if there is one."""
    problem = om.Problem(reports=None)
    if geometry is not None:
        problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    flow = make_flow(model=model, reference_area=condition.area, axes=condition.axes, **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=condition.mach)
    problem.model.set_input_defaults("alpha", val=condition.alpha, units="deg")
    problem.setup(mode="rev")
    return problem


def run_timed(problem: om.Problem) -> dict:
    """Run a flow, and tell its coefficients and ``seconds`` of wall time."""
    problem.final_setup()
    seconds = seconds_of(problem.run_model)
    names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None)}
    return {name: problem.get_val(name).item() for name in COEFFICIENTS if name in names} | {"seconds": seconds}


def run_euler(problem: om.Problem) -> dict:
    """Run a flow by the Euler equations, and tell what `run_timed` does and how it converged.

    Returns
    -------
    dict
        ``n_cells``, the coefficients, ``seconds``, and ``n_steps`` of Newton's method, ``n_products`` with the Jacobian
        and the last ``residual``.
    """
    told = run_timed(problem)
    history = solution_of(problem).history
    return {
        "n_cells": len(solution_of(problem).states),
        **told,
        "n_steps": len(history) - 1,
        "n_products": sum(step.n_products for step in history),
        "residual": history[-1].residual,
    }


def run_openfoam(problem: om.Problem, model: FittedModel, condition: Condition) -> tuple[dict, np.ndarray | None]:
    """Ask OpenFOAM for the flow about the grid of a problem: its numbers, or why there are none, and ``Cp``."""
    try:
        found = openfoam_forces(model.topology, nodes_of(problem), *condition)
    except InputError as error:
        return {"refused": str(error)}, None
    if found is None:
        return {"refused": "not installed"}, None
    told = {name: getattr(found, name) for name in ("CL", "CD", "seconds", "n_iterations", "is_converged")}
    return told, found.Cp


def solution_of(problem: om.Problem) -> FlowSolution:
    """Give the last solution of the Euler equations, with its history."""
    return problem.model.flow.state.solution


def nodes_of(problem: om.Problem) -> np.ndarray:
    """Nodes of the grid of a problem, shape (n, 3) (m)."""
    return problem.get_val(GRID).reshape(-1, 3)


def wall_quads(model: FittedModel) -> np.ndarray:
    """Rows of the grid at the corners of the wall faces, shape (n, 4), in the order of ``Cp``."""
    faces = CellFaces.of(model.topology, model.regenerate().to_vector().reshape(-1, 3))
    return faces.corners[faces.faces_of("wall")]


def seconds_of(action: Callable[[], object]) -> float:
    """Wall time of an action."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
