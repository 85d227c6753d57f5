"""Sparse symmetric matrices of 3 x 3 blocks, one block row per point, and linear systems with them.

Only the lower triangle is stored, by rows::

    row 0   [d]                     d = diagonal block, last of its row, both halves filled
    row 1   [b d]                   b = block (row, column) with column < row; the one above the diagonal is b^T
    row 2   [  b d] ...

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse
from numba import njit

from ...errors import InputError
from ..numerics.processes import ONE, OneProcess

__all__ = [
    "BlockMatrix",
    "BlockPattern",
    "Graph",
    "LinearSolution",
    "check_right",
    "graph_of",
    "relative_residual",
    "residual_norm",
    "slots",
]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Pattern of a symmetric matrix of 3 x 3 blocks: its lower triangle, by rows."""

    indptr: np.ndarray  # int64 (n + 1,), where each row starts
    indices: np.ndarray  # int32 (n_blocks,), columns, ascending within a row; the last of every row is the diagonal

    def __post_init__(self) -> None:
        is_short = np.diff(self.indptr) < 1
        is_wrong = is_short if is_short.any() else self.indices[self.indptr[1:] - 1] != np.arange(self.n)
        if is_wrong.any():
            raise InputError(f"block pattern: row {np.argmax(is_wrong) + 1} lacks its diagonal; store it last")

    @property
    def n(self) -> int:
        """Number of block rows."""
        return len(self.indptr) - 1

    @property
    def n_blocks(self) -> int:
        """Number of stored blocks."""
        return len(self.indices)

    @classmethod
    def of_elements(
        cls,
        # block row of every corner; -1 if the point is fixed. A number may occur twice in an element
        element_points: np.ndarray,  # int32 (n_elements, m)
        n: int,  # block rows. A row without an element has only its diagonal
    ) -> BlockPattern:
        """Pattern of a matrix that couples all points of each element with each other."""
        elements, corners = np.nonzero(element_points >= 0)
        points = np.asarray(element_points, np.int32)[elements, corners]
        shape = (len(element_points), n)
        incidence = scipy.sparse.csr_array((np.ones(len(elements), np.int32), (elements, points)), shape=shape)
        coupled = scipy.sparse.tril(incidence.T @ incidence + scipy.sparse.eye_array(n, dtype=np.int32), format="csr")
        coupled.sort_indices()
        return cls(coupled.indptr.astype(np.int64), coupled.indices.astype(np.int32))


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """Symmetric matrix of 3 x 3 blocks."""

    pattern: BlockPattern  # where the blocks are
    data: np.ndarray  # (n_blocks, 3, 3), the blocks. Diagonal ones contain both halves

    def __post_init__(self) -> None:
        if self.data.shape != (self.pattern.n_blocks, 3, 3):
            shape = (self.pattern.n_blocks, 3, 3)
            raise InputError(f"block matrix: data of shape {self.data.shape}; give shape {shape} as in the pattern")

    @property
    def comm(self) -> OneProcess:
        """Its processes: this one."""
        return ONE

    @property
    def n(self) -> int:
        """Number of block rows."""
        return self.pattern.n

    def dot(self, x: np.ndarray) -> np.ndarray:
        """Product with one vector, shape (n, 3), or with m of them, shape (n, 3, m)."""
        if x.ndim == 3:
            sides = [self.dot(x[..., side]) for side in range(x.shape[2])]
            return np.stack(sides, axis=2) if sides else np.zeros_like(x)
        if x.shape != (self.pattern.n, 3):
            raise InputError(f"block matrix: vector of shape {x.shape}; give shape ({self.pattern.n}, 3)")
        return _product(self.pattern.indptr, self.pattern.indices, self.data, np.ascontiguousarray(x, np.float64))

    def dot_of_sizes(self, x: np.ndarray) -> np.ndarray:
        """Product of the absolute values of all entries and of a vector, shape (n, 3)."""
        return _product_of_sizes(self.pattern.indptr, self.pattern.indices, self.data, np.abs(x))

    def to_scipy(self) -> scipy.sparse.csc_array:
        """Lower triangle as a scalar matrix in compressed columns, rows ascending; zeros are kept."""
        size = 3 * self.pattern.n
        indptr, rows, values = _lower_columns(self.pattern.indptr, self.pattern.indices, self.data)
        return scipy.sparse.csc_array((values, rows, indptr), shape=(size, size))


def slots(
    # pattern with all pairs of an element's points, from `BlockPattern.of_elements`
    pattern: BlockPattern,
    element_points: np.ndarray,  # int32 (n_elements, m), block row of every corner; -1 where a point is fixed
) -> np.ndarray:
    """Positions of the blocks of element matrices in the data of a `BlockMatrix`."""
    # returns int32 (n_elements, m (m + 1) / 2), place in ``data`` of the pair of corners (a, b), b <= a, in column ``a
    # (a + 1) / 2 + b``; -1 where one of them is fixed. With p = ``element_points[e]`` and the element's block ``K_ab``,
    # what is to be added there is
    # - ``K_ab`` where ``p[a] > p[b]`` or a = b,
    # - ``K_ab^T`` where ``p[a] < p[b]``, because only the lower triangle is stored,
    # - ``K_ab + K_ab^T`` where ``p[a] == p[b]`` but a > b, in an element with a collapsed edge
    points = np.asarray(element_points, np.int64)
    a, b = np.tril_indices(points.shape[1])
    rows, columns = np.maximum(points[:, a], points[:, b]), np.minimum(points[:, a], points[:, b])
    row_of = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    places = np.searchsorted(row_of * pattern.n + pattern.indices, rows * pattern.n + columns)
    return np.where(columns < 0, -1, places).astype(np.int32)


class Graph(NamedTuple):
    """The graph of a block pattern: couplings in both directions, without the diagonal, in compressed rows."""

    starts: np.ndarray  # int64 (n + 1,), where the neighbours of each point start
    # neighbours of every point, each edge at both ends, no point its own neighbour
    neighbours: np.ndarray  # int32 (n_edges,)


def graph_of(pattern: BlockPattern) -> Graph:
    """Make the graph of a pattern; the neighbours of every point are ascending."""
    lower = scipy.sparse.csr_array(
        (np.ones(len(pattern.indices), np.int8), pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n)
    )
    strict = scipy.sparse.tril(lower, k=-1, format="csr")
    both = (strict + strict.T).tocsr()
    both.sort_indices()
    return Graph(both.indptr.astype(np.int64), both.indices.astype(np.int32))


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Solution of a linear system, and how it was found."""

    x: np.ndarray  # (n, 3) or (n, 3, m), the solution, or the solutions for m right-hand sides
    iterations: int  # iterations, or steps of refinement
    residual: float  # residual in the 2-norm, relative to the right-hand side (the largest, if there are several)
    seconds: float  # wall time (s)


def check_right(right: np.ndarray, n: int) -> np.ndarray:
    """Right-hand side as floating-point numbers; `InputError` unless its shape is (n, 3) or (n, 3, m)."""
    if right.ndim not in (2, 3) or right.shape[:2] != (n, 3):
        raise InputError(f"right-hand side of shape {right.shape}; give shape ({n}, 3), or ({n}, 3, m) for several")
    return np.asarray(right, np.float64)


def relative_residual(residual: np.ndarray, right: np.ndarray) -> float:
    """Largest 2-norm of a residual relative to its right-hand side, shapes (n, 3) or (n, 3, m); 0 where both are 0."""
    norms, scales = (np.sqrt(np.einsum("ij...,ij...->...", v, v)) for v in (residual, right))
    return float(np.max(np.divide(norms, scales, out=np.where(norms > 0, np.inf, 0.0), where=scales > 0), initial=0.0))


def residual_norm(matrix: BlockMatrix, x: np.ndarray, right: np.ndarray) -> float:
    """Residual of a solution in the 2-norm, relative to the right-hand side; the largest if there are several."""
    return relative_residual(right - matrix.dot(x), right)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _product(indptr, indices, data, x):
    """Symmetric product: every stored off-diagonal block is used twice while it is in a register."""
    y = np.zeros_like(x)
    for row in range(len(indptr) - 1):
        x_0, x_1, x_2 = x[row, 0], x[row, 1], x[row, 2]
        y_0 = y_1 = y_2 = 0.0
        last = indptr[row + 1] - 1
        for entry in range(indptr[row], last):
            column = indices[entry]
            a, b, c = data[entry, 0, 0], data[entry, 0, 1], data[entry, 0, 2]
            d, e, f = data[entry, 1, 0], data[entry, 1, 1], data[entry, 1, 2]
            g, h, i = data[entry, 2, 0], data[entry, 2, 1], data[entry, 2, 2]
            z_0, z_1, z_2 = x[column, 0], x[column, 1], x[column, 2]
            y_0 += a * z_0 + b * z_1 + c * z_2
            y_1 += d * z_0 + e * z_1 + f * z_2
            y_2 += g * z_0 + h * z_1 + i * z_2
            y[column, 0] += a * x_0 + d * x_1 + g * x_2
            y[column, 1] += b * x_0 + e * x_1 + h * x_2
            y[column, 2] += c * x_0 + f * x_1 + i * x_2
        block = data[last]
        y[row, 0] += y_0 + block[0, 0] * x_0 + block[0, 1] * x_1 + block[0, 2] * x_2
        y[row, 1] += y_1 + block[1, 0] * x_0 + block[1, 1] * x_1 + block[1, 2] * x_2
        y[row, 2] += y_2 + block[2, 0] * x_0 + block[2, 1] * x_1 + block[2, 2] * x_2
    return y


@njit(cache=True)
def _product_of_sizes(indptr, indices, data, x):
    """Symmetric product with the absolute values of all entries, without a copy of them."""
    y = np.zeros_like(x)
    for row in range(len(indptr) - 1):
        for entry in range(indptr[row], indptr[row + 1]):
            column = indices[entry]
            for r in range(3):
                for c in range(3):
                    size = abs(data[entry, r, c])
                    y[row, r] += size * x[column, c]
                    if column != row:
                        y[column, c] += size * x[row, r]
    return y


@njit(cache=True)
def _lower_columns(indptr, indices, data):
    """Scalar lower triangle by columns; rows are ascending because block rows are processed in order."""
    starts = np.zeros(3 * (len(indptr) - 1) + 1, np.int64)
    for row in range(len(indptr) - 1):
        for entry in range(indptr[row], indptr[row + 1]):
            for c in range(3):
                starts[3 * indices[entry] + c + 1] += 3 if indices[entry] < row else 3 - c
    starts = np.cumsum(starts)
    rows, values = np.empty(starts[-1], np.int32), np.empty(starts[-1])
    ends = starts[:-1].copy()
    for row in range(len(indptr) - 1):
        for entry in range(indptr[row], indptr[row + 1]):
            for c in range(3):
                column = 3 * indices[entry] + c
                for r in range(0 if indices[entry] < row else c, 3):
                    rows[ends[column]], values[ends[column]] = 3 * row + r, data[entry, r, c]
                    ends[column] += 1
    return starts, rows, values
