"""Small smooth grids for the tests of file formats."""

import numpy as np

from bspline_mdao.grids.topology.grid import Block, Grid


def smooth_nodes(shape, offset=0.0, n_dimensions=3):
    """A gently curved and stretched box of nodes."""
    x, y, z = np.meshgrid(*(np.linspace(0.0, 1.0, n) ** 1.2 for n in shape), indexing="ij")
    nodes = np.stack([3.0 * x + 0.2 * y * y + offset, 1.5 * y + 0.1 * z * x, z + 0.1 * x * x - 0.05 * y], axis=-1)
    if n_dimensions == 2:
        nodes[..., 2] = 0.0
    return nodes


def smooth_grid(shapes=((4, 5, 6), (6, 4, 5)), n_dimensions=3, has_iblank=False, seed=0):
    """A grid of smooth blocks, rounded to what 4-byte reals hold exactly."""
    random = np.random.default_rng(seed)
    blocks = []
    for number, shape in enumerate(shapes, 1):
        nodes = smooth_nodes(shape, 4.0 * number, n_dimensions).astype(np.float32).astype(np.float64)
        iblank = random.integers(-2, 3, shape).astype(np.int32) if has_iblank else None
        blocks.append(Block(nodes, f"block {number}", iblank))
    return Grid(tuple(blocks))


def assert_same_grid(a, b):
    """Same shapes, and nodes and IBLANK to the last bit."""
    assert a.shapes == b.shapes
    for one, other in zip(a.blocks, b.blocks):
        np.testing.assert_array_equal(one.nodes, other.nodes)
        assert (one.iblank is None) == (other.iblank is None)
        if one.iblank is not None:
            np.testing.assert_array_equal(one.iblank, other.iblank)
