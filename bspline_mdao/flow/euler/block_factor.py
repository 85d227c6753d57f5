"""Incomplete factor L U of a matrix of 5 x 5 blocks, computed and applied on several threads.

It is computed in single precision; of L and U the upper half of every number is kept, eight bits and the exponent. The
error of an incomplete factor is much larger, and the sweeps read half as much.

The pattern is symmetric. Entry ``(row, column)`` of the strict lower triangle stores the block of L there and the block
of U at ``(column, row)``. Two threads take half of the rows each and wait for each other once. More threads share the
rows of one level after another, which only need rows of lower levels, each the same part of all of them first. Every
number is the same on any number of threads.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from ...base.numerics.threads import run_tasks, thread_count
from ...base.numerics.vec5 import (
    add_product,
    block_product,
    combined,
    lane_sums,
    less_product,
    load,
    load_block,
    load_half_block,
    load_halves,
    prefetch,
    product_of_blocks,
    store,
    store_block,
    store_half_block,
    subtract_combined,
    subtract_scaled,
    zero_halves,
    zeros,
)
from ...base.numerics.work_queue import claim, counters, finish
from .cell_sums import visit

__all__ = ["BLOCK", "BlockFactor", "Schedule", "levels_of"]

BLOCK = 5

ROWS, PER_THREAD = 16, 2
"""Smallest number of rows of a chunk, a microsecond of work, and largest number of chunks per level and thread."""

AHEAD, ROWS_AHEAD = 32, 16
"""Blocks and rows ahead of the current ones that are prefetched: without it half of a sweep is waiting."""

ROWS_PER_THREAD, ROWS_OF_LEVEL = 2_000, 150
"""Fewer rows than this do not justify a thread, nor do levels with fewer rows per thread on average justify more than
two: a thread would wait for the others for as long as it works."""


class FactorRows(NamedTuple):
    """Pattern of the strict lower triangle by rows and by columns, for kernels: see `Pattern`, `Schedule`."""

    order: np.ndarray
    starts: np.ndarray
    columns: np.ndarray
    column_starts: np.ndarray
    column_rows: np.ndarray


class Chunks(NamedTuple):
    """Chunks of rows for threads to claim, as arguments of kernels: see `Schedule`, `claim`."""

    firsts: np.ndarray
    ends: np.ndarray
    levels: np.ndarray
    turn: int  # level from which on the order is backwards
    numbers: np.ndarray  # counters, used only for this task


class FactorBlocks(NamedTuple):
    """Blocks of a matrix or of its factor, as arguments of kernels: below, above and on the diagonal."""

    lower: np.ndarray
    upper: np.ndarray
    diagonal: np.ndarray


@dataclass(frozen=True, eq=False)
class Schedule:
    """The rows that can be done in parallel, and the pattern by columns."""

    # firsts, ends: (n_chunks,) of int, rows between which each chunk lies
    firsts: np.ndarray
    ends: np.ndarray
    # levels, both: (n_levels + 1,) and (2 n_levels + 1,) of int, chunks with which the levels start, for one upward
    # pass, and for an upward and a downward pass
    levels: np.ndarray
    both: np.ndarray
    n_threads: int  # number of threads that the levels can occupy
    column_starts: np.ndarray  # (n + 1,) of int, where each column of the strict lower triangle starts
    # column_entries, column_rows: (n_blocks,) of int, entries of the columns, and their rows
    column_entries: np.ndarray
    column_rows: np.ndarray

    def chunks(self, levels: np.ndarray, turn: int) -> Chunks:
        """Chunks of some levels, to be claimed once."""
        return Chunks(self.firsts, self.ends, levels, turn, counters(levels[-1], levels[0]))

    @property
    def upwards(self) -> np.ndarray:
        """The first half of ``both``."""
        return self.both[: len(self.levels)]

    @property
    def downwards(self) -> np.ndarray:
        """The second half of ``both``."""
        return self.both[len(self.levels) - 1 :]

    @classmethod
    def of(
        cls,
        starts: np.ndarray,  # starts, columns: see `Pattern`; rows of a level should be adjacent
        columns: np.ndarray,
        # (n_parts + 1,) of int, rows between which the parts lie; the first two are independent, each later one needs
        # all before it
        parts: np.ndarray,
    ) -> Schedule:
        """Cut the rows of a pattern into chunks, one for each part, or more if levels occupy more threads."""
        n, wanted, level = len(starts) - 1, thread_count(None), levels_of(starts, columns)
        stage = np.repeat(np.maximum(np.arange(len(parts) - 1), 1), np.diff(parts))
        level += (stage - 1) * (int(level.max(initial=0)) + 1)
        n_fed = int(n / ROWS_OF_LEVEL / max(1, len(np.unique(level))))
        n_halves = max(1, int(np.count_nonzero(np.diff(parts[:3]))))
        is_by_level = min(wanted, n_fed) > n_halves
        chunks = _chunks(level, parts, PER_THREAD * wanted) if is_by_level else _chunks(stage, parts, 1)
        levels = chunks[2]
        both = np.concatenate([levels, 2 * levels[-1] - levels[-2::-1]])
        rows = np.repeat(np.arange(n, dtype=np.int32), np.diff(starts))
        entries = np.argsort(columns, kind="stable").astype(np.int32)
        column_starts = np.zeros(n + 1, np.int64)
        np.cumsum(np.bincount(columns, minlength=n), out=column_starts[1:])
        return cls(*chunks, both, n_fed if is_by_level else n_halves, column_starts, entries, rows[entries])


def _chunks(level: np.ndarray, parts: np.ndarray, n_most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First and last rows of chunks, level by level, and the chunks with which the levels start."""
    # Adjacent rows of a level in a part are cut into at most so many chunks.
    n = len(level)
    if not n:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(1, np.int64)
    is_first = np.diff(level, prepend=-1) != 0
    is_first[parts[parts < n]] = True
    edges = np.append(np.flatnonzero(is_first), n)
    n_chunks = np.clip(np.diff(edges) // ROWS, 1, n_most)
    firsts = np.concatenate([lo + (hi - lo) * np.arange(m) // m for lo, hi, m in zip(edges, edges[1:], n_chunks)])
    order, ends = np.argsort(level[firsts], kind="stable"), np.append(firsts[1:], n)
    sizes = np.unique(level[firsts], return_counts=True)[1]
    return firsts[order], ends[order], np.append(0, np.cumsum(sizes))


class Pattern(Protocol):
    """Pattern of the strict lower triangle by rows, with the order of its points and a schedule."""

    @property
    def order(self) -> np.ndarray:
        """Point of every row."""

    @property
    def starts(self) -> np.ndarray:
        """Where each row starts."""

    @property
    def columns(self) -> np.ndarray:
        """Columns of the rows."""

    @property
    def schedule(self) -> Schedule:
        """Order of the work."""


@dataclass(frozen=True, eq=False)
class BlockFactor:
    """Incomplete factor L U of a matrix of 5 x 5 blocks, or of its transpose."""

    # The upward sweep through the rows reads blocks by rows, the downward one by columns. Each has its own in the order
    # in which it reads them: scattered blocks take more than twice the time. So a factor serves either the matrix or
    # its transpose, and `into_transposed` converts one into the other, in the same memory and as fast as a solution.

    pattern: Pattern
    # lower, upper: (n_blocks, 5, 5), blocks of L below its unit diagonal, by rows, and of U above its diagonal, by
    # columns of the pattern, see `zero_halves`; for the transpose L by columns and U by rows
    lower: np.ndarray
    upper: np.ndarray
    pivots: np.ndarray  # (n, 5, 5), inverses of the diagonal blocks of U
    is_transposed: bool = False  # whether it is the factor of the transpose

    @classmethod
    def of(cls, pattern: Pattern, lower: np.ndarray, upper: np.ndarray, diagonal: np.ndarray) -> BlockFactor:
        """Factor a matrix, whose off-diagonal blocks are halves, at their entries, the others by rank."""
        # They are overwritten.
        schedule = pattern.schedule
        rows, chunks = factor_rows(pattern), schedule.chunks(schedule.levels, len(schedule.levels))
        blocks = FactorBlocks(lower, upper, diagonal)
        _together(schedule, len(diagonal), lambda *part: _factorize(rows, chunks, *part, blocks))
        return cls(pattern, lower, _by_columns(upper, schedule), diagonal)

    def into_transposed(self) -> BlockFactor:
        """Factor of the transpose, in the memory of this one, which becomes invalid."""
        # Blocks stored by rows must be stored by columns, and vice versa: they are exchanged block by block.
        entries = self.pattern.schedule.column_entries
        by_rows, by_columns = (self.upper, self.lower) if self.is_transposed else (self.lower, self.upper)
        visit(len(entries), lambda part: _swap(by_rows, entries[part], by_columns[part]))
        return BlockFactor(self.pattern, self.upper, self.lower, self.pivots, not self.is_transposed)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve ``L U x = right``, or ``U^T L^T x = right``, shape (n, 5), in single precision."""
        both, single = self.pattern.schedule.both, np.ascontiguousarray(right, np.float32)
        x, out = np.empty_like(single), np.empty_like(single)
        self._sweep(both, len(both) // 2, single, x, out)
        return out.astype(right.dtype, copy=False)

    def upwards(self, right: np.ndarray) -> np.ndarray:
        """First half of a solve: the solution with L, or with ``U^T``, shape (n, 5), float32, by rows."""
        levels, single = self.pattern.schedule.upwards, np.ascontiguousarray(right, np.float32)
        x = np.empty_like(single)
        self._sweep(levels, len(levels), single, x, x)
        return x

    def downwards(self, x: np.ndarray) -> np.ndarray:
        """Second half of a solve, from the result of `upwards`, which it overwrites: shape (n, 5), float32."""
        out = np.empty_like(x)
        self._sweep(self.pattern.schedule.downwards, 0, x, x, out)
        return out

    def _sweep(self, levels: np.ndarray, turn: int, right: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
        """Process the chunks of some levels, from ``turn`` on downwards."""
        kernel, schedule = (_solve_transposed if self.is_transposed else _solve), self.pattern.schedule
        rows, chunks = factor_rows(self.pattern), schedule.chunks(levels, turn)
        blocks = FactorBlocks(self.lower, self.upper, self.pivots)
        _together(schedule, len(right), lambda *part: kernel(rows, chunks, *part, blocks, right, x, out))


def factor_rows(pattern: Pattern) -> FactorRows:
    """A pattern as arguments of kernels."""
    schedule = pattern.schedule
    return FactorRows(pattern.order, pattern.starts, pattern.columns, schedule.column_starts, schedule.column_rows)


def _by_columns(blocks: np.ndarray, schedule: Schedule) -> np.ndarray:
    """Blocks by columns, from blocks by rows."""
    out = zero_halves(blocks.shape)
    visit(len(blocks), lambda part: _gather(blocks, schedule.column_entries[part], out[part]))
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _gather(blocks, entries, out):
    for n in range(len(entries)):
        prefetch(blocks, 25 * entries[min(n + AHEAD, len(entries) - 1)])
        store_half_block(out, 25 * n, load_half_block(blocks, 25 * entries[n]))


@njit(cache=True, error_model="numpy", nogil=True)
def _swap(by_rows, entries, by_columns):
    for n in range(len(entries)):
        prefetch(by_rows, 25 * entries[min(n + AHEAD, len(entries) - 1)])
        block = load_half_block(by_rows, 25 * entries[n])
        store_half_block(by_rows, 25 * entries[n], load_half_block(by_columns, 25 * n))
        store_half_block(by_columns, 25 * n, block)


def _together(schedule: Schedule, n_rows: int, work: Callable[[int, int], None]) -> None:
    """Call a function whose chunks threads claim on a suitable number of threads, with each one's part and number."""
    n_threads = max(1, min(thread_count(None), schedule.n_threads, n_rows // ROWS_PER_THREAD))
    run_tasks(lambda part: work(part, n_threads), range(n_threads), n_threads)


@njit(cache=True, error_model="numpy")
def levels_of(starts, columns):
    """Level of each row: one more than the highest level of the rows that it needs."""
    levels = np.zeros(len(starts) - 1, np.int32)
    for row in range(len(levels)):
        for entry in range(starts[row], starts[row + 1]):
            levels[row] = max(levels[row], levels[columns[entry]] + 1)
    return levels


@njit(cache=True, error_model="numpy", nogil=True)
def _factorize(rows, chunks, part, n_parts, blocks):
    """Factor row by row in place; diagonal blocks are replaced by their inverses."""
    # For every entry j of row i of the pattern, ascending; fill outside the pattern is dropped:
    #
    # 1. ``L_ij = A_ij - sum_k L_ik U_kj`` and ``U_ji = A_ji - sum_k L_jk U_ki``, over the k < j in both rows.
    # 2. ``L_ij = L_ij U_jj^-1``.
    # 3. ``U_ii = A_ii - sum_j L_ij U_ji``, and its inverse when the row is done.
    starts, columns = rows.starts, rows.columns
    firsts, ends, levels, turn, numbers = chunks
    lower, upper, diagonal = blocks
    block, inverse = np.empty((BLOCK, BLOCK)), np.empty((BLOCK, BLOCK))
    level = n_tried = 0
    while True:
        chunk, level, n_tried = claim(numbers, levels, turn, part, n_parts, level, n_tried)
        if chunk < 0:
            return
        for row in range(firsts[chunk], ends[chunk]):
            first, pivot = starts[row], load_block(diagonal, 25 * row)
            for entry in range(first, starts[row + 1]):
                column = columns[entry]
                place, low, up = first, load_half_block(lower, 25 * entry), load_half_block(upper, 25 * entry)
                for other in range(starts[column], starts[column + 1]):
                    while place < entry and columns[place] < columns[other]:
                        place += 1
                    if place < entry and columns[place] == columns[other]:  # step 1
                        low = less_product(low, load_half_block(lower, 25 * place), load_half_block(upper, 25 * other))
                        up = less_product(up, load_half_block(lower, 25 * other), load_half_block(upper, 25 * place))
                low = product_of_blocks(low, load_block(diagonal, 25 * column))  # step 2
                pivot = less_product(pivot, low, up)  # step 3
                store_half_block(lower, 25 * entry, low)
                store_half_block(upper, 25 * entry, up)
            store_block(diagonal, 25 * row, pivot)
            for a in range(BLOCK):
                for b in range(BLOCK):
                    block[a, b] = diagonal[row, a, b]
            _invert(block, inverse)
            for a in range(BLOCK):
                for b in range(BLOCK):
                    diagonal[row, a, b] = inverse[a, b]
        finish(numbers)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _ask_for_block(blocks, at):
    """Prefetch a block of single precision: it lies in two cache lines, or three."""
    prefetch(blocks, 25 * at)
    prefetch(blocks, 25 * at + 16)


@njit(cache=True, error_model="numpy", nogil=True)
def _invert(block, inverse):
    """Invert a block, which is overwritten, by Gauss-Jordan elimination with row exchanges."""
    for a in range(BLOCK):
        for b in range(BLOCK):
            inverse[a, b] = 1.0 if a == b else 0.0
    for k in range(BLOCK):
        pivot = k
        for a in range(k + 1, BLOCK):
            if abs(block[a, k]) > abs(block[pivot, k]):
                pivot = a
        for b in range(BLOCK):
            block[k, b], block[pivot, b] = block[pivot, b], block[k, b]
            inverse[k, b], inverse[pivot, b] = inverse[pivot, b], inverse[k, b]
        inverse_pivot = 1.0 / block[k, k]
        for b in range(BLOCK):
            block[k, b] *= inverse_pivot
            inverse[k, b] *= inverse_pivot
        for a in range(BLOCK):
            factor = block[a, k] if a != k else 0.0
            for b in range(BLOCK):
                block[a, b] -= factor * block[k, b]
                inverse[a, b] -= factor * inverse[k, b]


@njit(cache=True, error_model="numpy", nogil=True)
def _solve(rows, chunks, part, n_parts, blocks, right, x, out):
    """Solve with L, then with U."""
    order, starts, columns, column_starts, column_rows = rows
    firsts, ends, levels, turn, numbers = chunks
    lower, upper, pivots = blocks
    n_chunks, level, n_tried = levels[-1], 0, 0
    while True:
        chunk, level, n_tried = claim(numbers, levels, turn, part, n_parts, level, n_tried)
        if chunk < 0:
            return
        if level < turn:
            for row in range(firsts[chunk], ends[chunk]):
                prefetch(right, 5 * order[min(row + ROWS_AHEAD, len(order) - 1)])
                a = b = c = d = e = zeros()
                for entry in range(starts[row], starts[row + 1]):
                    z, at = load(x, 5 * columns[entry]), 25 * entry
                    prefetch(lower, at + 25 * AHEAD)
                    a, b = add_product(a, load_halves(lower, at), z), add_product(b, load_halves(lower, at + 5), z)
                    c, d = (
                        add_product(c, load_halves(lower, at + 10), z),
                        add_product(d, load_halves(lower, at + 15), z),
                    )
                    e = add_product(e, load_halves(lower, at + 20), z)
                known = load(right, 5 * order[row])
                store(x, 5 * row, subtract_scaled(known, np.float32(1.0), lane_sums(a, b, c, d, e)))
        else:
            back = n_chunks - 1 - chunk
            for row in range(ends[back] - 1, firsts[back] - 1, -1):
                prefetch(out, 5 * order[max(row - ROWS_AHEAD, 0)])
                _ask_for_block(pivots, row - ROWS_AHEAD)
                a = b = c = d = e = zeros()
                for place in range(column_starts[row + 1] - 1, column_starts[row] - 1, -1):
                    z, at = load(x, 5 * column_rows[place]), 25 * place
                    prefetch(upper, at - 25 * AHEAD)
                    a, b = add_product(a, load_halves(upper, at), z), add_product(b, load_halves(upper, at + 5), z)
                    c, d = (
                        add_product(c, load_halves(upper, at + 10), z),
                        add_product(d, load_halves(upper, at + 15), z),
                    )
                    e = add_product(e, load_halves(upper, at + 20), z)
                known = load(x, 5 * row)
                known = subtract_scaled(known, np.float32(1.0), lane_sums(a, b, c, d, e))
                z = block_product(pivots, 25 * row, known)
                store(x, 5 * row, z)
                store(out, 5 * order[row], z)
        finish(numbers)


@njit(cache=True, error_model="numpy", nogil=True)
def _solve_transposed(rows, chunks, part, n_parts, blocks, right, x, out):
    """Solve with the transpose of U, then with the transpose of L."""
    order, starts, columns, column_starts, column_rows = rows
    firsts, ends, levels, turn, numbers = chunks
    lower, upper, pivots = blocks
    n_chunks, level, n_tried = levels[-1], 0, 0
    while True:
        chunk, level, n_tried = claim(numbers, levels, turn, part, n_parts, level, n_tried)
        if chunk < 0:
            return
        if level < turn:
            for row in range(firsts[chunk], ends[chunk]):
                prefetch(right, 5 * order[min(row + ROWS_AHEAD, len(order) - 1)])
                _ask_for_block(pivots, row + ROWS_AHEAD)
                z = load(right, 5 * order[row])
                for entry in range(starts[row], starts[row + 1]):
                    prefetch(upper, 25 * (entry + AHEAD))
                    z = subtract_combined(z, load(x, 5 * columns[entry]), load_half_block(upper, 25 * entry))
                store(x, 5 * row, combined(z, load_block(pivots, 25 * row)))
        else:
            back = n_chunks - 1 - chunk
            for row in range(ends[back] - 1, firsts[back] - 1, -1):
                prefetch(out, 5 * order[max(row - ROWS_AHEAD, 0)])
                z = load(x, 5 * row)
                for place in range(column_starts[row + 1] - 1, column_starts[row] - 1, -1):
                    prefetch(lower, 25 * (place - AHEAD))
                    z = subtract_combined(z, load(x, 5 * column_rows[place]), load_half_block(lower, 25 * place))
                store(x, 5 * row, z)
                store(out, 5 * order[row], z)
        finish(numbers)
