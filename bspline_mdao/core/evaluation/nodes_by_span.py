"""The nodes of a volume sorted by span triple, and the kernels over them: points, their transpose and the matrix.

The nodes that share their span triple depend on the same control points, their *sub-net*. It is read from its *anchor*:
in each direction its low end, or its high end if the span touches the high end of the parameter range (for a single
span, in its upper half). So the nodes of any face are evaluated from the control points of that face alone, to the last
bit. The number of the anchor among the control points of the volume determines span and end in all three directions.

The kernels take one span triple after the other. They are compiled once for each triple of orders and kept on disk by
numba. They hold no lock, so several threads can work on different spans.

Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse
from numba import njit

from ...base.numerics.rows import copy_row
from ..splines.basis import basis
from ..splines.volume import Volume, basis_products, sort_by_key, sub_net_ids
from .contraction import (
    LANES,
    MARGIN,
    SOURCE,
    TILE,
    add_net,
    gather_points,
    load_net,
    sum_over_net,
    sum_over_net_turned,
    sum_over_nodes,
    sum_turns,
)
from .plain_contraction import functions_of_node


@dataclass(frozen=True, eq=False)
class NodesBySpan:
    """The nodes of one volume, sorted by span triple."""

    # orders and numbers of control points
    orders: tuple[int, int, int]
    n_control: tuple[int, int, int]
    starts: np.ndarray  # int (n_spans + 1,), first node of each span triple that has nodes
    anchors: np.ndarray  # int (n_spans,), anchor of the sub-net of each
    basis: np.ndarray  # functions of the nodes, see `.simd_contraction`: ``p_0 + p_1 + p_2 - 3`` numbers per node
    rows: np.ndarray  # row of each node, and `MARGIN` zeros
    copy_nodes: np.ndarray  # int64 (n_copies,), nodes with copies, ascending
    copy_rows: np.ndarray  # (n_copies,)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return int(self.starts[-1])

    @property
    def arrays(self) -> tuple:
        """Arguments that the kernels share, from ``n_control`` to ``copy_rows``."""
        return self.n_control, self.starts, self.anchors, self.basis, self.rows, self.copy_nodes, self.copy_rows

    @property
    def n_bytes(self) -> int:
        """Size of the arrays in bytes."""
        return sum(array.nbytes for array in self.arrays[1:])

    def layers(self, first_span: int, last_span: int) -> tuple[int, int]:
        """Layers ``first <= i < last`` of control points in direction 0 that the nodes of the given spans touch."""
        anchor_layers = self.anchors[first_span:last_span] // (self.n_control[1] * self.n_control[2])
        is_high = anchor_layers == self.n_control[0] - 1
        low = anchor_layers - is_high * (self.orders[0] - 1)
        return int(low.min()), int(low.max()) + self.orders[0]


def sort_nodes(
    volume: Volume,  # orders and knots
    parameters: np.ndarray,  # (n, 3), parameters of the nodes
    rows: np.ndarray,  # int (n,), row of each node in the vector of all nodes
    copies: np.ndarray,  # int (n_copies, 2), row of each copy, and number of the node that it copies
) -> NodesBySpan:
    """Sort the nodes of a volume by span triple and evaluate their basis functions, Eq. (4)."""
    orders, n_control = volume.orders, volume.n_control
    anchors, values = _anchors_and_functions(volume, parameters)
    used, starts, order = sort_by_key(anchors, int(np.prod(n_control)))
    packed = np.zeros(values.size + LANES)
    store_groups(starts, order, values, packed)
    copy_nodes, copy_rows = _sort_copies(order, copies)
    sorted_rows = np.concatenate([rows[order], np.zeros(MARGIN, dtype=np.int64)]).astype(np.uint32)
    return NodesBySpan(orders, n_control, starts, used, packed, sorted_rows, copy_nodes, copy_rows)


def _anchors_and_functions(volume: Volume, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Anchor of each node, and its functions without the anchor's, shape (n, p_0 + p_1 + p_2 - 3)."""
    anchors = np.zeros(len(parameters), dtype=np.int64)
    values = np.empty((len(parameters), sum(volume.orders) - 3))
    column = 0
    for d, knots in enumerate(volume.knots):
        end = column + knots.order - 1
        spans, functions = basis(knots, *(parameters[:, (d + offset) % 3] for offset in range(3)))
        _choose_anchors(knots.n_control, parameters[:, d], spans, functions, anchors, values[:, column:end])
        column = end
    return anchors, values


@njit(cache=True, nogil=True, error_model="numpy")
def _choose_anchors(n_control, xi, spans, functions, anchors, out):
    """Add one direction to the numbers of the anchors; write the functions, without the anchor's, from next to it."""
    order = functions.shape[1]
    for q in range(xi.size):
        is_high = spans[q] == n_control - 1 and (spans[q] > order - 1 or xi[q] > 0.5)
        anchors[q] = anchors[q] * n_control + (spans[q] if is_high else spans[q] - order + 1)
        for m in range(order - 1):
            out[q, m] = functions[q, order - 2 - m if is_high else m + 1]


@njit(cache=True, nogil=True, error_model="numpy")
def store_groups(starts, order, values, basis):
    """Store numbers of nodes, shape (n, n_functions), span by span and group by group, see `.simd_contraction`."""
    n_functions = values.shape[1]
    for span in range(starts.size - 1):
        for first in range(starts[span], starts[span + 1], LANES):
            n = min(LANES, starts[span + 1] - first)
            for m in range(n_functions):
                for i in range(n):
                    basis[first * n_functions + m * n + i] = values[order[first + i], m]


def _sort_copies(order: np.ndarray, copies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sorted nodes that have copies, and the rows of the copies."""
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    nodes = place[copies[:, 1]]
    ascending = np.argsort(nodes, kind="stable")
    return nodes[ascending], copies[ascending, 0].astype(np.uint32)


@cache
def forward_kernel(p_0: int, p_1: int, p_2: int) -> Callable:
    """Kernel that evaluates nodes, Eq. (3), for one triple of orders."""
    # returns callable, ``forward(first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows,
    # control_points, out)`` writes the nodes of the spans ``first_span <= span < last_span``, and their copies, to
    # ``out``, shape (3 * n_rows,), from ``control_points``, shape (N0 * N1 * N2 * 3,)
    size = 3 * p_0 * p_1 * p_2
    n_functions = p_0 + p_1 + p_2 - 3
    emitter = SOURCE

    @njit(cache=True, nogil=True, error_model="numpy")
    def forward(
        first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows, control_points, out
    ):
        _ = emitter  # a cell of the closure, hence part of the cache's key
        net = np.empty(size)
        for span in range(first_span, last_span):
            steps = control_point_steps(n_control, anchors[span])
            load_net(control_points, 3 * anchors[span], steps, net, p_0, p_1, p_2)
            for first in range(starts[span], starts[span + 1], LANES):
                n = min(LANES, starts[span + 1] - first)
                sum_over_net(net, basis[first * n_functions :], n, rows[first:], out, p_0, p_1, p_2)
        copy_points(first_span, last_span, starts, rows, copy_nodes, copy_rows, out)

    return forward


@cache
def turned_forward_kernel(p_0: int, p_1: int, p_2: int) -> Callable:
    """Kernel that evaluates nodes and adds turned vectors to them, for one triple of orders."""
    # returns callable, as `forward_kernel`, with ``fractions, vectors`` of the nodes, ``corners`` of each span, shape
    # (n_spans, 8), and ``matrices`` of the corners, shape (n_corners, 9), after ``control_points``
    size = 3 * p_0 * p_1 * p_2
    n_functions = p_0 + p_1 + p_2 - 3
    emitter = SOURCE

    @njit(cache=True, nogil=True, error_model="numpy")
    def forward(
        first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows,
        control_points, fractions, vectors, corners, matrices, out,
    ):  # fmt: skip
        _ = emitter  # a cell of the closure, hence part of the cache's key
        net, turn = np.empty(size), np.empty(72)
        for span in range(first_span, last_span):
            steps = control_point_steps(n_control, anchors[span])
            load_net(control_points, 3 * anchors[span], steps, net, p_0, p_1, p_2)
            _set_coefficients(corners[span], matrices, turn)
            for first in range(starts[span], starts[span + 1], LANES):
                n = min(LANES, starts[span + 1] - first)
                sum_over_net_turned(
                    net, basis[first * n_functions :], turn, fractions[3 * first :], vectors[3 * first :],
                    n, rows[first:], out, p_0, p_1, p_2,
                )  # fmt: skip
        copy_points(first_span, last_span, starts, rows, copy_nodes, copy_rows, out)

    return forward


@cache
def reverse_kernel(p_0: int, p_1: int, p_2: int) -> Callable:
    """Kernel that is the transpose of `forward_kernel`."""
    # returns callable, ``reverse(first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows,
    # bar, first_layer, out)`` adds to ``out``, the control points from layer ``first_layer`` of direction 0 on, the
    # products of the spans with ``bar``, shape (3 * n_rows,)
    size = 3 * p_0 * p_1 * p_2
    n_functions = p_0 + p_1 + p_2 - 3
    emitter = SOURCE

    @njit(cache=True, nogil=True, error_model="numpy")
    def reverse(
        first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows, bar, first_layer, out
    ):
        _ = emitter  # a cell of the closure, hence part of the cache's key
        net, points = np.empty(size + LANES), np.empty(3 * TILE)
        first_control_point = first_layer * n_control[1] * n_control[2]
        copy = _first_copy(copy_nodes, starts[first_span])
        for span in range(first_span, last_span):
            net[:] = 0.0
            for tile in range(starts[span], starts[span + 1], TILE):
                n = min(TILE, starts[span + 1] - tile)
                gather_points(bar, rows[tile:], n, points)
                copy = _add_copies(bar, copy_nodes, copy_rows, copy, tile, n, points)
                sum_over_nodes(net, basis[tile * n_functions :], n, points, rows[tile:], bar, p_0, p_1, p_2)
            steps = control_point_steps(n_control, anchors[span])
            add_net(out, 3 * (anchors[span] - first_control_point), steps, net, p_0, p_1, p_2)

    return reverse


@cache
def turned_reverse_kernel(p_0: int, p_1: int, p_2: int) -> Callable:
    """Kernel that is the transpose of `turned_forward_kernel` in control points and matrices."""
    # returns callable, as `reverse_kernel`, with ``fractions, vectors, turns`` after ``bar``: it writes the
    # derivatives in the rotations at the corners of each span to ``turns``, shape (n_spans, 8, 9)
    size = 3 * p_0 * p_1 * p_2
    n_functions = p_0 + p_1 + p_2 - 3
    emitter = SOURCE

    @njit(cache=True, nogil=True, error_model="numpy")
    def reverse(
        first_span, last_span, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows,
        bar, fractions, vectors, turns, first_layer, out,
    ):  # fmt: skip
        _ = emitter  # a cell of the closure, hence part of the cache's key
        net, points, turn = np.empty(size + LANES), np.empty(3 * TILE), np.empty(72 + LANES)
        first_control_point = first_layer * n_control[1] * n_control[2]
        copy = _first_copy(copy_nodes, starts[first_span])
        for span in range(first_span, last_span):
            net[:] = 0.0
            turn[:] = 0.0
            for tile in range(starts[span], starts[span + 1], TILE):
                n = min(TILE, starts[span + 1] - tile)
                gather_points(bar, rows[tile:], n, points)
                copy = _add_copies(bar, copy_nodes, copy_rows, copy, tile, n, points)
                sum_turns(turn, fractions[3 * tile :], vectors[3 * tile :], n, points)
                sum_over_nodes(net, basis[tile * n_functions :], n, points, rows[tile:], bar, p_0, p_1, p_2)
            steps = control_point_steps(n_control, anchors[span])
            add_net(out, 3 * (anchors[span] - first_control_point), steps, net, p_0, p_1, p_2)
            _set_corner_bars(turn, turns[span])

    return reverse


@njit(cache=True, nogil=True, error_model="numpy")
def _set_coefficients(corners, matrices, turn):
    """Write the coefficients of 1, u, v, uv, w, uw, vw, uvw of every entry of a rotation from the corner values."""
    for e in range(9):
        for c in range(8):
            turn[8 * e + c] = matrices[corners[c], e]
        for bit in (1, 2, 4):
            for c in range(8):
                if c & bit:
                    turn[8 * e + c] -= turn[8 * e + c - bit]


@njit(cache=True, nogil=True, error_model="numpy")
def _set_corner_bars(turn, bars):
    """Transpose of `_set_coefficients`; it overwrites ``turn``."""
    for e in range(9):
        for bit in (4, 2, 1):
            for c in range(8):
                if c & bit:
                    turn[8 * e + c - bit] -= turn[8 * e + c]
        for c in range(8):
            bars[c, e] = turn[8 * e + c]


@njit(cache=True, nogil=True, error_model="numpy")
def copy_points(first_span, last_span, starts, rows, copy_nodes, copy_rows, out):
    """Copy the points of those nodes of some spans that have copies."""
    first_copy, last_copy = _first_copy(copy_nodes, starts[first_span]), _first_copy(copy_nodes, starts[last_span])
    for copy in range(first_copy, last_copy):
        row, source = 3 * np.int64(copy_rows[copy]), 3 * np.int64(rows[copy_nodes[copy]])
        for d in range(3):
            out[row + d] = out[source + d]


@njit(cache=True, nogil=True, error_model="numpy")
def _first_copy(copy_nodes, node):
    """Place of the first copy of a sorted node, or of the next node with copies, by bisection."""
    low, high = 0, copy_nodes.size
    while low < high:
        middle = (low + high) // 2
        if copy_nodes[middle] < node:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, error_model="numpy")
def control_point_steps(n_control, anchor):
    """Return the steps between control points of a sub-net in each direction, away from its anchor."""
    rest, k = divmod(anchor, n_control[2])
    i, j = divmod(rest, n_control[1])
    plane, line = n_control[1] * n_control[2], n_control[2]
    return (
        -plane if i == n_control[0] - 1 else plane,
        -line if j == n_control[1] - 1 else line,
        -1 if k == n_control[2] - 1 else 1,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _add_copies(bar, copy_nodes, copy_rows, copy, first, n, points):
    """Add the copies of the nodes ``first .. first + n - 1`` to their points; return the first copy after them."""
    while copy < copy_nodes.size and copy_nodes[copy] < first + n:
        group, lane = divmod(copy_nodes[copy] - first, LANES)
        for d in range(3):
            points[LANES * (3 * group + d) + lane] += bar[3 * np.int64(copy_rows[copy]) + d]
        copy += 1
    return copy


def assemble(
    nodes: Sequence[NodesBySpan],  # the nodes of each volume
    control_ids: Sequence[np.ndarray],  # each (N0 * N1 * N2,), number of each control point of each volume
    # shape of the matrix
    n_rows: int,
    n_control_points: int,
) -> scipy.sparse.csr_array:
    """Assemble the sparse matrix of an evaluation, from the stored functions that the other kernels use."""
    # returns (n_rows, n_control_points), canonical: entries of one control point are summed, and columns ascend
    counts = np.zeros(n_rows + 1, dtype=np.int64)
    for of_volume in nodes:
        counts[1 + of_volume.rows[: of_volume.n_nodes].astype(np.int64)] = counts[
            1 + of_volume.copy_rows.astype(np.int64)
        ] = np.prod(of_volume.orders)
    index_type = np.int32 if max(counts.sum(), n_control_points) < 2**31 else np.int64
    indptr = np.cumsum(counts).astype(index_type)
    indices, data = np.empty(indptr[-1], dtype=index_type), np.empty(indptr[-1])
    for of_volume, ids in zip(nodes, control_ids):
        _fill(of_volume.orders, *of_volume.arrays, ids, indptr, indices, data)
    matrix = scipy.sparse.csr_array((data, indices, indptr), shape=(n_rows, n_control_points))
    matrix.sum_duplicates()
    return matrix


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(orders, n_control, starts, anchors, basis, rows, copy_nodes, copy_rows, ids, indptr, indices, data):
    """Write the entries of the nodes of one volume, then of their copies."""
    n_entries, n_functions = orders[0] * orders[1] * orders[2], orders[0] + orders[1] + orders[2] - 3
    values, sub_net = np.empty(orders[0] + orders[1] + orders[2]), np.empty(n_entries, dtype=np.int64)
    for span in range(anchors.size):
        sub_net_ids(orders, anchors[span], control_point_steps(n_control, anchors[span]), sub_net)
        for node in range(starts[span], starts[span + 1]):
            group, lane = node - (node - starts[span]) % LANES, (node - starts[span]) % LANES
            functions_of_node(orders, basis[group * n_functions :], min(LANES, starts[span + 1] - group), lane, values)
            subtract_from_anchors(orders, values)
            first = indptr[rows[node]]
            basis_products(orders, values, data[first : first + n_entries])
            for m in range(n_entries):
                indices[first + m] = ids[sub_net[m]]
    for copy in range(copy_nodes.size):
        target, source = indptr[copy_rows[copy]], indptr[rows[copy_nodes[copy]]]
        copy_row(indices[source : source + n_entries], indices[target : target + n_entries])
        copy_row(data[source : source + n_entries], data[target : target + n_entries])


@njit(cache=True, nogil=True, error_model="numpy")
def subtract_from_anchors(orders, values):
    """Replace the first function of each direction, stored as one, by its value: one minus the others."""
    first = 0
    for d in range(3):
        for m in range(first + 1, first + orders[d]):
            values[first] -= values[m]
        first += orders[d]
