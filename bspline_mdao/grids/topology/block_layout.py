"""Places of the entries of blocks in one flat array: block after block, each in C order.

Nodes, cells, control points and the faces of patches are all numbered in this way::

    shapes  (3, 4, 2)      (5, 1, 2)      (2, 2, 2)
            |------------- | ----------- | -------- |
    starts  0              24            34         42 = size

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine

__all__ = ["BlockLayout", "has_cells"]


@dataclass(frozen=True)
class BlockLayout(OneLine):
    """Shapes of blocks whose entries are numbered consecutively, block after block, each in C order; made by `of`."""

    # number of entries of each block in each direction, of as many directions in all blocks
    shapes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, shapes: Iterable[Sequence[int]]) -> BlockLayout:
        """Lay out blocks of some shapes."""
        return cls(tuple(tuple(int(n) for n in shape) for shape in shapes))

    def __getstate__(self) -> dict:
        """State without what is derived from the shapes."""
        return {"shapes": self.shapes}

    @cached_property
    def starts(self) -> np.ndarray:
        """Number of the first entry of each block, followed by the number of all entries: (n_blocks + 1,)."""
        starts = np.cumsum([0, *map(math.prod, self.shapes)], dtype=np.int64)
        starts.flags.writeable = False
        return starts

    @property
    def size(self) -> int:
        """Number of all entries, however large: shapes may come from a damaged file."""
        return sum(map(math.prod, self.shapes))

    @property
    def slices(self) -> list[slice]:
        """Slice of each block in the flat array."""
        return [slice(*ends) for ends in zip(self.starts[:-1].tolist(), self.starts[1:].tolist())]

    @property
    def numbers(self) -> list[np.ndarray]:
        """Numbers of the entries of each block, in the block's shape."""
        return self.split(np.arange(self.size))

    @cached_property
    def cells(self) -> BlockLayout:
        """Layout of the cells between nodes: one layer for one node, none in a line or a point."""
        return BlockLayout(tuple(_n_cells(shape) for shape in self.shapes))

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """View values (size, ...) block by block, each of shape (*shape, ...)."""
        return [values[part].reshape(*shape, *values.shape[1:]) for part, shape in zip(self.slices, self.shapes)]

    def join(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Join values of all blocks, each of shape (*shape, ...), into an array (size, ...): the inverse of `split`."""
        flat = [
            np.reshape(values, (math.prod(shape), *values.shape[len(shape) :]))
            for values, shape in zip(blocks, self.shapes, strict=True)
        ]
        return np.concatenate(flat)

    def owner(self, numbers: np.ndarray) -> np.ndarray:
        """Block that contains each of some entries, by their numbers."""
        return np.searchsorted(self.starts, numbers, side="right") - 1

    def unravel(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Block, shape (n,), and indices there, shape (n, n_directions), of entries by their numbers, shape (n,)."""
        block = self.owner(numbers)
        sizes = self._sizes[block]
        index = np.empty(sizes.shape, dtype=np.int64)
        rest = numbers - self.starts[block]
        for d in range(sizes.shape[1] - 1, 0, -1):
            rest, index[:, d] = np.divmod(rest, sizes[:, d])
        index[:, 0] = rest
        return block, index

    def ravel(self, block: np.ndarray | int, index: np.ndarray) -> np.ndarray:
        """Numbers of entries from their block and indices there, shape (n, n_directions): the inverse of `unravel`."""
        sizes, number = self._sizes[block], np.zeros(len(index), dtype=np.int64)
        for d in range(sizes.shape[-1]):
            number = number * sizes[..., d] + index[:, d]
        return self.starts[block] + number

    @cached_property
    def _sizes(self) -> np.ndarray:
        """Shapes as an array (n_blocks, n_directions), with three directions if there is no block."""
        n_directions = len(self.shapes[0]) if self.shapes else 3
        return np.array(self.shapes, dtype=np.int64).reshape(len(self.shapes), n_directions)


def has_cells(shape: Sequence[int]) -> bool:
    """Whether a block of ``shape`` nodes has cells: in three directions, or in two."""
    return sum(n > 1 for n in shape) > 1


def _n_cells(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(max(n - 1, 1) for n in shape) if has_cells(shape) else (0,) * len(shape)
