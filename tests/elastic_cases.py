"""Small meshes for the movers that solve for equilibrium, and dense stiffnesses to compare with."""

from functools import cache

import numpy as np

from bspline_mdao.base.sparse.blocks import BlockPattern, slots
from bspline_mdao.core.mesh.moving_mesh import MovingMesh


def crooked_points(shape, amount, seed=0):
    """Unit lattice of points, disturbed."""
    axes = [np.arange(float(n)) for n in shape]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return lattice + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, lattice.shape)


def two_blocks(shape, is_collapsed):
    """Point numbers of a lattice cut in two along i, the second left-handed; the face i = 0 is a line along k."""
    ids = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    if is_collapsed:
        ids[0] = ids[0, shape[1] // 2]
    cut = shape[0] // 2
    first, second = ids[: cut + 1], ids[cut:, :, ::-1]
    numbers, ids = np.unique(np.concatenate([first.ravel(), second.ravel()]), return_inverse=True)
    first, second = ids[: first.size].reshape(first.shape), ids[first.size :].reshape(second.shape)
    return numbers, (first.astype(np.int32), second.astype(np.int32))


@cache
def crooked_box(shape=(4, 5, 6), amount=0.15, is_collapsed=False, is_enclosed=False):
    """Two blocks of crooked elements on a moving floor (k = 0) under a held lid; all sides are free.

    With ``is_enclosed`` the whole boundary is surface.
    """
    numbers, blocks = two_blocks(shape, is_collapsed)
    index = np.stack(np.unravel_index(numbers, shape), axis=-1)
    points = crooked_points(shape, amount)[numbers]
    is_surface, is_held = index[:, 2] == 0, index[:, 2] == shape[2] - 1
    if is_enclosed:
        is_surface = (index == 0).any(axis=1) | (index == np.array(shape) - 1).any(axis=1)
    is_free = np.repeat(~(is_surface | is_held)[:, None], 3, axis=1)
    return MovingMesh(blocks, ("block 1", "block 2"), points, np.flatnonzero(is_surface).astype(np.int32), is_free)


def assembled(add_stiffness, elements, n):
    """Dense stiffness of all points from the blocks that a mover assembles."""
    pattern = BlockPattern.of_elements(elements, n)
    data = np.zeros((pattern.n_blocks, 3, 3))
    add_stiffness(elements, slots(pattern, elements), data)
    dense = np.zeros((n, 3, n, 3))
    rows = np.repeat(np.arange(n), np.diff(pattern.indptr))
    for row, column, block in zip(rows, pattern.indices, data):
        dense[row, :, column], dense[column, :, row] = block, block.T
    return dense.reshape(3 * n, 3 * n)


def by_columns(force, n):
    """Dense stiffness of all points from the forces of unit displacements."""
    return np.stack([force(unit.reshape(n, 3)).ravel() for unit in np.eye(3 * n)], axis=1)
