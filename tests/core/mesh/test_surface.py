"""The regenerated surface: which nodes it has, how it is oriented, and how it follows the surface control points."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.core.mesh.surface_map import SurfaceMap
from bspline_mdao.errors import InputError
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((9, 8, 7)))


@pytest.fixture(scope="module")
def plate():
    return fit_grid(flat_plate_grid((9, 8, 7)))


def area_vectors(surface):
    a, b, c, d = np.moveaxis(surface.points[surface.quads], 1, 0)
    return 0.5 * np.cross(c - a, d - b)


def shell(permutation, flips):
    """One block about a half cylinder of radius 1, its index directions permuted and reversed."""
    r, angle, z = np.meshgrid(np.linspace(1, 3, 5), np.linspace(0, np.pi, 9), np.linspace(0, 2, 6), indexing="ij")
    nodes = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)
    nodes = nodes.transpose(*permutation, 3)[tuple(slice(None, None, -1 if flip else 1) for flip in flips)]
    direction = permutation.index(0)
    window = Window.whole(0, nodes.shape).face(2 * direction + flips[direction])
    return Grid((Block(np.ascontiguousarray(nodes), "block 1"),), (Patch("wall", "wall", (window,)),), "half cylinder")


@pytest.mark.slow
@pytest.mark.parametrize("permutation", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("flips", [(False, False, False), (True, False, False), (False, True, True)])
def test_quads_face_the_fluid_in_blocks_of_any_orientation(permutation, flips):
    surface = SurfaceGrid.of(fit_grid(shell(permutation, flips), n_control=4))
    centres = surface.points[surface.quads].mean(axis=1)
    assert (np.sum(area_vectors(surface)[:, :2] * centres[:, :2], axis=1) > 0.0).all()


@pytest.mark.slow
def test_a_closed_body_cut_by_a_plane_leaves_only_the_hole_in_the_plane(wing):
    surface = SurfaceGrid.of(wing)
    hole = area_vectors(surface).sum(axis=0)
    np.testing.assert_allclose(hole[:2], 0.0, atol=1e-14)
    assert hole[2] > 0.01  # the root section, seen from inside


@pytest.mark.slow
def test_every_node_is_there_once_and_in_the_grid(wing):
    surface = SurfaceGrid.of(wing)
    assert len(np.unique(surface.rows)) == len(np.unique(surface.points, axis=0)) == surface.n_points
    assert np.array_equal(np.unique(surface.quads), np.arange(surface.n_points))
    np.testing.assert_array_equal(wing.regenerate().to_vector().reshape(-1, 3)[surface.rows], surface.points)


@pytest.mark.slow
def test_the_two_sides_of_a_plate_are_not_glued(plate):
    upper, lower = SurfaceGrid.of(plate, "wing_upper"), SurfaceGrid.of(plate, "wing_lower")
    both = SurfaceGrid.of(plate, ["wing_*"])
    n_shared = upper.n_points + lower.n_points - both.n_points
    n_stream, n_span = 9, 7
    assert n_shared == 2 * n_span + n_stream - 2  # leading edge, trailing edge and tip alone


@pytest.mark.slow
@pytest.mark.parametrize("keep_residual", [True, False])
def test_the_map_gives_the_nodes_of_the_grid(keep_residual):
    model = fit_grid(onera_m6_grid((9, 8, 7)), n_control=(5, 6, 4), keep_residual=keep_residual)
    mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
    moved = model.control_points.copy()
    moved[mesh.surface_ids] += np.random.default_rng(1).normal(scale=0.01, size=(len(mesh.surface_ids), 3))
    nodes = model.regenerate(moved).to_vector().reshape(-1, 3)[surface.rows]
    mapped = SurfaceMap.of(model, mesh, surface).apply(moved[mesh.surface_ids])
    assert np.abs(nodes - surface.points).max() > 0.01
    np.testing.assert_allclose(mapped, nodes, atol=1e-14)


@pytest.mark.slow
def test_points_that_are_held_are_part_of_the_map(wing):
    mesh, surface = moving_mesh(wing, design="wing_upper"), SurfaceGrid.of(wing)
    surface_map = SurfaceMap.of(wing, mesh, surface)
    np.testing.assert_allclose(surface_map.apply(wing.control_points[mesh.surface_ids]), surface.points, atol=1e-14)


@pytest.mark.slow
def test_nodes_that_a_mover_decides_are_refused(wing):
    with pytest.raises(InputError, match=r"symmetry depends on point \(.*\) of block .* not on the design surface"):
        SurfaceMap.of(wing, moving_mesh(wing), SurfaceGrid.of(wing, "symmetry*"))


@pytest.mark.slow
def test_a_mesh_of_another_model_is_refused(wing):
    other = moving_mesh(fit_grid(onera_m6_grid((7, 7, 7)), n_control=(4, 5, 4)))
    with pytest.raises(InputError, match="the mesh is not the control mesh of H-H wing grid; make it with moving_mesh"):
        SurfaceMap.of(wing, other, SurfaceGrid.of(wing))


def test_faces_are_found_by_patch(wing):
    surface = SurfaceGrid.of(wing)
    assert sorted(surface.part("wing_upper") + surface.part("wing_lower")) == list(range(len(surface.faces)))
    with pytest.raises(InputError, match="no patch is called 'tail'; the patches are wing_lower, wing_upper"):
        surface.part("tail")


def test_a_patch_that_does_not_exist_is_refused(wing):
    with pytest.raises(InputError, match="no patch is called 'fin"):
        SurfaceGrid.of(wing, "fin*")


def test_a_grid_without_walls_has_no_surface(wing):
    boundary = tuple(replace(face, kind="far field") for face in wing.topology.boundary)
    with pytest.raises(InputError, match="no patch is a wall"):
        SurfaceGrid.of(replace(wing, topology=replace(wing.topology, boundary=boundary)))
