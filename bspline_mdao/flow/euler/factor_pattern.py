"""The pattern of the preconditioner's factor: the large entries in a factor of a scalar matrix, the areas of faces.

A level of fill counts cells: it keeps as much along flat cells, where a factor is almost zero, as across them. A factor
of the matrix with the areas of the faces as couplings shows where the blocks will be large: its small entries are left
out, and fill extends as far as it is large. The pattern depends only on the grid, and is found once.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ...base.numerics.halo import Halo
from ...base.numerics.processes import summed_number
from ...base.sparse.blocks import Graph
from ...base.sparse.incomplete import IncompletePattern, narrow_order
from ...grids.cells.cell_faces import NONE
from .block_factor import Schedule, levels_of
from .interface_schur import Border
from .reconstruction import FARFIELD
from .residual import Discretization

__all__ = ["FactorPattern", "factor_pattern"]

SMALLEST = 0.01
"""Size, relative to the pivots of its row and its column, above which an entry of the factor of areas is kept."""

LARGE, SMALLEST_OF_LARGE = 200_000, 0.003
"""Cells of a grid beyond which more is kept, and the size for them: products grow with the grid, and twice the fill
saves a third of them. On smaller grids sweeps would take longer by as much, with 0.002 they do on these.

In rows of border cells, of which there are few, this size applies on any grid: they come last, whatever the order of
the others, and more is filled in there. It saves 2 to 4 % of the products on two processes, and 3 to 8 % on four."""


def factor_pattern(
    discretization: Discretization,
    face_sizes: np.ndarray,  # (n_faces,), areas of the faces (m^2)
) -> FactorPattern:
    """Find the pattern of the factor, once per grid; all processes call it together."""
    faces, is_far = discretization.faces, discretization.stencil.roles == FARFIELD
    behind = faces.beyond_left[faces.n_inner :]
    others = np.append(faces.right, np.where(behind == NONE, faces.n_cells, behind))
    coupled, passed = face_sizes.astype(float), face_sizes.astype(float)
    coupled[faces.n_inner :] = 0.0  # the first two cells inwards are neighbours, but not through this face
    passed[faces.n_inner :][~is_far[faces.n_inner :]] = 0.0
    matrix = faces.left, others, coupled, faces.sum_over_cells(passed, 1.0)
    smallest = smallest_entry(int(summed_number(discretization.halo.comm, faces.n_cells)))
    if discretization.halo.comm.size == 1:
        return FactorPattern.of(*matrix, smallest=smallest)
    is_cut = np.maximum(faces.left[: faces.n_inner], faces.right) >= faces.n_cells
    return FactorPattern.of_subdomain(*matrix, np.flatnonzero(is_cut), discretization.halo, smallest)


def smallest_entry(n_cells: int) -> float:
    """Size of the smallest entries in the factor of a grid of so many cells.

    Examples
    --------
    >>> smallest_entry(40_000), smallest_entry(1_000_000)
    (0.01, 0.003)
    """
    return SMALLEST if n_cells <= LARGE else SMALLEST_OF_LARGE


@dataclass(frozen=True, eq=False)
class FactorPattern(IncompletePattern):
    """Pattern of the factor, and the places in it of the blocks of the faces of the grid; points are cells.

    ``parts``, shape (5,), are the rows between which lie two parts that have no entries in each other's columns, the
    cells that separate them, and the border cells of several processes, see `_parts`. Within each the rows of a level
    are adjacent. ``places`` are the entries of the pairs of neighbours, those at faces and, at the boundary, the first
    two cells inwards; -1 if there is only one cell, or the second one inwards is on another process. Pairs of two
    border cells have places after the entries. With several processes ``border`` has the cells next to other processes,
    the last rows, and ``outer`` the pattern of their factor. The other fields are as in `IncompletePattern`.
    """

    parts: np.ndarray
    places: np.ndarray
    border: Border | None = None
    outer: FactorPattern | None = None

    @cached_property
    def schedule(self) -> Schedule:
        """Order in which threads share the rows."""
        return Schedule.of(self.starts, self.columns, self.parts)

    @property
    def n_entries(self) -> int:
        """Number of the entries plus the own pairs of border cells after them."""
        return len(self.columns) + (self.border.pairs.n_owned if self.border else 0)

    @classmethod
    def of(
        cls,
        # left, right: (n_pairs,) of int, pairs of neighbours; pairs with numbers of n or more, for none, have no place
        left: np.ndarray,
        right: np.ndarray,
        # (n_pairs,), off-diagonal entries of the scalar matrix, times -1; for repeated pairs, the sum
        couplings: np.ndarray,
        diagonal: np.ndarray,  # (n,), its diagonal: for every cell at least the sum of its couplings
        *,
        smallest: float,  # see `smallest_entry`; 0 for complete fill. Neighbours are always kept.
        has_turn: bool = True,  # whether cells are eliminated from both ends to the middle, for two threads
    ) -> FactorPattern:
        """Order the cells, and find the fill."""
        is_last = np.zeros(len(diagonal), bool)
        return cls._with_last(left, right, couplings, diagonal, is_last, has_turn, smallest)[0]

    @classmethod
    def of_subdomain(
        cls,
        # left, right, couplings, diagonal: see `of`; numbers of n or more are cells of other processes after the own
        # ones, or none
        left: np.ndarray,
        right: np.ndarray,
        couplings: np.ndarray,
        diagonal: np.ndarray,
        cut: np.ndarray,  # of int, pairs of an own cell and one of another process at a face
        halo: Halo,  # exchange of cells
        smallest: float,  # see `of`
    ) -> FactorPattern:
        """Find the pattern for the cells of one process, its border cells last: all processes call it together."""
        # They are eliminated from one end to the other: a turn in each of four processes takes 6 to 10 % more products.
        n, ends = len(diagonal), np.stack([left[cut], right[cut]])
        local, others = ends.min(axis=0), ends.max(axis=0)
        is_border = np.zeros(n, bool)
        is_border[local] = True
        pattern, inside, values, pivots = cls._with_last(left, right, couplings, diagonal, is_border, False, smallest)
        pattern.places[cut] = len(pattern.columns) + len(values) + np.arange(len(cut))
        numbers = np.where(is_border, pattern.rank - (n - len(pivots)), -1)
        names = numbers[local], halo.extend(numbers)[others], halo.owners()[others]
        border = Border.of(halo.comm, len(pivots), inside, *names)
        sums = border.pairs.extend(np.append(values, couplings[cut]))
        matrix = border.left, border.right, sums, border.cells.extend(pivots)
        outer = cls.of(*matrix, smallest=smallest, has_turn=False)
        return replace(pattern, border=border, outer=outer)

    @classmethod
    def _with_last(
        cls,
        left: np.ndarray,
        right: np.ndarray,
        couplings: np.ndarray,
        diagonal: np.ndarray,
        is_last: np.ndarray,
        has_turn: bool,
        smallest: float,
    ) -> tuple:
        """Pattern with some cells as its last rows, between which it has no entries."""
        # Returns pattern: pairs of two of these cells have places after its entries; pairs: of int, these pairs, by the
        # numbers of the rows among the last ones, the later one first; couplings, diagonal: the scalar matrix that
        # remains there after elimination of all others.
        n, n_first = len(diagonal), int(np.count_nonzero(~is_last))
        places, is_local = np.full(len(left), -1), (left < n) & (right < n)
        left, right = left[is_local], right[is_local]
        order, parts = _parts(left, right, is_last, has_turn)
        rank = _ranks(order)
        lower = _lower_rows(rank[left], rank[right], couplings[is_local], n)
        pivots = np.maximum(diagonal, np.finfo(np.float32).tiny)[order]
        matrix = lower.indptr, lower.indices, lower.data, pivots
        starts, columns, values, pivots = _large_entries(*matrix, n_first, smallest, min(smallest, SMALLEST_OF_LARGE))
        rows, is_rest = np.repeat(np.arange(n, dtype=np.int32), np.diff(starts)), columns >= n_first
        rest = rows[is_rest], columns[is_rest], values[is_rest[starts[n_first] :]]
        rows, columns = rows[~is_rest], columns[~is_rest]
        np.cumsum(np.bincount(rows, minlength=n), out=starts[1:])
        part = np.repeat(np.arange(len(parts) - 1), np.diff(parts))
        by_level = np.lexsort((levels_of(starts, columns), part))  # rows still come after those they need
        place = _ranks(by_level)
        inner = _lower_rows(place[rows], place[columns], np.zeros(len(columns), np.int8), n)
        outer = _lower_rows(place[rest[0]] - n_first, place[rest[1]] - n_first, -rest[2], n - n_first)
        order, rank = order[by_level], place[rank]
        places[is_local] = _places(inner, outer, np.stack([rank[left], rank[right]]))
        pattern = cls(order, rank, inner.indptr.astype(np.int64), inner.indices.astype(np.int32), parts, places)
        pairs = np.repeat(np.arange(n - n_first), np.diff(outer.indptr)), outer.indices.astype(int)
        return pattern, pairs, outer.data, pivots[by_level[n_first:]]


def _parts(left: np.ndarray, right: np.ndarray, is_last: np.ndarray, has_turn: bool) -> tuple[np.ndarray, np.ndarray]:
    """Reverse Cuthill-McKee order, or with its second half reversed, followed by the separator of both."""
    # Returns order: (n,) of int, some points come after all others; parts: (5,) of int, bounds of the first half, the
    # second, the separator, and these points; without a turn all are in the first half.
    #
    # Two threads take a half each and wait for each other once. An order with such a turn takes hardly more products
    # than one without it, whereas two halves that both run forwards take half as many more.
    n, ends = len(is_last), (np.concatenate([left, right]), np.concatenate([right, left]))
    both = csr_array((np.ones(2 * len(left), np.int8), ends), shape=(n, n))
    both.sum_duplicates()
    order = narrow_order(Graph(both.indptr.astype(np.int64), both.indices.astype(np.int32)))
    order = order[np.argsort(is_last[order], kind="stable")]
    n_first = n - int(np.count_nonzero(is_last))
    if not has_turn:
        return order, np.array([0, n_first, n_first, n_first, n])
    middle, ranks = n_first // 2, np.sort(_ranks(order)[np.stack([left, right])], axis=0)
    separator = np.unique(ranks[0, (ranks[0] < middle) & (middle <= ranks[1]) & (ranks[1] < n_first)])
    first, last = np.delete(order[:middle], separator), order[n_first:]
    found = [first, order[middle:n_first][::-1], order[separator], last]
    return np.concatenate(found), np.cumsum([0, *map(len, found)])


def _places(inner: csr_array, outer: csr_array, pairs: np.ndarray) -> np.ndarray:
    """Entries of pairs of rows, shape (2, n), in a pattern and, after it, in the pattern of its last rows."""
    n_first = inner.shape[0] - outer.shape[0]
    found, is_outer = np.empty(pairs.shape[1], np.int64), pairs.min(axis=0) >= n_first
    found[~is_outer] = _find(inner.indptr.astype(np.int64), inner.indices, *pairs[:, ~is_outer])
    found[is_outer] = _find(outer.indptr.astype(np.int64), outer.indices, *(pairs[:, is_outer] - n_first))
    found[is_outer] += len(inner.indices)
    return found


def _ranks(order: np.ndarray) -> np.ndarray:
    """Place of every point in an order."""
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return rank


def _lower_rows(left: np.ndarray, right: np.ndarray, values: np.ndarray, n: int) -> csr_array:
    """Lower triangle of a symmetric matrix by rows, columns ascending."""
    rows = csr_array((values, (np.maximum(left, right), np.minimum(left, right))), shape=(n, n))
    rows.sum_duplicates()
    return rows


@njit(cache=True, error_model="numpy")
def _large_entries(starts, columns, couplings, diagonal, n_first, smallest, smallest_behind):
    """Find the large entries of the factor L D L^T of a symmetric matrix, row by row; columns ascend."""
    # Only the first ``n_first`` columns are eliminated: the values and pivots of later rows are those of the remaining
    # matrix. The size of small entries differs between the rows up to there and the later ones.
    #
    # For every row i, from the couplings in it:
    #
    # 1. Take the next column k, and skip it if its entry is small and not a coupling.
    # 2. Add its fill, ``a_ij - a_ik a_jk / d_k`` for the finished rows j in column k, k < j < i, which are columns of
    #    this row, and to the pivot ``d_i``.
    # 3. When all are taken, put the row in the lists of its columns.
    n = len(diagonal)
    found, entries, later = np.empty(8 * n + 64, np.int32), np.empty(8 * n + 64), np.empty(8 * n + 64, np.int64)
    row_of, ends, heads = np.empty(8 * n + 64, np.int32), np.zeros(n + 1, np.int64), np.full(n, -1)
    pivots, values, seen, coupled = diagonal.copy(), np.zeros(n), np.full(n, -1), np.full(n, -1)
    waiting, total = np.empty(n, np.int32), 0
    for i in range(n):
        n_waiting, small = 0, (smallest if i < n_first else smallest_behind)
        for at in range(starts[i], starts[i + 1]):
            values[columns[at]], seen[columns[at]], coupled[columns[at]] = -couplings[at], i, i
            waiting[n_waiting] = columns[at]
            n_waiting += 1
        while n_waiting > 0:  # step 1
            n_waiting -= 1
            for other in range(n_waiting):  # the smallest one goes to the end
                if waiting[other] < waiting[n_waiting]:
                    waiting[other], waiting[n_waiting] = waiting[n_waiting], waiting[other]
            k = waiting[n_waiting]
            value = values[k]
            if coupled[k] != i and abs(value) <= small * min(diagonal[i], pivots[k]):
                continue
            at, part = (heads[k] if k < n_first else -1), value / pivots[k]
            while at >= 0:  # step 2
                j = row_of[at]
                if seen[j] != i:
                    values[j], seen[j] = 0.0, i
                    waiting[n_waiting] = j
                    n_waiting += 1
                values[j] -= part * entries[at]
                at = later[at]
            if k < n_first:
                pivots[i] = max(pivots[i] - part * value, 1e-12 * diagonal[i])
            if total == len(found):
                found, row_of = np.concatenate((found, found)), np.concatenate((row_of, row_of))
                entries, later = np.concatenate((entries, entries)), np.concatenate((later, later))
            found[total], entries[total], row_of[total] = k, value, i
            total += 1
        for at in range(ends[i], total):  # step 3
            later[at] = heads[found[at]]
            heads[found[at]] = at
        ends[i + 1] = total
    return ends, found[:total].copy(), entries[ends[n_first] : total].copy(), pivots


@njit(cache=True, error_model="numpy")
def _find(starts, columns, left, right):
    """Find the entry of the pattern for each pair of rows."""
    places = np.empty(len(left), np.int64)
    for n in range(len(left)):
        row, column = max(left[n], right[n]), min(left[n], right[n])
        places[n] = starts[row] + np.searchsorted(columns[starts[row] : starts[row + 1]], column)
    return places
