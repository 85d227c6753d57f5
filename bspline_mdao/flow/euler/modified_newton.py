"""Steady states near a known one: Newton steps with a frozen Jacobian and preconditioner.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .adjoint import FlowTangent
from .krylov import solve_roughly
from .newton import Field, FlowSolution, advance
from .newton_step import NewtonStep
from .preconditioner import by_surface
from .residual import Discretization
from .settings import NEWTON, NewtonSettings

__all__ = ["solve_nearby"]


def solve_nearby(
    discretization: Discretization,
    areas: np.ndarray,  # (n_faces, 3), area vectors (m^2)
    stream: np.ndarray,  # (5,), the free stream
    *,
    states: np.ndarray,  # (n_cells, 5), to start from: the flow nearby
    tangent: FlowTangent,  # the Jacobian there, and its preconditioner
    tolerance: float = 1e-10,  # tolerance, max_steps, progress: see `solve_flow`
    max_steps: int = 100,
    settings: NewtonSettings = NEWTON,
    progress: Callable[[NewtonStep, np.ndarray], None] | None = None,
) -> FlowSolution:
    """Solve for the steady flow from nearby states, with the Jacobian of the nearby flow, without pseudo-time.

    A small change of the shape changes the Jacobian little: each step leaves as much of the residual as its linear
    solve and this change. If that is too much, or a step must be cut, it stops with the best states so far.
    """
    field = Field(discretization, areas, stream)
    scale, residual = field.scale(tolerance), field.residual(states)
    norm = field.norm(residual)
    history = [NewtonStep(norm / scale, np.inf, 0, 1.0)]

    while history[-1].residual > tolerance and len(history) <= max_steps:
        forcing = max(settings.nearby_forcing, 0.5 * tolerance * scale / norm)
        system = by_surface(tangent.linearization.jacobians.product, tangent.factor.solve, field.sizes)
        solution = solve_roughly(*system, -residual, forcing, settings.nearby_products, discretization.halo.comm)
        update = solution.x if solution.is_converged else None
        moved, after, length = advance(settings, field, states, residual, update)
        is_better = length > 0.0 and field.norm(after) < norm
        if is_better:
            states, residual = moved, after
        before, norm = norm, field.norm(residual)
        history.append(NewtonStep(norm / scale, np.inf, solution.n_products, length if is_better else 0.0))
        if progress:
            progress(history[-1], states)
        if length < 1.0 or norm > settings.nearby_worth * before:
            break
    return FlowSolution(states, stream, tuple(history), tolerance)
