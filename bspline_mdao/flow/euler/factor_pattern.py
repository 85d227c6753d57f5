"""The pattern of the preconditioner's factor: what is large in a factor of a matrix of numbers, the areas of faces.

A level of fill counts cells: it keeps as much along flat cells, where a factor is next to nothing, as across them. A
factor of the matrix that has the areas of the faces for couplings tells where the blocks will be large: what is small
in it is left out, and fill goes as far as it is large. The pattern is of the grid alone, and found once.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ...cells.cell_faces import NONE
from ...sparse.blocks import Graph
from ...sparse.incomplete import IncompletePattern, narrow_order
from .block_factor import Schedule, levels_of
from .discretization import Discretization
from .reconstruction import FARFIELD

__all__ = ["FactorPattern", "factor_pattern"]

SMALLEST = 0.01
"""Size, relative to the pivots of its row and its column, from which on an entry of the factor of areas is kept."""


def factor_pattern(discretization: Discretization, face_sizes: np.ndarray) -> FactorPattern:
    """Find the pattern of the factor, once per grid.

    Parameters
    ----------
    discretization : Discretization
    face_sizes : ndarray, shape (n_faces,)
        Areas of the faces (m^2).
    """
    faces, is_far = discretization.faces, discretization.stencil.roles == FARFIELD
    behind = faces.beyond_left[faces.n_inner :]
    others = np.append(faces.right, np.where(behind == NONE, faces.n_cells, behind))
    coupled, passed = face_sizes.astype(float), face_sizes.astype(float)
    coupled[faces.n_inner :] = 0.0  # the first two cells inwards are neighbours, but not through this face
    passed[faces.n_inner :][~is_far[faces.n_inner :]] = 0.0
    return FactorPattern.of(faces.left, others, coupled, faces.sum_over_cells(passed, 1.0))


@dataclass(frozen=True, eq=False)
class FactorPattern(IncompletePattern):
    """Pattern of the factor, and the places in it of the blocks that faces of the grid make.

    Parameters
    ----------
    order, rank, starts, columns : ndarray
        See `IncompletePattern`; points are cells.
    places : ndarray of int64, shape (n_pairs,)
        Entry of every pair of neighbours, those at faces and, at the boundary, the first two cells inwards; -1 where
        there is one cell alone, or one of them is a cell of another process.
    """

    places: np.ndarray

    @cached_property
    def schedule(self) -> Schedule:
        """Order in which threads share the rows."""
        return Schedule.of(self.starts, self.columns)

    @classmethod
    def of(
        cls, left: np.ndarray, right: np.ndarray, couplings: np.ndarray, diagonal: np.ndarray, smallest=SMALLEST
    ) -> FactorPattern:
        """Order the cells by reverse Cuthill and McKee, those of a level next to each other, and find the fill.

        Parameters
        ----------
        left, right : ndarray of int, shape (n_pairs,)
            Pairs of neighbours; pairs with numbers of n or more, of cells of other processes or none, have no place.
        couplings : ndarray, shape (n_pairs,)
            What is off the diagonal of the matrix of numbers, times -1; of pairs that are there twice the sum.
        diagonal : ndarray, shape (n,)
            Its diagonal: for every cell no less than the sum of its couplings.
        smallest : float
            See `SMALLEST`; 0 for all fill. Neighbours are kept.
        """
        n = len(diagonal)
        places, is_own = np.full(len(left), -1), (left < n) & (right < n)
        left, right = left[is_own], right[is_own]
        ends = np.concatenate([left, right]), np.concatenate([right, left])
        both = csr_array((np.ones(2 * len(left), np.int8), ends), shape=(n, n))
        both.sum_duplicates()
        order = narrow_order(Graph(both.indptr.astype(np.int64), both.indices.astype(np.int32)))
        rank = _ranks(order)
        lower = _lower_rows(rank[left], rank[right], couplings[is_own], n)
        pivots = np.maximum(diagonal, np.finfo(np.float32).tiny)[order]
        starts, columns = _large_entries(lower.indptr, lower.indices, lower.data, pivots, smallest)
        by_level = np.argsort(levels_of(starts, columns), kind="stable")  # rows still come after those they need
        place = _ranks(by_level)
        rows = np.repeat(place, np.diff(starts))
        sorted_rows = _lower_rows(rows, place[columns], np.zeros(len(columns), np.int8), n)
        order, rank = order[by_level], place[rank]
        starts, columns = sorted_rows.indptr.astype(np.int64), sorted_rows.indices.astype(np.int32)
        places[is_own] = _find(starts, columns, rank[left], rank[right])
        return cls(order, rank, starts, columns, places)


def _ranks(order: np.ndarray) -> np.ndarray:
    """Place of every point in an order."""
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return rank


def _lower_rows(left, right, values, n: int) -> csr_array:
    """Lower triangle of a symmetric matrix by rows, columns ascending."""
    rows = csr_array((values, (np.maximum(left, right), np.minimum(left, right))), shape=(n, n))
    rows.sum_duplicates()
    return rows


@njit(cache=True, error_model="numpy")
def _large_entries(starts, columns, couplings, diagonal, smallest):
    """Find the large entries of the factor L D L^T of a symmetric matrix, row by row; columns ascend.

    For every row i, from the couplings in it:

    1. Take the next column k, and go on without it where its entry is small and no coupling.
    2. Add what it fills in, ``a_ij - a_ik a_jk / d_k`` for the rows j in column k that are done, k < j < i, which are
       columns of this row, and to the pivot ``d_i``.
    3. When all are taken, put the row in the lists of its columns.
    """
    n = len(diagonal)
    found, entries, later = np.empty(8 * n + 64, np.int32), np.empty(8 * n + 64), np.empty(8 * n + 64, np.int64)
    row_of, ends, heads = np.empty(8 * n + 64, np.int32), np.zeros(n + 1, np.int64), np.full(n, -1)
    pivots, values, seen, coupled = diagonal.copy(), np.zeros(n), np.full(n, -1), np.full(n, -1)
    waiting, total = np.empty(n, np.int32), 0
    for i in range(n):
        n_waiting = 0
        for at in range(starts[i], starts[i + 1]):
            values[columns[at]], seen[columns[at]], coupled[columns[at]] = -couplings[at], i, i
            waiting[n_waiting] = columns[at]
            n_waiting += 1
        while n_waiting > 0:  # step 1
            next_one = np.argmin(waiting[:n_waiting])
            k, n_waiting = waiting[next_one], n_waiting - 1
            waiting[next_one] = waiting[n_waiting]
            value = values[k]
            if coupled[k] != i and abs(value) <= smallest * min(diagonal[i], pivots[k]):
                continue
            at = heads[k]
            while at >= 0:  # step 2
                j = row_of[at]
                if seen[j] != i:
                    values[j], seen[j] = 0.0, i
                    waiting[n_waiting] = j
                    n_waiting += 1
                values[j] -= value * entries[at] / pivots[k]
                at = later[at]
            pivots[i] = max(pivots[i] - value * value / pivots[k], 1e-12 * diagonal[i])
            if total == len(found):
                found, row_of = np.concatenate((found, found)), np.concatenate((row_of, row_of))
                entries, later = np.concatenate((entries, entries)), np.concatenate((later, later))
            found[total], entries[total], row_of[total] = k, value, i
            total += 1
        for at in range(ends[i], total):  # step 3
            later[at] = heads[found[at]]
            heads[found[at]] = at
        ends[i + 1] = total
    return ends, found[:total].copy()


@njit(cache=True, error_model="numpy")
def _find(starts, columns, left, right):
    """Find the entry of the pattern for each pair of rows."""
    places = np.empty(len(left), np.int64)
    for n in range(len(left)):
        row, column = max(left[n], right[n]), min(left[n], right[n])
        places[n] = starts[row] + np.searchsorted(columns[starts[row] : starts[row + 1]], column)
    return places
