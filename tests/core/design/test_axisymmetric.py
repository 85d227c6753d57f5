"""Factors on the distance from an axis, and on lengths along it."""

import numpy as np
import pytest
from parametrization_cases import surface_of, wing_model

from bspline_mdao import InputError
from bspline_mdao.core.design.axisymmetric import ScaleRadius, StretchAlong
from bspline_mdao.core.design.deformation import amount_jvp, jvp, vjp
from bspline_mdao.design import Parametrization, RadiusFactor, parse_deformation
from bspline_mdao.grids.topology.periodic_pair import Motion
from bspline_mdao.movers import moving_mesh

AXIS = np.array([[0.3, -0.2, 0.1], [0.9, 0.4, 1.3]])
ALONG = (AXIS[1] - AXIS[0]) / np.linalg.norm(AXIS[1] - AXIS[0])
STEP = 1e-40


def cylindrical(points):
    """Places along the axis and distances from it (m), and directions from it."""
    x = (points - AXIS[0]) @ ALONG
    across = points - AXIS[0] - np.outer(x, ALONG)
    r = np.linalg.norm(across, axis=1)
    return x, r, across / r[:, None]


def cloud(n=37, seed=0):
    return AXIS[0] + np.random.default_rng(seed).normal(size=(n, 3))


def test_distances_are_scaled_and_places_along_and_around_stay():
    points = cloud()
    before, after = cylindrical(points), cylindrical(ScaleRadius(AXIS, 1.3).apply(points))
    np.testing.assert_allclose(after[0], before[0], atol=1e-14)
    np.testing.assert_allclose(after[1], 1.3 * before[1], rtol=1e-13)
    np.testing.assert_allclose(after[2], before[2], atol=1e-13)


def test_between_ends_the_factor_is_whole_in_the_middle_and_none_beyond():
    points, length = cloud(400), np.linalg.norm(AXIS[1] - AXIS[0])
    before, after = cylindrical(points), cylindrical(ScaleRadius(AXIS, 1.3, (0.2, 0.8)).apply(points))
    factor, part = after[1] / before[1], before[0] / length
    is_outside = (part <= 0.2) | (part >= 0.8)
    np.testing.assert_allclose(factor[is_outside], 1.0, rtol=1e-14)
    inside = np.clip((part - 0.2) / 0.6, 0.0, 1.0)
    np.testing.assert_allclose(factor, 1.0 + 0.3 * (4.0 * inside * (1.0 - inside)) ** 2, rtol=1e-12)
    assert factor.max() > 1.25


def test_lengths_along_the_axis_are_scaled_from_its_first_point():
    points = cloud()
    before, after = cylindrical(points), cylindrical(StretchAlong(AXIS, 1.7).apply(points))
    np.testing.assert_allclose(after[0], 1.7 * before[0], rtol=1e-12)
    np.testing.assert_allclose(after[1], before[1], rtol=1e-12)


@pytest.mark.parametrize("point_map", [ScaleRadius(AXIS, 1.3, (0.1, 0.7)), StretchAlong(AXIS, 0.6)])
def test_derivatives_are_exact(point_map):
    points, rng = cloud(), np.random.default_rng(1)
    change, bar = rng.normal(size=(2, *points.shape))
    exact = point_map.apply(points + 1j * STEP * change).imag / STEP
    np.testing.assert_allclose(jvp(point_map, points, change), exact, atol=1e-13)
    assert np.sum(vjp(point_map, points, bar) * change) == pytest.approx(np.sum(bar * exact), rel=1e-12)
    assert np.abs(amount_jvp(point_map, points)).max() > 0.1


def test_copies_by_a_rotation_about_the_axis_stay_copies():
    mesh = moving_mesh(wing_model())
    shape, points, rng = (
        Parametrization(mesh, [RadiusFactor("radius", AXIS, 5)]),
        surface_of(mesh),
        np.random.default_rng(2),
    )
    motion = Motion.about(ALONG, 0.7, AXIS[0] - Motion(tuple(ALONG), 0.7).turn(AXIS[:1])[0], 1e-12)
    values = {"radius": 1.0 + 0.2 * rng.normal(size=5)}
    bound = shape.maps["radius"]
    moved = bound.apply(points, values["radius"])
    np.testing.assert_allclose(bound.apply(motion.move(points), values["radius"]), motion.move(moved), atol=1e-13)


def test_words_are_understood_and_wrong_ones_named():
    model = wing_model()
    mesh = moving_mesh(model)
    points = surface_of(mesh)
    words = "radius=1.2@axis(0.3,-0.2,0.1 -> 0.9,0.4,1.3),along=0.2:0.8+axial=1.5@axis(0,0,0 -> 2,0,0)"
    first, second = parse_deformation(words, model, mesh).maps
    np.testing.assert_allclose(first.apply(points), ScaleRadius(AXIS, 1.2, (0.2, 0.8)).apply(points), atol=1e-15)
    np.testing.assert_allclose(second.apply(points), points * [1.5, 1.0, 1.0], atol=1e-15)
    for words, complaint in (
        ("radius=1.2", r"no axis is named; write @axis\(x,y,z -> x,y,z\)$"),
        ("radius=0@axis(0,0,0 -> 1,0,0)", "0 is out of bounds; give a number above 0"),
        ("radius=2@axis(0,0,0 -> 0,0,0)", "axis: both of its points are"),
        ("radius=2@axis(0,0,0 -> 1,0,0),along=0.8:0.2", "along '0.8:0.2' is not two rising parts"),
        ("axial=2@axis(0,0,0 -> 1,0,0),along=0:1", "'along' is not known here; axial takes @"),
    ):
        with pytest.raises(InputError, match=complaint):
            parse_deformation(words, model, mesh)


def test_what_is_no_axis_of_a_variable_is_named():
    with pytest.raises(InputError, match=r"'radius': an axis of shape \(3,\); give two points"):
        RadiusFactor("radius", (1.0, 0.0, 0.0))
    with pytest.raises(InputError, match="'radius': both points of the axis are the same"):
        RadiusFactor("radius", [(1.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    with pytest.raises(InputError, match="stations: 0 of them"):
        RadiusFactor("radius", AXIS, stations=0)
