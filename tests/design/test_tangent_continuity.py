"""Seams stay smooth, whatever the variables do: on balls, at the nose of a wing, with straight and curved knots."""

import numpy as np
import pytest

from bspline_mdao import TangentContinuity, ball_grid, fit_grid, moving_mesh, onera_m6_grid, seam_continuity
from bspline_mdao.design.elimination import eliminate
from bspline_mdao.design.selection import InBox
from bspline_mdao.mesh.seams import seams_of_mesh


def kinks_at_places(mesh, points, where=None):
    """Angles (deg) between both sides at the places of all control points inside of seams."""
    found = []
    for seam in seams_of_mesh(mesh):
        t = seam.first.greville()[1:-1]
        own, jets = points[seam.first.line(0)], [edge.weights(t) for edge in (seam.first, seam.second)]
        sides = [w[0] @ points[e.line(1)] + w[1] @ own for w, e in zip(jets, (seam.first, seam.second))]
        tangent = jets[0][2] @ own
        a, b = np.cross(sides[0], tangent), np.cross(tangent, sides[1])
        kinks = np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))
        found.append(kinks if where is None else kinks[np.isin(seam.first.line(0)[1:-1], where)])
    return np.concatenate(found)


def moved_at_random(mesh, constraint, points, size):
    elimination = eliminate(mesh, points, [constraint])
    d = size * np.random.default_rng(3).normal(size=points.shape)
    return points + (elimination.matrix @ d.ravel()).reshape(-1, 3), points + d


@pytest.fixture(scope="module")
def ball():
    return fit_grid(ball_grid((9, 9, 9, 9)))


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((17, 13, 13)), n_control=(13, 7, 7))


def surface_of(mesh):
    return mesh.points[mesh.surface_ids]


def test_a_snapped_ball_has_no_kink_at_any_place_and_random_moves_leave_it_so(ball):
    mesh, constraint = moving_mesh(ball), TangentContinuity()
    smooth = constraint.snapped(mesh, surface_of(mesh))
    assert kinks_at_places(mesh, surface_of(mesh)).max() > 0.1
    assert 1e-5 < np.abs(smooth - surface_of(mesh)).max() < 0.01
    assert kinks_at_places(mesh, smooth).max() < 1e-9
    held, free = moved_at_random(mesh, constraint, smooth, 0.02)
    assert kinks_at_places(mesh, held).max() < 1e-9
    assert kinks_at_places(mesh, free).max() > 10.0
    points = ball.control_points.copy()
    points[mesh.surface_ids] = held
    assert seam_continuity(ball, points)[0].max_kink < 1.0  # between the places as well


def test_the_nose_of_a_wing_stays_round_though_its_grid_lines_are_oblique_and_its_knots_curved(wing):
    mesh, nose = moving_mesh(wing), InBox(high=(0.855, None, None))
    points, near = surface_of(mesh), nose.rows(moving_mesh(wing))
    constraint = TangentContinuity(max_kink=30.0)
    smooth = constraint.snapped(mesh, points)
    edge = np.concatenate([s.first.line(0)[1:-1] for s in seams_of_mesh(mesh)])
    is_nose = edge[(kinks_at_places(mesh, points) < 30.0) & np.isin(edge, near)]
    assert len(is_nose) >= 3
    assert kinks_at_places(mesh, points, is_nose).min() > 0.1
    assert kinks_at_places(mesh, smooth, is_nose).max() < 1e-7
    held, free = moved_at_random(mesh, constraint, smooth, 0.002)
    assert kinks_at_places(mesh, held, is_nose).max() < 1e-7
    assert kinks_at_places(mesh, free, is_nose).max() > 5.0
    assert np.abs(held[mesh.in_plane_rows, 2]).max() < 1e-12  # the root stays on the symmetry plane


def test_kinks_that_a_fit_has_do_not_grow_with_what_variables_do(ball):
    mesh = moving_mesh(ball)
    points = surface_of(mesh)
    held, _ = moved_at_random(mesh, TangentContinuity(), points, 0.01)
    assert kinks_at_places(mesh, held).max() < 1.5 * kinks_at_places(mesh, points).max()


def test_any_affine_move_is_smooth_and_passes(ball):
    mesh = moving_mesh(ball)
    points = surface_of(mesh)
    smooth = TangentContinuity().snapped(mesh, points)
    elimination = eliminate(mesh, smooth, [TangentContinuity()])
    affine = smooth @ np.random.default_rng(1).normal(size=(3, 3)) + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(elimination.matrix @ affine.ravel(), affine.ravel(), atol=1e-10)
