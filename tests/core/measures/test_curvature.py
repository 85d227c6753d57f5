"""Curvature of patches against surfaces whose curvature is known."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_cases import assert_derivatives_are_exact, box, roughened, surface_of, turned, with_points

from bspline_mdao.errors import InputError
from bspline_mdao.measures import Curvature

KINDS = ("total", "mean", "gaussian")


def sheet(function, n, m, first=(0.0, 1.0), second=(0.0, 1.0)):
    """Sheet of points over unevenly divided parameters."""
    parameters = [graded(n, *first, 0.1), graded(m, *second, -0.15)]
    return np.stack(function(*np.meshgrid(*parameters, indexing="ij")), axis=-1)


def graded(n, low, high, bend):
    x = np.linspace(0.0, 1.0, n)
    return low + (high - low) * (x + bend * np.sin(np.pi * x))


def cubed_sphere(n):
    """Sphere of radius 1.5 of six blocks, smoothly divided."""
    s, t = np.meshgrid(graded(n, -1.0, 1.0, 0.1), graded(n, -1.0, 1.0, -0.1), indexing="ij")
    s, t = np.tan(0.25 * np.pi * s), np.tan(0.25 * np.pi * t)
    face = np.stack([s, t, np.ones_like(s)], axis=-1) / np.sqrt(1.0 + s * s + t * t)[..., None]
    return surface_of(*(1.5 * np.roll(sign * face, shift, axis=-1) for shift in range(3) for sign in (1.0, -1.0)))


def cylinder(n):
    """Part of a cylinder of radius 2 in skewed coordinates, of area 2 x 1 x 3."""
    return surface_of(sheet(lambda s, t: (2.0 * np.cos(s), 2.0 * np.sin(s), 3.0 * t + 0.2 * s), n, n + 2))


def ball(n):
    """Part of a sphere of radius 2 without its poles."""
    return surface_of(sheet(on_ball, n, n + 3, first=(0.3, 1.2), second=(0.0, 1.5)))


def on_ball(s, t):
    return 2.0 * np.sin(s) * np.cos(t), 2.0 * np.sin(s) * np.sin(t), 2.0 * np.cos(s)


BALL_AREA = 4.0 * 1.5 * (np.cos(0.3) - np.cos(1.2))
KNOWN = [
    (cylinder, "total", 6.0 / 4.0, 1.0 / 4.0),
    (cylinder, "mean", 6.0 / 16.0, 1.0 / 16.0),
    (ball, "total", BALL_AREA / 2.0, 1.0 / 2.0),
    (ball, "mean", BALL_AREA / 4.0, 1.0 / 4.0),
    (ball, "gaussian", BALL_AREA / 4.0, 1.0 / 4.0),
]


def value(measure):
    return measure.evaluate(measure.surface.points).item()


@pytest.mark.parametrize(("shape", "kind", "integral", "density"), KNOWN)
def test_curvature_of_cylinder_and_sphere_is_of_second_order(shape, kind, integral, density):
    measures = [Curvature.integral(shape(n), kind) for n in (17, 33, 65)]
    errors = np.abs([value(measure) / integral - 1.0 for measure in measures])
    assert errors[-1] < 1e-3
    assert (np.log2(errors[:-1] / errors[1:]) > 1.8).all()
    pointwise = np.array([np.abs(m.densities(m.surface.points) / density - 1.0).max() for m in measures])
    assert pointwise[-1] < 1e-2
    assert (np.log2(pointwise[:-1] / pointwise[1:]) > 1.7).all()


@pytest.mark.parametrize("kind", ["mean", "gaussian"])
def test_a_cylinder_has_mean_curvature_and_no_gaussian_one(kind):
    surface = cylinder(33)
    densities = Curvature.integral(surface, kind).densities(surface.points)
    np.testing.assert_allclose(densities, 1.0 / 16.0 if kind == "mean" else 0.0, atol=2e-3)


def test_gaussian_curvature_of_a_sphere_of_blocks_integrates_to_four_pi():
    errors = [abs(value(Curvature.integral(cubed_sphere(n), "gaussian")) / (4.0 * np.pi) - 1.0) for n in (9, 17)]
    assert errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) > 1.8


def test_a_plane_has_no_curvature():
    surface = box((5, 6, 7))
    for kind in KINDS:
        assert abs(value(Curvature.integral(surface, kind))) < 1e-12
    with pytest.raises(InputError, match="nothing to be relative to"):
        Curvature.integral(surface, relative=True)


@pytest.mark.parametrize("kind", KINDS)
def test_the_integral_depends_neither_on_size_nor_on_place(kind):
    measure = Curvature.integral(with_points(ball(9), roughened(ball(9), 3e-3)), kind)
    moved = turned(measure.surface)
    np.testing.assert_allclose(
        measure.evaluate(3.7 * moved.points), measure.evaluate(measure.surface.points), rtol=1e-11
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rho", [5.0, 100.0])
def test_the_bound_is_above_the_largest_by_no_more_than_it_says(kind, rho):
    surface = with_points(ball(7), roughened(ball(7), 2e-3))
    measure = Curvature.largest(surface, kind, rho=rho)
    densities = measure.densities(surface.points)
    excess = value(measure) - densities.max()
    assert 0.0 <= excess <= np.log(len(densities)) / rho * np.abs(densities).max()


def test_nodes_of_a_collapsed_edge_are_left_out():
    whole = surface_of(sheet(on_ball, 33, 36, first=(0.0, 1.2), second=(0.0, 1.5)))
    measure = Curvature.integral(whole)
    assert len(measure.weights) == 32 * 36
    np.testing.assert_allclose(value(measure), 3.0 * (1.0 - np.cos(1.2)), rtol=3e-3)


def test_only_the_patches_that_are_named_count():
    both = surface_of(sheet(on_ball, 9, 8, first=(0.3, 1.0)), sheet(lambda s, t: (s, t, 5.0 + s * t), 7, 6))
    both = replace(both, patches=("ball", "saddle"))
    parts = [value(Curvature.integral(both, patches=name)) for name in ("ball", "saddle")]
    np.testing.assert_allclose(sum(parts), value(Curvature.integral(both)), rtol=1e-13)
    assert min(parts) > 0.1
    assert value(Curvature.integral(both, "gaussian", patches="saddle")) < 0.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", [Curvature.integral, Curvature.largest])
@pytest.mark.parametrize("relative", [False, True])
def test_derivatives_are_exact(kind, make, relative):
    surface = surface_of(sheet(on_ball, 6, 5, first=(0.3, 1.2)), sheet(on_ball, 4, 3, first=(1.2, 1.5)))
    assert_derivatives_are_exact(make(surface, kind, relative=relative), size=3e-3)


def test_relative_measures_are_one_on_the_baseline_and_have_no_units():
    for make in (Curvature.integral, Curvature.largest):
        measure = make(ball(7), relative=True)
        assert value(measure) == pytest.approx(1.0, rel=1e-14)
        assert measure.units is None
    assert Curvature.largest(ball(7)).units == "1/m**2"


def test_what_cannot_be_measured_is_refused():
    with pytest.raises(InputError, match="no kind 'torsion'; choose from total, mean, gaussian"):
        Curvature.integral(ball(7), "torsion")
    with pytest.raises(InputError, match="block 1, wall is less than 3 nodes wide"):
        Curvature.integral(surface_of(sheet(on_ball, 2, 5)))
    with pytest.raises(InputError, match="give a positive number"):
        Curvature.largest(ball(7), rho=-1.0)
