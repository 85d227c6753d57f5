"""The nodes that a process fits: nodes of its blocks, and coincident nodes of other processes.

A fit distributes whole blocks. Nodes that blocks share belong to the first segment that has them, whose process is
their *home*. A process that needs nodes from elsewhere keeps places for them after its own nodes. Values computed at
home are fetched, values computed elsewhere are put there. A single process has all nodes, and sends nothing.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.numerics.processes import ONE
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.index_space import window_rows
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.partition import Partition
from ...grids.topology.sharing import node_sharing
from ...grids.topology.topology import Topology

__all__ = ["FitNodes", "whole_blocks"]


def whole_blocks(topology: Topology, n_ranks: int) -> Partition:
    """Distribute the blocks of a grid over processes without cutting any."""
    return Partition.of(topology, n_ranks, imbalance=math.inf)


@dataclass(frozen=True, eq=False)
class FitNodes:
    """Nodes of the blocks of a process, in the order of its partition, then the nodes that it needs from others."""

    topology: Topology  # topology of the grid
    comm: Any  # the processes
    blocks: tuple[int, ...]  # blocks of this process, in the order of its nodes
    here: tuple[int, ...]  # segments of these blocks
    # the numbers of the nodes of every segment of this process; of shape (0, 0, 0) for others
    rows: tuple[np.ndarray, ...]
    is_evaluated: tuple[np.ndarray, ...]  # true if the segment is the first of the grid with the node
    # numbers of nodes that are copies, ascending, and of the nodes that they copy
    copies: np.ndarray  # int (n_copies, 2)
    # numbers of nodes of the blocks, and of all nodes, including those from elsewhere
    n_owned: int
    n_rows: int
    homes: tuple[int, ...]  # process of every block
    # per process, the numbers of the nodes from there, and of the nodes that it needs from here
    wanted: tuple[np.ndarray, ...] = ()
    given: tuple[np.ndarray, ...] = ()

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid
        comm: Any = ONE,  # the processes
        # blocks of each process, none of them cut; by default from `whole_blocks`
        partition: Partition | None = None,
    ) -> FitNodes:
        """Distribute the blocks of a grid over processes, all of which call this."""
        if comm.size == 1:
            sharing, n_blocks, n = node_sharing(topology), len(topology.shapes), topology.n_nodes
            blocks, segments = tuple(range(n_blocks)), tuple(range(len(topology.segments)))
            nodes = sharing.rows, sharing.is_evaluated, sharing.copies, n, n
            return cls(topology, comm, blocks, segments, *nodes, (0,) * n_blocks)
        pieces = (whole_blocks(topology, comm.size) if partition is None else partition).pieces
        home_of = {window.block: rank for rank, windows in enumerate(pieces) for window in windows}
        homes = tuple(home_of[block] for block in range(len(home_of)))
        local = tuple(window.block for window in pieces[comm.rank])
        return cls._of_blocks(topology, comm, homes, local)._with_others()

    @classmethod
    def _of_blocks(cls, topology: Topology, comm: Any, homes: tuple[int, ...], blocks: tuple[int, ...]) -> FitNodes:
        """Number the nodes of the blocks of this process."""
        layout = BlockLayout.of(topology.shapes[block] for block in blocks)
        first = dict(zip(blocks, layout.starts.tolist()))
        nothing, rows, here = np.zeros((0, 0, 0), dtype=np.int64), [], []
        for number, segment in enumerate(topology.segments):
            if segment.block in first:
                here.append(number)
                rows.append(window_rows(segment, topology.shapes[segment.block], first[segment.block]))
            else:
                rows.append(nothing)
        empty = np.zeros((0, 2), dtype=np.int64)
        return cls(topology, comm, blocks, tuple(here), tuple(rows), (), empty, layout.size, layout.size, homes)

    def _with_others(self) -> FitNodes:
        """Add the nodes of others that these are copies of, and agree with all processes on what is sent."""
        layout = self.topology.layout
        local = [np.arange(layout.starts[block], layout.starts[block + 1]) for block in self.blocks]
        numbering = NodeNumbering.of(self.topology, np.concatenate([np.zeros(0, dtype=np.int64), *local]))
        there = numbering.rows[self.n_owned :]
        rank_of = np.asarray(self.homes)[layout.owner(there)]
        wanted = [self.n_owned + np.flatnonzero(rank_of == rank) for rank in range(self.comm.size)]
        asked = self.comm.alltoall([numbering.rows[numbers] for numbers in wanted])
        is_copy = np.zeros(numbering.n_nodes, dtype=bool)
        is_copy[numbering.copies[:, 0]] = True
        # a node whose first segment is in one of these blocks is evaluated by it, so by the first that has the node
        order = np.full(numbering.n_nodes, -1)
        for number in reversed(self.here):
            order[self.rows[number]] = number
        is_evaluated = tuple(
            ~is_copy[rows] & (order[rows] == number) if rows.size else np.zeros(rows.shape, dtype=bool)
            for number, rows in enumerate(self.rows)
        )
        return replace(
            self,
            is_evaluated=is_evaluated,
            copies=numbering.copies,
            n_rows=numbering.n_nodes,
            wanted=tuple(wanted),
            given=tuple(numbering.numbers_of(rows) for rows in asked),
        )

    @property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of the blocks of this process, the first ``n_owned``."""
        return BlockLayout.of(self.topology.shapes[block] for block in self.blocks)

    def by_blocks(self, values: np.ndarray) -> dict[int, np.ndarray]:
        """Split values of nodes, shape (n_rows, ...), by the blocks of this process, each (n, ...)."""
        return {block: values[part] for block, part in zip(self.blocks, self.layout.slices)}

    def source_rows(self) -> np.ndarray:
        """Number that represents each node, shape (n_rows,): its own, or its original's if it is a copy."""
        source = np.arange(self.n_rows)
        source[self.copies[:, 0]] = self.copies[:, 1]
        return source

    def with_places(self, values: np.ndarray) -> np.ndarray:
        """Append places for the nodes of others to values of the nodes of the blocks, shape (n_owned, ...)."""
        if self.n_rows == self.n_owned:
            return values
        return np.concatenate([values, np.zeros((self.n_rows - self.n_owned, *values.shape[1:]), values.dtype)])

    def fetch(self, values: np.ndarray) -> np.ndarray:
        """Write the values of other processes at their nodes, in place, shape (n_rows, ...)."""
        if self.comm.size > 1:
            for numbers, received in zip(self.wanted, self.comm.alltoall([values[numbers] for numbers in self.given])):
                values[numbers] = received
        return values

    def put(self, values: np.ndarray, is_made: np.ndarray) -> None:
        """Send values computed here for nodes of others to their homes, and receive such values, in place."""
        if self.comm.size > 1:
            sent = [(is_made[numbers], values[numbers]) for numbers in self.wanted]
            for numbers, (is_sent, received) in zip(self.given, self.comm.alltoall(sent)):
                values[numbers[is_sent]] = received[is_sent]
                is_made[numbers] |= is_sent

    def add_back(self, values: np.ndarray) -> np.ndarray:
        """Transpose of `fetch`: add values at nodes of others to their homes' values, in place, and clear them."""
        if self.comm.size > 1:
            received = self.comm.alltoall([values[numbers] for numbers in self.wanted])
            values[self.n_owned :] = 0.0
            for numbers, part in zip(self.given, received):
                np.add.at(values, numbers, part)
        return values

    def copy_shared(self, values: np.ndarray) -> np.ndarray:
        """Give every copy the value of its original, in place."""
        self.fetch(values)
        values[self.copies[:, 0]] = values[self.copies[:, 1]]
        return values

    def from_owners(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Write values, of which each process has computed those numbered ``ids``, on all processes, in place."""
        if self.comm.size > 1:
            for numbers, made in self.comm.allgather((ids, values[ids])):
                values[numbers] = made

    def of_all_segments(self, local: Sequence) -> list:
        """Items of all segments, on all processes, from the items that each process gives for its own segments."""
        if self.comm.size == 1:
            return list(local)
        items: list = [None] * len(self.topology.segments)
        for numbers, found in self.comm.allgather((self.here, list(local))):
            for number, item in zip(numbers, found):
                items[number] = item
        return items
