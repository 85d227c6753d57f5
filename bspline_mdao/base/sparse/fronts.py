"""Storage and schedule of the fronts of a multifrontal factorisation, determined before there are numbers.

A front is stored in two pieces, both column by column: the *panel* of its own columns, which becomes part of the
factor, and the *update* of its rows, which is added to the parent's front and discarded::

    own columns    rows
    [ L_11          .  ]      3 (size + n_rows) scalar rows in the panel,
    [ L_21       update]      3 n_rows in the update, of which the lower half is used

Theory: ``docs/theory/sparse.rst``, "Fronts".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from .symbolic import Supernodes, front_seconds

__all__ = ["Fronts", "Stages", "find_stages", "lay_out"]


LARGEST_BRANCH = 0.05
"""Largest fraction of all work in a branch: small enough for threads to end together."""

LEAST_WORK = 0.02
"""Factorisations shorter than this (s) are one branch: too little work for several threads."""


class Stages(NamedTuple):
    """Schedule of a factorisation on several threads: a stage can start when the previous one has ended."""

    # The large fronts near the roots, the *trunk*, are separate tasks, whose tiles are shared by threads. The subtrees
    # below them are cut into *branches*: sets of whole subtrees of about equal work, each for one thread. Branches come
    # first; a front of the trunk follows when everything below it is done. The cut and all sums depend only on the
    # pattern: results are the same for any number of threads.

    # first supernode of every task, and the one after its last; larger tasks of a stage come first
    ranges: np.ndarray  # int64 (n_tasks, 2)
    # where each stage starts: the branches, if any, then the fronts of the trunk, by height
    starts: np.ndarray  # int64 (n_stages + 1,)


def find_stages(supernodes: Supernodes) -> Stages:
    """Divide a factorisation into tasks."""
    sizes, n_rows = np.diff(supernodes.firsts), np.diff(supernodes.row_starts)
    ranges, stages, work = _cut(sizes.astype(np.int64), n_rows, supernodes.parents)
    order = np.lexsort((-work, stages))
    starts = np.searchsorted(stages[order], np.arange(stages.max(initial=0) + 2))
    return Stages(ranges[order], starts)


@njit(cache=True)
def _cut(sizes, n_rows, parents):
    """Ranges of supernodes, the stage of each (0 for branches), and its work."""
    n = len(parents)
    front, below, total = np.zeros(n), np.zeros(n), 0.0
    for s in range(n):
        front[s] = front_seconds(sizes[s], n_rows[s])
        below[s] += front[s]
        total += front[s]
        if parents[s] != -1:
            below[parents[s]] += below[s]
    limit = np.inf if total < LEAST_WORK else LARGEST_BRANCH * total
    ranges, stages, work = np.empty((n, 2), np.int64), np.zeros(n, np.int64), np.zeros(n)
    height, n_tasks, n_covered, is_open = np.zeros(n, np.int64), 0, 0, False
    for s in range(n):
        is_trunk = below[s] > limit
        if not is_trunk and parents[s] != -1 and below[parents[s]] <= limit:
            continue  # inside a subtree that is taken whole, with its root
        load = front[s] if is_trunk else below[s]
        if is_trunk or not is_open or work[n_tasks - 1] + load > limit:
            ranges[n_tasks, 0] = n_covered
            n_tasks += 1
        n_covered = s + 1
        ranges[n_tasks - 1, 1] = n_covered
        work[n_tasks - 1] += load
        is_open = not is_trunk
        if is_trunk:
            height[s] += 1
            stages[n_tasks - 1] = height[s]
            if parents[s] != -1:
                height[parents[s]] = max(height[parents[s]], height[s])
    return ranges[:n_tasks], stages[:n_tasks], work[:n_tasks]


class Fronts(NamedTuple):
    """Storage of the fronts of a forest of supernodes."""

    panel_starts: np.ndarray  # int64 (n_supernodes + 1,), positions of the panels in the factor, in scalars
    # positions of the updates, in scalars: among the ones kept from task to task, or, inverted bitwise, in the scratch
    # of the task. A position is reused by many, one after the other
    update_starts: np.ndarray  # int64 (n_supernodes,)
    # scalars of the kept updates, and of the scratch of a task
    n_kept: int
    n_scratch: int
    # for every row of a supernode, its position in the front of the parent, in points
    positions: np.ndarray  # int32 (n_rows,)
    child_starts: np.ndarray  # int32 (n_supernodes + 1,), where the children of each supernode start
    children: np.ndarray  # children of every supernode, ascending
    block_starts: np.ndarray  # int64 (n_supernodes + 1,), where the matrix blocks of each panel start
    blocks: np.ndarray  # int32 (n_blocks,), those blocks
    # position of their first scalar in the factor; bitwise inverted if the block is transposed
    block_places: np.ndarray  # int64 (n_blocks,)


def lay_out(supernodes: Supernodes, stages: Stages, indptr: np.ndarray, indices: np.ndarray) -> Fronts:
    """Assign storage to the fronts of a forest and to the blocks of a pattern."""
    sizes, n_rows = np.diff(supernodes.firsts).astype(np.int64), np.diff(supernodes.row_starts)
    panel_starts = np.concatenate(([0], np.cumsum(9 * sizes * (sizes + n_rows))))
    child_starts, children = _children(supernodes.parents)
    update_starts, n_kept, n_scratch = _allocate(9 * n_rows * n_rows, child_starts, children, *stages)
    blocks = _place_blocks(indptr, indices, supernodes, panel_starts)
    parents = np.repeat(supernodes.parents, n_rows)
    positions = _positions_in(parents, supernodes.rows.astype(np.int64), supernodes).astype(np.int32)
    return Fronts(panel_starts, update_starts, n_kept, n_scratch, positions, child_starts, children, *blocks)


def _children(parents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Children of every supernode, in compressed rows."""
    n, order = len(parents), np.argsort(parents, kind="stable").astype(np.int32)
    starts = np.searchsorted(parents[order], np.arange(n + 1)).astype(np.int32)
    return starts - starts[0], order[starts[0] :]


def _positions_in(fronts: np.ndarray, places: np.ndarray, supernodes: Supernodes) -> np.ndarray:
    """Positions of places in fronts that contain them, in points: own points first, then the rows."""
    firsts, row_starts, n = supernodes.firsts.astype(np.int64), supernodes.row_starts, len(supernodes.order)
    owners = np.repeat(np.arange(len(firsts) - 1), np.diff(row_starts))
    rows = np.searchsorted(owners * n + supernodes.rows, fronts * n + places) - row_starts[fronts]
    front = places - firsts[fronts]
    sizes = np.diff(firsts)[fronts]
    return np.where(front < sizes, front, sizes + rows)


@njit(cache=True)
def _allocate(n_scalars, child_starts, children, ranges, stage_starts):
    """Position of every update, and the sizes of the kept updates and of the scratch."""
    # Within a task an update is in the scratch until its parent has used it. The last updates of a task are kept until
    # the stage of their parents has ended, since other tasks run at the same time.
    n = len(n_scalars)
    starts, alive = np.zeros(n, np.int64), np.empty(n, np.int32)
    n_alive = n_kept = n_scratch = np.int64(0)
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
        n_alive = np.int64(0)
        for s in range(first, last):
            if not is_kept[s]:
                n_alive = _place(s, n_scalars, starts, alive, n_alive)
                n_scratch = max(n_scratch, starts[s] + n_scalars[s])
            n_alive = _drop(alive, n_alive, children[child_starts[s] : child_starts[s + 1]])
    for s in range(n):
        if not is_kept[s]:
            starts[s] = ~starts[s]
    return starts, n_kept, n_scratch


@njit(cache=True)
def _place(s, n_scalars, starts, alive, n_alive):
    """Assign the first large enough gap to an update; return the number of live ones, which stay sorted."""
    start, place = 0, 0
    while place < n_alive and starts[alive[place]] - start < n_scalars[s]:
        start = starts[alive[place]] + n_scalars[alive[place]]
        place += 1
    starts[s] = start
    for later in range(n_alive, place, -1):
        alive[later] = alive[later - 1]
    alive[place] = s
    return n_alive + 1


@njit(cache=True)
def _drop(alive, n_alive, done):
    """Remove used updates from the list; return its length."""
    for child in done:
        n_kept = 0
        for other in alive[:n_alive]:
            if other != child:
                alive[n_kept] = other
                n_kept += 1
        n_alive = n_kept
    return n_alive


def _place_blocks(
    indptr: np.ndarray, indices: np.ndarray, supernodes: Supernodes, panel_starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Blocks of the matrix sorted by supernode, and the position of each."""
    sizes, n_rows = np.diff(supernodes.firsts).astype(np.int64), np.diff(supernodes.row_starts)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    rows = supernodes.rank[np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))].astype(np.int64)
    columns = supernodes.rank[indices].astype(np.int64)
    low, high = np.minimum(rows, columns), np.maximum(rows, columns)
    s = owner[low]
    column = low - supernodes.firsts[s]
    places = panel_starts[s] + 9 * column * (sizes + n_rows)[s] + 3 * _positions_in(s, high, supernodes)
    blocks = np.argsort(s, kind="stable").astype(np.int32)
    starts = np.searchsorted(s[blocks], np.arange(len(sizes) + 1))
    return starts, blocks, np.where(rows == high, places, ~places)[blocks]
