"""Steady states from nothing: the ways of a cold start, one after the other until one of them leads to the flow.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np

from ...base.numerics.processes import summed
from .discretization import Discretization
from .flow_grid import FlowGrid
from .gas import free_stream
from .newton import MOST_PRODUCTS, FlowSolution, solve_flow
from .preconditioner import time_terms
from .reconstruction import SLIP
from .sequencing import CoarseLevel, coarse_flows, spread_from, states_from_coarse

__all__ = ["cold_solutions"]

FLAT, MOST_FLAT = 25.0, 0.1
"""Time steps of cells that are longer by more than this when long, and the part of the cells at walls and planes of
symmetry above which long ones come first."""

HARD = 20
"""Newton steps of a flow on a coarser member beyond which the grid itself is tried with long time steps first."""

ROUGH = 1e-6
"""Residual of the flow at half the angle."""

MOST_PRODUCTS_OF_ALL = 2400
"""Products with the Jacobian after which no other way is tried."""


def cold_solutions(
    flow: FlowGrid,
    levels: list[CoarseLevel],
    nodes: np.ndarray,
    areas: np.ndarray,
    stream: np.ndarray,
    *,
    tolerance: float = 1e-10,
    max_steps: int = 100,
    progress: Callable | None = None,
) -> Iterator[FlowSolution]:
    """Yield solutions of the steady flow, each by another way from the uniform stream; take the first that will do.

    1. From the flow on coarser members of the grid; with long time steps, there too, where many cells at walls are
       flat, or where the flow on one of the members took many steps or was not found.
    2. From the flow at half the angle, found from coarser members, with long time steps.
    3. From coarser members with the other kind of time steps.

    All share the products with the Jacobian.

    Parameters
    ----------
    flow : FlowGrid
    levels : list of CoarseLevel
        Coarser members, the finest first; may be empty.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of the grid (m).
    areas, stream, tolerance, max_steps, progress
        See `solve_flow`.
    """
    how = {"pattern": flow.pattern, "max_steps": max_steps, "progress": progress}
    discretization, half = flow.at(nodes), _at_half_the_angle(stream, flow.axes)
    coarse = cache(lambda is_long: coarse_flows(levels, nodes, stream, is_long))

    def solve(at_stream, states, is_long, end, most):
        limits = {"tolerance": end, "max_products": min(MOST_PRODUCTS, most)}
        return solve_flow(discretization, areas, at_stream, states=states, is_long=is_long, **limits, **how)

    def by_members(is_long, most):
        return solve(stream, spread_from(levels, coarse(is_long)), is_long, tolerance, most)

    def by_angle(most):
        first = solve(half, states_from_coarse(levels, nodes, half, True), True, max(tolerance, ROUGH), most)
        left = most - _n_products(first) if first.is_converged else 0
        solution = solve(stream, first.states, True, tolerance, left)
        history = first.history[:-1] + solution.history
        return replace(solution, history=history, is_found_at_half=first.is_converged)

    is_long = _is_flat(discretization, areas, stream) or any(len(one.history) > HARD for one in coarse(False))
    ways: list[Callable] = [partial(by_members, is_long), by_angle, partial(by_members, not is_long)]
    if np.array_equal(half, stream):
        ways.remove(by_angle)
    n_left = MOST_PRODUCTS_OF_ALL
    for way in ways:
        solution = way(n_left)
        yield solution
        n_left = max(0, n_left - _n_products(solution))


def _at_half_the_angle(stream: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Free stream of the same Mach number at half the angle of attack."""
    downstream, _, up = axes @ stream[1:4]
    return free_stream(np.hypot(downstream, up), 0.5 * np.arctan2(up, downstream), axes) if up else stream


def _n_products(solution: FlowSolution) -> int:
    return sum(step.n_products for step in solution.history)


def _is_flat(discretization: Discretization, areas: np.ndarray, stream: np.ndarray) -> bool:
    """Whether long time steps are much longer in many cells at walls and planes of symmetry."""
    stencil, comm = discretization.stencil, discretization.halo.comm
    uniform = discretization.uniform(stream)
    usual, long = (time_terms(discretization, uniform, areas, kind)[:, 0, 0] for kind in (False, True))
    cells = stencil.cells[stencil.roles == SLIP, 1]
    at_walls = (usual > FLAT * long)[cells[cells < len(uniform)]]
    n_flat, n_walls = summed(comm, np.array([at_walls.sum(), len(at_walls)], float))
    return bool(n_flat > MOST_FLAT * n_walls)
