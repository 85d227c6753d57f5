"""Which fronts can be factored at the same time.

The large fronts near the roots, the *trunk*, are tasks of their own, which threads share (`.tiled_front`). What hangs
on them is cut into *branches*: runs of whole subtrees of about equal work, each for one thread. Branches come first; a
front of the trunk comes when all below it is done. The cut depends on the pattern alone, and so do all sums: results
are the same for any number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from .supernodes import Supernodes, front_seconds

__all__ = ["Stages", "find_stages"]

LARGEST_BRANCH = 0.05
"""Share of all work that a branch has at most."""

LEAST_WORK = 0.02
"""Factorisations that take less time (s) are one branch."""


class Stages(NamedTuple):
    """Tasks of a factorisation: a stage can start when the one before it has ended.

    Parameters
    ----------
    ranges : ndarray of int64, shape (n_tasks, 2)
        First supernode of every task, and the one behind its last; the larger tasks of a stage come first.
    starts : ndarray of int64, shape (n_stages + 1,)
        Where each stage starts: the branches, if any, then the fronts of the trunk, by height.
    """

    ranges: np.ndarray
    starts: np.ndarray


def find_stages(supernodes: Supernodes) -> Stages:
    """Cut a factorisation into tasks."""
    sizes, n_rows = np.diff(supernodes.firsts), np.diff(supernodes.row_starts)
    ranges, stages, work = _cut(sizes.astype(np.int64), n_rows, supernodes.parents)
    order = np.lexsort((-work, stages))
    starts = np.searchsorted(stages[order], np.arange(stages.max(initial=0) + 2))
    return Stages(ranges[order], starts)


@njit(cache=True)
def _cut(sizes, n_rows, parents):
    """Ranges of supernodes, the stage of each (0 for branches), and its work."""
    n = len(parents)
    own, below, total = np.zeros(n), np.zeros(n), 0.0
    for s in range(n):
        own[s] = front_seconds(sizes[s], n_rows[s])
        below[s] += own[s]
        total += own[s]
        if parents[s] != -1:
            below[parents[s]] += below[s]
    limit = np.inf if total < LEAST_WORK else LARGEST_BRANCH * total
    ranges, stages, work = np.empty((n, 2), np.int64), np.zeros(n, np.int64), np.zeros(n)
    height, n_tasks, n_covered, is_open = np.zeros(n, np.int64), 0, 0, False
    for s in range(n):
        is_trunk = below[s] > limit
        if not is_trunk and parents[s] != -1 and below[parents[s]] <= limit:
            continue  # inside a subtree that is taken as a whole, with its root
        load = own[s] if is_trunk else below[s]
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
