"""Fill-reducing orders of elimination: minimum degree for small graphs, nested dissection for others.

Theory: ``docs/theory/sparse.rst``, "Order of elimination".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numba import njit
from scipy.sparse.linalg import spilu

from ..numerics.rows import copy_row
from .separators import SEPARATOR, common_neighbours, find_separator

__all__ = ["_minimum_degree_of_piece", "fill_reducing_order", "minimum_degree", "nested_dissection"]


LARGEST_FOR_MINIMUM_DEGREE = 4000
"""Graphs of at most this many points are ordered by SciPy's minimum degree. It fills the factor 1.1 to 1.3 times as
much, which costs less than dissecting such a graph, and needs no compilation."""

N_LEAF = 100
"""Pieces of at most this many points are not cut further: minimum degree orders them better, and as fast."""


def fill_reducing_order(
    # the graph
    starts: np.ndarray,  # int
    neighbours: np.ndarray,  # int
) -> np.ndarray:  # int32 (n,), points in the order of their elimination
    """Order the points of a graph so that the factor stays sparse, by the method that suits its size."""
    is_small = len(starts) - 1 <= LARGEST_FOR_MINIMUM_DEGREE
    return minimum_degree(starts, neighbours) if is_small else nested_dissection(starts, neighbours)


def nested_dissection(
    # the graph
    starts: np.ndarray,  # int
    neighbours: np.ndarray,  # int
) -> np.ndarray:  # int32 (n,), points in the order of their elimination
    """Order the points of a graph by nested dissection [1]."""
    # 1. Cut the graph in two by a separator.
    # 2. Number the points of the separator last, and the points of each side, contiguously, before them: eliminating
    #    one side does not affect the other.
    # 3. Treat each side in the same way; order pieces of at most `N_LEAF` points by minimum degree.
    # - [1] A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer. Anal. 10 (1973), 345-363.
    n = len(starts) - 1
    order, place = np.arange(n, dtype=np.int32), np.full(n, -1, np.int32)
    edge_weights = common_neighbours(starts, neighbours)
    pieces = [(0, n)]
    while pieces:
        first, last = pieces.pop()
        points = np.sort(order[first:last])
        if len(points) <= N_LEAF:
            order[first:last] = _minimum_degree_of_piece(starts, neighbours, points, place)
            continue
        parts = find_separator(*_subgraph(starts, neighbours, edge_weights, points, place))  # step 1
        middle, end = first + np.sum(parts == 0), last - np.sum(parts == SEPARATOR)
        order[first:middle], order[middle:end], order[end:last] = (  # step 2
            points[parts == 0],
            points[parts == 1],
            points[parts == SEPARATOR],
        )
        if end < last or first < middle < end:  # step 3, unless nothing was cut
            pieces.append((first, middle))
            pieces.append((middle, end))
    return order


@njit(cache=True)
def _subgraph(starts, neighbours, edge_weights, points, place):
    """Graph of only some points; ``place`` is -1 everywhere before and after."""
    for number in range(len(points)):
        place[points[number]] = number
    n_edges = 0
    for point in points:
        n_edges += starts[point + 1] - starts[point]
    new_starts, end = np.zeros(len(points) + 1, np.int64), 0
    new_neighbours, new_weights = np.empty(n_edges, np.int32), np.empty(n_edges, np.int32)
    for number in range(len(points)):
        point = points[number]
        for edge in range(starts[point], starts[point + 1]):
            if place[neighbours[edge]] != -1:
                new_neighbours[end], new_weights[end] = place[neighbours[edge]], edge_weights[edge]
                end += 1
        new_starts[number + 1] = end
    for point in points:
        place[point] = -1
    return new_starts, new_neighbours[:end].copy(), new_weights[:end].copy()


def minimum_degree(
    # the graph
    starts: np.ndarray,  # int
    neighbours: np.ndarray,  # int
) -> np.ndarray:  # int32 (n,), points in the order of their elimination
    """Order the points of a graph by multiple minimum degree [1], as in SciPy's SuperLU."""
    # SuperLU returns the order only with a factor. Its incomplete factor without fill is the cheapest one.
    # - [1] J. W. H. Liu, "Modification of the minimum-degree algorithm by multiple elimination", ACM Trans. Math.
    #   Softw. 11 (1985), 141-153.
    n = len(starts) - 1
    if n < 2:
        return np.arange(n, dtype=np.int32)
    edges = scipy.sparse.csc_array((np.full(len(neighbours), -1.0), neighbours, starts), shape=(n, n))
    dominant = (edges + scipy.sparse.diags_array(np.diff(starts) + 1.0)).tocsc()
    factor = spilu(
        dominant,
        drop_tol=1.0,
        fill_factor=1.0,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(factor.perm_c).astype(np.int32)


@njit(cache=True)
def _minimum_degree_of_piece(
    # the whole graph
    starts,  # ndarray of int
    neighbours,  # ndarray of int
    points,  # int32 (m,), points to order
    place,  # int32 (n,), -1 everywhere; used and restored
):  # int32 (m,), the points in the order of their elimination
    """Order a small piece of a graph by minimum degree, taking its surroundings into account."""
    # Points outside count as neighbours but are never eliminated: they belong to separators, which come later.
    m = len(points)
    around = _number_with_surroundings(starts, neighbours, points, place)
    bits = np.zeros((m, (len(around) + 63) // 64), np.uint64)
    for row in range(m):
        for other in neighbours[starts[points[row]] : starts[points[row] + 1]]:
            bits[row, place[other] // 64] |= np.uint64(1) << np.uint64(place[other] % 64)
    for point in around:
        place[point] = -1
    return points[_eliminate(bits)]


@njit(cache=True)
def _number_with_surroundings(starts, neighbours, points, place):
    """Number the points and then their surroundings; return all in that order."""
    n = len(points)
    n_most = n
    for point in points:
        n_most += starts[point + 1] - starts[point]
    around = np.empty(n_most, np.int32)
    copy_row(points, around)
    for number in range(n):
        place[points[number]] = number
    for point in points:
        for other in neighbours[starts[point] : starts[point + 1]]:
            if place[other] == -1:
                place[other] = n
                around[n] = other
                n += 1
    return around[:n]


@njit(cache=True)
def _eliminate(bits):
    """Order of elimination of the rows of a symmetric pattern; the pattern is overwritten."""
    # The neighbours of every point are a set of bits. As long as points are left [1]:
    # 1. Take the one of least degree, its number of neighbours, as the next pivot; the first of several.
    # 2. Eliminate it: its neighbours become neighbours of each other.
    # 3. Recount the neighbours of these.
    # - [1] A. George, J. W. H. Liu, "The evolution of the minimum degree ordering algorithm", SIAM Review 31 (1989),
    #   1-19.
    m = len(bits)
    order, is_left = np.empty(m, np.int32), np.ones(m, np.bool_)
    degrees = np.array([_count(bits[row]) for row in range(m)])
    for step in range(m):
        pivot = -1  # step 1
        for row in range(m):
            if is_left[row] and (pivot == -1 or degrees[row] < degrees[pivot]):
                pivot = row
        order[step], is_left[pivot] = pivot, False
        for row in range(m):
            if is_left[row] and _has(bits[pivot], row):
                for k in range(bits.shape[1]):
                    bits[row, k] |= bits[pivot, k]  # step 2
                _clear(bits[row], row)
                _clear(bits[row], pivot)
                degrees[row] = _count(bits[row])  # step 3
    return order


@njit(cache=True)
def _has(bits, number):
    """Whether a number is in a set."""
    return (bits[number // 64] >> np.uint64(number % 64)) & np.uint64(1) != 0


@njit(cache=True)
def _clear(bits, number):
    """Remove a number from a set."""
    bits[number // 64] &= ~(np.uint64(1) << np.uint64(number % 64))


@njit(cache=True)
def _count(bits):
    """Size of a set: bits are counted in pairs, fours and bytes, and a product adds up the bytes."""
    total = 0
    for word in bits:
        x = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
        x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
        x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))  # type: ignore[assignment]
    return total
