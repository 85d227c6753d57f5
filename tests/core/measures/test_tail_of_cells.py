"""Angle of the trailing edge on triangles: that of the section, closer with more nodes, with exact derivatives."""

import numpy as np
import pytest
from ellipse_wing_cases import wing as ellipse_wing
from scipy.spatial.transform import Rotation

from bspline_mdao.core.mesh.frame import Plane
from bspline_mdao.errors import InputError
from bspline_mdao.measures import SurfaceGrid, TrailingEdgeAngle

CAMBER, AT, THICK = 0.02, 0.4, 0.12
STATIONS = [0.2, 0.5, 0.83]


def naca2412(x, side):
    """Upper (1) and lower (-1) side, closed at the trailing edge."""
    half = 5.0 * THICK * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - x * 0.1036))))
    is_ahead = np.real(x) < AT
    part = np.where(is_ahead, AT, 1.0 - AT)
    slope = np.arctan(2.0 * CAMBER / part**2 * (AT - x))
    camber = CAMBER / part**2 * (np.where(is_ahead, 0.0, 1.0 - 2.0 * AT) + 2.0 * AT * x - x**2)
    return np.stack([x - side * half * np.sin(slope), camber + side * half * np.cos(slope)], axis=-1)


def angle_at(x):
    """Angle between both sides at the part x of the chord, exact."""
    (a, b), (c, d) = (naca2412(np.array(x + 1e-30j), side).imag * 1e30 for side in (1, -1))
    return np.arctan2(d, c) - np.arctan2(b, a)


def wing(n, end=1.0, shift=0.2):
    """Swept and tapered wing with n nodes from the nose to the part ``end`` of the chord, of quads, and as triangles.

    Nodes lie on no common sections, by up to ``shift`` of their distance along the span. Quads are cut along one of
    their diagonals or the other.
    """
    random = np.random.default_rng(1)
    x = end * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, n)) ** 2
    upper, lower = naca2412(x, 1), naca2412(x, -1)
    base = np.linspace(upper[-1], lower[-1], 5)[1:-1] if end < 1.0 else np.zeros((0, 2))
    ring = np.concatenate([lower[::-1], upper[1 : n if end < 1.0 else n - 1], base])
    n_span, k = n // 2, len(ring)
    z = np.repeat(3.0 * np.linspace(0.0, 1.0, n_span)[:, None], k, axis=1)
    z[1:-1] += shift * z[1, 0] * random.uniform(-1.0, 1.0, z[1:-1].shape)
    chord = 2.0 - 0.3 * z
    points = np.stack([0.5 * z + chord * ring[:, 0], 0.1 * z + chord * ring[:, 1], z], axis=-1).reshape(-1, 3)
    ids = np.arange(len(points)).reshape(z.shape)
    a, b, c, d = ids[:-1], np.roll(ids, -1, axis=1)[:-1], np.roll(ids, -1, axis=1)[1:], ids[1:]
    quads = np.stack([a, d, c, b], axis=-1).reshape(-1, 4)
    turned = np.where(random.random(len(quads))[:, None] < 0.5, quads, np.roll(quads, 1, axis=1))
    triangles = np.concatenate([turned[:, [0, 1, 2, 2]], turned[:, [0, 2, 3, 3]]])
    plane = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    made = [
        SurfaceGrid(points, np.arange(len(points)), (), ("wing",), ("wing",), (plane,), (cells,))
        for cells in (quads, triangles)
    ]
    return made


def test_angles_come_closer_to_those_of_the_section_with_more_nodes():
    errors = []
    for n in (17, 65):
        _, surface = wing(n)
        found = TrailingEdgeAngle.at(surface, STATIONS).evaluate(surface.points)
        errors.append(np.abs(found / angle_at(1.0) - 1.0).max())
    assert np.degrees(angle_at(1.0)) == pytest.approx(16.504, abs=1e-3)
    assert errors[0] < 3e-3
    assert errors[1] < 3e-4


def test_a_blunt_edge_has_the_angle_of_its_sides():
    _, surface = wing(33, end=0.97)
    found = TrailingEdgeAngle.at(surface, STATIONS).evaluate(surface.points)
    np.testing.assert_allclose(found, angle_at(0.97), rtol=1e-4)


@pytest.mark.parametrize("end", [1.0, 0.97])
def test_straight_lines_are_those_of_quads(end):
    quads, triangles = wing(33, end, shift=0.0)
    options = {"between": (0.8, 0.97)}
    wedges = [TrailingEdgeAngle.at(each, STATIONS, **options).evaluate(each.points) for each in (quads, triangles)]
    np.testing.assert_allclose(wedges[1], wedges[0], rtol=0.01)
    assert (wedges[1] < angle_at(1.0)).all()


@pytest.mark.parametrize("options", [{}, {"between": (0.8, 0.97)}])
def test_derivatives_are_exact_and_angles_turn_with_the_wing(options):
    random, (_, surface) = np.random.default_rng(2), wing(17)
    measure = TrailingEdgeAngle.at(surface, STATIONS, **options)
    points = surface.points @ (np.eye(3) + 0.1 * random.normal(size=(3, 3)))
    change = random.normal(size=points.shape)
    expected = measure.evaluate(points + 1e-30j * change).imag / 1e-30
    np.testing.assert_allclose(measure.partials(points) @ change.ravel(), expected, rtol=1e-10)
    turned = 2.0 * Rotation.from_rotvec([0.3, -0.7, 1.1]).apply(points) + 1.0
    np.testing.assert_allclose(measure.evaluate(turned), measure.evaluate(points), rtol=1e-12)
    twice = measure.evaluate(surface.points * [1.0, 2.0, 1.0])
    baseline = measure.evaluate(surface.points)
    assert (twice > 1.8 * baseline).all()


def test_what_has_no_angle_is_refused():
    surface = ellipse_wing(48, 12)
    with pytest.raises(InputError, match=r"the upper side has no corner at the trailing edge near \("):
        TrailingEdgeAngle.at(surface, [0.5])
    assert TrailingEdgeAngle.at(surface, [0.5], between=(0.8, 0.95)).evaluate(surface.points) > 0.1
    with pytest.raises(InputError, match=r"less than two points of a side are between 0.95 and 0.951 of the chord at"):
        TrailingEdgeAngle.at(surface, [0.5], between=(0.95, 0.951))
    with pytest.raises(InputError, match="wing has triangles, through which no grid lines go; give stations"):
        TrailingEdgeAngle.at(surface)
