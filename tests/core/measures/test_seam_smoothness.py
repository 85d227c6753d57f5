"""Kinks and jumps of curvature across seams as constraints: their values, and their derivatives."""

from functools import cache

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.generators import ball_grid, brick_grid, onera_m6_grid
from bspline_mdao.measures import SeamSmoothness, seam_continuity
from bspline_mdao.movers import moving_mesh


@cache
def ball():
    return fit_grid(ball_grid((9, 9, 9, 5)), n_control=(6, 6, 4))


@cache
def wing():
    return fit_grid(onera_m6_grid((9, 9, 7)))


def moved(measure, size):
    return measure.points + size * np.random.default_rng(2).normal(size=measure.points.shape)


def test_kinks_and_jumps_are_those_that_are_measured_on_the_splines():
    model, mesh = ball(), moving_mesh(ball())
    points = model.control_points.copy()
    kinks, jumps = SeamSmoothness.kinks(model, mesh), SeamSmoothness.curvature_jumps(model, mesh)
    points[mesh.surface_ids] = surface = moved(kinks, 0.01)
    seams = seam_continuity(model, points, n_places=5)
    assert len(seams) == 12
    expected = np.sort(np.concatenate([seam.kinks for seam in seams]))
    np.testing.assert_allclose(np.sort(np.abs(kinks.evaluate(surface))), expected, rtol=1e-9)
    expected = np.sort(np.concatenate([np.abs(np.diff(seam.curvatures, axis=1)).ravel() for seam in seams]))
    np.testing.assert_allclose(np.sort(np.abs(jumps.evaluate(surface))), expected, rtol=1e-9)


def test_the_edges_of_a_brick_are_kinks_of_plus_ninety_degrees():
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    kinks = SeamSmoothness.kinks(model, moving_mesh(model), max_kink=100.0, n_places=2)
    np.testing.assert_allclose(kinks.evaluate(kinks.points), np.full(24, 90.0), atol=1e-9)


@pytest.mark.parametrize("make", [SeamSmoothness.kinks, SeamSmoothness.curvature_jumps])
@pytest.mark.parametrize("model", [ball, wing], ids=["straight knots", "curved knots"])
def test_derivatives_are_those_of_the_complex_step(make, model):
    measure = make(model(), moving_mesh(model()), max_kink=60.0, n_places=3)
    points = moved(measure, 1e-3)
    direction = np.random.default_rng(3).normal(size=points.shape)
    expected = measure.evaluate(points + 1e-30j * direction).imag / 1e-30
    found = measure.partials(points) @ direction.ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())
    assert np.abs(expected).min() > 0.0


def test_what_cannot_be_measured_is_refused():
    model, mesh = ball(), moving_mesh(ball())
    with pytest.raises(InputError, match="seams: 0 places along each; ask for at least 1"):
        SeamSmoothness.kinks(model, mesh, n_places=0)
    with pytest.raises(InputError, match="the mesh is not the control mesh of"):
        SeamSmoothness.kinks(model, moving_mesh(wing()))
    brick = fit_grid(brick_grid((5, 5, 5, 5)))
    with pytest.raises(InputError, match="no seam is smooth to 5 deg on the baseline; raise max_kink"):
        SeamSmoothness.kinks(brick, moving_mesh(brick))
