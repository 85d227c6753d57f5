"""Steady states from scratch: from coarser members of the grid, with the two kinds of time steps in turn.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from ...base.numerics.processes import summed
from .flow_grid import FlowGrid
from .newton import FlowSolution, solve_flow
from .preconditioner import time_terms
from .reconstruction import SLIP
from .residual import Discretization
from .sequencing import CoarseLevel, coarse_flows, spread_from
from .settings import STARTS, StartSettings

__all__ = ["cold_solutions"]


def cold_solutions(
    flow: FlowGrid,
    levels: list[CoarseLevel],
    nodes: np.ndarray,
    areas: np.ndarray,
    stream: np.ndarray,
    *,
    tolerance: float = 1e-10,
    max_steps: int = 100,
    settings: StartSettings = STARTS,
    progress: Callable | None = None,
) -> Iterator[FlowSolution]:
    """Yield solutions of the steady flow, each started from coarser members of the grid; take the first acceptable one.

    Each solution uses one kind of time steps throughout; the second has the other. Long ones come first if many cells
    at walls are flat, or if the flow on a coarser member took many of the usual steps or was not found. ``levels`` are
    the coarser members, the finest first; if empty, the start is the uniform stream. Other parameters as in
    `solve_flow`.
    """
    discretization = flow.at(nodes)
    coarse = cache(lambda is_long: coarse_flows(levels, nodes, stream, is_long, settings))
    is_flat = _is_flat(settings, discretization, areas, stream)
    first = is_flat or any(len(one.history) > settings.hard for one in coarse(False))
    for is_long in (first, not first):
        states = spread_from(levels, coarse(is_long))
        yield solve_flow(
            discretization,
            areas,
            stream,
            pattern=flow.pattern,
            states=states,
            tolerance=tolerance,
            max_steps=max_steps,
            is_long=is_long,
            settings=settings.newton,
            progress=progress,
        )


def _is_flat(settings: StartSettings, discretization: Discretization, areas: np.ndarray, stream: np.ndarray) -> bool:
    """Whether long time steps are much longer in many cells at walls and planes of symmetry."""
    stencil, comm = discretization.stencil, discretization.halo.comm
    uniform = discretization.uniform(stream)
    usual, long = (time_terms(discretization, uniform, areas, kind)[:, 0, 0] for kind in (False, True))
    cells = stencil.cells[stencil.roles == SLIP, 1]
    at_walls = (usual > settings.flat * long)[cells[cells < len(uniform)]]
    n_flat, n_walls = summed(comm, np.array([at_walls.sum(), len(at_walls)], float))
    return bool(n_flat > settings.most_flat * n_walls)
