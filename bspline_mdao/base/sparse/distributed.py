"""Symmetric matrices of 3 x 3 blocks with rows distributed over several processes.

A process stores the rows that it owns as in `.blocks`, and below them the coupled rows of others, of which only the
blocks that couple with its own are used::

    own row 0    [d]                     numbered from 0 on every process: its own rows first, in their order in the
    own row 1    [b d]                   whole matrix, and then the others, ascending. Every block (own, any) is there
    other row 2  [b   *]                 once, as in a matrix of one process, so that the same kernels add to it and
    other row 3  [  b * *]               multiply with it. What stands at * is not used.

Theory: ``docs/theory/sparse_parallel.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ..numerics.processes import ONE
from .blocks import BlockMatrix, BlockPattern

__all__ = ["DistributedMatrix", "DistributedPattern", "FullRows"]


@dataclass(frozen=True, eq=False)
class DistributedPattern(BlockPattern):
    """One process's part of a symmetric pattern."""

    # indptr, indices: pattern in the numbers of this process, see `BlockPattern`

    # first row of every process in the whole matrix, and the number of its rows
    starts: np.ndarray  # int64 (comm.size + 1,)
    others: np.ndarray  # int32 (n - n_owned,), rows of the whole matrix, ascending, that follow its own ones here
    comm: Any = field(default=ONE, repr=False)  # the processes

    @classmethod
    def whole(cls, pattern: BlockPattern) -> DistributedPattern:
        """Pattern of a single process; an already distributed one is returned unchanged."""
        if isinstance(pattern, cls):
            return pattern
        return cls(pattern.indptr, pattern.indices, np.array([0, pattern.n]), np.zeros(0, np.int32))

    @classmethod
    def of_local_elements(
        cls,
        # row of the whole matrix of every corner of all elements; -1 if the point is fixed
        element_rows: np.ndarray,  # int32 (n_elements, m)
        n: int,  # rows of the whole matrix
        comm: Any,  # communicator, of which only rank and size are used; nothing is sent
    ) -> tuple[DistributedPattern, np.ndarray, np.ndarray]:
        """Pattern of a process's own rows, for a matrix that couples all points of each element."""
        # Rows are distributed in order, equally many to each process.
        # returns element_ids int (n_own_elements,): elements that touch an own row
        # returns rows int32 (n_own_elements, m): local row of each of their corners
        starts = np.arange(comm.size + 1) * n // comm.size
        first, end = starts[comm.rank], starts[comm.rank + 1]
        element_ids = np.flatnonzero(((element_rows >= first) & (element_rows < end)).any(axis=1))
        touched = element_rows[element_ids]
        others = np.unique(touched[(touched >= 0) & ((touched < first) | (touched >= end))])
        here = np.full(n + 1, -1, np.int32)  # the last one is for -1
        here[first:end], here[others] = np.arange(end - first), end - first + np.arange(len(others))
        rows = here[touched]
        local = BlockPattern.of_elements(rows, int(end - first) + len(others))
        return cls(local.indptr, local.indices, starts, others, comm), element_ids, rows

    @property
    def n_owned(self) -> int:
        """Number of rows that this process owns."""
        return self.n - len(self.others)

    @property
    def owned(self) -> slice:
        """Its rows in the whole matrix."""
        return slice(int(self.starts[self.comm.rank]), int(self.starts[self.comm.rank + 1]))

    @cached_property
    def rows(self) -> np.ndarray:
        """Row of the whole matrix of every row here, int32, shape (n,)."""
        owned = self.owned
        return np.concatenate([np.arange(owned.start, owned.stop, dtype=np.int32), self.others])

    def gathered(self, owned: np.ndarray) -> np.ndarray:
        """Values of all rows, on every process, from its own rows' values, shape (n_owned, 3) or (n_owned, 3, m)."""
        if self.comm.size == 1:
            return owned
        whole = np.empty((int(self.starts[-1]), *owned.shape[1:]))
        counts = np.diff(self.starts) * int(np.prod(owned.shape[1:]))
        self.comm.Allgatherv(np.ascontiguousarray(owned), (whole, counts))
        return whole


@dataclass(frozen=True, eq=False)
class FullRows:
    """Own rows of a pattern with both halves, in compressed rows."""

    indptr: np.ndarray  # int64 (n_owned + 1,), where each row starts
    columns: np.ndarray  # int32 (n_entries,), columns in the whole matrix
    # position of the block in the data of the matrix; ``-1 - position`` if it is transposed
    places: np.ndarray  # int32 (n_entries,)

    @classmethod
    def of(cls, pattern: DistributedPattern) -> FullRows:
        """Find the full rows of a pattern."""
        return cls(*_full_rows(pattern.indptr, pattern.indices, pattern.rows, pattern.n_owned))


@dataclass(frozen=True, eq=False)
class DistributedMatrix:
    """Matrix of several processes, each of which multiplies its own rows."""

    pattern: DistributedPattern
    matrix: BlockMatrix  # this process's part, with this pattern
    # values of the rows of others, shape (n - n_owned, 3), from its own rows' values: collective
    exchange: Callable[[np.ndarray], np.ndarray]

    @property
    def comm(self) -> Any:
        """The processes."""
        return self.pattern.comm

    @property
    def n(self) -> int:
        """Number of block rows that this process owns."""
        return self.pattern.n_owned

    def dot(self, x: np.ndarray) -> np.ndarray:
        """Own rows of the product with a vector, given by each process's own rows, shape (n_owned, 3)."""
        return self.matrix.dot(np.concatenate([x, self.exchange(x)]))[: self.n]

    def dot_of_sizes(self, x: np.ndarray) -> np.ndarray:
        """Own rows of the product of absolute values."""
        return self.matrix.dot_of_sizes(np.concatenate([x, self.exchange(x)]))[: self.n]


@njit(cache=True)
def _full_rows(indptr, indices, rows, n_owned):
    """Both halves of the first rows: lower blocks come first because rows are processed in order."""
    starts = np.zeros(n_owned + 1, np.int64)
    for row in range(len(indptr) - 1):
        for entry in range(indptr[row], indptr[row + 1]):
            column = indices[entry]
            if row < n_owned:
                starts[row + 1] += 1
            if column < n_owned and column != row:
                starts[column + 1] += 1
    starts = np.cumsum(starts)
    columns, places, ends = np.empty(starts[-1], np.int32), np.empty(starts[-1], np.int32), starts[:-1].copy()
    for row in range(len(indptr) - 1):
        for entry in range(indptr[row], indptr[row + 1]):
            column = indices[entry]
            if row < n_owned:
                columns[ends[row]], places[ends[row]] = rows[column], entry
                ends[row] += 1
            if column < n_owned and column != row:
                columns[ends[column]], places[ends[column]] = rows[row], -1 - entry
                ends[column] += 1
    return starts, columns, places
