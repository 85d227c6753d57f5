"""Steady states where Newton's steps find none from the uniform stream: by way of flows with more dissipation.

Where flow separates from sharp edges, as from those of a flat plate at an angle, a steady state of a scheme of little
dissipation draws Newton's steps from close by only. With all of the third difference dissipated it is found from the
uniform stream; from there the dissipation is lowered to that of the scheme. Such flows need not be the only ones of
their grid, and the way can end at a dissipation below which there is none nearby.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .block_ilu import FactorPattern
from .discretization import Discretization
from .newton import FlowSolution, NewtonStep, solve_flow

LEVELS = (1.0, 0.5, 0.35, 0.25, 0.2)
"""Shares of the third difference that are dissipated on the way."""

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

    The history is that of all flows on the way, each by the residual of its own uniform stream; where one ends, it has
    the residual with the dissipation of the next.
    """
    levels = [level for level in LEVELS if level > discretization.dissipation]
    settings = {"pattern": pattern, "progress": progress}
    states, history, n_left = None, (), max_steps
    for level in levels:
        solution = solve_flow(
            replace(discretization, dissipation=level),
            areas,
            stream,
            states=states,
            tolerance=max(tolerance, STAGE_TOLERANCE),
            max_steps=min(STAGE_STEPS, n_left),
            **settings,
        )
        states, history = solution.states, history[:-1] + solution.history
        n_left = max_steps - len(history) + 1 if solution.is_converged else 0
        if not n_left:
            break
    solution = solve_flow(
        discretization, areas, stream, states=states, tolerance=tolerance, max_steps=n_left, **settings
    )
    return replace(solution, history=history[:-1] + solution.history)
