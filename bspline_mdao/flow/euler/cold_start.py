"""Steady states from nothing: the ways of a cold start, one after the other until one of them leads to the flow.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from .flow_grid import FlowGrid
from .newton import MOST_PRODUCTS, FlowSolution, solve_by_dissipation, solve_flow
from .sequencing import CoarseLevel, coarse_flows, spread_from

__all__ = ["cold_solutions"]

HARD = 20
"""Newton steps of a flow on a coarser member beyond which the grid itself is tried with long time steps first."""

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

    1. From the flow on coarser members of the grid.
    2. From those again with long time steps, there too; before 1, where the flow on one of the members took many steps
       or was not found.
    3. By way of flows with more dissipation.

    All ways share the products with the Jacobian.

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
    how = {"pattern": flow.pattern, "tolerance": tolerance, "max_steps": max_steps, "progress": progress}
    field = flow.at(nodes), areas, stream
    coarse, n_left = coarse_flows(levels, nodes, stream), MOST_PRODUCTS_OF_ALL

    def plain(**rest):
        return solve_flow(*field, states=spread_from(levels, coarse), **rest)

    def with_long_steps(**rest):
        start = spread_from(levels, coarse_flows(levels, nodes, stream, is_long=True))
        return solve_flow(*field, states=start, is_long=True, **rest)

    is_hard = any(len(one.history) > HARD for one in coarse)
    ways: list[Callable] = [with_long_steps, plain] if is_hard else [plain, with_long_steps]
    ways.append(partial(solve_by_dissipation, *field))
    for solve in ways:
        solution = solve(max_products=min(MOST_PRODUCTS, n_left), **how)
        yield solution
        n_left = max(0, n_left - sum(step.n_products for step in solution.history))
