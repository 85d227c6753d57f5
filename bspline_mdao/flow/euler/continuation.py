"""Steady states where Newton's steps find none from the uniform stream: by way of flows with more dissipation.

Where flow separates from sharp edges, as from that of a flat plate at an angle, a steady state of a scheme of little
dissipation draws Newton's steps from close by only. With `LARGEST` of the third difference dissipated it is found from
the uniform stream. From there the dissipation is lowered to that of the scheme, by `RATIO` at a time, and by less
where that was too much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .block_ilu import FactorPattern
from .discretization import Discretization
from .newton import FlowSolution, NewtonStep, solve_flow

LARGEST, RATIO, LARGEST_RATIO = 1.0, 0.8, 0.95
"""Dissipation of the first flow, by how much the next has less, and the ratio at which it is given up."""

STAGE_TOLERANCE, STAGE_STEPS = 1e-6, 20
"""Residual of the flows on the way, and their Newton steps at most."""


def solve_by_dissipation(
    discretization: Discretization,
    areas: np.ndarray,
    stream: np.ndarray,
    *,
    pattern: FactorPattern,
    tolerance: float = 1e-10,
    max_steps: int = 200,
    progress: Callable[[NewtonStep], None] | None = None,
) -> FlowSolution:
    """Solve for the steady flow from the uniform stream; parameters and result are those of `solve_flow`.

    The history is that of all flows on the way, each by the residual of its own uniform stream.
    """
    target, reached, ratio = discretization.dissipation, LARGEST / RATIO, RATIO
    states, history = None, ()
    settings = {"pattern": pattern, "progress": progress}
    while len(history) < max_steps and ratio < LARGEST_RATIO:
        level, n_left = max(target, reached * ratio), max_steps - len(history)
        stage, stage_tolerance = replace(discretization, dissipation=level), max(tolerance, STAGE_TOLERANCE)
        solution = solve_flow(
            stage,
            areas,
            stream,
            states=states,
            tolerance=tolerance if level == target else stage_tolerance,
            max_steps=min(STAGE_STEPS, n_left),
            **settings,
        )
        history += solution.history
        if solution.is_converged and level == target:
            return replace(solution, history=history)
        if solution.is_converged:
            reached, states = level, solution.states
        else:
            ratio = np.sqrt(ratio)
    stuck = solve_flow(discretization, areas, stream, states=states, tolerance=tolerance, max_steps=0, **settings)
    return replace(stuck, history=history + stuck.history)
