"""Several numbers in one register, as a value in kernels: formulas written for one number work on all of them.

On some processors LLVM vectorizes loops with only half a register; it checks before every loop whether its rows
overlap, and gives up if there are many. A value of type `Lanes` is a whole register: sums, differences and products
with one another and with numbers, inverse square roots, and loads and stores from any place of a flat array.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.extending import intrinsic, models, overload, register_model

from .simd import LANE, LANES, VECTOR, Emitter, constant

__all__ = [
    "LANES",
    "add_points",
    "aligned_zeros",
    "any_below",
    "below",
    "exponential",
    "inverse_root",
    "least_of",
    "load",
    "load_bits",
    "load_points",
    "positive",
    "scaled",
    "smaller",
    "spread",
    "store",
    "sum_of",
    "with_bits",
    "within",
]

_INDEX, _BYTE, _BITS = ir.IntType(32), ir.IntType(8), ir.IntType(64)
_BYTES = ir.VectorType(_BYTE, LANES)
_CONTRACT = ("contract",)
_MAGIC = 0x5FE6EB50C7B537A9
_SHIFT = 1.5 * 2.0**52
_LOG2_E, _LN2_HIGH, _LN2_LOW = (
    1.0 / math.log(2.0),
    float.fromhex("0x1.62e42fefa38p-1"),
    float.fromhex("0x1.ef35793c7673p-45"),
)
_N_TERMS = 14


class _Lanes(types.Type):
    """Type of `LANES` numbers in a register."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


_LANES = _Lanes()


class _LaneBits(types.Type):
    """Type of one byte for each lane."""

    def __init__(self) -> None:
        super().__init__(name=f"LaneBits{LANES}")


_LANE_BITS = _LaneBits()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(_LaneBits)
class _LaneBitsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BYTES)


def _constant(kind: ir.Type, value: Any) -> ir.Constant:
    """Copies of a constant in all lanes."""
    return ir.Constant(ir.VectorType(kind, LANES), [value] * LANES)


def _as_vector(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    """Copies of a number in all lanes; lanes unchanged."""
    if value.type == VECTOR:
        return value
    empty = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, empty, _constant(_INDEX, 0))


def _binary(emit_one: Callable[[ir.IRBuilder, ir.Value, ir.Value], ir.Value]) -> Any:
    """Intrinsic of two operands, at least one of which is lanes."""

    @intrinsic
    def apply(typing_context, a, b):
        def emit(
            context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
        ) -> ir.Value:
            return emit_one(builder, *(_as_vector(builder, value) for value in args))

        return _LANES(*(kind if kind == _LANES else types.float64 for kind in (a, b))), emit

    return apply


def _define(function: Callable, emit_one: Callable) -> None:
    """Define an operator of lanes."""
    apply = _binary(emit_one)

    @overload(function, inline="always")
    def overloaded(a, b):
        if _LANES in (a, b) and all(kind == _LANES or isinstance(kind, types.Number) for kind in (a, b)):
            return lambda a, b: apply(a, b)
        return None


_define(operator.add, lambda builder, a, b: builder.fadd(a, b, flags=_CONTRACT))
_define(operator.sub, lambda builder, a, b: builder.fsub(a, b, flags=_CONTRACT))
_define(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_CONTRACT))

smaller = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))


@intrinsic
def spread(typing_context, number):
    """A number in all lanes."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return _as_vector(builder, args[0])

    return _LANES(types.float64), emit


@intrinsic
def within(typing_context, n, lanes, other):
    """The first ``n`` lanes; another number in the rest."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        return builder.select(Emitter(builder).is_lane_below(args[0]), args[1], _as_vector(builder, args[2]))

    return _LANES(types.int64, _LANES, types.float64), emit


@intrinsic
def positive(typing_context, lanes):
    """One in positive lanes; zero in others, and in NaN lanes."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        is_positive = builder.fcmp_ordered(">", args[0], _constant(LANE, 0.0))
        return builder.select(is_positive, _constant(LANE, 1.0), _constant(LANE, 0.0))

    return _LANES(_LANES), emit


@njit(cache=True, nogil=True)
def aligned_zeros(n):
    """Zeros aligned to registers: a register across two cache lines takes longer."""
    zeros = np.zeros(n + LANES)
    first = -(zeros.ctypes.data // zeros.itemsize) % LANES
    return zeros[first : first + n]


@intrinsic
def below(typing_context, limit, lanes, value):
    """A value where lanes are below a limit, or NaN; zero elsewhere."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        is_below = builder.fcmp_unordered("<", args[1], _as_vector(builder, args[0]))
        return builder.select(is_below, args[2], _constant(LANE, 0.0))

    return _LANES(types.float64, _LANES, _LANES), emit


@intrinsic
def any_below(typing_context, limit, lanes):
    """Whether any of the lanes is below a limit, or NaN."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        is_below = builder.fcmp_unordered("<", args[1], _as_vector(builder, args[0]))
        bits = builder.bitcast(is_below, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(types.float64, _LANES), emit


@intrinsic
def scaled(typing_context, lanes, factors, other):
    """Product with factors; another number where a factor is zero."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        is_zero = builder.fcmp_ordered("==", args[1], _constant(LANE, 0.0))
        return builder.select(is_zero, _as_vector(builder, args[2]), builder.fmul(args[0], args[1]))

    return _LANES(_LANES, _LANES, types.float64), emit


@intrinsic
def load(typing_context, array, offset, n):
    """Lanes from an offset into a flat array; zeros beyond the first ``n`` of them."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _address(context, builder, signature, args, VECTOR)
        return _load(builder, at, Emitter(builder).is_lane_below(args[2]), VECTOR)

    return _LANES(array, types.int64, types.int64), emit


@intrinsic
def store(typing_context, array, offset, n, lanes):
    """Write the first ``n`` lanes into a flat array, starting at an offset."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _address(context, builder, signature, args, VECTOR)
        _store(builder, args[3], at, Emitter(builder).is_lane_below(args[2]))
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, _LANES), emit


@intrinsic
def load_bits(typing_context, array, offset, n):
    """Bytes from an offset into a flat array, one for each lane; zeros beyond the first ``n`` of them."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        at = _address(context, builder, signature, args, _BYTES)
        return _load(builder, at, Emitter(builder).is_lane_below(args[2]), _BYTES)

    return _LANE_BITS(array, types.int64, types.int64), emit


@intrinsic
def with_bits(typing_context, bits, bit, lanes, other):
    """Lanes, or another number where a bit of their byte is set."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        first = builder.insert_element(ir.Constant(_BYTES, ir.Undefined), args[1], ir.Constant(_INDEX, 0))
        wanted = builder.shuffle_vector(first, first, _constant(_INDEX, 0))
        is_set = builder.icmp_unsigned("!=", builder.and_(args[0], wanted), _constant(_BYTE, 0))
        return builder.select(is_set, _as_vector(builder, args[3]), args[2])

    return _LANES(_LANE_BITS, types.uint8, _LANES, types.float64), emit


def _address(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value], kind: ir.Type
) -> ir.Value:
    """Pointer to a vector in the data of an array (first argument) at an offset (second argument)."""
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), kind.as_pointer())


@intrinsic
def load_points(typing_context, points, offset, n):
    """Three lanes, x, y and z, of an array of points from an offset on; zeros beyond ``n`` points."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        parts = [_load(builder, at, mask, VECTOR) for at, mask in _pieces_of_points(context, builder, signature, args)]
        return context.make_tuple(
            builder, signature.return_type, [_merged(builder, parts, _OF_POINTS[d]) for d in range(3)]
        )

    return types.UniTuple(_LANES, 3)(points, types.int64, types.int64), emit


@intrinsic
def add_points(typing_context, points, offset, n, vectors):
    """Add vectors, lanes of x, y and z, to ``n`` points of an array from an offset on."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        components = cgutils.unpack_tuple(builder, args[3], 3)
        for piece, (at, mask) in enumerate(_pieces_of_points(context, builder, signature, args)):
            now = _load(builder, at, mask, VECTOR)
            change = _merged(builder, components, _OF_PIECES[piece])
            _store(builder, builder.fadd(now, change), at, mask)
        return context.get_dummy_value()

    return types.void(points, types.int64, types.int64, types.UniTuple(_LANES, 3)), emit


_OF_POINTS = [[divmod(3 * lane + d, LANES) for lane in range(LANES)] for d in range(3)]
"""Location of each component of each point: which of three pieces read from memory, and which lane."""
_OF_PIECES = [
    [((LANES * piece + lane) % 3, (LANES * piece + lane) // 3) for lane in range(LANES)] for piece in range(3)
]
"""Component and point of each lane of each piece."""


def _pieces_of_points(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
) -> Iterator[tuple[ir.Value, ir.Value]]:
    """Pointers to three vectors filled by some points, and masks of their existing lanes."""
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    first = builder.bitcast(builder.gep(data, [args[1]]), LANE.as_pointer())
    n_numbers = builder.mul(args[2], constant(3))
    for piece in range(3):
        at = builder.gep(first, [constant(LANES * piece)])
        mask = Emitter(builder).is_lane_below(builder.sub(n_numbers, constant(LANES * piece)))
        yield builder.bitcast(at, VECTOR.as_pointer()), mask


def _load(builder: ir.IRBuilder, at: ir.Value, mask: ir.Value, vector: ir.Type) -> ir.Value:
    """Load the masked lanes of a vector; zeros elsewhere."""
    kind = ir.FunctionType(vector, [at.type, _INDEX, mask.type, vector])
    name = f"llvm.masked.load.v{LANES}{'f64' if vector == VECTOR else 'i8'}.p0"
    size = ir.Constant(_INDEX, 8 if vector == VECTOR else 1)
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    return builder.call(function, [at, size, mask, _constant(vector.element, 0)])


def _store(builder: ir.IRBuilder, vector: ir.Value, at: ir.Value, mask: ir.Value) -> None:
    """Store the masked lanes of a vector."""
    kind = ir.FunctionType(ir.VoidType(), [VECTOR, at.type, _INDEX, mask.type])
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.store.v{LANES}f64.p0")
    builder.call(function, [vector, at, ir.Constant(_INDEX, 8), mask])


def _merged(builder: ir.IRBuilder, vectors: Sequence[ir.Value], sources: Sequence[tuple[int, int]]) -> ir.Value:
    """Vector of lanes of three others, each given by the number of the vector and the lane in it."""
    kind = ir.VectorType(_INDEX, LANES)
    first = [LANES * v + lane if v < 2 else 0 for v, lane in sources]
    two = builder.shuffle_vector(vectors[0], vectors[1], ir.Constant(kind, first))
    last = [LANES + lane if v == 2 else k for k, (v, lane) in enumerate(sources)]
    return builder.shuffle_vector(two, vectors[2], ir.Constant(kind, last))


@njit(cache=True, nogil=True, error_model="numpy")
def sum_of(lanes):
    """Sum of all lanes."""
    numbers, total = np.empty(LANES), 0.0
    store(numbers, 0, LANES, lanes)
    for number in numbers:
        total += number
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def least_of(lanes):
    """Smallest of all lanes."""
    numbers, least = np.empty(LANES), np.inf
    store(numbers, 0, LANES, lanes)
    for number in numbers:
        least = min(least, number)
    return least


@intrinsic
def _guess(typing_context, x):
    """Estimate the inverse square root of a number, or of lanes, by halving the exponent."""
    is_one = x != _LANES
    bits = _BITS if is_one else ir.VectorType(_BITS, LANES)

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        constant = (lambda value: ir.Constant(_BITS, value)) if is_one else (lambda value: _constant(_BITS, value))
        half = builder.lshr(builder.bitcast(args[0], bits), constant(1))
        return builder.bitcast(builder.sub(constant(_MAGIC), half), args[0].type)

    kind = types.float64 if is_one else _LANES
    return kind(kind), emit


@intrinsic
def _off(typing_context, x, y):
    """``1 - x y^2`` as if rounded once: products with their errors."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        x, y = args
        one = ir.Constant(LANE, 1.0) if x.type == LANE else _constant(LANE, 1.0)
        product = builder.fmul(x, y)
        kind, name = x.type, "f64" if x.type == LANE else f"v{LANES}f64"
        fma = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, 3 * [kind]), f"llvm.fma.{name}")
        error = builder.call(fma, [x, y, builder.fneg(product)])
        return builder.fsub(builder.call(fma, [builder.fneg(product), y, one]), builder.fmul(error, y))

    return x(x, x), emit


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def inverse_root(x):
    """``1 / sqrt(x)`` of a positive normal number, or of lanes, rounded once but for one in some thousand numbers."""
    # A vector of roots and one of quotients take a processor as long as forty products. An estimate from the bits is
    # off by 3.5 %; two steps of Householder's method of fourth order leave only rounding: A. S. Householder, *The
    # Numerical Treatment of a Single Nonlinear Equation*, McGraw-Hill, 1970.
    y = _guess(x)
    off = 1.0 - x * y * y
    y = y + y * (off * (0.5 + off * (0.375 + off * 0.3125)))
    off = _off(x, y)
    return y + y * (off * (0.5 + off * (0.375 + off * 0.3125)))


@intrinsic
def _times_power_of_two(typing_context, lanes, shifted):
    """Lanes times powers of two with integer exponents, given as lanes with `_SHIFT` added."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        bits = ir.VectorType(_BITS, LANES)
        exponents = builder.shl(builder.bitcast(args[1], bits), _constant(_BITS, 52))
        return builder.bitcast(builder.add(builder.bitcast(args[0], bits), exponents), VECTOR)

    return _LANES(_LANES, _LANES), emit


@intrinsic
def _series(typing_context, x):
    """Taylor series of the exponential of lanes, by Horner's scheme."""

    def emit(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> ir.Value:
        total = _constant(LANE, 1.0 / math.factorial(_N_TERMS - 1))
        for n in range(_N_TERMS - 2, -1, -1):
            product = builder.fmul(total, args[0], flags=_CONTRACT)
            total = builder.fadd(product, _constant(LANE, 1.0 / math.factorial(n)), flags=_CONTRACT)
        return total

    return _LANES(_LANES), emit


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def exponential(x):
    """``exp(x)`` of lanes between -700 and 700, to an error of one unit in the last place."""
    # With k the nearest integer to x / ln 2, obtained by adding `_SHIFT`, exp(x) = 2^k exp(x - k ln 2). The difference
    # is below 0.35, so 13 terms of its Taylor series leave 4e-18. The logarithm is split in two parts, the first with
    # so few digits that its product with k is exact.
    shifted = x * _LOG2_E + _SHIFT
    k = shifted - _SHIFT
    r = x - k * _LN2_HIGH - k * _LN2_LOW
    return _times_power_of_two(_series(r), shifted)
