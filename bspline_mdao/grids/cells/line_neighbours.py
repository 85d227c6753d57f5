"""Neighbours of every cell along its grid lines, and the orientation of their index spaces relative to its own.

Slot ``2 d + s`` of a cell is its low (s = 0) or high (s = 1) side in direction d. Lines run through interfaces of any
orientation and end at boundaries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..topology.index_space import Interface, Window
from ..topology.topology import Topology
from .cell_faces import NONE

__all__ = ["LineNeighbours"]


@dataclass(frozen=True, eq=False)
class LineNeighbours:
    """Neighbours of the cells of a multi-block grid, numbered block after block, each in C order."""

    cells: np.ndarray  # int (n_cells, 6), cell beyond each slot; -1 if there is none
    entries: np.ndarray  # int (n_cells, 6), slot of that cell that leads back
    directions: np.ndarray  # int (n_cells, 6, 3), direction of that cell along each direction of this one
    signs: np.ndarray  # (n_cells, 6, 3), 1, or -1 if it runs backwards

    @classmethod
    def of(cls, topology: Topology) -> LineNeighbours:
        """Follow the lines of all blocks."""
        blocks, n_cells = topology.layout.cells.numbers, topology.layout.cells.size
        cells, entries = np.full((n_cells, 6), NONE), np.zeros((n_cells, 6), dtype=int)
        directions, signs = np.tile(np.arange(3), (n_cells, 6, 1)), np.ones((n_cells, 6, 3))
        for block in blocks:
            for d in range(3):
                line = np.moveaxis(block, d, 0)
                low, high = line[:-1].ravel(), line[1:].ravel()
                cells[low, 2 * d + 1], entries[low, 2 * d + 1] = high, 2 * d
                cells[high, 2 * d], entries[high, 2 * d] = low, 2 * d + 1
        for interface in topology.interfaces:
            for way in (interface, interface.reverse()):
                here, slot, others, entry = _across(blocks, way)
                cells[here, slot], entries[here, slot] = others, entry
                directions[here, slot] = way.orientation.perm
                signs[here, slot] = np.where(way.orientation.flip, -1.0, 1.0)
        return cls(cells, entries, directions, signs)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells)

    def beyond(self, slot: int) -> csr_array:
        """Matrix of the values beyond a slot, shape (n_cells, n_cells), from the values of all cells."""
        # At the end of a line they are extrapolated, by a parabola, a line or a constant as far as its length allows.
        here, first, second = self._inwards(slot)
        is_end = self.cells[:, slot] == NONE
        has_first, has_second = first != NONE, second != NONE
        entries = [
            (here[~is_end], self.cells[~is_end, slot], 1.0),
            *_weighted(here, here, is_end, ~has_first, 1.0),
            *_weighted(here, here, is_end, has_first & ~has_second, 2.0),
            *_weighted(here, first, is_end, has_first & ~has_second, -1.0),
            *_weighted(here, here, is_end, has_second, 3.0),
            *_weighted(here, first, is_end, has_second, -3.0),
            *_weighted(here, second, is_end, has_second, 1.0),
        ]
        return _matrix(entries, (self.n_cells, self.n_cells))

    def slopes_beyond(self, slot: int, d: int) -> csr_array:
        """Matrix of the slopes along own direction d beyond a slot, from all slopes: shape (n_cells, 3 n_cells)."""
        # The slopes of all cells along their direction 0 come first. At the end of a line they are extrapolated
        # linearly.
        here, first, _ = self._inwards(slot)
        is_end, has_first = self.cells[:, slot] == NONE, first != NONE
        through, inwards = self._turned(here[~is_end], slot, d), self._turned(here[is_end & has_first], slot ^ 1, d)
        kept = d * self.n_cells + here
        entries = [
            (here[~is_end], *through),
            *_weighted(here, kept, is_end, ~has_first, 1.0),
            *_weighted(here, kept, is_end, has_first, 2.0),
            (here[is_end & has_first], inwards[0], -inwards[1]),
        ]
        return _matrix(entries, (self.n_cells, 3 * self.n_cells))

    def _inwards(self, slot: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All cells, and the first and second behind each as seen from a slot."""
        here, first = np.arange(self.n_cells), self.cells[:, slot ^ 1]
        second = np.where(first == NONE, NONE, self.cells[first, self.entries[:, slot ^ 1] ^ 1])
        return here, first, second

    def _turned(self, cells: np.ndarray, slot: int, d: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns and signs, in all slopes, for own direction d of the neighbours of some cells."""
        return self.directions[cells, slot, d] * self.n_cells + self.cells[cells, slot], self.signs[cells, slot, d]


def _across(blocks: list[np.ndarray], interface: Interface) -> tuple[np.ndarray, int, np.ndarray, int]:
    """Cells on side a of an interface, their slot, the cells that they meet, and the slot of these."""
    (here, slot), (others, entry) = (_behind(blocks[window.block], window) for window in (interface.a, interface.b))
    return here.ravel(), slot, interface.orientation.apply(others).ravel(), entry


def _behind(cells: np.ndarray, window: Window) -> tuple[np.ndarray, int]:
    """Cells behind a face window, and their slot there."""
    d = next(d for d in range(3) if window.lo[d] == window.hi[d])
    side = int(window.lo[d] > 0)
    parts = [slice(lo, hi) for lo, hi in zip(window.lo, window.hi)]
    parts[d] = slice(-1, None) if side else slice(0, 1)
    return cells[tuple(parts)], 2 * d + side


def _weighted(
    rows: np.ndarray, columns: np.ndarray, *conditions_and_weight: Any
) -> Iterator[tuple[np.ndarray, np.ndarray, Any]]:
    """Yield the entries of a matrix where all conditions hold, with one weight."""
    *conditions, weight = conditions_and_weight
    kept = np.logical_and.reduce(conditions)
    yield rows[kept], columns[kept], weight


def _matrix(entries: Iterable[tuple[np.ndarray, np.ndarray, Any]], shape: tuple[int, int]) -> csr_array:
    """Sparse matrix of lists of rows, columns and values."""
    rows, columns, values = zip(*((r, c, np.broadcast_to(v, r.shape)) for r, c, v in entries))
    return coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape).tocsr()
