"""Steady states from nothing: the ways of a cold start, one after the other until one of them leads to the flow.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from ...numerics.processes import summed
from .discretization import Discretization
from .flow_grid import FlowGrid
from .newton import MOST_PRODUCTS, FlowSolution, solve_flow
from .preconditioner import time_terms
from .reconstruction import SLIP
from .sequencing import CoarseLevel, coarse_flows, spread_from

__all__ = ["cold_solutions"]

FLAT, MOST_FLAT = 25.0, 0.1
"""Time steps of cells that are longer by more than this when long, and the part of the cells at walls and planes of
symmetry above which long ones come first."""

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
    2. From those again with long time steps, there too; before 1, where many cells at walls are flat, or where the flow
       on one of the members took many steps or was not found.

    Both share the products with the Jacobian.

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
    n_left = MOST_PRODUCTS_OF_ALL
    coarse = cache(lambda is_long: coarse_flows(levels, nodes, stream, is_long))

    def by_members(is_long, **rest):
        return solve_flow(*field, states=spread_from(levels, coarse(is_long)), is_long=is_long, **rest)

    is_long = _is_flat(*field) or any(len(one.history) > HARD for one in coarse(False))
    for kind in (is_long, not is_long):
        solution = by_members(kind, max_products=min(MOST_PRODUCTS, n_left), **how)
        yield solution
        n_left = max(0, n_left - sum(step.n_products for step in solution.history))


def _is_flat(discretization: Discretization, areas: np.ndarray, stream: np.ndarray) -> bool:
    """Whether long time steps are much longer in many cells at walls and planes of symmetry."""
    stencil, comm = discretization.stencil, discretization.halo.comm
    uniform = discretization.uniform(stream)
    usual, long = (time_terms(discretization, uniform, areas, kind)[:, 0, 0] for kind in (False, True))
    cells = stencil.cells[stencil.roles == SLIP, 1]
    at_walls = (usual > FLAT * long)[cells[cells < len(uniform)]]
    n_flat, n_walls = summed(comm, np.array([at_walls.sum(), len(at_walls)], float))
    return bool(n_flat > MOST_FLAT * n_walls)
