"""A grid whose nodes stay in storage, such as its file: blocks and windows are read on request.

It has the names, shapes and patches of a `bspline_mdao.grids.topology.grid.Grid`, but holds no nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .block_layout import BlockLayout
from .grid import Block, Grid, Patch
from .index_space import Interface, Window
from .periodic_pair import PeriodicPair

__all__ = ["StoredBlock", "StoredGrid"]


@dataclass(frozen=True, eq=False)
class StoredBlock:
    """A block whose nodes are read on request, and not kept."""

    shape: tuple[int, ...]  # number of nodes in each direction
    name: str  # name of the block
    read: Callable[[Window | None], Block]  # takes a `Window` and returns a `Block` of its nodes; None for the whole

    @property
    def nodes(self) -> np.ndarray:
        """All nodes, shape (ni, nj, nk, 3), read now (m)."""
        return self.read(None).nodes

    @property
    def iblank(self) -> np.ndarray | None:
        """PLOT3D blanking, shape (ni, nj, nk), read now."""
        return self.read(None).iblank


@dataclass(frozen=True, eq=False)
class StoredGrid(OneLine):
    """A grid whose nodes stay in its file. Made by `bspline_mdao.open_grid`; it can be sent to other processes."""

    blocks: tuple[StoredBlock, ...]  # the blocks in file order
    patches: tuple[Patch, ...] = ()  # declared patches
    source: str = "grid"  # origin of the grid, for messages
    dialect: Any = field(default=None, compare=False)  # details of the file's format
    connections: tuple[Interface, ...] = ()  # one-to-one connections that the file declares, each once
    unit: str = ""  # unit of lengths; empty if unknown
    periodic: tuple[PeriodicPair, ...] = ()  # sides that the file declares as periodic

    @property
    def length_unit(self) -> str:
        """Unit in which lengths are shown: metres if unknown."""
        return self.unit or "m"

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Number of nodes of every block in each direction."""
        return tuple(block.shape for block in self.blocks)

    @cached_property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of the blocks in the grid vector."""
        return BlockLayout.of(self.shapes)

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks; interface nodes are counted once for every block that contains them."""
        return self.layout.size

    def read(self, window: Window) -> Block:
        """Read the nodes of a window of a block, as a block."""
        self._require_block(window.block)
        shape = self.blocks[window.block].shape
        if not Window.whole(window.block, shape).contains(window):
            raise InputError(
                f"{self.source}: block {window.block + 1} of {shape} nodes has no window {window.lo} to {window.hi}; "
                f"its indices count from 0"
            )
        return self.blocks[window.block].read(window)

    def grid(
        self,
        # their numbers, from 0, in the desired order; all by default
        blocks: Iterable[int] | None = None,
    ) -> Grid:
        """Read some of the blocks as a grid, with their patches and the connections between them."""
        numbers = list(range(len(self.blocks))) if blocks is None else [int(number) for number in blocks]
        for number in numbers:
            self._require_block(number)
        if len(set(numbers)) < len(numbers):
            raise InputError(f"{self.source}: a block is asked for twice in {numbers}; name each once")
        return Grid(
            tuple(self.blocks[number].read(None) for number in numbers),
            _patches_of(self.patches, numbers),
            self.source,
            self.dialect if numbers == list(range(len(self.blocks))) else None,
            tuple(
                replace(item, a=_renumbered(item.a, numbers), b=_renumbered(item.b, numbers))
                for item in self.connections
                if item.a.block in numbers and item.b.block in numbers
            ),
            self.unit,
            _pairs_of(self.periodic, numbers),
        )

    def _require_block(self, number: int) -> None:
        if not 0 <= number < len(self.blocks):
            raise InputError(
                f"{self.source}: there is no block {number}; its {len(self.blocks)} blocks are numbered from 0"
            )

    @classmethod
    def of(cls, grid: Grid) -> StoredGrid:
        """Treat a grid in memory as a stored one."""
        blocks = tuple(StoredBlock(block.shape, block.name, partial(_part, block)) for block in grid.blocks)
        return cls(blocks, grid.patches, grid.source, grid.dialect, grid.connections, grid.unit, grid.periodic)


def _part(block: Block, window: Window | None) -> Block:
    """Take a window out of a block in memory."""
    if window is None:
        return block
    iblank = None if block.iblank is None else block.iblank[window.slices]
    return Block(block.nodes[window.slices], block.name, iblank)


def _renumbered(window: Window, numbers: Sequence[int]) -> Window:
    return replace(window, block=numbers.index(window.block))


def _patches_of(patches: Sequence[Patch], numbers: Sequence[int]) -> tuple[Patch, ...]:
    """Patches of some blocks, renumbered, without patches that have no window there."""
    parts = (
        replace(patch, windows=tuple(_renumbered(w, numbers) for w in patch.windows if w.block in numbers))
        for patch in patches
    )
    return tuple(patch for patch in parts if patch.windows)


def _pairs_of(pairs: Sequence[PeriodicPair], numbers: Sequence[int]) -> tuple[PeriodicPair, ...]:
    """Periodic sides of some blocks, renumbered, without pairs with one side elsewhere."""
    parts = (
        replace(pair, windows=tuple(windows), others=tuple(others))
        for pair in pairs
        for windows, others in [
            ([_renumbered(w, numbers) for w in side if w.block in numbers] for side in (pair.windows, pair.others))
        ]
    )
    return tuple(pair for pair in parts if pair.windows and pair.others)
