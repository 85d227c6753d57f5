"""Contraction of the sub-net of one span triple with the basis functions of nodes, and its transpose.

In one direction the ``p`` functions that differ from zero on a span sum to one. With the *anchor*, control point
0 of the sub-net, Eq. (3) in one direction reads

    sum_a N_a B_a  =  B_0 + sum_{a > 0} N_a (B_a - B_0),

and in three directions the same holds one direction after the other: the sub-net is replaced by its *differences*, the
factor of index 0 is one, and only ``p - 1`` functions per direction are stored and multiplied. This saves a quarter of
memory and arithmetic for cubics, and is exact where it matters: a coordinate that all control points share is
reproduced to the last bit, and a node at the anchor's end of the span depends on nothing beyond that end.

All intrinsics here are straight-line code for one triple of orders; the SIMD lanes are nodes, or the control
points of one line of the sub-net with their three components.

A *group* is up to `LANES` nodes. Its functions are stored without the first of each direction, those of direction 0,
then 1, then 2: function ``m`` of node ``i`` at ``m * n + i`` in a group of ``n`` nodes. A group may be read beyond its
last node. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.errors import RequireLiteralValue
from numba.core.typing import Signature
from numba.extending import intrinsic

from ...base.numerics import simd
from ...base.numerics.simd import INT, LANES, ZERO, Emitter, constant

SOURCE = zlib.crc32(b"".join(Path(file).read_bytes() for file in (__file__, simd.__file__)))
"""Checksum of the source that emits the code. numba looks only for changes of a kernel's own file before it takes it
from the cache, so a kernel that calls these intrinsics has this number in its closure, part of the cache's key."""

GROUPS_AHEAD = 8
"""Prefetch distance: far enough to hide the latency of memory, by measurement."""

TILE = 256
"""Most nodes that `sum_over_nodes` is given at a time: their functions and points fit in the first-level cache."""

MAX_SUMS = 3 * LANES
"""Sums in one pass of `sum_over_nodes` over the nodes, unless one line has more: they stay in registers."""

MARGIN = TILE + LANES * (GROUPS_AHEAD + 1)
"""Elements beyond their end that row numbers are read."""


@intrinsic(prefer_literal=True)
def load_net(
    typingctx,
    control_points,  # (N0 * N1 * N2 * 3,), control points of the volume
    corner,  # int, element of ``control_points`` at which the anchor starts
    # steps between control points of the sub-net in each direction, negative if the anchor is at the high end; the last
    # is 1 or -1
    steps,  # tuple of int
    net,  # (p_0 * p_1 * p_2 * 3,), receives the differences
    # orders, compile-time constants
    p_0,  # int
    p_1,  # int
    p_2,  # int
):
    """Copy the differences of a sub-net to ``net``."""
    orders = _literal_values(p_0, p_1, p_2)
    signature = types.void(control_points, corner, steps, net, p_0, p_1, p_2)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        control_points, corner, steps, net = _arguments(context, builder, signature, args)[:4]
        emit = Emitter(builder)
        lines = _SubNet(emit, control_points, corner, steps, orders)
        rows = [[_line_differences(emit, lines.load(a, b)) for b in range(orders[1])] for a in range(orders[0])]
        for plane in rows:
            plane[1:] = [emit.subtract(row, plane[0]) for row in plane[1:]]
        for plane in rows[1:]:
            plane[:] = [emit.subtract(row, first) for row, first in zip(plane, rows[0])]
        for number, row in enumerate(row for plane in rows for row in plane):
            emit.store(row, net, constant(number * 3 * orders[2]))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic(prefer_literal=True)
def add_net(typingctx, control_points, corner, steps, net, p_0, p_1, p_2):
    """Add ``net`` to the control points that its differences were taken from: the transpose of `load_net`."""
    orders = _literal_values(p_0, p_1, p_2)
    signature = types.void(control_points, corner, steps, net, p_0, p_1, p_2)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        control_points, corner, steps, net = _arguments(context, builder, signature, args)[:4]
        emit = Emitter(builder)
        width = 3 * orders[2]
        lines = _SubNet(emit, control_points, corner, steps, orders)
        load = lambda a, b: emit.load(net, constant((a * orders[1] + b) * width), width)  # noqa: E731
        rows = [[load(a, b) for b in range(orders[1])] for a in range(orders[0])]
        for b in range(orders[1]):
            for plane in rows[1:]:
                rows[0][b] = emit.subtract(rows[0][b], plane[b])
        for a, plane in enumerate(rows):
            for row in plane[1:]:
                plane[0] = emit.subtract(plane[0], row)
            for b, row in enumerate(plane):
                lines.add(a, b, _line_differences_transposed(emit, row))
        return context.get_dummy_value()

    return signature, codegen


class _SubNet:
    """The lines of a sub-net in the control points of its volume, the anchor's first."""

    def __init__(
        self,
        emit: Emitter,
        control_points: ir.Value,
        corner: ir.Value,
        steps: Sequence[ir.Value],
        orders: Sequence[int],
    ) -> None:
        builder = emit.builder
        self.emit, self.control_points, self.width = emit, control_points, 3 * orders[2]
        steps = [builder.extract_value(steps, d) for d in range(3)]
        self.strides = [builder.mul(constant(3), step) for step in steps[:2]]
        self.is_reversed = builder.icmp_signed("<", steps[2], constant(0))
        back = builder.select(self.is_reversed, constant(self.width - 3), constant(0))
        self.first = builder.sub(corner, back)

    def load(self, a: int, b: int) -> ir.Value:
        """Load line (a, b)."""
        return self._turn(self.emit.load(self.control_points, self._start(a, b), self.width))

    def add(self, a: int, b: int, row: ir.Value) -> None:
        """Add to line (a, b)."""
        start = self._start(a, b)
        old = self.emit.load(self.control_points, start, self.width)
        self.emit.store(self.emit.add(old, self._turn(row)), self.control_points, start)

    def _start(self, a: int, b: int) -> ir.Value:
        builder = self.emit.builder
        steps = [builder.mul(constant(m), stride) for m, stride in zip((a, b), self.strides)]
        return builder.add(self.first, builder.add(*steps))

    def _turn(self, row: ir.Value) -> ir.Value:
        """Put the anchor's end of a line first, or back."""
        turned = [c + d for c in range(self.width - 3, -1, -3) for d in range(3)]
        return self.emit.builder.select(self.is_reversed, self.emit.shuffle(row, row, turned), row)


def _line_differences(emit: Emitter, row: ir.Value) -> ir.Value:
    """Subtract the first control point of a line from the others."""
    width = row.type.count
    anchors = [width] * 3 + [i % 3 for i in range(width - 3)]
    return emit.subtract(row, emit.shuffle(row, ir.Constant(row.type, [0.0] * width), anchors))


def _line_differences_transposed(emit: Emitter, row: ir.Value) -> ir.Value:
    """Subtract the other control points of a line from the first."""
    width = row.type.count
    zero = ir.Constant(row.type, [0.0] * width)
    for c in range(3, width, 3):
        row = emit.subtract(row, emit.shuffle(row, zero, [c, c + 1, c + 2] + [width] * (width - 3)))
    return row


@intrinsic(prefer_literal=True)
def sum_over_net(
    typingctx,
    net,  # (p_0 * p_1 * p_2 * 3,), differences of the sub-net
    basis,  # functions of the group
    n,  # int, number of nodes in the group
    rows,  # ndarray of uint32, row of each node in ``out``, readable `MARGIN` elements beyond the group
    out,  # (3 * n_rows,), receives the points
    # orders, compile-time constants
    p_0,  # int
    p_1,  # int
    p_2,  # int
):
    """Points of a group of nodes from one sub-net, Eq. (3)."""
    orders = _literal_values(p_0, p_1, p_2)
    signature = types.void(net, basis, n, rows, out, p_0, p_1, p_2)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        net, basis, n, rows, out = _arguments(context, builder, signature, args)[:5]
        emit = Emitter(builder)
        functions = _emit_functions(emit, basis, n, rows, out, orders)
        _emit_scatter(emit, _emit_sum_over_net(emit, net, functions, orders), n, rows, out)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic(prefer_literal=True)
def sum_over_net_turned(
    typingctx,
    net,
    basis,
    turn,  # (72,), coefficients of 1, u, v, uv, w, uw, vw, uvw of the nine entries of a rotation
    fractions,  # ndarray of float32, u, v, w of the group, each for all its nodes in turn
    vectors,  # the three components of its vectors, stored in the same way
    n,
    rows,
    out,
    p_0,
    p_1,
    p_2,
):
    """As `sum_over_net`, with the turned vectors of the nodes added to their points."""
    # net, basis, n, rows, out, p_0, p_1, p_2: as for `sum_over_net`
    orders = _literal_values(p_0, p_1, p_2)
    signature = types.void(net, basis, turn, fractions, vectors, n, rows, out, p_0, p_1, p_2)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        net, basis, turn, fractions, vectors, n, rows, out = _arguments(context, builder, signature, args)[:8]
        emit = Emitter(builder)
        functions = _emit_functions(emit, basis, n, rows, out, orders)
        for m in range(3):
            emit.prefetch(vectors, constant((GROUPS_AHEAD * 3 + m) * LANES))
        emit.prefetch(fractions, constant(GROUPS_AHEAD * 3 * LANES))
        point = _emit_sum_over_net(emit, net, functions, orders)
        powers, vector = _emit_turn_terms(emit, fractions, vectors, n, constant(0), constant(0))
        for d in range(3):
            for k in range(3):
                first = 8 * (3 * d + k)
                entry = emit.add(emit.broadcast(turn, first), emit.multiply(powers[1], emit.broadcast(turn, first + 1)))
                for m in range(2, 8):
                    entry = emit.add(entry, emit.multiply(powers[m], emit.broadcast(turn, first + m)))
                point[d] = emit.add(point[d], emit.multiply(entry, vector[k]))
        _emit_scatter(emit, point, n, rows, out)
        return context.get_dummy_value()

    return signature, codegen


def _emit_functions(
    emit: Emitter, basis: ir.Value, n: ir.Value, rows: ir.Value, out: ir.Value, orders: Sequence[int]
) -> list[list]:
    """Emit the loads of the functions of a group, and prefetches for later groups."""
    n_functions = sum(orders) - 3
    for m in range(n_functions):
        emit.prefetch(basis, constant((GROUPS_AHEAD * n_functions + m) * LANES))
    for lane in range(LANES):
        emit.prefetch(out, _first_component(emit.builder, rows, constant(GROUPS_AHEAD * LANES + lane)))
    return _split([emit.load(basis, o) for o in _multiples(emit.builder, n, n_functions)], orders)


def _emit_turn_terms(
    emit: Emitter,
    fractions: ir.Value,
    vectors: ir.Value,
    stride: ir.Value,
    first_fraction: ir.Value,
    first_vector: ir.Value,
) -> tuple[list, list]:
    """Emit 1 (as None), u, v, uv, w, uw, vw, uvw of a group, and the components of its vectors."""
    builder, offsets = emit.builder, _multiples(emit.builder, stride, 3)
    u, v, w = (emit.load_singles(fractions, builder.add(first_fraction, offset)) for offset in offsets)
    vector = [emit.load(vectors, builder.add(first_vector, offset)) for offset in offsets]
    uv = emit.multiply(u, v)
    return [None, u, v, uv, w, emit.multiply(u, w), emit.multiply(v, w), emit.multiply(uv, w)], vector


def _emit_sum_over_net(emit: Emitter, net: ir.Value, functions: list[list], orders: Sequence[int]) -> list:
    """Emit the nested sums of Eq. (3) and return the three components."""
    total: Any = None
    for a in range(orders[0]):
        plane: Any = None
        for b in range(orders[1]):
            line: Any = None
            for c in range(orders[2]):
                first = 3 * ((a * orders[1] + b) * orders[2] + c)
                control_point = [emit.broadcast(net, first + d) for d in range(3)]
                line = emit.accumulate(line, functions[2][c], control_point)
            plane = emit.accumulate(plane, functions[1][b], line)
        total = emit.accumulate(total, functions[0][a], plane)
    return total


def _emit_scatter(emit: Emitter, point: Sequence[ir.Value], n: ir.Value, rows: ir.Value, out: ir.Value) -> None:
    """Emit the stores of the first ``n`` lanes to their rows."""
    builder = emit.builder
    done = builder.append_basic_block("done")
    for lane in range(LANES):
        first = _first_component(builder, rows, constant(lane))
        for d, vector in enumerate(point):
            builder.store(emit.lane(vector, lane), builder.gep(out, [builder.add(first, constant(d))]))
        if lane < LANES - 1:
            more = builder.append_basic_block("more")
            builder.cbranch(builder.icmp_signed(">", n, constant(lane + 1)), more, done)
            builder.position_at_end(more)
    builder.branch(done)
    builder.position_at_end(done)


@intrinsic
def gather_points(
    typingctx,
    bar,  # (3 * n_rows,), points
    rows,  # ndarray of uint32, row of each node in ``bar``, readable `MARGIN` elements beyond the last
    n,  # int, number of nodes
    # receives component ``d`` of node ``LANES * g + i`` at ``LANES * (3 * g + d) + i``
    points,  # (>= 3 * (n + LANES - 1),)
):
    """Copy rows of ``bar`` to ``points``, group by group, one vector per component and zero beyond the last node."""
    signature = types.void(bar, rows, n, points)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        bar, rows, n, points = _arguments(context, builder, signature, args)
        emit = Emitter(builder)
        with emit.loop(n, LANES) as (i, _):
            is_node = emit.is_lane_below(builder.sub(n, i))
            firsts = [_first_component(builder, rows, builder.add(i, constant(lane))) for lane in range(LANES)]
            for d in range(3):
                vector = emit.gather(bar, [builder.add(first, constant(d)) for first in firsts])
                emit.store(builder.select(is_node, vector, ZERO), points, _point(builder, i, d))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic(prefer_literal=True)
def sum_over_nodes(
    typingctx,
    net,  # (p_0 * p_1 * p_2 * 3 + LANES,), sums; the last `LANES` elements are scratch
    basis,
    n,
    points,
    rows,
    bar,
    p_0,
    p_1,
    p_2,
):
    """Add the products of the functions with the points of ``n`` nodes, summed over the nodes, to ``net``."""
    # The transpose of `sum_over_net`, for several groups at once, all of `LANES` nodes except the last.
    # basis, p_0, p_1, p_2: as for `sum_over_net`
    # n, points: as for `gather_points`
    # rows, bar: as for `gather_points`; rows of later nodes are prefetched
    orders = _literal_values(p_0, p_1, p_2)
    signature = types.void(net, basis, n, points, rows, bar, p_0, p_1, p_2)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        emit = Emitter(builder)
        net, *data = _arguments(context, builder, signature, args)[:6]
        nodes = _Nodes(emit, orders, *data)
        for number, lines in enumerate(nodes.passes):
            first = number * len(nodes.passes[0]) * 3 * orders[2]
            _emit_add_sums(emit, nodes.emit_line_sums(number, lines), net, first)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_turns(
    typingctx,
    sums,  # (72 + LANES,), sums; the last `LANES` elements are scratch
    fractions,
    vectors,
    n,
    points,
):
    """Add the derivatives in the coefficients of a rotation to ``sums``: the transpose of `sum_over_net_turned`."""
    # fractions, vectors: as for `sum_over_net_turned`, of several groups, all of `LANES` nodes except the last
    # n, points: as for `gather_points`
    signature = types.void(sums, fractions, vectors, n, points)

    def codegen(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]
    ) -> ir.Value:
        sums, fractions, vectors, n, points = _arguments(context, builder, signature, args)
        emit = Emitter(builder)
        for d in range(3):
            totals = [emit.variable() for _ in range(24)]
            for total in totals:
                builder.store(ZERO, total)
            with emit.loop(n, LANES) as (i, _):
                left = builder.sub(n, i)
                is_last = builder.icmp_signed("<", left, constant(LANES))
                stride = builder.select(is_last, left, constant(LANES))
                first = builder.mul(i, constant(3))
                powers, vector = _emit_turn_terms(emit, fractions, vectors, stride, first, first)
                point = emit.load(points, _point(builder, i, d))
                products = [emit.multiply(point, component) for component in vector]
                terms = [emit.multiply(power, product) for product in products for power in powers]
                for total, term in zip(totals, terms):
                    builder.store(emit.add(builder.load(total), term), total)
            _emit_add_sums(emit, totals, sums, 24 * d)
        return context.get_dummy_value()

    return signature, codegen


class _Nodes:
    """The nodes that `sum_over_nodes` sums over, group by group."""

    def __init__(
        self,
        emit: Emitter,
        orders: Sequence[int],
        basis: ir.Value,
        n: ir.Value,
        points: np.ndarray,
        rows: ir.Value,
        bar: np.ndarray,
    ) -> None:
        self.emit, self.builder = emit, emit.builder
        self.basis, self.n, self.points, self.rows, self.bar = basis, n, points, rows, bar
        self.orders, self.n_functions = orders, sum(orders) - 3
        self.functions = _split(list(range(self.n_functions)), orders)
        lines = [(a, b) for a in range(orders[0]) for b in range(orders[1])]
        per_pass = max(1, MAX_SUMS // (3 * orders[2]))
        self.passes = [lines[first : first + per_pass] for first in range(0, len(lines), per_pass)]

    def emit_line_sums(self, number: int, lines: Sequence[tuple[int, int]]) -> list:
        """Emit the sums over the nodes for some (a, b), all c and the three components."""
        builder, emit = self.builder, self.emit
        sums = [emit.variable() for _ in range(3 * self.orders[2] * len(lines))]
        for variable in sums:
            builder.store(ZERO, variable)
        with emit.loop(self.n, LANES) as (i, _):
            self._emit_prefetch(i, number)
            for variable, term in zip(sums, self._line_terms(i, lines)):
                builder.store(emit.add(builder.load(variable), term), variable)
        return sums

    def _line_terms(self, i: ir.Value, lines: Sequence[tuple[int, int]]) -> Iterator[ir.Value]:
        """Emit what one group adds to the sums."""
        emit, load = self.emit, self._functions_of_group(i)
        points = [emit.load(self.points, _point(self.builder, i, d)) for d in range(3)]
        for a, b in lines:
            weight = emit.multiply(load(0, a), load(1, b))
            weighted = [emit.multiply(weight, point) for point in points]
            for c in range(self.orders[2]):
                yield from (emit.multiply(load(2, c), w) for w in weighted)

    def _functions_of_group(self, i: ir.Value) -> Callable[[int, int], ir.Value | None]:
        """Return a function that loads function ``a`` of direction ``d`` (None for function 0, which is one)."""
        left = self.builder.sub(self.n, i)
        is_last = self.builder.icmp_signed("<", left, constant(LANES))
        stride = self.builder.select(is_last, left, constant(LANES))
        offsets = _multiples(self.builder, stride, self.n_functions)
        first = self.builder.mul(i, constant(self.n_functions))

        def load(d: int, a: int) -> ir.Value | None:
            m = self.functions[d][a]
            return None if m is None else self.emit.load(self.basis, self.builder.add(first, offsets[m]))

        return load

    def _emit_prefetch(self, i: ir.Value, number: int) -> None:
        """Emit prefetches for a later call, spread over the passes."""
        builder, n_passes = self.builder, len(self.passes)
        group = builder.add(i, builder.add(self.n, constant(GROUPS_AHEAD * LANES)))
        for m in range(number, self.n_functions, n_passes):
            offset = builder.mul(group, constant(self.n_functions))
            self.emit.prefetch(self.basis, builder.add(offset, constant(m * LANES)))
        for lane in range(number, LANES, n_passes):
            self.emit.prefetch(self.bar, _first_component(builder, self.rows, builder.add(group, constant(lane))))


def _point(builder: ir.IRBuilder, i: ir.Value, d: int) -> ir.Value:
    """Element of `gather_points`' result at which component ``d`` of the group of node ``i`` starts."""
    return builder.add(builder.mul(i, constant(3)), constant(d * LANES))


def _emit_add_sums(emit: Emitter, sums: Sequence[ir.Value], net: ir.Value, first: int) -> None:
    """Emit the sums over the lanes, added to ``net`` from element ``first`` on (zeros beyond the last sum)."""
    for block, vector in enumerate(emit.lane_sums([emit.builder.load(variable) for variable in sums])):
        offset = constant(first + block * LANES)
        emit.store(emit.add(emit.load(net, offset), vector), net, offset)


def _first_component(builder: ir.IRBuilder, rows: ir.Value, i: ir.Value) -> ir.Value:
    """Element of a flat array of points at which row ``rows[i]`` starts."""
    row = builder.load(builder.gep(rows, [i]))
    return builder.mul(builder.zext(row, INT), constant(3))


def _literal_values(*literals: Any) -> list[int]:
    """Values of compile-time constants; a NumPy integer in a closure is not one."""
    if not all(isinstance(literal, types.IntegerLiteral) for literal in literals):
        raise RequireLiteralValue(f"orders of types {literals}; they must be Python integers of the kernel's closure")
    return [literal.literal_value for literal in literals]


def _arguments(context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: Sequence[ir.Value]) -> list:
    """Data pointers of arrays, and scalars unchanged."""
    return [
        cgutils.create_struct_proxy(kind)(context, builder, value=value).data
        if isinstance(kind, types.Array)
        else value
        for kind, value in zip(signature.args, args)
    ]


def _multiples(builder: ir.IRBuilder, stride: ir.Value, count: int) -> list:
    """``0, stride, 2 stride, ...``."""
    return [builder.mul(constant(m), stride) for m in range(count)]


def _split(items: list, orders: Sequence[int]) -> list[list]:
    """Items of the functions 1 .. p-1 of each direction, None standing for function 0, which is one."""
    rest = iter(items)
    return [[None] + [next(rest) for _ in range(p - 1)] for p in orders]
