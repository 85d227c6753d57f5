"""Grid sequencing: a start from the flow on coarser members of the grid's family, which pick from its nodes.

Every level has half the cells of the next in each direction, see `bspline_mdao.evaluation.family`. Its states, solved
roughly, are given to the cells of the next that lie in its cells.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...evaluation.family import IndexScaling, refined_topology
from ...topology.index_space import block_rows
from ...topology.topology import Topology
from .flow_grid import FlowGrid
from .newton import solve_flow

__all__ = ["CoarseLevel", "coarse_levels", "states_from_coarse", "useful_levels"]

TOLERANCE, MAX_STEPS = 1e-3, 30
"""Residual of the flows on coarser members, and their Newton steps at most."""

SMALLEST = 4_000
"""Cells below which a coarser member saves nothing."""


@dataclass(frozen=True, eq=False)
class CoarseLevel:
    """A coarser member of a grid.

    Parameters
    ----------
    flow : FlowGrid
        Its faces, scheme and preconditioner.
    picked : ndarray of int, shape (n_nodes of the member,)
        Rows of its nodes among those of the finer grid.
    parents : ndarray of int, shape (n_cells of the finer grid,)
        Cell of the member that each cell of the finer grid lies in.
    """

    flow: FlowGrid
    picked: np.ndarray
    parents: np.ndarray


def coarse_levels(topology: Topology, nodes: np.ndarray, n_levels: int, axes: str = "xzy", **settings):
    """Make coarser members of a grid, each of the one before: once per grid.

    Parameters
    ----------
    topology : Topology
        Connections of the blocks of the grid, with declared patches.
    nodes : ndarray, shape (n_nodes, 3)
        Baseline nodes (m).
    n_levels : int
        Number of members.
    axes : str
        See `FlowGrid.of`.
    **settings
        Of the `Discretization`.

    Returns
    -------
    list of CoarseLevel
        The finest first.
    """
    levels = []
    for _ in range(n_levels):
        scaling = IndexScaling.of(topology, 0.5)
        planes = [scaling.nearest(block) for block in range(len(topology.shapes))]
        picked = np.concatenate([r[np.ix_(*p)].ravel() for r, p in zip(block_rows(topology.shapes), planes)])
        parents = _parents(topology.shapes, scaling.shapes, planes)
        topology, nodes = refined_topology(topology, 0.5), nodes[picked]
        levels.append(CoarseLevel(FlowGrid.of(topology, nodes, axes, **settings), picked, parents))
    return levels


def useful_levels(n_cells: int) -> int:
    """Count the coarser members that save time where a grid has so many cells.

    Examples
    --------
    >>> useful_levels(10_000), useful_levels(36_864), useful_levels(1_000_000)
    (0, 1, 2)
    """
    return max(0, int(np.log(n_cells / SMALLEST) / np.log(8.0)))


def states_from_coarse(levels: list[CoarseLevel], nodes: np.ndarray, stream: np.ndarray) -> np.ndarray | None:
    """Solve on the coarser members for states to start from on the grid.

    Parameters
    ----------
    levels : list of CoarseLevel
        The finest first.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of the grid as it is now (m).
    stream : ndarray, shape (5,)
        The free stream.

    Returns
    -------
    ndarray, shape (n_cells, 5), or None
        None, for the uniform stream, without levels.
    """
    if not levels:
        return None
    level, coarse_nodes = levels[0], nodes[levels[0].picked]
    start = states_from_coarse(levels[1:], coarse_nodes, stream)
    solution = solve_flow(
        level.flow.discretization,
        level.flow.areas(coarse_nodes),
        stream,
        pattern=level.flow.pattern,
        states=start,
        tolerance=TOLERANCE,
        max_steps=MAX_STEPS,
    )
    return solution.states[level.parents]


def _parents(shapes, coarse_shapes, planes) -> np.ndarray:
    """Cell of the coarse blocks that each cell of the fine ones lies in."""
    coarse_cells = block_rows([tuple(n - 1 for n in shape) for shape in coarse_shapes])
    parents = []
    for shape, cells, kept in zip(shapes, coarse_cells, planes):
        inside = [np.searchsorted(k, np.arange(n - 1), side="right") - 1 for k, n in zip(kept, shape)]
        parents.append(cells[np.ix_(*inside)].ravel())
    return np.concatenate(parents)
