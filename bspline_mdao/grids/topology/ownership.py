"""The process that holds a node or a cell of a grid, and its local number there.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .block_layout import BlockLayout
from .partition import Partition

__all__ = ["Ownership"]


@dataclass(frozen=True, eq=False)
class Ownership:
    """Boxes of the index spaces of blocks, and the process that holds each; by `of_nodes` or `of_cells`."""

    layout: BlockLayout  # layout of the nodes or cells of the grid
    # block, process, lowest indices, shape, and the number there of its first entry
    boxes: tuple[tuple[int, int, np.ndarray, np.ndarray, int], ...]

    @classmethod
    def of_nodes(cls, partition: Partition) -> Ownership:
        """Ownership of nodes; nodes on several processes belong to the first."""
        return cls(partition.layout, _boxes(partition, 0))

    @classmethod
    def of_cells(cls, partition: Partition) -> Ownership:
        """Ownership of cells."""
        return cls(partition.layout.cells, _boxes(partition, 1))

    def find(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Process of each of some nodes or cells, given by their numbers in the grid, and their local numbers there."""
        block, index = self.layout.unravel(numbers)
        ranks, rows = np.full(len(numbers), -1), np.full(len(numbers), -1)
        order = np.argsort(block, kind="stable")
        ends = np.searchsorted(block[order], np.arange(len(self.layout.shapes) + 1))
        for number, rank, low, shape, start in reversed(self.boxes):  # the first one comes last, and stays
            here = order[ends[number] : ends[number + 1]]
            inside = index[here] - low
            is_inside = ((inside >= 0) & (inside < shape)).all(axis=1)
            i, j, k = inside[is_inside].T
            ranks[here[is_inside]] = rank
            rows[here[is_inside]] = start + (i * shape[1] + j) * shape[2] + k
        return ranks, rows


def _boxes(partition: Partition, shrink: int) -> tuple:
    """Boxes of all pieces, with ``shrink`` fewer entries in each direction than their nodes."""
    boxes = []
    for rank, pieces in enumerate(partition.pieces):
        layout = BlockLayout.of([n - shrink for n in piece.shape] for piece in pieces)
        for piece, shape, start in zip(pieces, layout.shapes, layout.starts.tolist()):
            boxes.append((piece.block, rank, np.array(piece.lo), np.array(shape), start))
    return tuple(boxes)
