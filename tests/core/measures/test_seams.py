"""Kinks and curvatures across seams, of shapes of which they are known."""

import numpy as np
import pytest
from seam_cases import globe_grid

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.mesh.seams import seams_of_mesh
from bspline_mdao.core.splines.side import STRAIGHT
from bspline_mdao.generators import ball_grid, brick_grid, onera_m6_grid
from bspline_mdao.measures import pole_continuity, seam_continuity
from bspline_mdao.movers import moving_mesh


def ball(n):
    return fit_grid(ball_grid((n, n, n, 5)), n_control=((n + 1) // 2, (n + 1) // 2, 4))


def test_a_ball_loses_its_kinks_and_gets_the_curvature_of_its_radius_as_the_fit_gets_finer():
    found = []
    for n in (9, 17):
        seams = seam_continuity(ball(n))
        assert len(seams) == 12
        assert seams[0].max_kink == max(seam.max_kink for seam in seams)
        curvatures = np.concatenate([seam.curvatures for seam in seams])
        assert max(seam.max_jump for seam in seams) < 1e-9  # both sides are mirror images
        found.append((seams[0].max_kink, np.abs(curvatures + 1.0).max()))  # the normal points into the fluid
    (kink, error), (finer_kink, finer_error) = found
    assert finer_kink < kink / 2**3 < 0.2
    assert finer_error < error / 2**3 < 0.02


def test_the_edges_of_a_brick_are_kinks_of_ninety_degrees_between_flat_sides():
    seams = seam_continuity(fit_grid(brick_grid((5, 5, 5, 5))), n_places=3)
    assert len(seams) == 12
    np.testing.assert_allclose([seam.kinks for seam in seams], np.full((12, 3), 90.0), atol=1e-9)
    np.testing.assert_allclose([seam.curvatures for seam in seams], np.zeros((12, 3, 2)), atol=1e-9)


def test_weights_of_control_points_give_the_derivatives_of_both_sides_through_curved_knots():
    mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7))))
    points, t = mesh.points[mesh.surface_ids], np.sort(np.random.default_rng(1).random(7))
    bends = []
    for seam in seams_of_mesh(mesh):
        for edge in (seam.first, seam.second):
            inner, own, tangent = edge.weights(t)
            gradients = edge.side.gradients(*edge.uv(t))
            into = edge.inward * gradients[..., edge.axis]
            np.testing.assert_allclose(inner @ points[edge.line(1)] + own @ points[edge.line(0)], into, atol=1e-12)
            along = edge.along * gradients[..., 1 - edge.axis]
            np.testing.assert_allclose(tangent @ points[edge.line(0)], along, atol=1e-12)
            bends.append(np.ptp(edge.side.knots(1 - edge.axis, np.array([0.0, 1.0])), axis=0).max())
        ours, theirs = (edge.side.points(*edge.uv(t)) for edge in (seam.first, seam.second))
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    assert min(bends) > 1e3 * STRAIGHT


def test_poles_of_a_globe_get_flatter_as_the_fit_gets_finer_and_a_cone_has_its_angle():
    kinks = []
    for n in (7, 11):
        poles = pole_continuity(fit_grid(globe_grid(), n_control=(5, n, 4)))
        assert [abs(pole.point[2]) for pole in poles] == pytest.approx([1.0, 1.0])
        assert [len(pole.names) for pole in poles] == [4, 4]
        kinks.append(poles[0].kink)
    assert 0.0 < kinks[1] < kinks[0] / 2 < 0.5
    model = fit_grid(globe_grid(), n_control=(5, 7, 4))
    points, (pole,) = model.control_points.copy(), pole_continuity(model, patches="wall")[:1]
    tip = np.linalg.norm(points - pole.point, axis=1).argmin()
    points[tip] *= 1.5
    assert pole_continuity(model, points)[0].kink > 20.0


def test_wrong_places_and_patches_are_refused():
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    with pytest.raises(InputError, match="seams: 0 places along each; ask for at least 1"):
        seam_continuity(model, n_places=0)
    with pytest.raises(InputError, match="poles: 0 directions on each side; ask for at least 1"):
        pole_continuity(model, n_places=0)
    with pytest.raises(InputError, match="no patch is called 'tail'"):
        seam_continuity(model, patches="tail")
