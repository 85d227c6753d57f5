"""Grid sequencing: a start from the flow on coarser members of the grid's family, with a subset of its nodes.

Every level has half the cells of the next in each direction, see `bspline_mdao.core.evaluation.family`. Its states,
solved roughly, are injected into the cells of the next level that lie in its cells.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.numerics.halo import ALONE, Halo
from ...base.numerics.processes import ONE
from ...core.evaluation.family import IndexScaling, refined_topology
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.index_space import Window
from ...grids.topology.ownership import Ownership
from ...grids.topology.partition import Partition
from ...grids.topology.topology import Topology
from .flow_grid import FlowGrid
from .newton import FlowSolution, solve_flow
from .settings import STARTS, StartSettings

__all__ = ["CoarseLevel", "coarse_flows", "coarse_levels", "spread_from", "states_from_coarse", "useful_levels"]


@dataclass(frozen=True, eq=False)
class CoarseLevel:
    """A coarser member of a grid."""

    flow: FlowGrid  # its faces, scheme and preconditioner
    picked: np.ndarray  # (n_nodes of the member,) of int, rows of its nodes among the finer grid's
    # (n_cells of the finer grid,) of int, cell of the member that contains each cell of the finer grid
    parents: np.ndarray
    # nodes, cells: exchange of nodes of the finer grid and of cells of the member with other processes, if planes
    # between their pieces are not planes of the member
    nodes: Halo = ALONE
    cells: Halo = ALONE

    def pick(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the member, from nodes of the finer grid."""
        return self.nodes.extend(nodes)[self.picked]

    def spread(self, states: np.ndarray) -> np.ndarray:
        """States of the cells of the finer grid, from states of the member."""
        return self.cells.extend(states)[self.parents]


def coarse_levels(
    topology: Topology,  # connections of the blocks of the grid, with declared patches
    nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
    n_levels: int,  # number of members
    axes: str = "xzy",  # see `FlowGrid.of`
    *,
    # partition, comm: see `FlowGrid.of`; a cell of a member is on the process of its first cell of the finer grid
    partition: Partition | None = None,
    comm: Any = ONE,
    **settings: Any,  # of the `Discretization`
) -> list[CoarseLevel]:  # the finest first
    """Make coarser members of a grid, each from the previous one: once per grid."""
    levels = []
    for _ in range(n_levels):
        scaling = IndexScaling.of(topology, 0.5)
        planes = [scaling.nearest(block) for block in range(len(topology.shapes))]
        coarse = refined_topology(topology, 0.5)
        if comm.size == 1:
            picked = np.concatenate([r[np.ix_(*p)].ravel() for r, p in zip(topology.layout.numbers, planes)])
            parents, exchanges = _parents(topology.shapes, scaling.shapes, planes), (ALONE, ALONE)
        else:
            fine = partition or Partition.of(topology, comm.size)
            partition = _coarse_partition(fine, scaling.shapes, planes)
            picked, parents, exchanges = _shared(fine, partition, planes, comm)
        nodes = exchanges[0].extend(nodes)[picked]
        flow = FlowGrid.of(coarse, nodes, axes, partition=partition, comm=comm, **settings)
        levels.append(CoarseLevel(flow, picked, parents, *exchanges))
        topology = coarse
    return levels


def useful_levels(topology: Topology, settings: StartSettings = STARTS) -> int:
    """Count the coarser members of a grid that save time: those with at least 250 cells.

    Examples
    --------
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.grids.topology.detection import find_topology
    >>> [useful_levels(find_topology(flat_plate_grid((n, n, n)))) for n in (8, 16)]
    [1, 2]
    """
    n_levels = 0
    while True:
        coarse = refined_topology(topology, 0.5)
        if coarse.shapes == topology.shapes or coarse.layout.cells.size < settings.smallest_member:
            return n_levels
        topology, n_levels = coarse, n_levels + 1


def states_from_coarse(
    levels: list[CoarseLevel],
    nodes: np.ndarray,
    stream: np.ndarray,
    is_long: bool = False,
    settings: StartSettings = STARTS,
) -> np.ndarray | None:
    """Initial states on the grid from coarser members, see `coarse_flows`; without any None, for a uniform stream."""
    return spread_from(levels, coarse_flows(levels, nodes, stream, is_long, settings))


def coarse_flows(
    levels: list[CoarseLevel],
    nodes: np.ndarray,
    stream: np.ndarray,
    is_long: bool = False,
    settings: StartSettings = STARTS,
) -> list[FlowSolution]:
    """Solve roughly on the coarser members, on each from the flow on the next; the finest comes first in both lists.

    With ``is_long`` flat cells have long time steps there too: otherwise a bubble at the foot of a shock would stay in
    the start.
    """
    if not levels:
        return []
    level, coarse_nodes = levels[0], levels[0].pick(nodes)
    coarser = coarse_flows(levels[1:], coarse_nodes, stream, is_long, settings)
    solution = solve_flow(
        level.flow.discretization,
        level.flow.areas(coarse_nodes),
        stream,
        pattern=level.flow.pattern,
        states=spread_from(levels[1:], coarser),
        tolerance=settings.member_tolerance,
        max_steps=settings.member_steps,
        is_long=is_long,
        settings=settings.newton,
    )
    return [solution, *coarser]


def spread_from(levels: list[CoarseLevel], flows: list[FlowSolution]) -> np.ndarray | None:
    """States of the cells of a grid, shape (n_cells, 5), from the flow on its first coarser member; None without."""
    return levels[0].spread(flows[0].states) if levels else None


def _parents(
    shapes: Sequence[tuple[int, ...]], coarse_shapes: Sequence[tuple[int, ...]], planes: Sequence[Sequence[np.ndarray]]
) -> np.ndarray:
    """Cell of the coarse blocks that contains each cell of the fine ones."""
    coarse_cells = BlockLayout.of(coarse_shapes).cells.numbers
    parents = []
    for shape, cells, kept in zip(shapes, coarse_cells, planes):
        inside = [_lying_in(k, np.arange(n - 1)) for k, n in zip(kept, shape)]
        parents.append(cells[np.ix_(*inside)].ravel())
    return np.concatenate(parents)


def _coarse_partition(
    fine: Partition, shapes: Sequence[tuple[int, ...]], planes: Sequence[Sequence[np.ndarray]]
) -> Partition:
    """Assign every cell of a member to the process that has its first cell of the finer grid."""
    pieces = []
    for subdomain in fine.pieces:
        kept = [
            Window(piece.block, *(tuple(map(_first_at, planes[piece.block], end)) for end in (piece.lo, piece.hi)))
            for piece in subdomain
        ]
        pieces.append(tuple(piece for piece in kept if min(np.subtract(piece.hi, piece.lo)) > 0))
    return Partition(tuple(map(tuple, shapes)), tuple(pieces))


def _first_at(kept: np.ndarray, index: int) -> int:
    """Number of the first kept plane from an index on."""
    return int(np.searchsorted(kept, index))


def _shared(
    fine: Partition, coarse: Partition, planes: Sequence[Sequence[np.ndarray]], comm: Any
) -> tuple[np.ndarray, np.ndarray, tuple[Halo, Halo]]:
    """Places of the nodes and parents of one process in extended arrays of the finer grid and the member."""
    rows, parents = [np.zeros(0, int)], [np.zeros(0, int)]
    starts = fine.layout.starts
    for piece in coarse.pieces[comm.rank]:
        kept = (plane[lo : hi + 1] for plane, lo, hi in zip(planes[piece.block], piece.lo, piece.hi))
        rows.append(starts[piece.block] + _numbers(kept, fine.shapes[piece.block]))
    cells = coarse.layout.cells
    for piece in fine.pieces[comm.rank]:
        ranges = (np.arange(lo, hi) for lo, hi in zip(piece.lo, piece.hi))
        inside = (_lying_in(plane, cells) for plane, cells in zip(planes[piece.block], ranges))
        parents.append(cells.starts[piece.block] + _numbers(inside, cells.shapes[piece.block]))
    n_nodes, n_cells = fine.subdomain(comm.rank).n_nodes, len(coarse.subdomain(comm.rank).cells)
    nodes_halo, picked = Halo.of(comm, n_nodes, *Ownership.of_nodes(fine).find(np.concatenate(rows)))
    cells_halo, places = Halo.of(comm, n_cells, *Ownership.of_cells(coarse).find(np.concatenate(parents)))
    return picked, places, (nodes_halo, cells_halo)


def _numbers(indices: Iterable[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Numbers, in the C order of a shape, of entries with given indices in each direction."""
    i, j, k = np.ix_(*indices)
    return ((i * shape[1] + j) * shape[2] + k).ravel()


def _lying_in(kept: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Interval between kept planes that contains each cell."""
    return np.searchsorted(kept, cells, side="right") - 1
