"""Symmetric scaling of a block matrix to unit diagonal, so that single precision can hold it."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["inverse_root_diagonal", "scaled_blocks"]


@njit(cache=True)
def inverse_root_diagonal(indptr, data):
    """One over the root of every diagonal entry, shape (n, 3); 1 where the entry is not positive."""
    n = len(indptr) - 1
    scale = np.ones((n, 3))
    for row in range(n):
        for r in range(3):
            entry = data[indptr[row + 1] - 1, r, r]
            if entry > 0.0:
                scale[row, r] = 1.0 / np.sqrt(entry)
    return scale


@njit(cache=True)
def scaled_blocks(indptr, indices, data, scale):
    """Blocks with rows and columns multiplied by the scale, in single precision; float32, shape (n_blocks, 3, 3)."""
    scaled = np.empty(data.shape, np.float32)
    for row in range(len(indptr) - 1):
        for block in range(indptr[row], indptr[row + 1]):
            for r in range(3):
                for c in range(3):
                    scaled[block, r, c] = data[block, r, c] * scale[row, r] * scale[indices[block], c]
    return scaled
