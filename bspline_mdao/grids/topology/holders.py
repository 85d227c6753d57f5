"""Which process holds a node or a cell of a grid, and where among its own.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .partition import Partition

__all__ = ["Holders", "cell_shapes", "indices_of"]


@dataclass(frozen=True, eq=False)
class Holders:
    """Boxes of the index spaces of blocks, and the process that has each; by `of_nodes` or `of_cells`.

    Parameters
    ----------
    shapes : tuple of tuple of int
        Shape of the index space of each block.
    boxes : tuple of (int, int, ndarray, ndarray, int)
        Block, process, lowest indices, shape, and the number there of its first entry.
    """

    shapes: tuple[tuple[int, ...], ...]
    boxes: tuple[tuple[int, int, np.ndarray, np.ndarray, int], ...]

    @classmethod
    def of_nodes(cls, partition: Partition) -> Holders:
        """Nodes; of those that several processes hold, the first process has them."""
        return cls(partition.shapes, _boxes(partition, 0))

    @classmethod
    def of_cells(cls, partition: Partition) -> Holders:
        """Cells."""
        return cls(cell_shapes(partition.shapes), _boxes(partition, 1))

    def find(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Process that has each of some nodes or cells, given by their numbers in the grid, and their numbers there."""
        block, index = indices_of(self.shapes, numbers)
        ranks, rows = np.full(len(numbers), -1), np.full(len(numbers), -1)
        order = np.argsort(block, kind="stable")
        ends = np.searchsorted(block[order], np.arange(len(self.shapes) + 1))
        for number, rank, low, shape, start in reversed(self.boxes):  # the first one comes last, and stays
            here = order[ends[number] : ends[number + 1]]
            inside = index[here] - low
            is_inside = ((inside >= 0) & (inside < shape)).all(axis=1)
            i, j, k = inside[is_inside].T
            ranks[here[is_inside]] = rank
            rows[here[is_inside]] = start + (i * shape[1] + j) * shape[2] + k
        return ranks, rows


def cell_shapes(shapes: Sequence[tuple[int, ...]]) -> tuple[tuple[int, int, int], ...]:
    """Cells of each block in each direction, of blocks of given numbers of nodes."""
    return tuple((ni - 1, nj - 1, nk - 1) for ni, nj, nk in shapes)


def indices_of(shapes: Sequence[tuple[int, ...]], numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Block, shape (n,), and indices, shape (n, 3), of what is numbered blocks in order, each in C order."""
    starts = np.cumsum([0, *map(math.prod, shapes)])
    block = np.searchsorted(starts, numbers, side="right") - 1
    sizes = np.array(shapes)[block]
    rest, k = np.divmod(numbers - starts[block], sizes[:, 2])
    i, j = np.divmod(rest, sizes[:, 1])
    return block, np.stack([i, j, k], axis=1)


def _boxes(partition: Partition, shrink: int) -> tuple:
    """Boxes of all pieces, fewer by ``shrink`` in each direction than their nodes."""
    boxes = []
    for rank, pieces in enumerate(partition.pieces):
        start = 0
        for piece in pieces:
            shape = np.array(piece.shape) - shrink
            boxes.append((piece.block, rank, np.array(piece.lo), shape, start))
            start += int(np.prod(shape))
    return tuple(boxes)
