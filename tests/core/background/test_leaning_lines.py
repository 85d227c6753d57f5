"""Grids of blocks in a lattice: first cells whose lines lean by many of their heights stay valid where walls bend."""

from dataclasses import replace

import numpy as np
from topology_cases import grid_of, patch

from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.topology.index_space import Window

SHAPE = (21, 17, 9)


def leaning_grid(lean):
    """A floor whose first cells are 1.1e-3 high and 0.1 wide, and all nodes above it are aside by up to so much."""
    off = np.expm1(0.9 * np.arange(SHAPE[2]))
    x, y, k = np.meshgrid(*(np.linspace(-e, e, n) for e, n in zip((1.0, 0.8), SHAPE)), range(SHAPE[2]), indexing="ij")
    aside = lean * (1.0 - x**2) * (1.0 - (y / 0.8) ** 2) * np.minimum(k, 1)
    whole = Window.whole(0, SHAPE)
    far = patch("farfield", *(whole.face(face) for face in (0, 1, 2, 3, 5)), name="far")
    nodes = np.stack([x + aside, y + 0.6 * aside, off[k] / off[-1]], axis=-1)
    return grid_of(nodes, patches=[patch("wall", whole.face(4), name="floor"), far])


def n_inverted(mesh, kinds):
    """Cells that a bump of the floor inverts."""
    model = MeshModel.of(mesh, kinds)
    walls = mesh.points[model.wall_rows]
    up = 0.1 * np.cos(0.5 * np.pi * walls[:, 0]) ** 2 * np.cos(np.pi * walls[:, 1] / 1.6) ** 2
    moved = model.mover.move(model.control_points, walls + up[:, None] * [0.0, 0.0, 1.0])
    return mesh.quality(model.node_map.at(moved.points).nodes).is_inverted.sum()


def test_nodes_of_blocks_turn_about_the_nodes_of_walls_however_their_lines_lean():
    marked = marked_grid(leaning_grid(0.05))
    kinds = {name: guess.kind for name, guess in marked.kinds.items()}
    assert not marked.mesh.quality(marked.mesh.points).is_inverted.any()
    assert n_inverted(marked.mesh, kinds) == 0
    assert n_inverted(replace(marked.mesh, numbers=None), kinds) > 20  # as of a mesh whose lines nobody knows
