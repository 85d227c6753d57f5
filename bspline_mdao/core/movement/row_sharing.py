"""Rows of a matrix that several points share: the blocks of the points are added, P^T K P.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...base.sparse.blocks import BlockPattern, slots

__all__ = ["RowSharing"]


@dataclass(frozen=True, eq=False)
class RowSharing:
    """Points that share rows of a matrix, and the blocks of the matrix that are added up for it."""

    rows: np.ndarray  # (n_points,) of int, row of each point
    pattern: BlockPattern  # of the rows; a `DistributedPattern` for the rows of one of several processes
    # (n_blocks, n_blocks of the points), which blocks of the points are added unchanged, and which transposed
    as_they_are: csr_array
    transposed: csr_array

    @classmethod
    def of(cls, pattern: BlockPattern, shared: BlockPattern, rows: np.ndarray) -> RowSharing:
        """Add up the blocks of a pattern of points, by the row of each point in the pattern of the same elements."""
        points = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr)), pattern.indices
        pairs = np.stack([rows[points[0]], rows[points[1]]], axis=1).astype(np.int32)
        # pairs of corners (1, 0); pairs that become one row are added both unchanged and transposed
        place = slots(shared, pairs)[:, 1]
        is_turned, is_one = pairs[:, 0] < pairs[:, 1], (pairs[:, 0] == pairs[:, 1]) & (points[0] != points[1])
        shape = shared.n_blocks, pattern.n_blocks

        def summing(is_added: np.ndarray) -> csr_array:
            entries = np.flatnonzero(is_added)
            return csr_array((np.ones(len(entries)), (place[entries], entries)), shape=shape)

        return cls(rows, shared, summing(~is_turned), summing(is_turned | is_one))

    def added(self, data: np.ndarray) -> np.ndarray:
        """Blocks of the rows, shape (n_blocks, 3, 3), from blocks of the points."""
        turned = np.ascontiguousarray(data.transpose(0, 2, 1)).reshape(-1, 9)
        return (self.as_they_are @ data.reshape(-1, 9) + self.transposed @ turned).reshape(-1, 3, 3)
