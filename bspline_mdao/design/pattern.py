"""Sums and products of sparse matrices whose pattern does not depend on their numbers: zeros that turn up are kept."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

__all__ = ["ones_like", "product_on_pattern", "sum_on_pattern"]


def ones_like(matrix: csr_array) -> csr_array:
    """The same pattern with ones."""
    return csr_array((np.ones_like(matrix.data), matrix.indices, matrix.indptr), shape=matrix.shape)


def sum_on_pattern(*matrices: csr_array) -> csr_array:
    """Sum of matrices, with an entry wherever one of them has one."""
    parts = [matrix.tocoo() for matrix in matrices]
    rows, columns, data = (np.concatenate([getattr(p, name) for p in parts]) for name in ("row", "col", "data"))
    return coo_array((data, (rows, columns)), shape=matrices[0].shape).tocsr()


def product_on_pattern(a: csr_array, b: csr_array) -> csr_array:
    """Product of two matrices, with an entry wherever entries of theirs meet."""
    pattern = ones_like(a) @ ones_like(b)
    return sum_on_pattern(0.0 * pattern, a @ b)
