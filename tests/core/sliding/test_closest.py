"""Fixed surfaces, and closest points on them and on the curves in which they meet."""

import numpy as np
import pytest

from bspline_mdao.core.sliding.fixed_surface import Plane
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.movers import Cone, Cylinder, Revolution, Sphere, SplineSurface, closest_on
from bspline_mdao.testing import central_difference

X = np.linspace(-2.0, 4.0, 23)
AXIS = {"origin": (0.3, -0.2, 0.1), "direction": (1.0, 0.3, -0.2)}
U, V = np.meshgrid(X[4:-4], np.linspace(-1.0, 2.0, 21), indexing="ij")
RADIUS = 1.3 + 0.2 * np.sin(U) + 0.1 * np.cos(2.0 * V)
BARREL = np.stack([U, RADIUS * np.cos(V), RADIUS * np.sin(V)], axis=-1)
SURFACES = {
    "cylinder": Cylinder(**AXIS, radius=1.3),
    "cone": Cone((-3.0, 0.2, 0.1), (2.0, 0.3, -0.2), 0.4),
    "sphere": Sphere((0.1, 0.2, -0.3), 1.7),
    "spline": SplineSurface(BARREL),
    "revolution": Revolution(**AXIS, profile=np.column_stack([X, 1.4 + 0.2 * np.sin(1.3 * X)])),
}
PLANE = Plane(np.array([0.6, 0.0, 0.8]), 0.35)  # neither through an axis nor normal to it
ON = [pytest.param(name, n, id=f"{name}, {n}") for name in SURFACES for n in (1, 2)]


def points_near(seed, chosen=(), n=7):
    """Points beside surfaces, by a fifth of their size."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=(n, 3)) * [0.4, 0.2, 0.2] + [0.2, 0.9, 0.4]
    return closest_on(chosen, start).points + 0.2 * rng.normal(size=(n, 3)) if chosen else start


def constraints(name, n):
    """A surface, alone or with a plane that cuts it at an angle."""
    return [SURFACES[name], PLANE][:n]


@pytest.mark.parametrize("name", SURFACES)
def test_gradients_and_hessians_are_those_of_the_function(name):
    surface, points, rng = SURFACES[name], points_near(0), np.random.default_rng(1)
    direction = rng.normal(size=points.shape)
    levels, step = surface.levels(points), surface.levels(points + 1e-30j * direction)
    np.testing.assert_allclose(step.values.imag / 1e-30, (levels.gradients * direction).sum(axis=1), rtol=1e-13)
    change = np.einsum("nij,nj->ni", levels.hessians, direction)
    np.testing.assert_allclose(step.gradients.imag / 1e-30, change, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(step.hessians.real, levels.hessians, rtol=1e-13)
    for part, exact in (("values", step.values), ("gradients", step.gradients)):
        slope = central_difference(
            lambda h, part=part: getattr(surface.levels(points + h * direction), part), 1e-3, levels=3
        )
        np.testing.assert_allclose(slope, exact.imag / 1e-30, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("name", "n"), ON)
def test_closest_points_are_on_all_surfaces_and_no_others_nearby_are_closer(name, n):
    chosen, rng = constraints(name, n), np.random.default_rng(3)
    points = points_near(2, chosen)
    found = closest_on(chosen, points).points
    assert max(surface.distances(found).max() for surface in chosen) < 1e-14
    distances = np.linalg.norm(found - points, axis=1)
    assert distances.min() > 1e-3
    for _ in range(5):
        others = closest_on(chosen, found + 1e-2 * rng.normal(size=found.shape)).points
        assert (np.linalg.norm(others - points, axis=1) > distances).all()


@pytest.mark.parametrize(("name", "n"), ON)
def test_derivatives_of_closest_points_are_exact_and_their_own_transpose(name, n):
    chosen, rng = constraints(name, n), np.random.default_rng(5)
    points = points_near(4, chosen)
    direction, bar = rng.normal(size=points.shape), rng.normal(size=points.shape)
    closest = closest_on(chosen, points)
    step = closest_on(chosen, points + 1e-30j * direction).points.imag / 1e-30
    np.testing.assert_allclose(closest.jvp(direction), step, rtol=1e-12, atol=1e-13)
    differences = central_difference(lambda h: closest_on(chosen, points + h * direction).points, 1e-3, levels=3)
    np.testing.assert_allclose(step, differences, rtol=1e-8, atol=1e-8)
    assert abs(np.vdot(closest.jvp(direction), bar) - np.vdot(direction, closest.vjp(bar))) < 1e-13


@pytest.mark.parametrize(("name", "n"), ON)
def test_points_at_rest_stay_to_the_last_bit_however_far_off_they_are(name, n):
    chosen = constraints(name, n)
    points = points_near(6, chosen)
    heights = np.array([surface.levels(points).values for surface in chosen])
    np.testing.assert_array_equal(closest_on(chosen, points, heights).points, points)


def test_heights_above_a_surface_are_kept():
    surface, points = SURFACES["cone"], points_near(7)
    heights = np.linspace(-0.2, 0.3, len(points))[None]
    found = closest_on([surface], points, heights).points
    np.testing.assert_allclose(surface.levels(found).values, heights[0], atol=1e-15)


def test_a_point_on_three_surfaces_has_nowhere_to_go():
    chosen = [SURFACES["cylinder"], PLANE, Plane(np.array([0.0, 1.0, 0.0]), 0.4)]
    closest = closest_on(chosen, np.array([[0.1, 0.45, 1.2]]))
    assert np.abs(closest.jacobians).max() < 1e-14
    assert max(surface.distances(closest.points).max() for surface in chosen) < 1e-14


def test_a_surface_through_points_has_them_and_one_of_a_saddle_is_it():
    assert SURFACES["spline"].distances(BARREL.reshape(-1, 3)).max() < 1e-14
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 7), np.linspace(-2.0, 1.0, 9), indexing="ij")
    rng = np.random.default_rng(8)
    at = rng.uniform(-0.8, 0.8, (20, 2))
    saddle = SplineSurface(np.stack([x, y, x * y], axis=-1))
    assert saddle.distances(np.column_stack([at, at.prod(axis=1)])).max() < 1e-14
    with pytest.raises(MovementError, match=r"no point of it is near \[5.0, 5.0, 0.0\]; give a surface that continues"):
        saddle.levels(np.array([[5.0, 5.0, 0.0]]))


def test_points_without_a_closest_one_are_refused():
    ring, beyond = Revolution((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.column_stack([X, 1.0 + X**2])), [[0.0, 3.0, 0.0]]
    with pytest.raises(
        MovementError, match=r"casing: the node taken to .* has no closest point nearby; take a smaller"
    ):
        closest_on([ring], np.array(beyond), what="casing")  # farther off than the middle of its curvature
    tunnel = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0)
    with pytest.raises(MovementError, match=r"cylinder: the point \[3.0, 0.0, 0.0\] is on the axis"):
        closest_on([tunnel], np.array([[3.0, 0.0, 0.0]]))
    with pytest.raises(MovementError, match="a point is at its centre"):
        closest_on([Sphere((1.0, 2.0, 3.0), 1.0)], np.array([[1.0, 2.0, 3.0]]))
    aside = Plane(np.array([0.0, 0.0, 1.0]), 5.0)
    with pytest.raises(MovementError, match="casing: "):
        closest_on([tunnel, aside], np.array([[0.1, 0.2, 1.9]]), what="casing")  # the two do not meet


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0), "cylinder: direction"),
        (lambda: Cylinder((0.0, 0.0), (0.0, 0.0, 1.0), 1.0), "cylinder: origin"),
        (lambda: Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), -1.0), "cylinder: radius -1.0; give a positive number"),
        (lambda: Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), [1.0, 2.0]), "cylinder: radius"),
        (lambda: Cone((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 30.0), "cone: half angle 30.0; give one between 0 and pi / 2"),
        (lambda: Sphere((0.0, np.nan, 0.0), 1.0), "sphere: center"),
        (lambda: Sphere((0.0, 0.0, 0.0), np.inf), "sphere: radius inf; give a positive number"),
        (lambda: Revolution((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.ones((3, 2))), r"shape \(3, 2\); give shape \(n, 2\)"),
        (lambda: Revolution((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.ones((4, 2))), "point 2 of the profile"),
        (
            lambda: Revolution((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.column_stack([X, X])),
            "a radius of -2 m in the profile",
        ),
        (lambda: SplineSurface(BARREL[:3]), r"shape \(3, 21, 3\); give shape \(n, m, 3\), rows of 4 points at least"),
        (lambda: SplineSurface(BARREL[[0, 1, 1, 2, 3]]), "spline surface: lines 2 and 3 of direction 0 coincide"),
        (lambda: closest_on([PLANE], np.zeros((3, 2))), r"points of shape \(3, 2\)"),
    ],
)
def test_surfaces_that_are_none_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        (Cylinder((-4e-6, 2e-16, 1e-16), (-1.0, -1e-17, 2e-17), 2.0), "a cylinder of radius 2 about x"),
        (Cylinder((1.0, 2.0, 0.0), (0.0, 0.0, 3.0), 0.5), "a cylinder of radius 0.5 about z through (1, 2, 0)"),
        (Sphere((0.0, 0.0, 1e-17), 3.0), "a sphere of radius 3 about (0, 0, 0)"),
        (
            Cone((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), 0.25 * np.pi),
            "a cone of half angle 45 deg with its apex at (0, 1, 0)",
        ),
        (
            Revolution((0.0, 0.0, 0.0), (0.0, 3.0, 4.0), [(0.0, 1.0), (1.0, 1.5), (2.0, 2.0), (3.0, 1.0)]),
            "a surface of revolution about the direction (0, 0.6, 0.8), of radii 1 to 2",
        ),
    ],
)
def test_surfaces_say_what_they_are_without_the_digits_of_rounding(surface, words):
    assert str(surface) == words
