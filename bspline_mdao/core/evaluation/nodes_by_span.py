"""The nodes of a volume sorted by span triple, with the basis functions that the kernels read.

The nodes that share their span triple depend on the same control points, their *sub-net*. It is read from its *anchor*,
in each direction its low end, or its high end where the span touches the high end of the parameter range (and, of a
single span, in its upper half). So the nodes of any face are evaluated from the control points of that face alone, to
the last bit. The number of the anchor among the control points of the volume tells span and end in all three
directions. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..splines.basis import basis
from ..splines.volume import Volume, sort_by_key
from .contraction import LANES, MARGIN


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
    """Add one direction to the numbers of the anchors; write the functions but for the anchor's, starting beside it."""
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
    """Sorted nodes that have copies, and the rows of these."""
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    nodes = place[copies[:, 1]]
    ascending = np.argsort(nodes, kind="stable")
    return nodes[ascending], copies[ascending, 0].astype(np.uint32)
