"""Small fitted grids for the tests of components and command line."""

import numpy as np

from bspline_mdao.fit.fitting import fit_grid
from bspline_mdao.grids.multiblock import Block, Grid


def two_blocks(seed: int = 0) -> Grid:
    """Two blocks of unequal sizes with one interface, bent smoothly and differently in every direction."""
    rng = np.random.default_rng(seed)
    bend = rng.uniform(-0.15, 0.15, (3, 3))
    ends = ((0.0, 1.0, 7), (1.0, 2.5, 9))
    return Grid(
        tuple(Block(_bent(*end, bend), f"block {n}") for n, end in enumerate(ends, start=1)), source="two blocks"
    )


def _bent(start: float, stop: float, n: int, bend: np.ndarray) -> np.ndarray:
    axes = np.linspace(start, stop, n), np.linspace(0.0, 1.2, 8), np.linspace(0.0, 0.9, 6)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return x + np.sin(2.0 * x) @ bend + np.cos(x[..., [1, 2, 0]]) @ bend.T


def small_model(**options):
    """Fit of `two_blocks` with unequal numbers of control points."""
    return fit_grid(two_blocks(), n_control=[(4, 6, 5), (6, 6, 5)], **options)
