"""Grids that move without splines, and slide on surfaces that are not planes."""

from functools import cache

import numpy as np
import pytest
from mover_cases import assert_derivative_is_transposed, mesh_of, rotation
from sliding_cases import SHIFT, lean, passage_grid, surface_of

from bspline_mdao.movers import (
    ComovingFrame,
    Cylinder,
    InverseDistance,
    LinearElasticity,
    Rotations,
    Transfinite,
)
from bspline_mdao.testing import central_difference

SLIDING = ["hub", "casing"]
MOVERS = {
    "elasticity": lambda mesh: LinearElasticity(mesh, n_increments=2),
    "rotations": lambda mesh: Rotations(mesh, n_repetitions=1),
    "transfinite": Transfinite,
    "inverse distance": lambda mesh: InverseDistance(mesh, n_increments=1),
    "in a frame": lambda mesh: ComovingFrame(Rotations(mesh)),
}


@cache
def passage_points(n_blocks=2):
    """Every node of a passage between a hub and a casing, in two blocks, turned out of the axes."""
    grid = passage_grid((9, 6, 7), contour=lambda x: 2.0 - 0.3 * x, turn=rotation(), n_blocks=n_blocks)
    return mesh_of(grid, design="blade", sliding=SLIDING)


def deformed(mesh):
    """Points of a blade that leans, and is stretched along the axis, so that it leaves the casing."""
    x = ((mesh.points[mesh.surface_ids] - SHIFT) @ rotation())[:, :1]
    return lean(mesh, 0.03, rotation()) + 0.02 * np.sin(np.pi * x / x.max()) * rotation()[:, 0]


def on(surface, points):
    return surface.distances(points) < 1e-12


@pytest.fixture(params=MOVERS)
def mover(request):
    return MOVERS[request.param](passage_points())


def test_points_end_on_their_surfaces_and_those_given_where_they_are_given(mover):
    mesh = mover.mesh
    surface = deformed(mesh)
    movement = mover.move(mesh.points, surface)
    is_edge = np.zeros(mesh.n_points, dtype=bool)
    for name in SLIDING:
        rows = on(surface_of(mesh, name), mesh.points)
        is_edge |= rows
        assert surface_of(mesh, name).distances(movement.points[rows]).max() < 1e-14
        assert np.linalg.norm(movement.points - mesh.points, axis=1)[rows].max() > 0.01
    at_casing = on(surface_of(mesh, "casing"), mesh.points[mesh.surface_ids])
    assert surface_of(mesh, "casing").distances(surface[at_casing]).max() > 1e-3
    for slide in mesh.slides[2:]:
        rows = on(slide.surface, mesh.points)
        assert slide.surface.distances(movement.points[rows]).max() < 1e-12
    inner = ~is_edge[mesh.surface_ids]
    np.testing.assert_allclose(movement.points[mesh.surface_ids[inner]], surface[inner], rtol=0.0, atol=1e-14)
    assert movement.report.increments[-1].n_tangled == 0


def test_at_rest_no_point_moves(mover):
    mesh = mover.mesh
    moved = mover.move(mesh.points, mesh.points[mesh.surface_ids]).points
    np.testing.assert_allclose(moved, mesh.points, rtol=0.0, atol=1e-14)


def test_derivatives_are_exact_and_transposed(mover):
    mesh, rng = mover.mesh, np.random.default_rng(7)
    surface, directions = deformed(mesh), []
    for x in (mesh.points, surface):
        directions.append(np.sin(x @ rng.normal(size=(3, 3))))
    initial = mesh.points + 1e-3 * np.sin(3.0 * mesh.points[:, ::-1])
    surface = surface + (initial - mesh.points)[mesh.surface_ids]
    movement = mover.move(initial, surface)
    exact = movement.jvp(*directions)
    differences = central_difference(
        lambda h: mover.move(initial + h * directions[0], surface + h * directions[1]).points, 1e-4, levels=3
    )
    np.testing.assert_allclose(exact, differences, atol=1e-8 * np.abs(exact).max())
    assert_derivative_is_transposed(movement, tolerance=1e-12)


def test_points_keep_their_heights_over_a_surface_that_is_given():
    tunnel = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.001)
    mesh = mesh_of(passage_grid((9, 6, 7)), design="blade", sliding={"casing": tunnel})
    moved = Rotations(mesh).move(mesh.points, lean(mesh, 0.03)).points
    rows = np.abs(np.linalg.norm(mesh.points[:, 1:], axis=1) - 2.0) < 1e-12
    np.testing.assert_allclose(tunnel.levels(moved[rows]).values, -1e-3, atol=1e-14)


def test_grids_of_which_nothing_slides_on_curved_surfaces_move_as_before():
    mesh = mesh_of(passage_grid((9, 6, 7)), design="blade")
    assert mesh.sliding_points is None
    assert Rotations(mesh).move(mesh.points, lean(mesh, 0.03)).slid is None
