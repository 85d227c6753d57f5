"""Curvature and radius on triangles and quads without grid lines: exact where they must be, closer with more nodes."""

import numpy as np
import pytest
from ellipse_wing_cases import THICK, chord_at, wing

from bspline_mdao.core.measures.jets import SmoothCorners, jets, tangents
from bspline_mdao.errors import InputError
from bspline_mdao.measures import Curvature, LeadingEdgeRadius, SurfaceGrid

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
FACETS = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]


def surface_of(points, triangles):
    cells = triangles[:, [0, 1, 2, 2]]
    return SurfaceGrid(points, np.arange(len(points)), (), ("marker body",), ("body",), (), (cells,))


def ball(n, radii=(1.0, 1.0, 1.0)):
    """Ellipsoid of triangles: every facet of an octahedron is cut into n each way."""
    places, triangles = [], []
    for corners in OCTAHEDRON[np.array(FACETS)]:
        at = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                at[i, j] = len(places)
                places.append(np.array([n - i - j, i, j]) @ corners)
        for i, j in at:
            if i + j < n:
                triangles.append([at[i, j], at[i + 1, j], at[i, j + 1]])
            if i + j < n - 1:
                triangles.append([at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]])
    unique, number = np.unique(places, axis=0, return_inverse=True)
    points = unique / np.linalg.norm(unique, axis=1)[:, None] * radii
    return surface_of(points, number.ravel()[np.array(triangles)])


def sheet(random, n=7):
    """Triangles over a plane, with random nodes: the corners and the places in the plane."""
    i, j = (a.ravel() for a in np.meshgrid(*2 * [np.arange(n)], indexing="ij"))
    uv = np.stack([i, j], axis=1) + random.uniform(-0.2, 0.2, (n * n, 2))
    first = (n * i + j)[(i < n - 1) & (j < n - 1)]
    halves = [(first, first + n, first + n + 1), (first, first + n + 1, first + 1)]
    return uv, np.concatenate([np.stack(half, axis=1) for half in halves])[:, [0, 1, 2, 2]]


def test_derivatives_of_a_plane_by_its_own_coordinates_are_exact():
    random = np.random.default_rng(1)
    uv, cells = sheet(random)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    corners = SmoothCorners(np.pad(uv * [1.0, 0.1], ((0, 0), (0, 1))) @ turn.T, cells)
    at = np.arange(len(corners.nodes))
    matrices, is_found = jets(corners, at)
    assert is_found.all()
    u, v = np.einsum("nij,nj->in", tangents(corners.normals), corners.points)
    field = 1.0 + 2.0 * u - v + 0.5 * u * u - 3.0 * u * v + v * v
    found = np.stack([matrix @ field for matrix in matrices])
    expected = [2.0 + u - 3.0 * v, -1.0 - 3.0 * u + 2.0 * v, 1.0 + 0.0 * u, -3.0 + 0.0 * u, 2.0 + 0.0 * u]
    assert np.ptp(corners.normals, axis=0).max() < 1e-12  # so that all have the same coordinates
    np.testing.assert_allclose(found, np.array(expected)[:, corners.nodes], atol=1e-8)


def test_curvature_of_balls_comes_closer_with_more_nodes():
    errors = []
    for n in (5, 10):
        body = ball(n, (2.0, 2.0, 2.0))
        densities = [Curvature.integral(body, kind).densities(body.points) for kind in ("total", "mean", "gaussian")]
        errors.append(np.abs(np.array(densities) / [[0.5], [0.25], [0.25]] - 1.0).max())
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 8.0
    assert Curvature.integral(body).evaluate(body.points) == pytest.approx(8.0 * np.pi, rel=0.01)
    assert Curvature.integral(ball(12, (2.0, 1.0, 0.7)), "gaussian").evaluate(
        ball(12, (2.0, 1.0, 0.7)).points
    ) == pytest.approx(4.0 * np.pi, rel=0.015)


@pytest.mark.parametrize("make", [Curvature.integral, Curvature.largest])
def test_derivatives_of_curvature_are_exact(make):
    random, body = np.random.default_rng(2), ball(4, (1.5, 1.0, 0.8))
    points, change = body.points @ (np.eye(3) + 0.1 * random.normal(size=(3, 3))), random.normal(size=body.points.shape)
    measure = make(body)
    expected = measure.evaluate(points + 1e-30j * change).imag / 1e-30
    np.testing.assert_allclose(measure.partials(points) @ change.ravel(), expected, rtol=1e-11)


def test_kinks_do_not_count():
    """Two halves of a ball that are moved apart by a cylinder's rim: the flat lids and their edges bend nothing."""
    body = ball(8)
    is_upper = (body.points[body.quads[:, :3], 2] >= -1e-12).all(axis=1)
    rim = np.flatnonzero(np.abs(body.points[:, 2]) < 1e-12)
    rim = rim[np.argsort(np.arctan2(body.points[rim, 1], body.points[rim, 0]))]
    rings, points = [rim], [body.points]
    for part in (0.75, 0.5, 0.25):
        rings.append(len(np.concatenate(points)) + np.arange(len(rim)))
        points.append(part * body.points[rim])
    a, b = np.concatenate(rings[:-1]), np.concatenate(rings[1:])
    c, d = (np.concatenate([np.roll(ring, -1) for ring in part]) for part in (rings[:-1], rings[1:]))
    lid = np.concatenate([np.stack([a, b, c], axis=1), np.stack([c, b, d], axis=1)])
    upper = surface_of(np.concatenate(points), np.concatenate([body.quads[is_upper][:, :3], lid]))
    integral = Curvature.integral(upper)
    assert len(integral.weights) == len(np.unique(upper.quads)) + len(rim)  # those of the rim are there twice
    assert integral.evaluate(upper.points) == pytest.approx(4.0 * np.pi, rel=0.03)


def test_the_radius_of_a_leading_edge_is_that_of_its_ellipse():
    surface, stations = wing(48, 12), [0.1, 0.5, 0.8]
    radius = LeadingEdgeRadius.at(surface, stations)
    z = 0.9 + 2.1 * np.array(stations)
    np.testing.assert_allclose(radius.evaluate(surface.points), 0.5 * THICK**2 * chord_at(z), rtol=0.06)
    np.testing.assert_allclose(radius.stations, z - 0.4, atol=1e-12)
    thicker = LeadingEdgeRadius.at(surface, stations, relative_to="baseline").evaluate(surface.points * [1.0, 1.2, 1.0])
    np.testing.assert_allclose(thicker, 1.44, rtol=1e-3)
    random = np.random.default_rng(3)
    points = surface.points @ (np.eye(3) + 0.1 * random.normal(size=(3, 3)))
    change, chord = random.normal(size=points.shape), LeadingEdgeRadius.at(surface, stations, relative_to="chord")
    expected = chord.evaluate(points + 1e-30j * change).imag / 1e-30
    np.testing.assert_allclose(chord.partials(points) @ change.ravel(), expected, rtol=1e-10)


def test_a_leading_edge_with_a_kink_is_refused():
    with pytest.raises(InputError, match=r"the surface has a kink at its leading edge, near \(0.\d+, "):
        LeadingEdgeRadius.at(wing(12, 6), [0.5])
