"""A heap of points by gain, largest first, in which the gain of any point can be changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["Heap", "empty_heap", "insert", "pop", "remove", "reset"]


class Heap(NamedTuple):
    """Binary heap; points of equal gain come in the order of their numbers.

    Parameters
    ----------
    points : ndarray of int32, shape (n,)
        The heap; only the first ``size[0]`` count.
    places : ndarray of int32, shape (n,)
        Place of every point in it, or -1.
    gains : ndarray of int64, shape (n,)
        Gain of every point.
    size : ndarray of int64, shape (1,)
        Number of points in the heap.
    """

    points: np.ndarray
    places: np.ndarray
    gains: np.ndarray
    size: np.ndarray


@njit(cache=True)
def empty_heap(n):
    """Heap for points 0 to n - 1, without any."""
    return Heap(np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(n, np.int64), np.zeros(1, np.int64))


@njit(cache=True)
def reset(heap):
    """Take all points out."""
    for place in range(heap.size[0]):
        heap.places[heap.points[place]] = -1
    heap.size[0] = 0


@njit(cache=True)
def insert(heap, point, gain):
    """Put a point in, or change its gain if it is in."""
    place = heap.places[point]
    if place == -1:
        place = heap.size[0]
        heap.size[0] += 1
    heap.gains[point] = gain
    _down(heap, _up(heap, place, point), point)


@njit(cache=True)
def remove(heap, point):
    """Take a point out, if it is in."""
    place = heap.places[point]
    if place == -1:
        return
    heap.places[point] = -1
    heap.size[0] -= 1
    if place < heap.size[0]:
        last = heap.points[heap.size[0]]
        _down(heap, _up(heap, place, last), last)


@njit(cache=True)
def pop(heap):
    """Take the point of largest gain out and return it."""
    point = heap.points[0]
    remove(heap, point)
    return point


@njit(cache=True)
def _is_before(heap, a, b):
    """Whether point a comes before point b."""
    return heap.gains[a] > heap.gains[b] or (heap.gains[a] == heap.gains[b] and a < b)


@njit(cache=True)
def _up(heap, place, point):
    """Move a point from a place towards the top as far as it belongs; return where that is."""
    while place > 0:
        above = heap.points[(place - 1) // 2]
        if not _is_before(heap, point, above):
            break
        heap.points[place] = above
        heap.places[above] = place
        place = (place - 1) // 2
    heap.points[place] = point
    heap.places[point] = place
    return place


@njit(cache=True)
def _down(heap, place, point):
    """Move a point from a place away from the top as far as it belongs."""
    while 2 * place + 1 < heap.size[0]:
        below = 2 * place + 1
        if below + 1 < heap.size[0] and _is_before(heap, heap.points[below + 1], heap.points[below]):
            below += 1
        if not _is_before(heap, heap.points[below], point):
            break
        heap.points[place] = heap.points[below]
        heap.places[heap.points[place]] = place
        place = below
    heap.points[place] = point
    heap.places[point] = place
