"""Vectors at the nodes of a grid, turned by rotations that are interpolated from the corners of spans.

Every node has a place in its span. The rotations of the eight corners of the span are interpolated trilinearly there.
The weights are positive and sum to one, so if all rotations are equal, this rotation turns the vector.

On planar boundary faces that are not walls, the part of a vector along the normal follows the face's mean normal, and
the rest stays in the plane (`FaceNodes`). All other nodes are turned by the kernels that evaluate the volumes
(`SpanNodes`, `bspline_mdao.core.evaluation.contraction`).

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.numerics.rows import copy_row
from ..evaluation.contraction import LANES
from ..evaluation.nodes_by_span import NodesBySpan, store_groups
from ..splines.greville import span_breaks
from ..splines.knots import Knots
from ..splines.volume import Volume

__all__ = ["FaceNodes", "SpanNodes", "Vectors", "transposed"]

_CHUNK = 4096  # nodes at a time whose knots are evaluated: their arrays fit the second-level cache


@dataclass(frozen=True, eq=False)
class SpanNodes:
    """The nodes of one volume, sorted by their spans."""

    nodes: NodesBySpan  # the nodes
    # (n_spans, 8) of int, corners of the span of each run; bits 0, 1, 2 of the column are the ends of directions 0, 1,
    # 2
    corners: np.ndarray
    # (3 n_nodes + LANES,), places of the nodes between the ends, in groups, see
    # `bspline_mdao.core.evaluation.simd_contraction`
    fractions: np.ndarray

    @classmethod
    def of(cls, volume: Volume, ids: np.ndarray, nodes: NodesBySpan, parameters: np.ndarray) -> SpanNodes:
        """Place the nodes of a volume; ``parameters`` are in their order."""
        first, spans, is_high = _spans(volume, nodes)
        corners = np.empty((len(nodes.anchors), 8), dtype=np.int32)
        for column in range(8):
            corners[:, column] = ids[tuple(first[d] + ((column >> d & 1) ^ is_high[d]) for d in range(3))]
        n_nodes, values = np.diff(nodes.starts), np.empty((nodes.n_nodes, 3))
        for d, knots in enumerate(volume.knots):
            turned, span, is_end = (
                np.roll(parameters, -d, axis=1),
                *(np.repeat(a[d], n_nodes) for a in (spans, is_high)),
            )
            values[:, d] = _fractions(knots, turned, span, is_end)
        fractions = np.zeros(values.size + LANES, dtype=np.float32)
        store_groups(nodes.starts, np.arange(nodes.n_nodes), values, fractions)
        return cls(nodes, corners, fractions)

    def pack(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of all nodes, shape (n_nodes, 3), in groups."""
        packed = np.zeros(3 * self.nodes.n_nodes + LANES)
        store_groups(self.nodes.starts, self.nodes.rows, vectors, packed)
        return packed

    def weights(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners and their weights, each of shape (n, 4), of nodes on faces of the volume, by sorted place."""
        starts = self.nodes.starts
        run = np.searchsorted(starts, nodes, side="right") - 1
        group = starts[run] + (nodes - starts[run]) // LANES * LANES
        n = np.minimum(LANES, starts[run + 1] - group)
        u = [self.fractions[3 * group + d * n + nodes - group].astype(float) for d in range(3)]
        ends = [[u[d] if column >> d & 1 else 1.0 - u[d] for d in range(3)] for column in range(8)]
        weights = np.stack([np.prod(three, axis=0) for three in ends], axis=1)
        largest = np.argsort(-weights, axis=1, kind="stable")[:, :4]  # the other four are on the far side
        return np.take_along_axis(self.corners[run], largest, 1), np.take_along_axis(weights, largest, 1)


@dataclass(frozen=True, eq=False)
class FaceNodes:
    """Nodes on boundary faces with the weights of their corners, and the planes that their vectors stay in."""

    rows: np.ndarray  # (n,) of int, rows of the nodes, ascending
    # corners, weights: (n, 4), corners of spans, and their weights
    corners: np.ndarray
    weights: np.ndarray
    # (n, 3) of int, planes whose normals parts of the vectors follow, one after the other; -1 for none
    planes: np.ndarray

    def part(self, which: np.ndarray) -> FaceNodes:
        """Some of the nodes."""
        return FaceNodes(self.rows[which], self.corners[which], self.weights[which], self.planes[which])

    def turned(
        self,
        matrices: np.ndarray,  # (n_corners, 9), rotations of all corners
        normals: np.ndarray,  # (2, n_planes, 3), normals of all planes, now and at first
        vectors: np.ndarray,  # (n, 3), the vectors
    ) -> np.ndarray:
        """Turn the vectors, shape (n, 3), of these nodes."""
        out = vectors.copy()
        _add_products(self.corners, self.weights, matrices - np.eye(3).ravel(), vectors, out)  # exact if all are one
        _put_along(self.planes, normals, vectors, out)
        return out

    def jvp(
        self,
        matrices: np.ndarray,
        normals: np.ndarray,
        vectors: np.ndarray,
        d_matrices: np.ndarray,
        d_normals: np.ndarray,
        d_vectors: np.ndarray | None,
    ) -> np.ndarray:
        """Change of the turned vectors."""
        turned, change = np.zeros_like(vectors), np.zeros_like(vectors)
        _add_products(self.corners, self.weights, matrices, vectors, turned)
        _add_products(self.corners, self.weights, d_matrices, vectors, change)
        d_vectors = np.zeros_like(vectors) if d_vectors is None else d_vectors
        _add_products(self.corners, self.weights, matrices, d_vectors, change)
        _put_along_jvp(self.planes, normals, vectors, turned, d_normals, d_vectors, change)
        return change

    def vjp(
        self, matrices: np.ndarray, normals: np.ndarray, vectors: np.ndarray, bar: np.ndarray, matrices_bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: adds to ``matrices_bar``; returns derivatives with respect to normals and vectors."""
        turned, bar = np.zeros_like(vectors), bar.copy()
        vectors_bar, normals_bar = np.zeros_like(vectors), np.zeros_like(normals)
        _add_products(self.corners, self.weights, matrices, vectors, turned)
        _put_along_vjp(self.planes, normals, vectors, turned, bar, normals_bar, vectors_bar)
        _add_products(self.corners, self.weights, transposed(matrices), bar, vectors_bar)
        _add_outer_products(self.corners, self.weights, bar, vectors, matrices_bar)
        return normals_bar, vectors_bar


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors of all nodes, sorted by span, nodes in planes separate. Made by `RotationMap.vectors`."""

    packed: tuple[np.ndarray, ...]
    flat: np.ndarray

    @property
    def n_bytes(self) -> int:
        """Memory in bytes."""
        return self.flat.nbytes + sum(array.nbytes for array in self.packed)


def transposed(matrices: np.ndarray) -> np.ndarray:
    """Transposed matrices, shape (n, 9), row by row."""
    return np.ascontiguousarray(matrices.reshape(-1, 3, 3).transpose(0, 2, 1)).reshape(-1, 9)


def _spans(volume: Volume, nodes: NodesBySpan) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Distinct spans of the nodes: places among the volume's spans, numbers, and whether counted from the end."""
    # As for the control points (see `bspline_mdao.core.evaluation.nodes_by_span`), nodes of a face depend only on the
    # corners of that face, to the last bit.
    anchors = np.unravel_index(nodes.anchors, volume.n_control)
    is_high = [a == k.n_control - 1 for a, k in zip(anchors, volume.knots)]
    spans = [np.where(high, a, a + k.order - 1) for a, high, k in zip(anchors, is_high, volume.knots)]
    return [np.searchsorted(span_breaks(k), s) for s, k in zip(spans, volume.knots)], spans, is_high


def _fractions(knots: Knots, parameters: np.ndarray, spans: np.ndarray, is_high: np.ndarray) -> np.ndarray:
    """Places of nodes in their spans, from the counting end; the first parameter is the knots' own direction."""
    fractions = np.empty(len(spans))
    for start in range(0, len(spans), _CHUNK):
        at = slice(start, start + _CHUNK)
        values = knots.values(parameters[at, 1].copy(), parameters[at, 2].copy())
        rows, span = np.arange(len(values)), spans[at]
        low, high = values[rows, span], values[rows, span + 1]
        fractions[at] = np.where(is_high[at], high - parameters[at, 0], parameters[at, 0] - low) / (high - low)
    return fractions.clip(0.0, 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_products(corners, weights, matrices, vectors, out):
    """Add the products of interpolated matrices with the vectors of nodes."""
    for i in range(corners.shape[0]):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for column in range(corners.shape[1]):
            m, weight = matrices[corners[i, column]], weights[i, column]
            for d in range(3):
                out[i, d] += weight * (m[3 * d] * x + m[3 * d + 1] * y + m[3 * d + 2] * z)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_outer_products(corners, weights, bar, vectors, out):
    """Add the derivatives of `_add_products` with respect to the matrices."""
    for i in range(corners.shape[0]):
        for column in range(corners.shape[1]):
            m, weight = out[corners[i, column]], weights[i, column]
            for d in range(3):
                for k in range(3):
                    m[3 * d + k] += weight * bar[i, d] * vectors[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _put_along(planes, normals, vectors, turned):
    """Replace the parts of turned vectors along normals by the vectors' parts along the initial normals."""
    for i in range(planes.shape[0]):
        for k in planes[i]:
            if k >= 0:
                n, along = normals[0, k], _dot(turned[i], normals[0, k]) - _dot(vectors[i], normals[1, k])
                for d in range(3):
                    turned[i, d] -= along * n[d]


@njit(cache=True, nogil=True, error_model="numpy")
def _put_along_jvp(planes, normals, vectors, turned, d_normals, d_vectors, change):
    """Derivative of `_put_along`, which is also applied to ``turned``."""
    for i in range(planes.shape[0]):
        for k in planes[i]:
            if k >= 0:
                n, d_n = normals[0, k], d_normals[0, k]
                along = _dot(turned[i], n) - _dot(vectors[i], normals[1, k])
                d_along = _dot(change[i], n) + _dot(turned[i], d_n)
                d_along -= _dot(d_vectors[i], normals[1, k]) + _dot(vectors[i], d_normals[1, k])
                for d in range(3):
                    turned[i, d] -= along * n[d]
                    change[i, d] -= d_along * n[d] + along * d_n[d]


@njit(cache=True, nogil=True, error_model="numpy")
def _put_along_vjp(planes, normals, vectors, turned, bar, normals_bar, vectors_bar):
    """Transpose of `_put_along_jvp` with respect to ``bar``, the normals and the vectors."""
    steps = np.empty((planes.shape[1], 3))
    for i in range(planes.shape[0]):
        for m, k in enumerate(planes[i]):
            copy_row(turned[i], steps[m])
            if k >= 0:
                along = _dot(turned[i], normals[0, k]) - _dot(vectors[i], normals[1, k])
                for d in range(3):
                    turned[i, d] -= along * normals[0, k, d]
        for m in range(planes.shape[1] - 1, -1, -1):
            k = planes[i, m]
            if k >= 0:
                along = _dot(steps[m], normals[0, k]) - _dot(vectors[i], normals[1, k])
                along_bar = -_dot(bar[i], normals[0, k])
                for d in range(3):
                    normals_bar[0, k, d] += along_bar * steps[m, d] - along * bar[i, d]
                    normals_bar[1, k, d] -= along_bar * vectors[i, d]
                    vectors_bar[i, d] -= along_bar * normals[1, k, d]
                for d in range(3):
                    bar[i, d] += along_bar * normals[0, k, d]


@njit(cache=True, nogil=True, error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
