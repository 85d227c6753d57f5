"""Chunks of work that threads claim one after another inside a kernel, and wait for each other's by level.

Chunks are numbered; a thread claims the lowest that is left. Before it begins one, all chunks before some number have
to be done. Whoever claims a chunk works on it at once, so that any number of threads gets to the end, one that comes
late or never included, and each number is computed by the same operations whoever does it.
"""

from __future__ import annotations

import sys

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["claim", "counters", "finish"]

CLAIMED, DONE = 0, 8
"""Places of the two counters, which are on cache lines of their own."""

PATIENCE = 2000
"""Looks at a counter after which a thread lets others have its core."""


def counters() -> np.ndarray:
    """Counters of a new piece of work."""
    return np.zeros(16, np.int64)


def _element(context, builder, array_type, array, place: int):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [ir.Constant(ir.IntType(64), place)])


@intrinsic
def _next_claim(typingctx, numbers):
    """Number of a chunk that no other thread has."""

    def emit(context, builder, signature, args):
        one = ir.Constant(ir.IntType(64), 1)
        return builder.atomic_rmw("add", _element(context, builder, numbers, args[0], CLAIMED), one, "monotonic")

    return types.int64(numbers), emit


@intrinsic
def _n_done(typingctx, numbers):
    """Number of chunks that are done, with all that was written in them."""

    def emit(context, builder, signature, args):
        return builder.load_atomic(_element(context, builder, numbers, args[0], DONE), "acquire", 8)

    return types.int64(numbers), emit


@intrinsic
def finish(typingctx, numbers):
    """Say that a chunk is done."""

    def emit(context, builder, signature, args):
        one = ir.Constant(ir.IntType(64), 1)
        builder.atomic_rmw("add", _element(context, builder, numbers, args[0], DONE), one, "release")
        return context.get_dummy_value()

    return types.void(numbers), emit


@intrinsic
def _let_others_run(typingctx):
    """Offer the core to other threads, where the system knows such a call."""

    def emit(context, builder, signature, args):
        if sys.platform != "win32":
            kind = ir.FunctionType(ir.IntType(32), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), emit


@njit(cache=True, nogil=True)
def claim(numbers, n_chunks, first_needed):
    """Claim a chunk and wait until it may begin: its number, or -1 when there is none left.

    Parameters
    ----------
    numbers : ndarray
        See `counters`.
    n_chunks : int
        Number of chunks.
    first_needed : ndarray of int, shape (n_chunks,)
        How many chunks have to be done before each; never more than its own number.
    """
    chunk = _next_claim(numbers)
    if chunk >= n_chunks:
        return -1
    looks = 0
    while _n_done(numbers) < first_needed[chunk]:
        looks += 1
        if looks % PATIENCE == 0:
            _let_others_run()
    return chunk
