"""Matrices for the iterative solvers."""

import numpy as np

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern, slots


def box_elements(shape):
    """Corners of the hexahedra of a box of ``shape`` points."""
    ids = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    low, high = slice(None, -1), slice(1, None)
    corners = [ids[i, j, k] for i in (low, high) for j in (low, high) for k in (low, high)]
    return np.stack(corners, axis=-1).reshape(-1, 8)


def stiffness(shape, seed, stretch=30.0, hold=1.0):
    """Matrix of springs between all corners of each element, along random directions, their stiffness far from even.

    Every spring resists mostly along its direction and a little across it; all points are held a little.
    Each point has axes of its own, so that blocks are not symmetric.
    """
    random = np.random.default_rng(seed)
    elements = box_elements(shape)
    pattern = BlockPattern.of_elements(elements, int(np.prod(shape)))
    places, data = slots(pattern, elements), np.zeros((pattern.n_blocks, 3, 3))
    data[pattern.indptr[1:] - 1] = hold * np.eye(3)
    for element, place in zip(elements, places):
        for a in range(8):
            for b in range(a):
                direction = random.normal(size=3)
                spring = stretch ** random.uniform() * (np.outer(direction, direction) + 0.1 * np.eye(3))
                data[place[a * (a + 1) // 2 + b]] -= spring
                data[pattern.indptr[element[a] + 1] - 1] += spring
                data[pattern.indptr[element[b] + 1] - 1] += spring
    axes = np.linalg.qr(random.normal(size=(pattern.n, 3, 3)))[0]
    rows = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    return BlockMatrix(pattern, axes[rows] @ data @ axes[pattern.indices].transpose(0, 2, 1))


def dense(matrix):
    """The matrix as a full scalar array."""
    lower = matrix.to_scipy().toarray()
    return lower + np.tril(lower, -1).T
