"""Small sets of points that cut a graph in two: vertex separators by the multilevel method.

Every point of a graph is on side 0, on side 1 or in the separator (2), and no edge joins the two sides.

Theory: ``docs/theory/sparse.rst``, "Order of elimination".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["SEPARATOR", "coarsen", "common_neighbours", "find_separator", "improve", "score"]


SEPARATOR = np.int8(2)

N_COARSEST = 80
"""Number of points at which coarsening ends."""

N_STARTS = 4
"""Number of separators grown on the coarsest graph."""

LARGEST_SIDE = 0.58
"""Largest fraction of the weight on one side. Even cuts make a flat elimination tree; a little freedom lets the
separator find a narrow place."""

N_PASSES, PATIENCE, PATIENCE_COARSEST = 4, 40, 25
"""Maximum number of search passes, and number of moves without gain that end one, on every level and on the
coarsest."""

UNEVENNESS = 0.3
"""Price of an uneven cut: a separator that leaves one side empty counts as larger by this fraction."""

EXCESS = 4.0
"""Price of a side that is too heavy, per excess weight: more than any moved point can save."""


@njit(cache=True)
def find_separator(
    # the graph
    starts,  # ndarray of int
    neighbours,  # ndarray of int
    edge_weights,  # ndarray of int32, how strongly the ends of its edges are coupled
):  # (n,), part of every point: side 0, side 1 or `SEPARATOR`. No edge joins the two sides
    """Cut a graph in two by the multilevel method [1] [2]."""
    # 1. Coarsen: join the points in pairs, and the pairs in turn, until few are left.
    # 2. Partition the coarsest graph: grow several separators, improve each, and take the best.
    # 3. Uncoarsen: transfer the separator to the next finer graph, where each point is in the part of its pair, and
    #    improve it there; repeat until the graph is the given one.
    # - [1] B. Hendrickson, R. Leland, "A multilevel algorithm for partitioning graphs", Proc. Supercomputing '95.
    # - [2] G. Karypis, V. Kumar, "A fast and high quality multilevel scheme for partitioning irregular graphs", SIAM J.
    #   Sci. Comput. 20 (1998), 359-392.
    n = len(starts) - 1
    weights = np.ones(n, np.int32)
    heaviest = max(1, int(LARGEST_SIDE * n))
    levels = [(starts, neighbours, weights)]
    maps = [np.empty(0, np.int32)]
    while len(weights) > N_COARSEST:  # step 1
        heaviest_pair = 3 * n // (2 * N_COARSEST) + 1  # otherwise a few heavy points would dominate the coarsest graph
        starts, neighbours, edge_weights, weights, coarse = coarsen(
            starts, neighbours, edge_weights, weights, heaviest_pair
        )
        if len(weights) > 0.95 * len(coarse):  # hardly any pairs are light enough: further levels would be copies
            break
        levels.append((starts, neighbours, weights))
        maps.append(coarse)
    starts, neighbours, weights = levels[-1]
    parts = _best_grown(starts, neighbours, weights, heaviest)  # step 2
    # step 3; a plain number would be a separate type, and `improve` compiled for each
    for level in range(len(levels) - 2, -1, -1):
        parts = parts[maps[level + 1]]
        starts, neighbours, weights = levels[level]
        improve(starts, neighbours, weights, parts, heaviest, N_PASSES, np.int64(PATIENCE))
    return parts


@njit(cache=True)
def _best_grown(starts, neighbours, weights, heaviest):
    """Smallest of several separators, grown from points spread over the numbering."""
    n = len(weights)
    best, best_parts = np.inf, np.zeros(n, np.int8)
    for number in range(min(n, N_STARTS)):
        parts = _grow(starts, neighbours, weights, number * n // min(n, N_STARTS))
        score = improve(starts, neighbours, weights, parts, heaviest, N_PASSES, np.int64(PATIENCE_COARSEST))
        if score < best:
            best, best_parts = score, parts
    return best_parts


@njit(cache=True)
def _grow(starts, neighbours, weights, first):
    """Side 0: half of the weight, breadth first from a point; separator: its neighbours; side 1: the rest."""
    n, half = len(weights), np.sum(weights) // 2
    parts = np.ones(n, np.int8)
    queue, head, tail, total, unseen = np.empty(n, np.int32), 0, 1, 0, 0
    is_seen = np.zeros(n, np.bool_)
    queue[0] = first
    is_seen[first] = True
    while total < half:
        if head == tail:
            while is_seen[unseen]:
                unseen += 1
            queue[tail] = unseen
            is_seen[unseen] = True
            tail += 1
        point = queue[head]
        head += 1
        parts[point] = 0
        total += weights[point]
        for other in neighbours[starts[point] : starts[point + 1]]:
            if not is_seen[other]:
                is_seen[other] = True
                queue[tail] = other
                tail += 1
    for point in queue[head:tail]:
        parts[point] = SEPARATOR
    return parts


@njit(cache=True)
def coarsen(
    # the graph
    starts,  # ndarray of int
    neighbours,  # ndarray of int
    # weights of its edges (at both ends) and of its points
    edge_weights,  # ndarray of int32
    weights,  # ndarray of int32
    heaviest,  # int, no pair is heavier than this
):
    """Join the points of a graph in pairs, each along the heaviest edge to a free point."""
    # A separator of the smaller graph is one of the graph, and moving one of its points moves many of the graph, which
    # a local search cannot do on the graph itself. This is the heavy-edge matching of Karypis and Kumar (1998), except
    # for the edge weights, see `common_neighbours`, and the fixed order of the points: nothing is random.
    # returns starts, neighbours, edge_weights, weights, the smaller graph
    # returns coarse int32 (n,): the coarse point of each point
    partner = _match(starts, neighbours, edge_weights, weights, heaviest)
    coarse, n_coarse = _number_pairs(partner)
    return (*_contract(starts, neighbours, edge_weights, weights, partner, coarse, n_coarse), coarse)


@njit(cache=True)
def common_neighbours(starts, neighbours):
    """Weights of edges for the first level: one, and one for each common neighbour of the ends."""
    # In a hexahedral mesh this distinguishes neighbours along a mesh line from diagonal ones, so that the pairs, and
    # the pairs of pairs, are boxes of the mesh.
    weights, seen_by = np.ones(len(neighbours), np.int32), np.full(len(starts) - 1, -1, np.int32)
    for point in range(len(starts) - 1):
        for other in neighbours[starts[point] : starts[point + 1]]:
            seen_by[other] = point
        for edge in range(starts[point], starts[point + 1]):
            other = neighbours[edge]
            if other < point:
                continue
            for third in neighbours[starts[other] : starts[other + 1]]:
                weights[edge] += seen_by[third] == point
            mirrored = starts[other] + np.searchsorted(neighbours[starts[other] : starts[other + 1]], point)
            weights[mirrored] = weights[edge]
    return weights


@njit(cache=True)
def _match(starts, neighbours, edge_weights, weights, heaviest):
    """Partner of every point over its heaviest edge to a free point; itself if there is none."""
    n = len(weights)
    partner = np.full(n, -1, np.int32)
    for point in range(n):
        if partner[point] != -1:
            continue
        best, best_weight = point, 0
        for edge in range(starts[point], starts[point + 1]):
            other = neighbours[edge]
            is_free = partner[other] == -1 and weights[point] + weights[other] <= heaviest
            if is_free and edge_weights[edge] > best_weight:
                best, best_weight = other, edge_weights[edge]
        partner[point] = best
        partner[best] = point
    return partner


@njit(cache=True)
def _number_pairs(partner):
    """Number of the pair of every point, and the number of pairs."""
    coarse, n_coarse = np.empty(len(partner), np.int32), 0
    for point in range(len(partner)):
        if partner[point] >= point:
            coarse[point] = coarse[partner[point]] = n_coarse
            n_coarse += 1
    return coarse, n_coarse


@njit(cache=True)
def _contract(starts, neighbours, edge_weights, weights, partner, coarse, n_coarse):
    """The graph of the pairs: parallel edges become one with their total weight, edges within a pair vanish."""
    new_starts, new_weights = np.zeros(n_coarse + 1, np.int64), np.zeros(n_coarse, np.int32)
    new_neighbours, new_edge_weights = np.empty_like(neighbours), np.empty_like(edge_weights)
    place = np.full(n_coarse, -1, np.int64)
    end = 0
    for point in range(len(partner)):
        if partner[point] < point:
            continue
        pair, first = coarse[point], end
        for member in range(2 if partner[point] > point else 1):
            node = partner[point] if member else point
            new_weights[pair] += weights[node]
            for edge in range(starts[node], starts[node + 1]):
                other = coarse[neighbours[edge]]
                if other == pair:
                    continue
                if place[other] < first:
                    place[other] = end
                    new_neighbours[end], new_edge_weights[end] = other, 0
                    end += 1
                new_edge_weights[place[other]] += edge_weights[edge]
        new_starts[pair + 1] = end
    return new_starts, new_neighbours[:end].copy(), new_edge_weights[:end].copy(), new_weights


@njit(cache=True)
def improve(
    # the graph
    starts,  # ndarray of int
    neighbours,  # ndarray of int
    weights,  # int32 (n,), weights of its points
    parts,  # (n,), part of every point: 0, 1 or `SEPARATOR`. Changed
    heaviest,  # int, weight that no side may exceed
    n_passes,  # int, maximum number of passes
    patience,  # int, number of moves without a better separator that ends a pass
):  # the `score` of the result
    """Shrink a separator in place, by alternating passes towards one side and the other."""
    # A *move* takes a point of the separator to one side and its neighbours on the other side into the separator; its
    # *gain* is the weight lost by the separator. A pass [1], in the form for vertex separators [2]:
    # 1. Find the gains of all points of the separator.
    # 2. Make the move of largest gain, even if that is negative, so that the separator can cross a ridge.
    # 3. Update the gains around it.
    # 4. Note when the separator is the best so far; continue with step 2 until that was too long ago.
    # 5. Undo all moves after the best one.
    # - [1] C. M. Fiduccia, R. M. Mattheyses, "A linear-time heuristic for improving network partitions", Proc. 19th
    #   Design Automation Conf. (1982).
    # - [2] C. Ashcraft, J. W. H. Liu, SIAM J. Matrix Anal. Appl. 19 (1998).
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
def score(totals, heaviest):
    """Weight of a separator, with penalties for uneven sides and for a side that is too heavy; to be minimised."""
    heavier, lighter = max(totals[0], totals[1]), min(totals[0], totals[1])
    imbalance = (heavier - lighter) / max(1, heavier + lighter)
    return totals[2] * (1.0 + UNEVENNESS * imbalance) + EXCESS * max(0, heavier - heaviest)


@njit(cache=True)
def _part_weights(weights, parts):
    """Weights of the two sides and of the separator."""
    totals = np.zeros(3, np.int64)
    for point in range(len(weights)):
        totals[parts[point]] += weights[point]
    return totals


@njit(cache=True)
def _gain(starts, neighbours, weights, parts, point, side):
    """Weight lost by the separator when one of its points moves to a side."""
    gain = np.int64(weights[point])
    for other in neighbours[starts[point] : starts[point + 1]]:
        if parts[other] == 1 - side:
            gain -= weights[other]
    return gain


@njit(cache=True)
def _one_pass(starts, neighbours, weights, parts, totals, heap, log, side, heaviest, patience):
    """Move to a side until nothing is left or patience ends, then back to the best separator; steps as in `improve`."""
    # The log stores each move as the points pulled into the separator and then, inverted bitwise, the moved point.
    reset(heap)
    for point in range(len(weights)):  # step 1
        if parts[point] == SEPARATOR:
            push(heap, point, _gain(starts, neighbours, weights, parts, point, side))
    best, best_end, end, n_since = score(totals, heaviest), 0, 0, 0
    while n_since < patience and heap.size[0] and totals[side] <= heaviest:
        end = _move(starts, neighbours, weights, parts, totals, heap, log, end, pop(heap), side)  # steps 2 and 3
        n_since += 1
        if score(totals, heaviest) < best:  # step 4
            best, best_end, n_since = score(totals, heaviest), end, 0
    _undo(weights, parts, totals, log[best_end:end], side)  # step 5


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
    """Pull a point of the other side into the separator."""
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
    """Undo the moves in a piece of the log."""
    for entry in log[::-1]:
        point = ~entry if entry < 0 else entry
        before, after = (side, 2) if entry < 0 else (2, 1 - side)
        parts[point] = after
        totals[before] -= weights[point]
        totals[after] += weights[point]


class Heap(NamedTuple):
    """Binary heap of points by gain, largest first, in which the gain of any point can rise."""

    # Points of equal gain are ordered by number, so that results do not depend on the order of pushes.

    points: np.ndarray  # int32 (n,), the heap; only the first ``size[0]`` count
    places: np.ndarray  # int32 (n,), position of every point in it, or -1
    gains: np.ndarray  # int64 (n,), gain of every point
    size: np.ndarray  # int64 (1,), number of points in the heap


@njit(cache=True)
def empty_heap(n):
    """Empty heap for points 0 to n - 1."""
    return Heap(np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(n, np.int64), np.zeros(1, np.int64))


@njit(cache=True)
def reset(heap):
    """Remove all points from the heap."""
    for place in range(heap.size[0]):
        heap.places[heap.points[place]] = -1
    heap.size[0] = 0


@njit(cache=True)
def push(heap, point, gain):
    """Insert a point, or raise its gain if it is already there."""
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
    """Remove the point of largest gain and return it."""
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
    """Put a point at the top and move it down to its position."""
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
