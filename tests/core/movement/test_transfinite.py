from dataclasses import replace

import numpy as np
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    bent_surface,
    both_sides,
    channel,
    channel_grid,
    mesh_of,
    opened,
    plate,
    rotation,
    wing,
)
from topology_cases import grid_of, patch

from bspline_mdao.core.movement.transfinite import Transfinite, free_corners
from bspline_mdao.grids.topology.index_space import Window


def test_affine_displacements_of_all_boundaries_are_reproduced_in_a_grid_of_boxes():
    mesh = mesh_of(channel_grid(rotation()), design="*")
    matrix, shift = np.random.default_rng(0).normal(size=(3, 3)), [0.1, 0.2, 0.3]
    moved = mesh.points @ matrix + shift
    points = Transfinite(mesh).move(mesh.points, moved[mesh.surface_ids]).points
    np.testing.assert_allclose(points, moved, atol=1e-14)


def test_the_order_of_the_blocks_does_not_matter_in_a_grid_of_boxes():
    mesh = channel()
    initial, surface = bent_surface(mesh)
    other = replace(mesh, blocks=mesh.blocks[::-1], names=mesh.names[::-1])
    points = Transfinite(mesh).move(initial, surface).points
    np.testing.assert_allclose(Transfinite(other).move(initial, surface).points, points, atol=1e-14)


def test_corners_between_two_known_ends_move_by_the_length_of_the_edges():
    boxes = channel_grid().blocks
    ends = {"left": Window(0, (0, 0, 0), (0, 4, 5)), "right": Window(1, (0, 5, 0), (4, 5, 5))}
    grid = grid_of(*(block.nodes for block in boxes), patches=[patch("wall", w, name=n) for n, w in ends.items()])
    sides = [Window(0, (0, 0, 0), (3, 0, 5)), Window(0, (0, 4, 0), (3, 4, 5)), Window(0, (0, 0, 0), (3, 4, 0))]
    sides += [Window(0, (0, 0, 5), (3, 4, 5)), Window(1, (0, 0, 0), (0, 5, 5)), Window(1, (4, 0, 0), (4, 5, 5))]
    sides += [Window(1, (0, 0, 0), (4, 5, 0)), Window(1, (0, 0, 5), (4, 5, 5))]
    grid = replace(grid, patches=(*grid.patches, patch("other", *sides)))
    mesh = mesh_of(grid, design="left", released="other")
    points = Transfinite(mesh).move(mesh.points, mesh.points[mesh.surface_ids] + [0.0, 0.0, 0.1]).points
    assert len(free_corners(mesh).ids) == 4
    np.testing.assert_allclose((points - mesh.points)[:, 2], 0.1 * (1.0 - mesh.points[:, 0] / 2.5), atol=1e-15)


def test_derivatives_about_a_wing_are_exact():
    mover = Transfinite(wing(), 2)
    initial, surface = bent_surface(mover.mesh)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


def test_the_coincident_sides_of_a_plate_take_their_own_blocks_along():
    mesh = plate()
    lower, upper = both_sides(mesh)
    np.testing.assert_array_equal(mesh.points[lower], mesh.points[upper])
    points = Transfinite(mesh).move(mesh.points, opened(mesh)).points
    moved = (points - mesh.points)[..., 1]
    below, above = (moved[mesh.blocks[b]][1:-1, 1:-1, 1:-1] for b in (1, 4))
    assert (below < 0.0).all()
    assert (above > 0.0).all()
