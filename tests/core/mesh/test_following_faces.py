"""Outer faces on which the design surface ends: curved ones follow it, all others do as they did."""

from dataclasses import replace

import numpy as np
import pytest
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    flare_grid,
    mesh_of,
)
from topology_cases import grid_of, patch, sphere_octants

from bspline_mdao.core.mesh.boundary import moving_grid
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.movers import LinearElasticity, Rotations, Transfinite

MOVES = {
    "thicker": lambda p: p * np.stack([1.0 + 0.0 * p[:, 0], 1.0 + 0.08 * p[:, 0], 1.0 + 0.08 * p[:, 0]], axis=1),
    "longer": lambda p: p * [1.1, 1.0, 1.0],
    "thinner and longer": lambda p: (
        p * np.stack([1.05 + 0.0 * p[:, 0], 1.0 - 0.05 * p[:, 0], 1.0 - 0.05 * p[:, 0]], axis=1)
    ),
}
"""Moves of the surface of `flare_grid` that keep it in its planes of symmetry."""


@pytest.mark.parametrize("kind", [Rotations, LinearElasticity])
@pytest.mark.parametrize("move", MOVES.values(), ids=MOVES)
def test_a_wall_that_ends_on_a_cone_moves_without_folding_cells(kind, move):
    n_tangled = {}
    for fixed in ((), "cone"):
        mesh = mesh_of(flare_grid(), fixed=fixed)
        moved = kind(mesh).move(mesh.points, move(mesh.points[mesh.surface_ids]))
        n_tangled[fixed] = mesh.tangled(moved.points).n_tangled
    assert n_tangled[()] == 0 < n_tangled["cone"]


def test_a_face_that_follows_stays_at_its_edges_to_fixed_ones_and_in_planes_of_symmetry():
    mesh = mesh_of(flare_grid())
    cone, far = mesh.blocks[0][-1], mesh.blocks[0][..., -1]
    assert mesh.is_free[cone[1:-1, 1:-1]].all()
    assert [what for what, _ in mesh.following] == ["patch 'cone'"]
    np.testing.assert_array_equal(mesh.is_free[cone[0, 1:-1]].sum(axis=-1), 2)
    assert not mesh.is_free[far].any()
    surface = MOVES["thicker"](mesh.points[mesh.surface_ids])
    shift = np.linalg.norm(Rotations(mesh).move(mesh.points, surface).points - mesh.points, axis=1)[cone]
    assert (np.diff(shift, axis=1) < 1e-3 * shift.max()).all()  # it fades from the wall to the far field
    assert (shift[:, -1] == 0.0).all()


@pytest.mark.parametrize("kind", [Rotations, LinearElasticity, Transfinite])
def test_derivatives_of_a_move_whose_outer_face_follows_are_exact_both_ways(kind):
    mesh = mesh_of(flare_grid((5, 4, 5)))
    movement = kind(mesh).move(mesh.points, MOVES["longer"](mesh.points[mesh.surface_ids]))
    assert_derivative_is_transposed(movement)
    assert_derivative_is_exact(kind(mesh), mesh.points, movement.points[mesh.surface_ids], tolerance=1e-9, scale=0.01)


def test_faces_of_a_periodic_pair_that_are_not_tied_stay_and_are_named_as_obstacles():
    grid = flare_grid(swirl=0.3)
    topology = replace(find_topology(grid), periodic=())
    mesh = moving_grid(topology, grid.to_vector().reshape(-1, 3))[0]
    assert [what for what, _ in mesh.obstacles] == ["patch 'side 2'", "patch 'side 3'"]
    assert not mesh.is_free[mesh.blocks[0][:, 0]].any()
    assert mesh.is_free[mesh.blocks[0][-1, 1:-1, 1:-1]].all()
    lone = flare_grid(swirl=0.3)
    lone.blocks[0].nodes[1:-1, -1, :, 0] += 0.01  # no rotation lays the one side onto the other any more
    assert not mesh_of(lone).obstacles


def test_a_face_that_is_collapsed_to_an_axis_stays():
    whole, sides = Window.whole(0, (4, 5, 6)), {0: "wall", 2: "other", 4: "symmetry", 5: "symmetry"}
    patches = [patch(kind, whole.face(side), name=f"side {side}") for side, kind in sides.items()]
    mesh = mesh_of(grid_of(sphere_octants()[0], patches=patches))
    assert not mesh.following
    assert not mesh.is_free[mesh.blocks[0][:, 0]].any()


def test_faces_that_are_fixed_by_name_stay():
    mesh = mesh_of(flare_grid(), fixed="cone")
    assert [what for what, _ in mesh.obstacles] == ["patch 'cone'"]
    assert not mesh.following
    assert not mesh.is_free[mesh.blocks[0][-1]].any()


@pytest.mark.parametrize(("make", "shape"), [(onera_m6_grid, (7, 7, 5)), (flat_plate_grid, (5, 5, 5))])
def test_grids_whose_walls_end_on_no_curved_face_move_as_with_all_else_fixed(make, shape):
    grid = make(shape)
    meshes = mesh_of(grid), mesh_of(grid, fixed="farfield")
    one, other = (Rotations(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * 1.1).points for mesh in meshes)
    np.testing.assert_array_equal(one, other)
    assert not meshes[0].following
