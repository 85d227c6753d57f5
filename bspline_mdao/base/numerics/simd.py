"""A small vocabulary to emit vector instructions, with nodes as SIMD lanes.

For the intrinsics of `bspline_mdao.core.evaluation.simd_contraction`. LLVM does not vectorize the contraction of a
sub-net: the loop over the nodes is not the innermost one, and unrolled by hand it has more pointers than its aliasing
checks allow. So the body is emitted with vectors of nodes as values. Multiplications and additions are marked as
contractible and become fused multiply-adds if the machine has them; the compiler decides nothing else about the
arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager

import llvmlite.binding
from llvmlite import ir
from numba.core import cgutils, config


def _is_wide() -> bool:
    """Whether the target processor has 512-bit registers."""
    chosen = config.CPU_FEATURES
    return "+avx512f" in chosen if chosen else bool(llvmlite.binding.get_host_cpu_features().get("avx512f"))


LANES = 8 if _is_wide() else 4
"""Nodes per vector: the width of a machine register, or of two narrow ones."""

INT = ir.IntType(64)
LANE = ir.DoubleType()
VECTOR = ir.VectorType(LANE, LANES)
ZERO = ir.Constant(VECTOR, [0.0] * LANES)

_SINGLES = ir.VectorType(ir.FloatType(), LANES)
_INDEX = ir.IntType(32)
_CONTRACT = ("contract",)


def constant(value: int) -> ir.Constant:
    """Integer constant with the width of an array index."""
    return ir.Constant(INT, value)


class Emitter:
    """Emits vector code at the position of an llvmlite builder."""

    def __init__(self, builder: ir.IRBuilder):
        self.builder = builder

    def load(self, base: ir.Value, offset: ir.Value, width: int = LANES) -> ir.Value:
        """Load the vector of ``width`` elements starting at element ``offset``, with any alignment."""
        return self.builder.load(self._vector_pointer(base, offset, width), align=8)

    def load_singles(self, base: ir.Value, offset: ir.Value) -> ir.Value:
        """Load `LANES` numbers of single precision, as doubles."""
        pointer = self.builder.bitcast(self.builder.gep(base, [offset]), _SINGLES.as_pointer())
        return self.builder.fpext(self.builder.load(pointer, align=4), VECTOR)

    def store(self, vector: ir.Value, base: ir.Value, offset: ir.Value) -> None:
        """Store a vector from element ``offset`` on."""
        self.builder.store(vector, self._vector_pointer(base, offset, vector.type.count), align=8)

    def broadcast(self, base: ir.Value, element: int) -> ir.Value:
        """Copy one element to all lanes."""
        scalar = self.builder.load(self.builder.gep(base, [constant(element)]))
        first = self.builder.insert_element(ir.Constant(VECTOR, ir.Undefined), scalar, ir.Constant(_INDEX, 0))
        return self.shuffle(first, first, [0] * LANES)

    def add(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """Lane by lane, ``a + b``."""
        return self.builder.fadd(a, b, flags=_CONTRACT)

    def subtract(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """Lane by lane, ``a - b``."""
        return self.builder.fsub(a, b)

    def lane(self, vector: ir.Value, lane: int) -> ir.Value:
        """One lane of a vector."""
        return self.builder.extract_element(vector, ir.Constant(_INDEX, lane))

    def gather(self, base: ir.Value, offsets: Iterable[ir.Value]) -> ir.Value:
        """Vector of the elements at the offsets."""
        vector = ir.Constant(VECTOR, ir.Undefined)
        for lane, offset in enumerate(offsets):
            element = self.builder.load(self.builder.gep(base, [offset]))
            vector = self.builder.insert_element(vector, element, ir.Constant(_INDEX, lane))
        return vector

    def is_lane_below(self, n: ir.Value) -> ir.Value:
        """Mask of the lanes ``< n``."""
        numbers = ir.VectorType(INT, LANES)
        first = self.builder.insert_element(ir.Constant(numbers, ir.Undefined), n, ir.Constant(_INDEX, 0))
        limit = self.shuffle(first, first, [0] * LANES)
        return self.builder.icmp_signed("<", ir.Constant(numbers, list(range(LANES))), limit)

    def prefetch(self, base: ir.Value, offset: ir.Value) -> None:
        """Prefetch the cache line of element ``offset``, which may lie beyond the end."""
        byte = ir.IntType(8).as_pointer()
        pointer = self.builder.bitcast(self.builder.gep(base, [offset]), byte)
        kind = ir.FunctionType(ir.VoidType(), [byte, _INDEX, _INDEX, _INDEX])
        function = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.prefetch.p0")
        self.builder.call(function, [pointer] + [ir.Constant(_INDEX, c) for c in (0, 3, 1)])

    def multiply(self, a: ir.Value | None, b: ir.Value | None) -> ir.Value | None:
        """Lane by lane, ``a b``; None stands for a factor of one."""
        if a is None or b is None:
            return b if a is None else a
        return self.builder.fmul(a, b, flags=_CONTRACT)

    def accumulate(self, total: Sequence[ir.Value] | None, factor: ir.Value | None, terms: Iterable[ir.Value]) -> list:
        """Per component, ``total + factor * term``; a ``total`` of None is zero and a ``factor`` of None is one."""
        products = [self.multiply(factor, term) for term in terms]
        return products if total is None else [self.add(t, product) for t, product in zip(total, products)]

    def lane_sums(self, vectors: list) -> list:
        """Sum every vector over its lanes; the sums are returned as the lanes of as few vectors as possible."""
        # Pairs are repeatedly folded into one vector of half sums: a third of the work of folding each separately.
        vectors = vectors + [ZERO] * (-len(vectors) % LANES)
        width = 1
        while width < LANES:
            vectors = [self._fold(u, v, width) for u, v in zip(vectors[::2], vectors[1::2])]
            width *= 2
        return vectors

    def loop(self, n: ir.Value, step: int) -> AbstractContextManager:
        """Context of a loop over ``range(0, n, step)``; gives the index."""
        return cgutils.for_range_slice(self.builder, constant(0), n, constant(step), INT)

    def variable(self) -> ir.Value:
        """Return a vector variable, which LLVM keeps in a register."""
        return cgutils.alloca_once(self.builder, VECTOR)

    def _fold(self, u: ir.Value, v: ir.Value, width: int) -> ir.Value:
        """Add neighbouring groups of ``width`` lanes: sums of ``u`` go to the even groups, sums of ``v`` to the odd."""
        groups = range(0, LANES, 2 * width)
        low = [at + i for g in groups for at in (g, LANES + g) for i in range(width)]
        return self.add(self.shuffle(u, v, low), self.shuffle(u, v, [i + width for i in low]))

    def shuffle(self, a: ir.Value, b: ir.Value, lanes: Sequence[int]) -> ir.Value:
        """Vector of the given lanes of ``a`` followed by ``b``."""
        return self.builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INDEX, len(lanes)), lanes))

    def _vector_pointer(self, base: ir.Value, offset: ir.Value, width: int) -> ir.Value:
        return self.builder.bitcast(self.builder.gep(base, [offset]), ir.VectorType(LANE, width).as_pointer())


def check_emission() -> None:
    """Emit a function with the instructions of `Emitter` and let LLVM verify it; raises if their API has changed."""
    module, number = ir.Module(), LANE.as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [number, ir.FloatType().as_pointer(), INT])
    function = ir.Function(module, kind, "trial")
    builder, (base, singles, n) = ir.IRBuilder(function.append_basic_block()), function.args
    emit = Emitter(builder)
    total = emit.variable()
    builder.store(ZERO, total)
    with emit.loop(n, LANES) as (i, _):
        emit.prefetch(base, i)
        term = emit.subtract(emit.load(base, i), emit.load_singles(singles, i))
        (vector,) = emit.accumulate([builder.load(total)], emit.broadcast(base, 0), [term])
        builder.store(builder.select(emit.is_lane_below(n), vector, emit.gather(base, [i] * LANES)), total)
    for vector in emit.lane_sums([builder.load(total)]):
        emit.store(vector, base, constant(0))
        builder.store(emit.lane(vector, 0), base)
    builder.ret_void()
    llvmlite.binding.parse_assembly(str(module)).verify()
