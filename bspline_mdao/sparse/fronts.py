"""Where everything goes in a multifrontal factorisation: known before there are numbers.

A front is stored in two pieces, both column by column: the *panel* of its own columns, which becomes a piece of the
factor, and the *update* of its rows, which is added to the front of the parent and forgotten::

    own columns    rows
    [ L_11          .  ]      3 (size + n_rows) scalar rows in the panel,
    [ L_21       update]      3 n_rows in the update, of which the lower half counts
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from .stages import Stages
from .supernodes import Supernodes

__all__ = ["Fronts", "lay_out"]


class Fronts(NamedTuple):
    """Storage of the fronts of a forest of supernodes.

    Parameters
    ----------
    panel_starts : ndarray of int64, shape (n_supernodes + 1,)
        Where the panels are in the factor, in scalars.
    update_starts : ndarray of int64, shape (n_supernodes,)
        Where the updates are, in scalars: among those kept from task to task, or, inverted bitwise, in the scratch of
        the task. The same place serves many, one after the other.
    n_kept, n_scratch : int
        Scalars of the updates that are kept, and of the scratch of a task.
    positions : ndarray of int32, shape (n_rows,)
        For every row of a supernode, its position in the front of the parent, in points.
    child_starts : ndarray of int32, shape (n_supernodes + 1,)
        Where the children of each supernode start.
    children : ndarray of int32
        Children of every supernode, ascending.
    block_starts : ndarray of int64, shape (n_supernodes + 1,)
        Where the blocks of the matrix that go to each panel start.
    blocks : ndarray of int32, shape (n_blocks,)
        Those blocks.
    block_places : ndarray of int64, shape (n_blocks,)
        Where their first scalar goes in the factor; bitwise inverted where the block is to be transposed.
    """

    panel_starts: np.ndarray
    update_starts: np.ndarray
    n_kept: int
    n_scratch: int
    positions: np.ndarray
    child_starts: np.ndarray
    children: np.ndarray
    block_starts: np.ndarray
    blocks: np.ndarray
    block_places: np.ndarray


def lay_out(supernodes: Supernodes, stages: Stages, indptr: np.ndarray, indices: np.ndarray) -> Fronts:
    """Find a place for the fronts of a forest and for the blocks of a pattern."""
    sizes, n_rows = np.diff(supernodes.firsts).astype(np.int64), np.diff(supernodes.row_starts)
    panel_starts = np.concatenate(([0], np.cumsum(9 * sizes * (sizes + n_rows))))
    child_starts, children = _children(supernodes.parents)
    updates = _allocate(9 * n_rows * n_rows, child_starts, children, *stages)
    blocks = _place_blocks(indptr, indices, supernodes, panel_starts)
    return Fronts(panel_starts, *updates, _positions(supernodes), child_starts, children, *blocks)


@njit(cache=True)
def _children(parents):
    """Children of every supernode, in compressed rows."""
    n = len(parents)
    starts = np.zeros(n + 1, np.int32)
    for s in range(n):
        if parents[s] != -1:
            starts[parents[s] + 1] += 1
    starts = np.cumsum(starts).astype(np.int32)
    children, ends = np.empty(starts[n], np.int32), starts[:-1].copy()
    for s in range(n):
        if parents[s] != -1:
            children[ends[parents[s]]] = s
            ends[parents[s]] += 1
    return starts, children


@njit(cache=True)
def _positions(supernodes):
    """Position of every row of a supernode in its parent's front; both lists are ascending, so one sweep finds it."""
    firsts, row_starts, rows = supernodes.firsts, supernodes.row_starts, supernodes.rows
    positions = np.empty(len(rows), np.int32)
    for s in range(len(supernodes.parents)):
        parent = supernodes.parents[s]
        position = row_starts[parent]
        for entry in range(row_starts[s], row_starts[s + 1]):
            if rows[entry] < firsts[parent + 1]:
                positions[entry] = rows[entry] - firsts[parent]
                continue
            while rows[position] < rows[entry]:
                position += 1
            positions[entry] = firsts[parent + 1] - firsts[parent] + position - row_starts[parent]
    return positions


@njit(cache=True)
def _allocate(n_scalars, child_starts, children, ranges, stage_starts):
    """Place of every update, and the sizes of what is kept and of the scratch.

    Within a task an update is in the scratch until its parent has used it. The last ones of a task are kept until the
    stage of their parents has ended, since other tasks work at the same time.
    """
    n = len(n_scalars)
    starts, alive, n_alive, n_kept, n_scratch = np.zeros(n, np.int64), np.empty(n, np.int32), 0, 0, 0
    is_kept = np.ones(n, np.bool_)
    for first, last in ranges:
        for s in range(first, last):
            for child in children[child_starts[s] : child_starts[s + 1]]:
                is_kept[child] = child < first
    for stage in range(len(stage_starts) - 1):
        tasks = ranges[stage_starts[stage] : stage_starts[stage + 1]]
        for first, last in tasks:
            for s in range(first, last):
                if is_kept[s]:
                    n_alive = _place(s, n_scalars, starts, alive, n_alive)
                    n_kept = max(n_kept, starts[s] + n_scalars[s])
        for first, last in tasks:
            for s in range(first, last):
                n_alive = _drop(alive, n_alive, children[child_starts[s] : child_starts[s + 1]])
    for first, last in ranges:
        n_alive = 0
        for s in range(first, last):
            if not is_kept[s]:
                n_alive = _place(s, n_scalars, starts, alive, n_alive)
                n_scratch = max(n_scratch, starts[s] + n_scalars[s])
            n_alive = _drop(alive, n_alive, children[child_starts[s] : child_starts[s + 1]])
    return np.where(is_kept, starts, ~starts), n_kept, n_scratch


@njit(cache=True)
def _place(s, n_scalars, starts, alive, n_alive):
    """Give an update the first gap that is large enough; return the number of those alive, which stay sorted."""
    start, place = 0, 0
    while place < n_alive and starts[alive[place]] - start < n_scalars[s]:
        start = starts[alive[place]] + n_scalars[alive[place]]
        place += 1
    starts[s] = start
    alive[place + 1 : n_alive + 1] = alive[place:n_alive].copy()
    alive[place] = s
    return n_alive + 1


@njit(cache=True)
def _drop(alive, n_alive, done):
    """Take the updates that have been used off the list; return its length."""
    for child in done:
        n_kept = 0
        for other in alive[:n_alive]:
            if other != child:
                alive[n_kept] = other
                n_kept += 1
        n_alive = n_kept
    return n_alive


@njit(cache=True)
def _place_blocks(indptr, indices, supernodes, panel_starts):
    """Blocks of the matrix sorted by supernode, and where each of them goes."""
    rank, firsts, row_starts = supernodes.rank, supernodes.firsts, supernodes.row_starts
    n_supernodes = len(firsts) - 1
    owner = np.repeat(np.arange(n_supernodes).astype(np.int32), firsts[1:] - firsts[:-1])
    starts = np.zeros(n_supernodes + 1, np.int64)
    for row in range(len(rank)):
        for column in indices[indptr[row] : indptr[row + 1]]:
            starts[owner[min(rank[row], rank[column])] + 1] += 1
    starts = np.cumsum(starts)
    blocks, places, ends = np.empty(len(indices), np.int32), np.empty(len(indices), np.int64), starts[:-1].copy()
    for row in range(len(rank)):
        for block in range(indptr[row], indptr[row + 1]):
            low, high = min(rank[row], rank[indices[block]]), max(rank[row], rank[indices[block]])
            s = owner[low]
            size = firsts[s + 1] - firsts[s]
            position = high - firsts[s]
            if high >= firsts[s + 1]:
                position = size + np.searchsorted(supernodes.rows[row_starts[s] : row_starts[s + 1]], high)
            n_points = size + row_starts[s + 1] - row_starts[s]
            place = panel_starts[s] + 9 * (low - firsts[s]) * n_points + 3 * position
            blocks[ends[s]] = block
            places[ends[s]] = place if rank[row] == high else ~place
            ends[s] += 1
    return starts, blocks, places
