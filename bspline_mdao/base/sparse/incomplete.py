"""Incomplete factorisation L D L^T of a symmetric matrix of 3 x 3 blocks, with fill level p: ILU(p), section III.B.

Theory: ``docs/theory/sparse_iterative.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import DTypeLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...errors import MovementError
from .blocks import BlockMatrix, Graph

__all__ = [
    "IncompleteFactor",
    "IncompletePattern",
    "fill_pattern",
    "incomplete_factor",
    "incomplete_pattern",
    "narrow_order",
]


LARGEST_SHIFT = 10.0
"""Largest shift that is tried: the factor is then hardly better than the diagonal."""

SMALLEST_SHIFT, SHIFT_GROWTH = 1e-3, 4.0
"""The first shift tried after zero, and the growth factor between trials."""


@dataclass(frozen=True, eq=False)
class IncompletePattern:
    """Pattern of an incomplete factor."""

    # points in the order of elimination, and the position of every point in it
    order: np.ndarray  # int32 (n,)
    rank: np.ndarray  # int32 (n,)
    starts: np.ndarray  # int64 (n + 1,), where each row of the strict lower triangle starts
    columns: np.ndarray  # int32 (n_blocks,), columns, ascending within a row


@dataclass(frozen=True, eq=False)
class IncompleteFactor:
    """Incomplete factor L D L^T."""

    pattern: IncompletePattern
    lower: np.ndarray  # (n_blocks, 3, 3), blocks of L below its unit diagonal
    inverse_diagonal: np.ndarray  # (n, 3, 3), inverses of the blocks of D
    shift: float  # fraction of the diagonal blocks that was added to them
    # smaller shifts tried first, and the number of non-positive pivots with each
    breakdowns: tuple[tuple[float, int], ...]

    @property
    def n_bytes(self) -> int:
        """Memory of the factor and its pattern."""
        pattern = self.pattern
        arrays = self.lower, self.inverse_diagonal, pattern.order, pattern.rank, pattern.starts, pattern.columns
        return sum(array.nbytes for array in arrays)

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve L D L^T x = right, shape (n, 3)."""
        pattern = self.pattern
        return _solve(pattern.order, pattern.starts, pattern.columns, self.lower, self.inverse_diagonal, right)


def narrow_order(graph: Graph) -> np.ndarray:
    """Order points by reverse Cuthill-McKee (1969), which gives the fewest iterations of the orders measured."""
    n, edges = len(graph.starts) - 1, np.ones(len(graph.neighbours), np.int8)
    if not n:  # SciPy takes the maximum of their degrees
        return np.zeros(0, np.int32)
    return reverse_cuthill_mckee(csr_array((edges, graph.neighbours, graph.starts), shape=(n, n)), True)


def incomplete_pattern(graph: Graph, order: np.ndarray, fill: int) -> IncompletePattern:
    """Find the pattern of the factor with fill level ``fill``, for elimination in ``order``."""
    order = np.ascontiguousarray(order, np.int32)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return IncompletePattern(order, rank, *fill_pattern(*graph, order, fill))


def fill_pattern(
    # the graph of the matrix: neighbours of every point, in compressed rows, without the point itself
    neighbour_starts: np.ndarray,
    neighbours: np.ndarray,
    order: np.ndarray,  # int (n,), points in the order of elimination
    fill: int,  # fill level p; 0 keeps the pattern of the matrix
) -> tuple[np.ndarray, np.ndarray]:
    """Find the strict lower triangle of the incomplete factor with fill level p, by rows [1]."""
    # Block (i, j) of the factor, j < i, is kept if a path of at most p + 1 edges leads from i to j in the graph of the
    # matrix through points that are all eliminated before j. For every j:
    # 1. Search breadth first from j, up to p + 1 edges.
    # 2. Continue only from points eliminated before j.
    # 3. Every later point reached is a row of column j.
    # No levels are stored.
    # - [1] D. Hysom, A. Pothen, "Level-based incomplete LU factorization: graph model and algorithms", UCRL-JC-150789,
    #   2002.
    # returns starts int64 (n + 1,)
    # returns columns: columns of each row, ascending; rows and columns are positions in the order of elimination
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    starts = _count(neighbour_starts, neighbours, order, rank, fill)
    return starts, _columns(neighbour_starts, neighbours, order, rank, fill, starts)


@njit(cache=True)
def _count(neighbour_starts, neighbours, order, rank, fill):
    """Find the starts of the rows of the factor."""
    n = len(order)
    starts, queue, seen = np.zeros(n + 1, np.int64), np.empty(n, np.int32), np.full(n, -1, np.int32)
    for column in range(n):
        for place in range(_reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue)):
            if queue[place] > column:  # step 3
                starts[queue[place] + 1] += 1
    return np.cumsum(starts)


@njit(cache=True)
def _columns(neighbour_starts, neighbours, order, rank, fill, starts):
    """Columns of the rows; they are ascending because columns are processed in order."""
    n = len(order)
    columns, ends = np.empty(starts[n], np.int32), starts[:n].copy()
    queue, seen = np.empty(n, np.int32), np.full(n, -1, np.int32)
    for column in range(n):
        for place in range(_reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue)):
            row = queue[place]
            if row > column:  # step 3
                columns[ends[row]] = column
                ends[row] += 1
    return columns


@njit(cache=True)
def _reach(column, neighbour_starts, neighbours, order, rank, fill, seen, queue):
    """Write the ranks separated from ``column`` by at most ``fill`` points of lower rank to ``queue``; their number."""
    # The search continues only from ranks below ``column``.
    seen[column], queue[0] = column, column
    first, last = 0, 1
    for _ in range(fill + 1):  # step 1
        reached = last
        for place in range(first, last):
            if place > 0 and queue[place] > column:  # step 2
                continue
            point = order[queue[place]]
            for other in neighbours[neighbour_starts[point] : neighbour_starts[point + 1]]:
                if seen[rank[other]] != column:
                    seen[rank[other]], queue[reached] = column, rank[other]
                    reached += 1
        first, last = last, reached
    return last


def incomplete_factor(
    matrix: BlockMatrix, pattern: IncompletePattern, shift: float, dtype: DTypeLike = np.float32
) -> IncompleteFactor:
    """Factor a matrix incompletely on a pattern."""
    # The diagonal blocks are multiplied by 1 + ``shift``. If a pivot is still not positive, everything is repeated with
    # a larger shift.
    lower, diagonal = np.empty((len(pattern.columns), 3, 3), dtype), np.empty((len(pattern.order), 3, 3))
    source = matrix.pattern.indptr, matrix.pattern.indices, matrix.data
    breakdowns: list[tuple[float, int]] = []
    while shift <= LARGEST_SHIFT:
        lower[:] = 0.0
        _place_blocks(*source, pattern.rank, pattern.starts, pattern.columns, 1.0 + shift, lower, diagonal)
        n_failed, first = _factorize(pattern.starts, pattern.columns, lower, diagonal)
        if n_failed == 0:
            return IncompleteFactor(pattern, lower, diagonal, shift, tuple(breakdowns))
        breakdowns.append((shift, n_failed))
        shift = max(SHIFT_GROWTH * shift, SMALLEST_SHIFT)
    raise MovementError(
        f"incomplete factor: {n_failed} pivots are not positive with a shift of {breakdowns[-1][0]:g}, the first at "
        f"block row {pattern.order[first] + 1}; look for an inverted or collapsed element there, or use a direct solver"
    )


@njit(cache=True, nogil=True)
def _place_blocks(indptr, indices, data, rank, starts, columns, scale, lower, diagonal):
    """Put the blocks at their positions in the order of elimination, with scaled diagonal ones."""
    for point in range(len(rank)):
        last = indptr[point + 1] - 1
        diagonal[rank[point]] = scale * data[last]
        for entry in range(indptr[point], last):
            row, column = rank[point], rank[indices[entry]]
            is_turned = row < column
            row, column = max(row, column), min(row, column)
            place = starts[row] + np.searchsorted(columns[starts[row] : starts[row + 1]], column)
            for a in range(3):
                for b in range(3):
                    lower[place, a, b] = data[entry, b, a] if is_turned else data[entry, a, b]


@njit(cache=True, nogil=True, error_model="numpy")
def _factorize(starts, columns, lower, diagonal):
    """Factor row by row in place, inverting diagonal blocks; number of non-positive pivots, and the first row."""
    # With S = L D, row i of an incomplete factorisation by rows (the order that Saad, Iterative Methods for Sparse
    # Linear Systems, 2nd ed., section 10.3, calls IKJ), for every entry j of its pattern, ascending:
    # 1. ``S_ij = A_ij - sum_k S_ik L_jk^T``, over k < j where both rows have an entry: fill elsewhere is dropped.
    # 2. ``L_ij = S_ij D_j^-1``.
    # 3. ``D_i = A_ii - sum_j L_ij S_ij^T``.
    n, n_failed, first_failed = len(starts) - 1, 0, -1
    place_of = np.full(n, -1, np.int32)
    scaled = np.empty((max(1, np.max(np.diff(starts))), 3, 3))  # blocks of the row times D
    for row in range(n):
        first = starts[row]
        for entry in range(first, starts[row + 1]):
            block = scaled[entry - first]
            for a in range(3):
                for b in range(3):
                    block[a, b] = lower[entry, a, b]
            for other in range(starts[columns[entry]], starts[columns[entry] + 1]):
                place = place_of[columns[other]]
                if place >= 0:
                    _subtract_product(block, scaled[place], lower[other])  # step 1
            place_of[columns[entry]] = entry - first
        for entry in range(first, starts[row + 1]):
            place_of[columns[entry]] = -1
            _divide(scaled[entry - first], diagonal[columns[entry]], lower[entry], diagonal[row])  # steps 2 and 3
        n_wrong = _invert(diagonal[row])
        if n_wrong and not n_failed:
            first_failed = row
        n_failed += n_wrong
    return n_failed, first_failed


@njit(cache=True, nogil=True, fastmath={"contract"})
def _subtract_product(block, scaled, lower):
    """Subtract ``scaled`` times the transpose of ``lower`` from a block."""
    for a in range(3):
        for b in range(3):
            block[a, b] -= scaled[a, 0] * lower[b, 0] + scaled[a, 1] * lower[b, 1] + scaled[a, 2] * lower[b, 2]


@njit(cache=True, nogil=True)
def _divide(scaled, inverse, block, diagonal):
    """Block of L from the same times D, and its contribution to the diagonal."""
    for a in range(3):
        l_0 = scaled[a, 0] * inverse[0, 0] + scaled[a, 1] * inverse[1, 0] + scaled[a, 2] * inverse[2, 0]
        l_1 = scaled[a, 0] * inverse[0, 1] + scaled[a, 1] * inverse[1, 1] + scaled[a, 2] * inverse[2, 1]
        l_2 = scaled[a, 0] * inverse[0, 2] + scaled[a, 1] * inverse[1, 2] + scaled[a, 2] * inverse[2, 2]
        block[a, 0], block[a, 1], block[a, 2] = l_0, l_1, l_2
        for b in range(3):
            diagonal[a, b] -= l_0 * scaled[b, 0] + l_1 * scaled[b, 1] + l_2 * scaled[b, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _invert(block):
    """Invert a symmetric block in place from its lower triangle; count pivots that are not positive."""
    # A block with such pivots is replaced, so that the others can still be counted.
    d_0 = block[0, 0]
    l_10, l_20 = block[1, 0] / d_0, block[2, 0] / d_0
    d_1 = block[1, 1] - l_10 * block[1, 0]
    l_21 = (block[2, 1] - l_20 * block[1, 0]) / d_1
    d_2 = block[2, 2] - l_20 * block[2, 0] - l_21 * l_21 * d_1
    n_wrong = (not d_0 > 0.0) + (not d_1 > 0.0) + (not d_2 > 0.0)
    if n_wrong:
        block[:] = np.eye(3) / (abs(block[0, 0]) + abs(block[1, 1]) + abs(block[2, 2]))
        return n_wrong
    m_20 = l_10 * l_21 - l_20  # inverse of the unit lower triangle
    block[2, 2] = 1.0 / d_2
    block[2, 1] = block[1, 2] = -l_21 / d_2
    block[2, 0] = block[0, 2] = m_20 / d_2
    block[1, 1] = 1.0 / d_1 + l_21 * l_21 / d_2
    block[1, 0] = block[0, 1] = -l_10 / d_1 - l_21 * m_20 / d_2
    block[0, 0] = 1.0 / d_0 + l_10 * l_10 / d_1 + m_20 * m_20 / d_2
    return 0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _solve(order, starts, columns, lower, inverse_diagonal, right):
    """Solve with L, D and L^T, streaming through the factor twice."""
    n = len(order)
    x = np.empty((n, 3))
    for row in range(n):
        point = order[row]
        x_0, x_1, x_2 = right[point, 0], right[point, 1], right[point, 2]
        for entry in range(starts[row], starts[row + 1]):
            l, z = lower[entry], x[columns[entry]]
            x_0 -= l[0, 0] * z[0] + l[0, 1] * z[1] + l[0, 2] * z[2]
            x_1 -= l[1, 0] * z[0] + l[1, 1] * z[1] + l[1, 2] * z[2]
            x_2 -= l[2, 0] * z[0] + l[2, 1] * z[1] + l[2, 2] * z[2]
        x[row, 0], x[row, 1], x[row, 2] = x_0, x_1, x_2
    for row in range(n):
        d, x_0, x_1, x_2 = inverse_diagonal[row], x[row, 0], x[row, 1], x[row, 2]
        for a in range(3):
            x[row, a] = d[a, 0] * x_0 + d[a, 1] * x_1 + d[a, 2] * x_2
    out = np.empty((n, 3))
    for row in range(n - 1, -1, -1):
        x_0, x_1, x_2 = x[row, 0], x[row, 1], x[row, 2]
        point = order[row]
        out[point, 0], out[point, 1], out[point, 2] = x_0, x_1, x_2
        for entry in range(starts[row], starts[row + 1]):
            l, z = lower[entry], x[columns[entry]]
            z[0] -= l[0, 0] * x_0 + l[1, 0] * x_1 + l[2, 0] * x_2
            z[1] -= l[0, 1] * x_0 + l[1, 1] * x_1 + l[2, 1] * x_2
            z[2] -= l[0, 2] * x_0 + l[1, 2] * x_1 + l[2, 2] * x_2
    return out
