"""Chunks of work that threads claim one after another inside a kernel, waiting for each other level by level.

Levels of chunks are processed one after another. In each level a thread begins with the chunks of its own part,
adjacent to its chunks in the previous level, so its data are in its own cache; then it takes chunks left by others. A
thread works on a claimed chunk as soon as the previous levels are done. So any number of threads finishes, even if one
comes late or never, and each number is computed by the same operations on any thread.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.extending import intrinsic

__all__ = ["claim", "counters", "finish"]

DONE, FIRST = 0, 8
"""Positions of the number of finished chunks, on a cache line of its own, and of the first chunk's mark."""

PATIENCE = 2000
"""Number of polls of a counter after which a thread yields its core."""


def counters(
    n_chunks: int,  # number of the last chunk, plus one
    n_done: int = 0,  # number of the first one: earlier ones are done
) -> np.ndarray:
    """Counters of a new piece of work: number of finished chunks, and a mark for each claimed one."""
    numbers = np.zeros(FIRST + n_chunks, np.int64)
    numbers[DONE] = n_done
    return numbers


def _element(
    context: BaseContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value, place: ir.Value
) -> ir.Value:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [place])


def _n_done_place(context: BaseContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value) -> ir.Value:
    return _element(context, builder, array_type, array, ir.Constant(ir.IntType(64), DONE))


@intrinsic
def _mark(typingctx, numbers, place):
    """Mark a chunk as claimed, and return the previous mark."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        one = ir.Constant(ir.IntType(64), 1)
        return builder.atomic_rmw("xchg", _element(context, builder, numbers, *args), one, "monotonic")

    return types.int64(numbers, types.int64), emit


@intrinsic
def _n_done(typingctx, numbers):
    """Number of finished chunks, whose results are visible."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return builder.load_atomic(_n_done_place(context, builder, numbers, args[0]), "acquire", 8)

    return types.int64(numbers), emit


@intrinsic
def finish(typingctx, numbers):
    """Report that a chunk is finished."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        one = ir.Constant(ir.IntType(64), 1)
        builder.atomic_rmw("add", _n_done_place(context, builder, numbers, args[0]), one, "release")
        return context.get_dummy_value()

    return types.void(numbers), emit


@intrinsic
def _let_others_run(typingctx):
    """Yield the core to other threads, if the system supports it."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        if sys.platform != "win32":
            kind = ir.FunctionType(ir.IntType(32), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), emit


@njit(cache=True, nogil=True)
def claim(
    numbers,  # see `counters`
    starts,  # int64 (n_levels + 1,), chunks with which the levels start
    turn,  # int, level from which chunks are numbered backwards, so that a part is at the other end
    # part of every level with which this thread begins, and the number of parts
    part,  # int
    n_parts,  # int
    # result of the last call; 0 and 0 in the first
    level,  # int
    n_tried,  # int
):
    """Claim a chunk and wait until the levels before its own are done."""
    # returns chunk int: its number, or -1 when there is none left
    # returns level, n_tried int: for the next call: its level, and how many chunks of it this thread has tried
    while level + 1 < len(starts):
        first, n_chunks = starts[level], starts[level + 1] - starts[level]
        local = part if level < turn else n_parts - 1 - part
        while n_tried < n_chunks:
            chunk = first + (local * n_chunks // n_parts + n_tried) % n_chunks
            n_tried += 1
            if numbers[FIRST + chunk] == 0 and _mark(numbers, FIRST + chunk) == 0:
                polls = 0
                while _n_done(numbers) < first:
                    polls += 1
                    if polls % PATIENCE == 0:
                        _let_others_run()
                return chunk, level, n_tried
        level, n_tried = level + 1, 0
    return -1, level, n_tried
