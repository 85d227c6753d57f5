import numpy as np
import pytest
from mover_cases import (
    assert_derivative_is_transposed,
    bent_surface,
    both_sides,
    channel,
    channel_grid,
    irregular,
    mesh_of,
    opened,
    plate,
    rotation,
)

from bspline_mdao.core.movement.delaunay import DelaunayGraph, signed_volumes, tetrahedra
from bspline_mdao.errors import MovementError


def test_affine_displacements_of_all_boundaries_are_reproduced():
    mesh = mesh_of(channel_grid(rotation()), design="*")
    matrix, shift = np.eye(3) + 0.2 * np.random.default_rng(0).normal(size=(3, 3)), [0.1, 0.2, 0.3]
    moved = mesh.points @ matrix + shift
    points = DelaunayGraph(mesh).move(mesh.points, moved[mesh.surface_ids]).points
    np.testing.assert_allclose(points, moved, atol=1e-13)


@pytest.mark.slow
def test_one_increment_is_linear_in_the_surface():
    mesh = plate()
    change = 1e-3 * np.random.default_rng(0).normal(size=(2, len(mesh.surface_ids), 3)) * [1.0, 1.0, 0.0]
    start = mesh.points[mesh.surface_ids]
    one, two, both = (
        DelaunayGraph(mesh).move(mesh.points, start + c).points - mesh.points for c in (*change, change.sum(axis=0))
    )
    np.testing.assert_allclose(one + two, both, atol=1e-14)


def test_derivatives_about_a_plate_are_transposed():
    mover = DelaunayGraph(plate(), 4)
    assert_derivative_is_transposed(mover.move(*bent_surface(mover.mesh, size=0.05)))


@pytest.mark.slow
def test_several_increments_may_connect_the_graph_anew_where_one_does_not():
    mesh = channel()
    initial = irregular(mesh)
    way = bent_surface(mesh, size=0.02)[1] - mesh.points[mesh.surface_ids]

    def along(n_increments, t):
        surface = initial[mesh.surface_ids] + t * way
        return DelaunayGraph(mesh, n_increments).move(initial, surface).jvp(np.zeros_like(initial), way)

    def largest_jump(n_increments):
        slopes = [along(n_increments, t) for t in np.linspace(0.0, 1.0, 9)]
        return max(np.abs(b - a).max() for a, b in zip(slopes, slopes[1:]))

    assert largest_jump(1) < 1e-12
    assert largest_jump(3) > 1e-3


def test_the_coincident_sides_of_a_plate_take_their_own_blocks_along():
    mesh = plate()
    lower, upper = both_sides(mesh)
    assert (mesh.points[lower] == mesh.points[upper]).all()
    points = DelaunayGraph(mesh).move(mesh.points, opened(mesh)).points
    moved = (points - mesh.points)[..., 1]
    below, above = (moved[mesh.blocks[b]][1:-1, 1:-1, 1:-1] for b in (1, 4))
    assert (below < 1e-15).all()
    assert (above > -1e-15).all()
    assert below.min() < -0.05
    assert above.max() > 0.05


def test_an_inverted_graph_is_told_with_the_increment():
    mesh = channel()
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.0, 0.6]
    with pytest.raises(
        MovementError, match=r"increment 1 of 1: Delaunay graph: the tetrahedron that holds point \(.*\) of block 1"
    ):
        DelaunayGraph(mesh).move(mesh.points, surface + [0.0, 0.0, 0.6])
    with pytest.raises(MovementError, match="increment 4 of 5"):
        DelaunayGraph(mesh, 5).move(mesh.points, surface + [0.0, 0.0, 0.6])


def test_points_that_the_graph_does_not_hold_are_told():
    mesh = channel(released=("farfield",))
    with pytest.raises(MovementError, match="span no volume"):
        DelaunayGraph(mesh).move(mesh.points, mesh.points[mesh.surface_ids])
    initial = mesh.points.copy()
    initial[mesh.surface_ids, 2] -= 0.1 * np.sin(initial[mesh.surface_ids, 0])
    with pytest.raises(MovementError, match="fix the boundary about it"):
        DelaunayGraph(mesh).move(initial, initial[mesh.surface_ids])


def test_every_target_is_found_and_the_tetrahedra_fill_the_hull():
    random = np.random.default_rng(0)
    corners = np.stack(np.meshgrid([0.0, 1.0], [0.0, 2.0], [0.0, 3.0]), axis=-1).reshape(-1, 3)
    points = np.concatenate([corners, random.uniform(0.1, 0.9, (30, 3)) * [1.0, 2.0, 3.0]])
    targets = random.uniform(0.0, 1.0, (50, 3)) * [1.0, 2.0, 3.0]
    targets[:20, 0] = 1.0  # on the hull
    graph, which = tetrahedra(points, targets)
    weights = graph.coordinates(which, targets)
    assert weights.min() > -1e-12
    np.testing.assert_allclose(np.einsum("nm,nmd->nd", weights, points[graph.corners[which]]), targets, atol=1e-13)
    volumes = signed_volumes(points, graph.corners)
    assert (volumes > 0.0).all()
    np.testing.assert_allclose(volumes.sum() / 6.0, 6.0)
