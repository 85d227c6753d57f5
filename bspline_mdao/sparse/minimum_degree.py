"""Minimum degree order of a small piece of a graph, with its surroundings taken into account."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["by_minimum_degree"]


@njit(cache=True)
def by_minimum_degree(starts, neighbours, points, place):
    """Order of points in which the one with fewest neighbours is eliminated next.

    The neighbours of every point are kept as a set of bits. Points outside count as neighbours but are never
    eliminated: they are those of separators, which come later.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The whole graph.
    points : ndarray of int32, shape (m,)
        Points to order.
    place : ndarray of int32, shape (n,)
        -1 everywhere; used and restored.

    Returns
    -------
    ndarray of int32, shape (m,)
        The points in the order of their elimination.
    """
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
    """Number the points and then those around them; return all in that order."""
    n = len(points)
    n_most = n
    for point in points:
        n_most += starts[point + 1] - starts[point]
    around = np.empty(n_most, np.int32)
    around[:n] = points
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
    m = len(bits)
    order, is_left = np.empty(m, np.int32), np.ones(m, np.bool_)
    degrees = np.array([_count(bits[row]) for row in range(m)])
    for step in range(m):
        pivot = -1
        for row in range(m):
            if is_left[row] and (pivot == -1 or degrees[row] < degrees[pivot]):
                pivot = row
        order[step], is_left[pivot] = pivot, False
        for row in range(m):
            if is_left[row] and _has(bits[pivot], row):
                bits[row] |= bits[pivot]
                _clear(bits[row], row)
                _clear(bits[row], pivot)
                degrees[row] = _count(bits[row])
    return order


@njit(cache=True)
def _has(bits, number):
    """Whether a number is in a set."""
    return (bits[number // 64] >> np.uint64(number % 64)) & np.uint64(1) != 0


@njit(cache=True)
def _clear(bits, number):
    """Take a number out of a set."""
    bits[number // 64] &= ~(np.uint64(1) << np.uint64(number % 64))


@njit(cache=True)
def _count(bits):
    """Size of a set."""
    total = 0
    for word in bits:
        x = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
        x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
        x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))
    return total
