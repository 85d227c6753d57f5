"""Cells of grids of blocks as a mesh: one node where blocks meet, cells of any handedness, collapsed ones."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import find_topology
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.grid_mesh import grid_mesh
from bspline_mdao.grids.cells.quads import area_vectors
from bspline_mdao.grids.io.plane_grids import lift_plane_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


def wedge_and_box() -> Grid:
    """Half a cylinder about the z axis, singular there and left-handed, and a box below it that it stands on."""
    r, t, z = np.meshgrid(np.linspace(0.0, 1.0, 4), np.linspace(0.0, np.pi, 7), np.linspace(0.0, 1.0, 3), indexing="ij")
    cylinder = np.stack([r * np.cos(t), r * np.sin(t), z], axis=-1)
    cylinder[0, :, :, :2] = 0.0
    box = np.meshgrid(np.linspace(0.0, 1.0, 4), np.linspace(-1.0, 0.0, 5), np.linspace(0.0, 1.0, 3), indexing="ij")
    blocks = Block(cylinder[:, :, ::-1], "cylinder"), Block(np.stack(box, axis=-1), "box")
    outer = Patch("outer", "farfield", (Window(0, (3, 0, 0), (3, 6, 2)),))
    return Grid(blocks, (outer,))


def mesh_of(grid: Grid):
    topology = find_topology(grid)
    return grid_mesh(grid, topology, {face.window: face.patch or "rest" for face in topology.boundary})


def test_volumes_are_those_of_the_grid_whatever_the_handedness_of_blocks_and_where_they_collapse():
    grid = wedge_and_box()
    mesh = mesh_of(grid)
    quality = mesh.quality()
    assert not quality.is_inverted.any()
    assert mesh.n_cells == 3 * 6 * 2 + 3 * 4 * 2
    assert len(mesh.cells["hexahedron"]) == 2 * 6 * 2 + 3 * 4 * 2
    assert quality.volumes.sum() == pytest.approx(1.0 + 6 * 0.5 * np.sin(np.pi / 6), rel=1e-12)
    assert np.abs(area_vectors(mesh.points[mesh.skin]).sum(axis=0)).max() < 1e-13
    assert len(mesh.skin) == sum(len(faces) for faces in mesh.markers.values())


def test_nodes_that_blocks_share_are_one_and_come_back_in_the_order_of_the_grid():
    grid = wedge_and_box()
    mesh = mesh_of(grid)
    n_axis = 3 * 6  # each node of the axis stands seven times in its block
    n_shared = 4 * 3  # of both blocks, on the half plane where they meet
    assert mesh.n_points == grid.n_nodes - n_axis - n_shared
    np.testing.assert_array_equal(mesh.nodes_of_file(mesh.points).ravel(), grid.to_vector())


def test_markers_are_the_faces_of_their_patches_and_look_out_of_one_cell_each():
    grid = onera_m6_grid((7, 6, 5))
    mesh = mesh_of(grid)
    for patch in grid.patches:
        assert len(mesh.into_fluid(mesh.markers[patch.name])) == len(mesh.markers[patch.name])
    assert set(mesh.markers) == {patch.name for patch in grid.patches}


def test_a_plane_grid_has_the_nodes_of_its_file_twice_and_no_markers_in_its_planes():
    plane = wedge_and_box()
    blocks = tuple(replace(block, nodes=block.nodes[:, :, [1]] * [1.0, 1.0, 0.0]) for block in plane.blocks)
    grid = Grid(blocks)
    lifted = lift_plane_grid(grid)
    topology = find_topology(lifted)
    names = {face.window: "edge" for face in topology.boundary}
    mesh = grid_mesh(lifted, topology, names, lifted.dialect.directions)
    n = mesh.n_stored
    assert (mesh.n_copies, mesh.n_points) == (2, 2 * n)
    assert n == grid.n_nodes - 6 - 4
    np.testing.assert_array_equal(mesh.nodes_of_file(mesh.points).ravel(), grid.to_vector())
    assert np.ptp(mesh.points[n:] - mesh.points[:n], axis=0).max() < 1e-15
    assert not mesh.quality().is_inverted.any()
    edges = mesh.markers["edge"]
    assert ((edges >= n).sum(axis=1) == 2).all()
    assert len(edges) == 6 + 3 + (4 + 3 + 4)
