"""Matrices for the tests of the sparse solvers."""

from __future__ import annotations

import numpy as np

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern


def box_elements(shape, periodic=False):
    """Elements of a box of points of unequal sides, and their coordinates; the first direction may close on itself."""
    ids = np.arange(np.prod(shape)).reshape(shape)
    points = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    wrapped = np.concatenate((ids, ids[:1])) if periodic else ids
    cut = [(slice(None, -1), slice(1, None))[bit] for bit in (0, 1)]
    corners = [wrapped[cut[a], cut[b], cut[d]].ravel() for d in (0, 1) for b in (0, 1) for a in (0, 1)]
    return np.stack(corners, axis=1).astype(np.int32), points


def random_pattern(n, density, rng):
    """Pattern of random couplings; disconnected where they are few."""
    lower = np.tril(rng.random((n, n)) < density, -1) | np.eye(n, dtype=bool)
    indptr = np.concatenate(([0], np.cumsum(lower.sum(axis=1)))).astype(np.int64)
    return BlockPattern(indptr, np.nonzero(lower)[1].astype(np.int32))


def definite_matrix(pattern, rng):
    """Positive definite matrix of a pattern: random blocks, dominant diagonal."""
    data = rng.standard_normal((pattern.n_blocks, 3, 3))
    rows = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    load = np.zeros((pattern.n, 3))
    np.add.at(load, rows, np.abs(data).sum(axis=2))
    np.add.at(load, pattern.indices, np.abs(data).sum(axis=1))
    diagonal = pattern.indptr[1:] - 1
    data[diagonal] = load[:, :, None] * np.eye(3)
    return BlockMatrix(pattern, data)


def dense(matrix):
    """The full scalar matrix."""
    lower = matrix.to_scipy().toarray()
    return lower + np.tril(lower, -1).T
