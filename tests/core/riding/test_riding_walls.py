"""Walls of meshes that follow another map: heights above narrow faces, and on lines that lean."""

import numpy as np

from bspline_mdao.core.riding.riding_walls import RidingWalls
from bspline_mdao.core.riding.wall_faces import WallFaces
from bspline_mdao.grids.cells.mixed_cells import MixedMesh

FIRST = 1e-4


def plate(x, lean=0.0):
    """Layers of hexahedra on a plate with nodes at x, along lines that lean; its mesh and its walls."""
    z = FIRST * np.array([0.0, 1.0, 2.5, 5.0, 9.0])
    nodes = np.stack(np.meshgrid(x, [0.0, 0.1, 0.2, 0.3], z, indexing="ij"), axis=-1)
    nodes[..., 0] += lean * nodes[..., 2]
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    around = [ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]]
    cells = np.stack([c[..., :-1] for c in around] + [c[..., 1:] for c in around], axis=-1).reshape(-1, 8)
    quads = np.stack([c[..., 0] for c in around], axis=-1).reshape(-1, 4)
    mesh = MixedMesh(nodes.reshape(-1, 3), {"hexahedron": cells})
    faces = WallFaces(("plate",), quads, np.zeros(len(quads), dtype=int))
    return mesh, RidingWalls.of(mesh, faces, [], np.zeros(0, dtype=int), np.zeros_like(mesh.points))


def ratios(mesh, walls, mapped):
    """Heights after a move by those before."""
    nodes = mapped.copy()
    walls.following.at(mesh.points, nodes, mesh.points, nodes)
    return walls.heights(nodes) / walls.heights(mesh.points)


def test_heights_above_faces_as_narrow_as_they_are_stay_where_the_map_loses_a_tenth():
    # faces of a blunt edge are as wide as the first cells are high
    steps = np.concatenate([np.full(8, 0.1), np.full(12, FIRST), np.full(8, 0.1)])
    mesh, walls = plate(np.cumsum(np.r_[0.0, steps]))
    mapped = mesh.points * [1.0, 1.0, 0.9]
    assert np.abs(ratios(mesh, walls, mapped) - 1.0).max() < 0.005


def test_heights_on_lines_that_lean_stay_where_a_wall_becomes_wavy():
    mesh, walls = plate(np.linspace(0.0, 3.0, 13), lean=1.0)
    mapped = mesh.points + 0.15 * np.sin(2.5 * mesh.points[:, :1]) * [0.0, 0.0, 1.0]
    kept = ratios(mesh, walls, mapped).reshape(13, 4)[1:-1]
    assert np.abs(kept - 1.0).max() < 0.03
