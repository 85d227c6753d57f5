"""Polyhedra of CGNS: polygons (NGON_n), and the cells that they bound (NFACE_n, or the polygons' parents).

A list of polygons or cells is one array of numbers: with an array of starts, as in CGNS 4, or with the length of each
before it, as in CGNS 3.

Format: CGNS Standard Interface Data Structures, section "Elements".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import h5py
import numpy as np
from numba import njit

from ....errors import InputError
from ...cells.mixed_cells import fans
from ..cgns_nodes import whole_numbers

__all__ = ["NFACE", "NGON", "Lists", "Polygons"]

NGON, NFACE = 22, 23
"""CGNS's numbers of sections of polygons and of cells by their polygons."""


@dataclass(frozen=True, eq=False)
class Lists:
    """Lists of numbers: corners of polygons, or polygons of cells."""

    numbers: np.ndarray  # (n,) of int, their numbers in the zone, from 1
    values: np.ndarray  # (n_values,) of int, their entries in sequence
    sizes: np.ndarray  # (n,) of int, number of entries of each

    @classmethod
    def read(cls, parts: Mapping[str, h5py.Group], low: int, high: int, what: str) -> Lists:
        """Read the lists of a section with numbers from ``low`` to ``high`` from its nodes."""
        stored, n = whole_numbers(parts["ElementConnectivity"]), high - low + 1
        if not 0 <= n <= len(stored):  # before an array of that size is allocated
            raise InputError(f"{what}: announces {n:,} polygons or cells of {len(stored):,} numbers; write it again")
        if "ElementStartOffset" in parts:
            starts = whole_numbers(parts["ElementStartOffset"])
            is_whole = len(starts) == n + 1 and starts[0] == 0 and starts[-1] == len(stored)
            values, sizes = stored, np.diff(starts)
        else:
            values, sizes = np.empty(len(stored) - n, dtype=np.int64), np.empty(n, dtype=np.int64)
            is_whole = _take_apart(stored, values, sizes)
        if not is_whole or (sizes < 0).any():
            raise InputError(f"{what}: its polygons or polyhedra do not end with the numbers; write it again")
        return cls(np.arange(low, high + 1), values, sizes)

    @classmethod
    def joined(cls, parts: list[Lists]) -> Lists:
        """Join lists of several sections, in the order of their numbers."""
        parts = sorted(parts, key=lambda part: part.numbers[:1].tolist())
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("numbers", "values", "sizes"))
        )


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons of a zone, cut into triangles and quads."""

    numbers: np.ndarray  # (n,) of int, numbers of the polygons in the zone, ascending
    quads: np.ndarray  # (n_quads, 4) of int, their pieces by nodes from 0, see `fans`
    polygon: np.ndarray  # (n_quads,) of int, polygon of each piece, ascending

    @classmethod
    def of(cls, lists: Lists, what: str) -> Polygons:
        """Cut polygons."""
        if (lists.sizes < 3).any():
            worst = int(np.argmin(lists.sizes))
            raise InputError(f"{what}: polygon {lists.numbers[worst]} has {lists.sizes[worst]} corners; write it again")
        return cls(lists.numbers, *fans(lists.values - 1, lists.sizes))

    def of_cells(self, cells: Lists, what: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pieces as seen from cells that list their polygons, their cells and polygons, from 0."""
        # The number of a polygon that faces into the cell is negative.
        numbers = np.abs(cells.values)
        rows = np.minimum(np.searchsorted(self.numbers, numbers), len(self.numbers) - 1)
        is_known = self.numbers[rows] == numbers
        if not is_known.all():
            raise InputError(
                f"{what}: a cell has polygon {numbers[~is_known][0]}, which does not exist; write it again"
            )
        return self._seen(rows, np.repeat(np.arange(len(cells.sizes)), cells.sizes), cells.values < 0)

    def of_parents(self, parents: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pieces as seen from the cells on both sides of polygons, shape (2, n), these cells and polygons, from 0."""
        # A polygon faces from the first to the second; 0 stands for none.
        sides, rows = np.nonzero(parents)
        _, cells = np.unique(parents[sides, rows], return_inverse=True)
        return self._seen(rows, cells.ravel(), sides == 1)

    def _seen(
        self, rows: np.ndarray, cells: np.ndarray, is_turned: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pieces of some polygons for their cells, turned or not."""
        starts = np.searchsorted(self.polygon, np.arange(len(self.numbers) + 1))
        counts = np.diff(starts)[rows]
        first = np.repeat(starts[rows] - np.cumsum(counts) + counts, counts)
        quads, turned = self.quads[first + np.arange(len(first))], np.repeat(is_turned, counts)
        quads[turned] = quads[turned, ::-1]
        return quads, np.repeat(cells, counts), np.repeat(rows, counts)


@njit(cache=True)
def _take_apart(stored, values, sizes):
    """Separate lengths and values; False if they do not end with the numbers."""
    at = n_values = 0
    for k in range(len(sizes)):
        if at >= len(stored) or stored[at] < 0 or stored[at] > len(stored) - at - 1:
            return False
        sizes[k] = stored[at]
        for j in range(stored[at]):
            if n_values >= len(values):
                return False
            values[n_values] = stored[at + 1 + j]
            n_values += 1
        at += 1 + sizes[k]
    return at == len(stored)
