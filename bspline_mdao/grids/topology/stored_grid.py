"""A grid whose nodes stay where they are stored, such as in its file: blocks and windows are read when asked for.

It has what a `bspline_mdao.grids.topology.grid.Grid` has, names, shapes and patches, and holds no node.
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
    """A block whose nodes are read when they are asked for, and not kept."""

    shape: tuple[int, ...]  # number of nodes in each direction
    name: str  # name of the block
    read: Callable[[Window | None], Block]  # takes a `Window` and returns a `Block` of its nodes; None is the whole

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
    """A grid whose nodes stay in its file. Made by `bspline_mdao.open_grid`; other processes may be sent it."""

    blocks: tuple[StoredBlock, ...]  # the blocks in file order
    patches: tuple[Patch, ...] = ()  # declared patches
    source: str = "grid"  # where the grid came from, for messages
    dialect: Any = field(default=None, compare=False)  # how the file was written
    connections: tuple[Interface, ...] = ()  # one-to-one connections that the file declares, each once
    unit: str = ""  # unit of lengths; empty where nobody says it
    periodic: tuple[PeriodicPair, ...] = ()  # sides that the file declares as periodic

    @property
    def length_unit(self) -> str:
        """Unit that lengths are shown in: metres where nobody says another one."""
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
        """Nodes of all blocks, interface nodes counted once for every block that holds them."""
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
        # their numbers, from 0, in the order in which they are wanted; all by default
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
        """See a grid in memory as a stored one."""
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
    """Patches of some blocks, which are numbered anew; those without a window there are left out."""
    parts = (
        replace(patch, windows=tuple(_renumbered(w, numbers) for w in patch.windows if w.block in numbers))
        for patch in patches
    )
    return tuple(patch for patch in parts if patch.windows)


def _pairs_of(pairs: Sequence[PeriodicPair], numbers: Sequence[int]) -> tuple[PeriodicPair, ...]:
    """Periodic sides of some blocks, which are numbered anew; those of which one side is elsewhere are left out."""
    parts = (
        replace(pair, windows=tuple(windows), others=tuple(others))
        for pair in pairs
        for windows, others in [
            ([_renumbered(w, numbers) for w in side if w.block in numbers] for side in (pair.windows, pair.others))
        ]
    )
    return tuple(pair for pair in parts if pair.windows and pair.others)
