"""Grids with skewed cells that interior control points can mend."""

import numpy as np

from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window

SHAPES = ((9, 8, 10), (7, 8, 10))


def skewed_grid(amount: float = 0.1, seed: int = 0, spacing: float = 2.0, planes: bool = True) -> Grid:
    """Two blocks side by side over a bent floor, their inside and their interface pushed aside by smooth waves.

    Cells get longer with height by ``spacing``. The floor is a wall, the side ``jmin`` a symmetry plane, where
    ``planes`` declares them; nothing else is declared.
    """
    random = np.random.default_rng(seed)
    push, phases = random.uniform(-amount, amount, (3, 3)), random.uniform(0.0, 1.0, 3)
    x0 = np.linspace(0.0, 1.9, SHAPES[0][0] + SHAPES[1][0] - 1)
    height = np.linspace(0.0, 1.0, SHAPES[0][2]) ** spacing
    u = np.stack(np.meshgrid(x0, np.linspace(0.0, 1.0, SHAPES[0][1]), height, indexing="ij"), axis=-1)
    t = u / u.max(axis=(0, 1, 2))
    bubble = np.sin(np.pi * t[..., 0]) * np.sin(np.pi * t[..., 1]) * np.sin(np.pi * t[..., 2])
    x = u + bubble[..., None] * (np.sin(2.0 * np.pi * (t + phases)) @ push)
    x[..., 2] += 0.1 * np.sin(2.0 * u[..., 0]) * (1.0 - t[..., 2])
    cut = SHAPES[0][0] - 1
    blocks = Block(x[: cut + 1], "left"), Block(x[cut:], "right")
    return Grid(blocks, _patches() if planes else (), "skewed grid")


def skewed_model(**options):
    """Fit of `skewed_grid`."""
    return fit_grid(skewed_grid(**options), n_control=[(6, 5, 6), (5, 5, 6)])


def _patches():
    floor = (Window(n, (0, 0, 0), (i - 1, j - 1, 0)) for n, (i, j, _) in enumerate(SHAPES))
    side = (Window(n, (0, 0, 0), (i - 1, 0, k - 1)) for n, (i, _, k) in enumerate(SHAPES))
    return Patch("floor", "wall", tuple(floor)), Patch("side", "symmetry", tuple(side))
