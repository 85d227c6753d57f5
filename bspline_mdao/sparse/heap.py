"""A heap of points by gain, largest first, in which the gain of any point can rise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["Heap", "empty_heap", "pop", "push", "reset"]


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
def push(heap, point, gain):
    """Put a point in, or raise its gain if it is in."""
    place = heap.places[point]
    if place == -1:
        place = heap.size[0]
        heap.size[0] += 1
    heap.gains[point] = gain
    while place > 0:
        above = heap.points[(place - 1) // 2]
        if not _is_before(heap, point, above):
            break
        heap.points[place] = above
        heap.places[above] = place
        place = (place - 1) // 2
    heap.points[place] = point
    heap.places[point] = place


@njit(cache=True)
def pop(heap):
    """Take the point of largest gain out and return it."""
    top = heap.points[0]
    heap.places[top] = -1
    heap.size[0] -= 1
    if heap.size[0]:
        _down(heap, heap.points[heap.size[0]])
    return top


@njit(cache=True)
def _is_before(heap, a, b):
    """Whether point a comes before point b."""
    return heap.gains[a] > heap.gains[b] or (heap.gains[a] == heap.gains[b] and a < b)


@njit(cache=True)
def _down(heap, point):
    """Put a point at the top and move it down as far as it belongs."""
    place = 0
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
