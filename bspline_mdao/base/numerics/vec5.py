"""Vectors of five numbers of single precision, as values in kernels: states and rows of 5 x 5 blocks.

LLVM does not vectorize blocks of five. Here they are the first five of eight lanes; the others are zero after loading,
except for halves, and are not stored. Products and sums are marked as contractible and become fused if the machine has
such instructions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.extending import intrinsic, models, register_model

__all__ = [
    "add_product",
    "add_scaled",
    "block_product",
    "combined",
    "lane_sums",
    "less_product",
    "load",
    "load_block",
    "load_half_block",
    "load_halves",
    "prefetch",
    "product_of_blocks",
    "store",
    "store_block",
    "store_half_block",
    "store_halves",
    "subtract_combined",
    "subtract_scaled",
    "zero_halves",
    "zeros",
]

N, LANES = 5, 8

_INT, _FLOAT = ir.IntType(32), ir.FloatType()
_HALVES = ir.VectorType(ir.IntType(16), LANES)
_VECTOR, _MASK_TYPE = ir.VectorType(_FLOAT, LANES), ir.VectorType(ir.IntType(1), LANES)
_MASK = ir.Constant(_MASK_TYPE, [int(k < N) for k in range(LANES)])
_CONTRACT = ("contract",)


class _Five(types.Type):
    """Type of five numbers of single precision in a register."""

    def __init__(self) -> None:
        super().__init__(name="Five")


FIVE = _Five()

ROWS = types.UniTuple(FIVE, N)


@register_model(_Five)
class _FiveModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _is_flat(array: types.Type) -> bool:
    return isinstance(array, types.Array) and array.dtype == types.float32 and array.layout == "C"


def _pointer(
    context: BaseContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value, offset: ir.Value
) -> ir.Value:
    """Address of an element of the data of an array, whatever its dimensions."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset])


@intrinsic
def load(typingctx, array, offset):
    """Five numbers from an offset into the data of an array in C order."""
    if not _is_flat(array):
        return None

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _pointer(context, builder, array, args[0], args[1])
        kind = ir.FunctionType(_VECTOR, [_FLOAT.as_pointer(), _INT, _MASK_TYPE, _VECTOR])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v8f32.p0")
        zeros = ir.Constant(_VECTOR, [0.0] * LANES)
        return builder.call(function, [at, ir.Constant(_INT, 4), _MASK, zeros])

    return FIVE(array, types.int64), emit


def zero_halves(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros as 16-bit numbers, the upper half of single precision (bfloat16), in an array of uint16."""
    # It is padded for `load_halves`.
    size = math.prod(shape)
    return np.zeros(size + LANES, np.uint16)[:size].reshape(shape)


@intrinsic
def load_halves(typingctx, array, offset):
    """Five numbers from an offset into an array of `zero_halves`; the other lanes contain the numbers that follow."""
    if not (isinstance(array, types.Array) and array.dtype == types.uint16 and array.layout == "C"):
        return None

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _pointer(context, builder, array, args[0], args[1])
        halves = builder.load(builder.bitcast(at, _HALVES.as_pointer()), align=2)
        wide = ir.VectorType(_INT, LANES)
        bits = builder.shl(builder.zext(halves, wide), ir.Constant(wide, [16] * LANES))
        return builder.bitcast(bits, _VECTOR)

    return FIVE(array, types.int64), emit


@intrinsic
def store_halves(typingctx, array, offset, vector):
    """Round five numbers to halves, ties to even, and write them from an offset into an array of halves."""
    if not (isinstance(array, types.Array) and array.dtype == types.uint16 and array.layout == "C"):
        return None

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _pointer(context, builder, array, args[0], args[1])
        wide = ir.VectorType(_INT, LANES)

        def all_lanes(number: int) -> ir.Constant:
            return ir.Constant(wide, [number] * LANES)

        bits = builder.bitcast(args[2], wide)
        odd = builder.and_(builder.lshr(bits, all_lanes(16)), all_lanes(1))
        rounded = builder.lshr(builder.add(builder.add(bits, all_lanes(0x7FFF)), odd), all_lanes(16))
        halves, first = builder.trunc(rounded, _HALVES), ir.VectorType(ir.IntType(16), 4)
        four = builder.shuffle_vector(halves, halves, ir.Constant(ir.VectorType(_INT, 4), [0, 1, 2, 3]))
        builder.store(four, builder.bitcast(at, first.as_pointer()), align=2)  # the rest belongs to others
        last = builder.extract_element(halves, ir.Constant(_INT, 4))
        builder.store(last, builder.gep(at, [ir.Constant(_INT, 4)]), align=2)
        return context.get_dummy_value()

    return types.void(array, types.int64, FIVE), emit


@intrinsic
def prefetch(typingctx, array, offset):
    """Prefetch the numbers at an offset into the data of an array, which may lie beyond its end."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _pointer(context, builder, array, args[0], args[1])
        kind = ir.FunctionType(ir.VoidType(), [_FLOAT.as_pointer(), _INT, _INT, _INT])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        at = builder.bitcast(at, _FLOAT.as_pointer())
        builder.call(function, [at] + [ir.Constant(_INT, number) for number in (0, 3, 1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), emit


@intrinsic
def store(typingctx, array, offset, vector):
    """Write five numbers from an offset into the data of an array in C order."""
    if not _is_flat(array):
        return None

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _pointer(context, builder, array, args[0], args[1])
        kind = ir.FunctionType(ir.VoidType(), [_VECTOR, _FLOAT.as_pointer(), _INT, _MASK_TYPE])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.store.v8f32.p0")
        builder.call(function, [args[2], at, ir.Constant(_INT, 4), _MASK])
        return context.get_dummy_value()

    return types.void(array, types.int64, FIVE), emit


def _broadcast(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    """Copy a number to all lanes."""
    empty = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(empty, number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


@intrinsic
def zeros(typingctx):
    """Five zeros."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return ir.Constant(_VECTOR, [0.0] * LANES)

    return FIVE(), emit


@intrinsic
def add_scaled(typingctx, total, factor, v):
    """Five numbers ``total + factor v``."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        product = builder.fmul(_broadcast(builder, args[1]), args[2], flags=_CONTRACT)
        return builder.fadd(args[0], product, flags=_CONTRACT)

    return FIVE(FIVE, types.float32, FIVE), emit


@intrinsic
def subtract_scaled(typingctx, total, factor, v):
    """Five numbers ``total - factor v``."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        product = builder.fmul(_broadcast(builder, args[1]), args[2], flags=_CONTRACT)
        return builder.fsub(args[0], product, flags=_CONTRACT)

    return FIVE(FIVE, types.float32, FIVE), emit


def _combination(builder: ir.IRBuilder, factors: ir.Value, vectors: Sequence[ir.Value]) -> ir.Value:
    """Sum of vectors times the numbers in the lanes of another."""
    total = None
    for k, vector in enumerate(vectors):
        lanes = ir.Constant(ir.VectorType(_INT, LANES), [k] * LANES)
        factor = builder.shuffle_vector(factors, ir.Constant(_VECTOR, ir.Undefined), lanes)
        product = builder.fmul(factor, vector, flags=_CONTRACT)
        total = product if total is None else builder.fadd(total, product, flags=_CONTRACT)
    return total


@intrinsic
def combined(typingctx, factors, rows):
    """Five numbers: the sum of five vectors times those in ``factors``, a row times a block."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return _combination(builder, args[0], cgutils.unpack_tuple(builder, args[1], N))

    return FIVE(FIVE, ROWS), emit


@intrinsic
def subtract_combined(typingctx, total, factors, rows):
    """Five numbers ``total - combined(factors, rows)``."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        product = _combination(builder, args[1], cgutils.unpack_tuple(builder, args[2], N))
        return builder.fsub(args[0], product, flags=_CONTRACT)

    return FIVE(FIVE, FIVE, ROWS), emit


@intrinsic
def add_product(typingctx, total, u, v):
    """Five numbers ``total + u v``, one by one."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return builder.fadd(args[0], builder.fmul(args[1], args[2], flags=_CONTRACT), flags=_CONTRACT)

    return FIVE(FIVE, FIVE, FIVE), emit


@intrinsic
def lane_sums(typingctx, a, b, c, d, e):
    """Sums of the five numbers of each of five vectors."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        def fold(u: ir.Value, v: ir.Value, width: int) -> ir.Value:
            groups = range(0, LANES, 2 * width)
            low = [at + i for g in groups for at in (g, LANES + g) for i in range(width)]
            index = ir.VectorType(_INT, LANES)
            parts = (builder.shuffle_vector(u, v, ir.Constant(index, [k + shift for k in low])) for shift in (0, width))
            return builder.fadd(*parts)

        vectors = [*args, *[ir.Constant(_VECTOR, [0.0] * LANES)] * (LANES - N)]
        width = 1
        while width < LANES:
            vectors = [fold(u, v, width) for u, v in zip(vectors[::2], vectors[1::2])]
            width *= 2
        return vectors[0]

    return FIVE(FIVE, FIVE, FIVE, FIVE, FIVE), emit


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def block_product(blocks, at, z):
    """Five numbers: the block of five rows from an offset into the data of an array, times a vector."""
    nothing = zeros()
    return lane_sums(
        add_product(nothing, load(blocks, at), z),
        add_product(nothing, load(blocks, at + 5), z),
        add_product(nothing, load(blocks, at + 10), z),
        add_product(nothing, load(blocks, at + 15), z),
        add_product(nothing, load(blocks, at + 20), z),
    )


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def load_block(blocks, at):
    """Rows of a block from an offset into the data of an array."""
    return (
        load(blocks, at),
        load(blocks, at + 5),
        load(blocks, at + 10),
        load(blocks, at + 15),
        load(blocks, at + 20),
    )


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def load_half_block(blocks, at):
    """Rows of a block of halves from an offset into the data of an array."""
    return (
        load_halves(blocks, at),
        load_halves(blocks, at + 5),
        load_halves(blocks, at + 10),
        load_halves(blocks, at + 15),
        load_halves(blocks, at + 20),
    )


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def store_block(blocks, at, rows):
    """Write the rows of a block into the data of an array, starting at an offset."""
    store(blocks, at, rows[0])
    store(blocks, at + 5, rows[1])
    store(blocks, at + 10, rows[2])
    store(blocks, at + 15, rows[3])
    store(blocks, at + 20, rows[4])


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def store_half_block(blocks, at, rows):
    """Write the rows of a block of halves into the data of an array, starting at an offset."""
    store_halves(blocks, at, rows[0])
    store_halves(blocks, at + 5, rows[1])
    store_halves(blocks, at + 10, rows[2])
    store_halves(blocks, at + 15, rows[3])
    store_halves(blocks, at + 20, rows[4])


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def less_product(block, left, right):
    """Rows of a block minus the product of two others."""
    return (
        subtract_combined(block[0], left[0], right),
        subtract_combined(block[1], left[1], right),
        subtract_combined(block[2], left[2], right),
        subtract_combined(block[3], left[3], right),
        subtract_combined(block[4], left[4], right),
    )


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def product_of_blocks(left, right):
    """Rows of the product of two blocks."""
    return (
        combined(left[0], right),
        combined(left[1], right),
        combined(left[2], right),
        combined(left[3], right),
        combined(left[4], right),
    )
