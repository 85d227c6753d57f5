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
        Where the updates are in the workspace, in scalars; the same place serves many, one after the other.
    n_workspace : int
        Scalars of the workspace.
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
    n_workspace: int
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
    update_starts, n_workspace = _allocate(9 * n_rows * n_rows, child_starts, children, *stages)
    blocks = _place_blocks(indptr, indices, supernodes, panel_starts)
    return Fronts(panel_starts, update_starts, n_workspace, _positions(supernodes), child_starts, children, *blocks)


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
    """Place of every update in the workspace: each task has a piece of its own, since others work at the same time."""
    starts, n_workspace = np.zeros(len(n_scalars), np.int64), 0
    for task in range(len(ranges)):
        first, last = ranges[task]
        n_workspace += _allocate_task(first, last, n_scalars, child_starts, children, starts, n_workspace)
    return starts, n_workspace


@njit(cache=True)
def _allocate_task(first, last, n_scalars, child_starts, children, starts, offset):
    """Give every update of a task the first gap that is large enough while those alive stay put; return the size."""
    alive, n_alive, size = np.empty(last - first, np.int32), 0, 0
    for s in range(first, last):
        start, place = offset, 0
        while place < n_alive and starts[alive[place]] - start < n_scalars[s]:
            start = starts[alive[place]] + n_scalars[alive[place]]
            place += 1
        starts[s] = start
        size = max(size, start + n_scalars[s] - offset)
        alive[place + 1 : n_alive + 1] = alive[place:n_alive].copy()
        alive[place] = s
        n_alive = _drop(alive, n_alive + 1, children[child_starts[s] : child_starts[s + 1]])
    return size


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
