"""All nodes of a grid from the control points of a B-spline mesh, Eq. (3), without a matrix.

`Evaluator` is the linear map ``x = A b`` at fixed parameters, and its transpose. Per node it stores the functions of
its span triple and its place in the result. Shared nodes are evaluated once and copied, so all blocks get the same
bits. The work is cut into chunks that do not depend on the number of threads. In reverse each chunk sums into its own
control points, which are then added up in the order of the chunks. So results do not depend on the number of threads.
Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from numba import njit
from numpy.typing import ArrayLike

from ...base.display import OneLine
from ...base.numerics.threads import run_tasks, thread_count
from ...errors import InputError
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.topology import Topology
from ..splines.mesh import BSplineMesh
from .nodes_by_span import (
    NodesBySpan,
    assemble,
    forward_kernel,
    reverse_kernel,
    sort_nodes,
    turned_forward_kernel,
    turned_reverse_kernel,
)

CHUNK_NODES = 2**15
"""Least number of nodes per chunk: about 0.2 ms of work, against about 10 us to start it."""

MAX_CHUNKS = 64
"""Most chunks of a grid beyond one per volume: bounds the memory that the transpose needs."""


@dataclass(frozen=True)
class _Chunk:
    """Spans ``first_span <= span < last_span`` of a volume, and the layers of control points that they touch."""

    volume: int
    first_span: int
    last_span: int
    layers: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Evaluator(OneLine):
    """The linear map from control points to nodes at fixed parameters. Made by `Evaluator.build`.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.core.splines.knots import ConstantKnots
    >>> from bspline_mdao.core.splines.volume import Volume
    >>> curve = Volume.of(ConstantKnots.uniform(n_control=3, order=3))
    >>> mesh = BSplineMesh((curve,), (np.arange(3).reshape(3, 1, 1),), 3)
    >>> evaluator = Evaluator.build(mesh, [np.array([[0.0, 0, 0], [0.5, 0, 0]])], [np.arange(2)], n_rows=2)
    >>> evaluator.forward(np.array([[0.0, 0, 0], [1, 2, 0], [2, 0, 0]]))
    array([[0., 0., 0.],
           [1., 1., 0.]])
    """

    control_ids: tuple[np.ndarray, ...]  # number of each control point of each volume
    nodes: tuple[NodesBySpan, ...]  # the nodes of each volume
    chunks: tuple[_Chunk, ...]  # the pieces of work
    # length of the two sides
    n_control_points: int
    n_rows: int
    is_complete: bool  # whether every row belongs to a node; other rows are zero
    n_threads: int | None = None  # number of threads; None stands for ``NUMBA_NUM_THREADS``

    @classmethod
    def build(
        cls,
        mesh: BSplineMesh,  # volumes and control point ids
        parameters: Sequence[np.ndarray],  # each (n_v, 3), parameters of the nodes that each volume evaluates
        rows: Sequence[np.ndarray],  # int each (n_v,), row of each of these nodes in the result
        n_rows: int,  # rows of the result
        copies: np.ndarray | None = None,  # int (n_copies, 2), rows that are copies, and the rows that they copy
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
    ) -> Evaluator:
        """Sort the nodes and evaluate their basis functions."""
        # `InputError` if the arrays do not fit together, a row is given twice, or a parameter is not finite
        n_threads_now = thread_count(n_threads)
        parameters = [np.asarray(p, dtype=float) for p in parameters]
        rows = [np.asarray(r, dtype=np.int64) for r in rows]
        copies = np.empty((0, 2), dtype=np.int64) if copies is None else np.asarray(copies, dtype=np.int64)
        is_complete = _check_rows(mesh, parameters, rows, n_rows, copies)
        copies_of = _copies_by_volume(rows, n_rows, copies)
        given = list(zip(mesh.volumes, parameters, rows, copies_of))
        nodes = run_tasks(lambda volume: sort_nodes(*volume), given, n_threads_now)
        ids = tuple(np.asarray(ids).reshape(-1) for ids in mesh.control_ids)
        return cls(ids, tuple(nodes), _cut(nodes), mesh.n_control_points, n_rows, is_complete, n_threads)

    @classmethod
    def of_grid(
        cls,
        topology: Topology,  # topology of the grid
        mesh: BSplineMesh,  # one volume per segment
        parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
    ) -> Evaluator:
        """Operator to the nodes of a grid; shared nodes are evaluated once and copied."""
        numbering = NodeNumbering.of_grid(topology)
        local = [x.reshape(-1, 3)[places] for x, places in zip(parameters, numbering.places)]
        return cls.of_nodes(numbering, mesh, local, n_threads)

    @classmethod
    def of_nodes(
        cls,
        numbering: NodeNumbering,
        mesh: BSplineMesh,  # one volume per segment
        # parameters of the nodes that each segment evaluates, ``held.numbers``
        parameters: Sequence[np.ndarray],  # each (n_v, 3)
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
    ) -> Evaluator:
        """Operator to some nodes of a grid, with the same bits as in the whole grid."""
        return cls.build(mesh, parameters, numbering.numbers, numbering.n_nodes, numbering.copies, n_threads)

    def with_threads(self, n_threads: int | None) -> Evaluator:
        """Return the same map on another number of threads."""
        return replace(self, n_threads=n_threads)

    @property
    def bytes_per_node(self) -> float:
        """Size of all that is stored, in bytes per row of the result."""
        n_bytes = sum(r.n_bytes for r in self.nodes) + sum(ids.nbytes for ids in self.control_ids)
        return n_bytes / max(self.n_rows, 1)

    def forward(
        self,
        control_points: np.ndarray,  # (n_control_points, 3); complex ones are evaluated part by part
        out: np.ndarray | None = None,  # (n_rows, 3), C order, where to write the result
        # of every volume, the arguments of `turned_forward_kernel`: vectors to be turned and added
        turned: Sequence[tuple] | None = None,
    ) -> np.ndarray:  # (n_rows, 3)
        """Nodes from control points, ``A b``."""
        control_points = _checked(control_points, self.n_control_points, "control points")
        if np.iscomplexobj(control_points):
            return self.forward(control_points.real) + 1j * self.forward(control_points.imag)
        if out is None:
            out = (np.empty if self.is_complete else np.zeros)((self.n_rows, 3))
        elif out.shape != (self.n_rows, 3) or out.dtype != float or not out.flags.c_contiguous:
            raise InputError(f"evaluation: cannot write to `out` of shape {out.shape}; give a float array in C order")
        nets = [control_points[ids].reshape(-1) for ids in self.control_ids]
        flat = out.reshape(-1)

        def evaluate(chunk: _Chunk) -> None:
            nodes, net = self.nodes[chunk.volume], nets[chunk.volume]
            if turned is None:
                forward_kernel(*nodes.orders)(chunk.first_span, chunk.last_span, *nodes.arrays, net, flat)
            else:
                arguments = *nodes.arrays, net, *turned[chunk.volume], flat
                turned_forward_kernel(*nodes.orders)(chunk.first_span, chunk.last_span, *arguments)

        run_tasks(evaluate, self.chunks, thread_count(self.n_threads))
        return out

    def adjoint(
        self,
        bar: np.ndarray,  # (n_rows, 3), one row per node; complex ones are treated part by part
        # of every volume, the arguments of `turned_reverse_kernel`: turned vectors, and where the derivatives go
        turned: Sequence[tuple] | None = None,
    ) -> np.ndarray:  # (n_control_points, 3)
        """Transposed product, ``A^T bar``. `InputError` if the array has the wrong shape."""
        bar = _checked(bar, self.n_rows, "nodes")
        if np.iscomplexobj(bar):
            return self.adjoint(bar.real) + 1j * self.adjoint(bar.imag)
        flat = bar.reshape(-1)

        def accumulate(chunk: _Chunk) -> np.ndarray:
            nodes = self.nodes[chunk.volume]
            layer_size = nodes.n_control[1] * nodes.n_control[2]
            first, last = chunk.layers
            products = np.zeros(3 * (last - first) * layer_size)
            if turned is None:
                reverse_kernel(*nodes.orders)(chunk.first_span, chunk.last_span, *nodes.arrays, flat, first, products)
            else:
                arguments = *nodes.arrays, flat, *turned[chunk.volume], first, products
                turned_reverse_kernel(*nodes.orders)(chunk.first_span, chunk.last_span, *arguments)
            return products

        sums = run_tasks(accumulate, self.chunks, thread_count(self.n_threads))
        out = np.zeros((self.n_control_points, 3))
        for chunk, chunk_sums in zip(self.chunks, sums):
            n_control = self.nodes[chunk.volume].n_control
            first = chunk.layers[0] * n_control[1] * n_control[2]
            _add_at(out, self.control_ids[chunk.volume][first:], chunk_sums.reshape(-1, 3))
        return out

    def matrix(self) -> scipy.sparse.csr_array:
        """Assemble ``A``, shape (n_rows, n_control_points): ten times slower, for uses that need its entries."""
        return assemble(self.nodes, self.control_ids, self.n_rows, self.n_control_points)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_at(out, ids, terms):
    for m in range(terms.shape[0]):
        for d in range(3):
            out[ids[m], d] += terms[m, d]


def _check_rows(
    mesh: BSplineMesh,
    parameters: Sequence[np.ndarray],
    rows: Sequence[np.ndarray],
    n_rows: int,
    copies: np.ndarray,
) -> bool:
    """Check the arguments of `Evaluator.build`; return whether every row belongs to a node."""
    if not len(mesh.volumes) == len(parameters) == len(rows):
        raise InputError(
            f"evaluation: {len(mesh.volumes)} volumes, parameters for {len(parameters)} and rows for {len(rows)}; "
            f"give one array of each per volume"
        )
    for v, (p, r) in enumerate(zip(parameters, rows), start=1):
        if p.shape != (r.size, 3) or r.ndim != 1:
            raise InputError(
                f"evaluation: volume {v} has parameters of shape {p.shape} and rows of shape {r.shape}; "
                f"give shapes (n, 3) and (n,)"
            )
        if not np.isfinite(p).all():
            q = int(np.argmin(np.isfinite(p).all(axis=1)))
            raise InputError(f"evaluation: parameters of point {q + 1} of volume {v} are not finite; give numbers")
    if copies.ndim != 2 or copies.shape[1] != 2:
        raise InputError(f"evaluation: copies of shape {copies.shape}; give shape (n, 2)")
    return _check_destinations(np.concatenate([*rows, copies[:, 0]]), n_rows)


def _check_destinations(destinations: np.ndarray, n_rows: int) -> bool:
    """Check that every row is written once at most; return whether every row is written."""
    if n_rows >= 2**32:
        raise InputError(f"evaluation: {n_rows} rows; split the grid into pieces of fewer than {2**32}")
    if destinations.size and not 0 <= destinations.min() <= destinations.max() < n_rows:
        raise InputError(f"evaluation: a row lies outside 0 .. {n_rows - 1}; number the rows from 0")
    count = np.bincount(destinations, minlength=n_rows)
    if n_rows and count.max() > 1:
        raise InputError(f"evaluation: row {int(count.argmax()) + 1} is given twice; evaluate each row once")
    return bool(count.all())


def _copies_by_volume(rows: Sequence[np.ndarray], n_rows: int, copies: np.ndarray) -> list[np.ndarray]:
    """Per volume, the row of each copy and the number of the node that it copies, shape (n, 2)."""
    layout = BlockLayout.of(map(np.shape, rows))
    node_of_row = np.full(n_rows, -1, dtype=np.int64)
    for r, numbers in zip(rows, layout.numbers):
        node_of_row[r] = numbers
    is_inside = (copies[:, 1] >= 0) & (copies[:, 1] < n_rows)
    nodes = np.where(is_inside, node_of_row[np.where(is_inside, copies[:, 1], 0)] if n_rows else -1, -1)
    if (nodes < 0).any():
        bad = copies[np.argmin(nodes)]
        raise InputError(f"evaluation: row {bad[0] + 1} copies row {bad[1] + 1}, which no volume evaluates")
    volume, start = layout.owner(nodes), layout.starts
    return [np.stack([copies[volume == v, 0], nodes[volume == v] - start[v]], axis=1) for v in range(len(rows))]


def _cut(nodes: Sequence[NodesBySpan]) -> tuple[_Chunk, ...]:
    """Cut the nodes into chunks of about the same number of nodes."""
    n_nodes = max(CHUNK_NODES, sum(r.n_nodes for r in nodes) // MAX_CHUNKS)
    chunks = []
    for v, r in enumerate(nodes):
        n_pieces = -(-r.n_nodes // n_nodes)
        cuts = np.searchsorted(r.starts, np.arange(n_pieces + 1) * r.n_nodes / max(n_pieces, 1))
        for first, last in zip(cuts[:-1].tolist(), cuts[1:].tolist()):
            if first < last:
                chunks.append(_Chunk(v, first, last, r.layers(first, last)))
    return tuple(chunks)


def _checked(array: ArrayLike, n: int, name: str) -> np.ndarray:
    array = np.asarray(array)
    if array.shape != (n, 3):
        raise InputError(f"evaluation: {name} of shape {array.shape}; give shape ({n}, 3)")
    return np.ascontiguousarray(array, dtype=complex if np.iscomplexobj(array) else float)
