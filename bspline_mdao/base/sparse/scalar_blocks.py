"""Symmetric positive definite scalar systems by the block Cholesky factor: three unknowns form a block.

Consecutively numbered unknowns should be neighbours, so that blocks are full.

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csr_array, eye_array

from .blocks import BlockMatrix, BlockPattern
from .cholesky import Cholesky, CholeskyFactor

__all__ = ["ScalarBlocksFactor", "factorize_scalars"]


@dataclass(frozen=True, eq=False)
class ScalarBlocksFactor:
    """Factor of a scalar matrix. Made by `factorize_scalars`."""

    n: int  # number of unknowns
    factor: CholeskyFactor  # of blocks, the last of which may be padded

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve for right-hand sides, shape (n, m)."""
        sides = np.zeros((3 * self.factor.matrix.n, right.shape[1]))
        sides[: self.n] = right
        blocks = self.factor.solve(sides.reshape(-1, 3, right.shape[1]))
        return blocks.x.reshape(sides.shape)[: self.n]


def factorize_scalars(matrix: csr_array, n_threads: int | None = None) -> ScalarBlocksFactor:
    """Factor a symmetric matrix, shape (n, n); `MovementError` if it is not positive definite."""
    n_padding = -matrix.shape[0] % 3
    padded = block_diag([matrix, eye_array(n_padding)], format="csr") if n_padding else matrix
    blocks = padded.tobsr((3, 3))
    blocks.sort_indices()
    rows = np.repeat(np.arange(blocks.shape[0] // 3), np.diff(blocks.indptr))
    is_lower = blocks.indices <= rows
    counts = np.bincount(rows[is_lower], minlength=blocks.shape[0] // 3)
    pattern = BlockPattern(np.concatenate([[0], np.cumsum(counts)]), blocks.indices[is_lower].astype(np.int32))
    points = np.zeros((pattern.n, 3))  # the order comes only from the graph
    analysis = Cholesky(n_threads=n_threads).analyze(pattern, points)
    data = np.ascontiguousarray(blocks.data[is_lower])
    return ScalarBlocksFactor(matrix.shape[0], analysis.factorize(BlockMatrix(pattern, data)))
