"""Local search for a smaller vertex separator.

Every point is on side 0, on side 1 or in the separator (2), and no edge joins the two sides. A *move* takes a point of
the separator to one side and its neighbours on the other side into the separator; its *gain* is what the separator
loses in weight. In a pass all moves go to the same side, the best first, also where the gain is negative, so that the
separator can travel over a ridge; then everything after the best separator seen is undone [Fiduccia and Mattheyses,
Proc. 19th Design Automation Conf. (1982); Ashcraft and Liu, SIAM J. Matrix Anal. Appl. 19 (1998)].
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .heap import empty_heap, pop, push, reset

__all__ = ["SEPARATOR", "improve", "score"]

SEPARATOR = np.int8(2)

UNEVENNESS = 0.3
"""Price of an uneven cut: a separator that leaves one side empty counts as so much larger."""


@njit(cache=True)
def improve(starts, neighbours, weights, parts, heaviest, n_passes, patience):
    """Improve a separator in place, by passes towards one side and the other in turn.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        The graph.
    weights : ndarray of int32, shape (n,)
        Weights of its points.
    parts : ndarray of int8, shape (n,)
        Part of every point: 0, 1 or `SEPARATOR`. Changed.
    heaviest : int
        Weight that no side shall exceed.
    n_passes : int
        Passes at most.
    patience : int
        Moves without a better separator that end a pass.

    Returns
    -------
    float
        The `score` of the result.
    """
    totals = _part_weights(weights, parts)
    heap, log = empty_heap(len(weights)), np.empty(2 * len(weights), np.int64)
    side, n_idle = 0 if totals[0] <= totals[1] else 1, 0
    for _ in range(n_passes):
        before = score(totals, heaviest)
        _one_pass(starts, neighbours, weights, parts, totals, heap, log, side, heaviest, patience)
        n_idle = n_idle + 1 if score(totals, heaviest) >= before else 0
        if n_idle == 2:
            break
        side = 1 - side
    return score(totals, heaviest)


@njit(cache=True)
def _part_weights(weights, parts):
    """Weights of the two sides and of the separator."""
    totals = np.zeros(3, np.int64)
    for point in range(len(weights)):
        totals[parts[point]] += weights[point]
    return totals


@njit(cache=True)
def score(totals, heaviest):
    """What is to be small: the separator, more so where it cuts unevenly, and the excess of the heavier side."""
    heavier, lighter = max(totals[0], totals[1]), min(totals[0], totals[1])
    imbalance = (heavier - lighter) / max(1, heavier + lighter)
    return totals[2] * (1.0 + UNEVENNESS * imbalance) + 4.0 * max(0, heavier - heaviest)


@njit(cache=True)
def _gain(starts, neighbours, weights, parts, point, side):
    """What the separator loses in weight when a point of it moves to a side."""
    gain = np.int64(weights[point])
    for other in neighbours[starts[point] : starts[point + 1]]:
        if parts[other] == 1 - side:
            gain -= weights[other]
    return gain


@njit(cache=True)
def _one_pass(starts, neighbours, weights, parts, totals, heap, log, side, heaviest, patience):
    """Move to a side until nothing is left or patience ends, then go back to the best separator.

    The log holds each move as the points that it pulled into the separator and then, inverted bitwise, the point.
    """
    reset(heap)
    for point in range(len(weights)):
        if parts[point] == SEPARATOR:
            push(heap, point, _gain(starts, neighbours, weights, parts, point, side))
    best, best_end, end, n_since = score(totals, heaviest), 0, 0, 0
    while n_since < patience and heap.size[0] and totals[side] <= heaviest:
        end = _move(starts, neighbours, weights, parts, totals, heap, log, end, pop(heap), side)
        n_since += 1
        if score(totals, heaviest) < best:
            best, best_end, n_since = score(totals, heaviest), end, 0
    _undo(weights, parts, totals, log[best_end:end], side)


@njit(cache=True)
def _move(starts, neighbours, weights, parts, totals, heap, log, end, point, side):
    """Move a point of the separator to a side; return the new end of the log."""
    parts[point] = side
    totals[side] += weights[point]
    totals[2] -= weights[point]
    for other in neighbours[starts[point] : starts[point + 1]]:
        if parts[other] == 1 - side:
            _pull(starts, neighbours, weights, parts, totals, heap, other, side)
            log[end] = other
            end += 1
    log[end] = ~np.int64(point)
    return end + 1


@njit(cache=True)
def _pull(starts, neighbours, weights, parts, totals, heap, point, side):
    """Take a point of the other side into the separator."""
    parts[point] = SEPARATOR
    totals[1 - side] -= weights[point]
    totals[2] += weights[point]
    gain = np.int64(weights[point])
    for other in neighbours[starts[point] : starts[point + 1]]:
        if parts[other] == SEPARATOR and heap.places[other] != -1:
            push(heap, other, heap.gains[other] + weights[point])
        elif parts[other] == 1 - side:
            gain -= weights[other]
    push(heap, point, gain)


@njit(cache=True)
def _undo(weights, parts, totals, log, side):
    """Take back the moves of a piece of the log."""
    for entry in log[::-1]:
        point = ~entry if entry < 0 else entry
        before, after = (side, 2) if entry < 0 else (2, 1 - side)
        parts[point] = after
        totals[before] -= weights[point]
        totals[after] += weights[point]
