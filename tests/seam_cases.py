"""A ball with poles."""

import numpy as np

from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


def globe_grid():
    """Shell around a ball of radius 1 of four wedges that meet at two poles."""
    a, b, r = np.meshgrid(np.linspace(0, np.pi / 2, 9), np.linspace(0, np.pi, 17), np.linspace(1, 3, 5), indexing="ij")
    nodes = [
        np.stack([r * np.sin(b) * np.cos(a + turn), r * np.sin(b) * np.sin(a + turn), r * np.cos(b)], axis=-1).round(14)
        for turn in np.pi / 2 * np.arange(4)
    ]
    blocks = tuple(Block(x, f"wedge {n}") for n, x in enumerate(nodes))
    faces = [[Window.whole(n, x.shape[:3]).face(side) for n, x in enumerate(nodes)] for side in (4, 5)]
    return Grid(blocks, (Patch("wall", "wall", tuple(faces[0])), Patch("far", "farfield", tuple(faces[1]))), "globe")
