"""Pieces of the blocks of a grid that are distributed to processes, and properties of whole blocks.

A piece is a window of a block, usually all of it. Pieces of a split block share the nodes at the cut, but no cells.
Properties of a whole block, such as its size, are gathered from all processes that hold a piece.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import ONE, gathered, together
from ...errors import InputError
from ..topology.block_layout import BlockLayout, has_cells
from ..topology.grid import Grid, Patch
from ..topology.index_space import Window
from ..topology.partition import Partition
from .hexahedron import flat_direction, summed_areas, unit_normal

__all__ = ["Frame", "Pieces"]


class Frame(NamedTuple):
    """Size and plane of a block."""

    size: float  # diagonal of its box (m)
    normal: np.ndarray | None  # (3,), or None, unit mean normal of a planar block


@dataclass(frozen=True, eq=False)
class Pieces(OneLine):
    """Pieces of the blocks of a grid, and the processes that hold them."""

    # The nodes of a process are the nodes of its pieces in order, each in C order.

    partition: Partition  # pieces of every process, which may have none
    names: tuple[str, ...]  # names of the blocks of the grid
    patches: tuple[Patch, ...]  # patches of the grid
    source: str = "grid"  # where the grid came from, for messages
    comm: Any = ONE  # the processes, see `bspline_mdao.base.numerics.processes`

    def __post_init__(self) -> None:
        n_cells = BlockLayout.of(piece.shape for pieces in self.partition.pieces for piece in pieces).cells.size
        if self.partition.n_ranks != self.comm.size or n_cells != self.n_cells_of_all:
            raise InputError(
                f"{self.source}: pieces of {self.partition.n_ranks} processes with {n_cells} cells, of a grid with "
                f"{self.n_cells_of_all} on {self.comm.size}; make them by Partition.of(topology, {self.comm.size})"
            )

    @classmethod
    def of_grid(cls, grid: Grid) -> Pieces:
        """Take the whole blocks of a grid, all in one process."""
        whole = tuple(Window.whole(number, shape) for number, shape in enumerate(grid.shapes))
        names = tuple(block.name for block in grid.blocks)
        return cls(Partition(grid.shapes, (whole,)), names, grid.patches, grid.source)

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of every block of the grid in each direction."""
        return self.partition.shapes

    @property
    def local(self) -> tuple[Window, ...]:
        """Pieces of this process."""
        return self.partition.pieces[self.comm.rank]

    @cached_property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of its pieces among its nodes."""
        return BlockLayout.of(piece.shape for piece in self.local)

    @property
    def n_nodes(self) -> int:
        """Nodes of this process."""
        return self.layout.size

    @cached_property
    def split(self) -> frozenset[int]:
        """Blocks that are cut into several pieces."""
        counts = Counter(piece.block for pieces in self.partition.pieces for piece in pieces)
        return frozenset(block for block, n in counts.items() if n > 1)

    @cached_property
    def has_planes(self) -> bool:
        """Whether a block of the grid is planar."""
        return any(1 in shape for shape in self.shapes)

    @cached_property
    def has_split_planes(self) -> bool:
        """Whether a planar block is split."""
        return any(1 in self.shapes[block] for block in self.split)

    @property
    def n_cells_of_all(self) -> int:
        """Cells of all blocks of the grid."""
        return self.partition.layout.cells.size

    def nodes_of(self, nodes: np.ndarray) -> list[np.ndarray]:
        """View nodes (n_nodes, 3) of this process piece by piece, as (ni, nj, nk, 3)."""
        return self.layout.split(nodes)

    def frames(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of this process (m)
    ) -> list[Frame]:
        """Size and plane of the block of each piece of this process; all processes call it."""
        # `InputError` if all nodes of a block are at one point
        rows = np.array([[piece.block, *_extent(x)] for piece, x in zip(self.local, self.nodes_of(nodes))])
        rows = rows.reshape(-1, 10)
        if self.split:
            every = gathered(self.comm, rows[np.isin(rows[:, 0], list(self.split))])
            for n in np.flatnonzero(np.isin(rows[:, 0], list(self.split))):
                same = every[every[:, 0] == rows[n, 0]]
                rows[n, 1:] = *same[:, 1:4].min(axis=0), *same[:, 4:7].max(axis=0), *same[:, 7:].sum(axis=0)
        with together(self.comm):
            return [self._frame(int(row[0]), row[1:4], row[4:7], row[7:]) for row in rows]

    def _frame(self, block: int, low: np.ndarray, high: np.ndarray, area: np.ndarray) -> Frame:
        if not (high > low).any():
            raise InputError(f"{self.source}: all nodes of block {block + 1} are at one point; leave it out")
        size = float(np.linalg.norm(high - low))
        return Frame(size, unit_normal(area) if 1 in self.shapes[block] and has_cells(self.shapes[block]) else None)


def _extent(x: np.ndarray) -> list[float]:
    """Lowest and highest coordinates of nodes (ni, nj, nk, 3), and the sum of the area vectors of a plane."""
    box = [find(x[..., c]) for find in (np.min, np.max) for c in range(3)]
    flat = flat_direction(x.shape) if has_cells(x.shape[:3]) else None
    return [*box, *(np.zeros(3) if flat is None else summed_areas(np.moveaxis(x, flat, 2)[:, :, 0]))]
