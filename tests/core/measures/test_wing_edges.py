"""Radius of the leading edge and angle of the trailing edge in plane sections."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_cases import assert_derivatives_are_exact, rectangular_wing, surface_of, turned, wing_sheets
from scipy.spatial.transform import Rotation

from bspline_mdao import fit_grid
from bspline_mdao.core.measures.section_lines import GridLines, SectionLines
from bspline_mdao.core.mesh.frame import Frame, Plane, surface_frame
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import LeadingEdgeRadius, SurfaceGrid, TrailingEdgeAngle

ROOT = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
STATIONS = [0.0, 0.23, 0.5, 0.81]


def swept_sheets(n, shape, lag=0.04, n_span=9):
    """Upper and lower side of a swept and tapered wing of span 3, and the places of its grid lines.

    ``shape(side, t)`` gives chord fraction and height of both sides; grid lines lag towards the tip behind the edge.
    """
    t, z = np.linspace(0.0, 1.0, n)[:, None], 3.0 * np.linspace(0.0, 1.0, n_span)
    sheets = []
    for side in (1, -1):
        place = z + lag * z * (3.0 - z) * t
        fraction, height = shape(side, t)
        chord = 2.0 - 0.3 * place
        sheets.append(np.stack([0.5 * place + chord * fraction, 0.1 * place + chord * height, place], axis=-1))
    return [sheets[0].swapaxes(0, 1), sheets[1]]


def swept(n, shape, n_span=9, **options):
    return surface_of(*swept_sheets(n, shape, n_span=n_span, **options), planes=[ROOT])


def teardrop(side, t):
    """Unsymmetric section, whose nodes are divided unlike on its two sides; the radius is 0.02 in chords."""
    s = side * t + 0.15 * t**2 * (1.0 - t**2)
    return s**2 * (1.0 + 0.4 * s * (1.0 - s**2)), 0.2 * s * (1.0 - s**2)


def naca(side, t):
    """NACA 0012 with its trailing edge closed."""
    x = np.sin(0.5 * np.pi * t) ** 2
    return x, side * 0.6 * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - x * 0.1036))))


NACA_ANGLE = 2.0 * np.arctan(-0.6 * (0.2969 / 2 - 0.1260 - 2 * 0.3516 + 3 * 0.2843 - 4 * 0.1036))


def blunt(side, t):
    """Wedge of 0.1 rad on each side behind a round edge, with a base of 0.02 chords."""
    x = t**2
    return x, side * (0.01 + 0.1 * (1.0 - x)) * np.sqrt(1.0 - (1.0 - t) ** 8)


def blunt_wing(n=13):
    upper, lower = swept_sheets(n, blunt)
    base = np.linspace(upper[:, -1], lower[-1], 5)
    return surface_of(upper, lower, base, planes=[ROOT])


def radii(surface, **options):
    return LeadingEdgeRadius.at(surface, STATIONS, **options).evaluate(surface.points)


def angles(surface, **options):
    return TrailingEdgeAngle.at(surface, STATIONS, **options).evaluate(surface.points)


def rate(errors):
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize("n_nodes", [1, 2, 3])
def test_radius_of_swept_sections_converges_with_the_order_of_the_polynomial(n_nodes):
    surfaces = [swept(n, teardrop) for n in (65, 129)]
    errors = [np.abs(radii(s, n_nodes=n_nodes, relative_to="chord") / 0.02 - 1.0).max() for s in surfaces]
    assert errors[1] < 3e-3 / 10**n_nodes
    assert np.log2(errors[0] / errors[1]) > 2 * n_nodes - 0.4


def test_radius_of_naca_0012_is_that_of_abbott_within_two_per_cent():
    found = [radii(swept(n, naca), relative_to="chord") / (1.1019 * 0.12**2) - 1.0 for n in (33, 65, 129)]
    assert np.abs(found[0]).max() < 0.03
    assert np.abs(found[1]).max() < 0.02
    # the curvature of the section has a kink at the edge: first order
    assert np.abs(found[2]).max() < 0.6 * np.abs(found[1]).max()


def test_radius_in_metres_is_that_over_chord_times_the_chord():
    surface = swept(65, teardrop)
    chords = 2.0 - 0.3 * 3.0 * np.array(STATIONS)
    np.testing.assert_allclose(radii(surface), chords * radii(surface, relative_to="chord"), rtol=2e-4)


def test_radius_relative_to_the_baseline_grows_with_the_square_of_the_thickness():
    surface = swept(17, teardrop)
    measure = LeadingEdgeRadius.at(surface, STATIONS, relative_to="baseline")
    np.testing.assert_allclose(measure.evaluate(surface.points), 1.0, rtol=1e-14)
    thicker = surface.points + 0.3 * (surface.points[:, 1:2] - 0.1 * surface.points[:, 2:3]) * [0.0, 1.0, 0.0]
    np.testing.assert_allclose(measure.evaluate(thicker), 1.3**2, rtol=1e-5)


@pytest.mark.parametrize(("n_nodes", "order"), [(2, 1), (3, 2), (4, 3)])
def test_angle_of_naca_0012_converges_with_the_order_of_the_polynomial(n_nodes, order):
    straight = [swept(n, naca) for n in (17, 33, 65)]
    errors = np.array([np.abs(angles(s, n_nodes=n_nodes) / NACA_ANGLE - 1.0).max() for s in straight])
    assert errors[-1] < 1e-2 / 10 ** (n_nodes - 2)
    # the nodes are spaced as t^2 next to the edge, which doubles the order in n
    assert (rate(errors) > 2 * order - 0.3).all()


@pytest.mark.parametrize("options", [{"n_nodes": 2}, {"n_nodes": 5, "degree": 1}, {"between": (0.8, 0.95)}])
def test_angle_of_a_blunt_wedge_is_that_of_its_sides(options):
    # sections are cut at constant span, along which the sides of the tapered wedge are straight
    np.testing.assert_allclose(angles(blunt_wing(25), **options), 2.0 * np.arctan(0.1), rtol=2e-3)


def test_lines_end_at_the_corner_of_a_blunt_trailing_edge():
    surface = blunt_wing()
    lines = SectionLines.of(surface)
    assert lines.sides[0].shape[0] == 9
    for side in range(2):
        assert ((lines.sides[side] >= 0).sum(axis=1) == 13).all()
        np.testing.assert_array_equal(
            lines.trailing(side, 1)[:, 0], [surface.faces[0][:, -1], surface.faces[1][-1]][side]
        )


def test_angle_changes_sign_where_the_sides_cross():
    surface = swept(9, naca)
    measure = TrailingEdgeAngle.at(surface, STATIONS)
    x, y, z = surface.points.T
    is_aft = x - 0.5 * z > 0.5 * (2.0 - 0.3 * z)
    crossed = np.stack([x, np.where(is_aft, 0.2 * z - y, y), z], axis=1)
    np.testing.assert_allclose(measure.evaluate(crossed), -measure.evaluate(surface.points), rtol=1e-9)


@pytest.mark.parametrize("make", [LeadingEdgeRadius, TrailingEdgeAngle])
def test_edges_keep_their_values_where_the_surface_is_turned_in_any_direction(make):
    surface = swept(17, teardrop if make is LeadingEdgeRadius else naca)
    measure = make.at(surface, STATIONS)
    before = measure.evaluate(surface.points)
    for turn in Rotation.random(5, random_state=3).as_matrix():
        np.testing.assert_allclose(measure.evaluate(surface.points @ turn.T + [1.0, 2.0, 3.0]), before, rtol=1e-10)


@pytest.mark.parametrize("make", [LeadingEdgeRadius, TrailingEdgeAngle])
def test_edges_of_sections_that_turn_with_a_bend_keep_their_values(make):
    surface = swept(33, teardrop if make is LeadingEdgeRadius else naca, n_span=33)
    x, y, z = surface.points.T
    angle = np.deg2rad(60.0) * z / 3.0  # about the stream, in proportion to the span
    arc = 3.0 / np.deg2rad(60.0)
    bent = np.stack([x, arc - (arc - y) * np.cos(angle), (arc - y) * np.sin(angle)], axis=1)
    measure = make.at(surface, STATIONS)
    np.testing.assert_allclose(measure.evaluate(bent), measure.evaluate(surface.points), rtol=0.02)


@pytest.mark.parametrize("measure", [radii, angles])
def test_edges_do_not_depend_on_how_the_surface_is_divided_into_faces(measure):
    upper, lower = swept_sheets(13, teardrop if measure is radii else naca)
    wrapped = np.concatenate([upper.swapaxes(0, 1)[::-1], lower[1:]])
    whole = measure(surface_of(upper, lower, planes=[ROOT]))
    np.testing.assert_allclose(measure(surface_of(wrapped, planes=[ROOT])), whole, rtol=1e-12)
    parts = surface_of(wrapped[:9], wrapped[8:, :5], wrapped[8:, 4:].swapaxes(0, 1), planes=[ROOT])
    np.testing.assert_allclose(measure(parts), whole, rtol=1e-12)


@pytest.mark.parametrize("measure", [radii, angles])
def test_edges_do_not_depend_on_where_the_wing_is(measure):
    surface = swept(13, teardrop if measure is radii else naca)
    moved = turned(surface)
    frame = surface_frame(surface.points, surface.planes)
    turn = (
        moved.planes[0].normal,
        np.linalg.lstsq(surface.points - surface.points[0], moved.points - moved.points[0])[0],
    )
    elsewhere = Frame(moved.points[0], frame.axes @ turn[1], frame.chord, frame.span, frame.middle)
    np.testing.assert_allclose(measure(moved, frame=elsewhere), measure(surface), rtol=1e-9)


@pytest.mark.parametrize("relative_to", ["metre", "chord", "baseline"])
@pytest.mark.parametrize("stations", [None, [0.13, 0.7]])
def test_derivatives_of_the_radius_are_exact(relative_to, stations):
    surface = swept(9, teardrop, n_span=5)
    assert_derivatives_are_exact(LeadingEdgeRadius.at(surface, stations, relative_to=relative_to), size=1e-3)


@pytest.mark.parametrize("options", [{}, {"n_nodes": 5, "degree": 2}, {"between": (0.7, 1.0)}])
def test_derivatives_of_the_angle_are_exact(options):
    surface = swept(9, naca, n_span=5)
    assert_derivatives_are_exact(TrailingEdgeAngle.at(surface, [0.13, 0.7], **options), size=1e-3)


def test_stations_default_to_the_grid_lines_around_the_leading_edge():
    surface = swept(9, naca, n_span=6, lag=0.0)
    for measure in (LeadingEdgeRadius.at(surface), TrailingEdgeAngle.at(surface)):
        np.testing.assert_allclose(measure.stations, 3.0 * np.linspace(0.0, 1.0, 6))
        assert measure.evaluate(surface.points).shape == measure.shape == (6,)


@pytest.mark.slow
def test_edges_of_a_fitted_wing_are_found():
    surface = SurfaceGrid.of(fit_grid(onera_m6_grid((17, 9, 13)), n_control=(9, 6, 7)))
    measure = LeadingEdgeRadius.at(surface, [0.0, 0.3, 0.6], relative_to="chord")
    np.testing.assert_allclose(measure.evaluate(surface.points), 0.0145, rtol=0.1)
    wedge = TrailingEdgeAngle.at(surface, [0.0, 0.3, 0.6]).evaluate(surface.points)
    assert ((wedge > np.radians(10.0)) & (wedge < np.radians(20.0))).all()


def test_a_tip_face_is_no_leading_edge():
    surface = rectangular_wing(n_chord=13, n_span=5)
    assert SectionLines.of(surface).sides[0].shape[0] == 5


def test_what_cannot_be_measured_is_refused():
    wing = swept(9, naca)
    with pytest.raises(InputError, match=r"around station 1\.2; take fractions of the span from 0\.0000"):
        LeadingEdgeRadius.at(wing, [0.5, 1.2])
    with pytest.raises(InputError, match="relative_to 'area' and 2 nodes"):
        LeadingEdgeRadius.at(wing, relative_to="area")
    with pytest.raises(InputError, match=r"upper grid line 1 along the span has 9 nodes .* 11 are needed"):
        LeadingEdgeRadius.at(wing, n_nodes=10)
    with pytest.raises(InputError, match="degree 3 through 3 nodes"):
        TrailingEdgeAngle.at(wing, degree=3)
    with pytest.raises(InputError, match=r"less than two nodes of a side are between 0.95 and 0.951"):
        TrailingEdgeAngle.at(wing, [0.0, 0.5], between=(0.95, 0.951))
    with pytest.raises(InputError, match="no patch is called 'tail'"):
        LeadingEdgeRadius.at(wing, patches="tail")


def test_surfaces_without_one_leading_edge_are_refused():
    flat = swept(9, lambda side, t: (t, 0.0 * t))
    with pytest.raises(InputError, match="no grid line of the surface turns round it"):
        LeadingEdgeRadius.at(replace(flat, faces=flat.faces[:1], names=flat.names[:1], patches=("wall",)))
    sheets = wing_sheets(n_chord=9)[:2]
    two = surface_of(*sheets, *(sheet + [5.0, 0.0, 0.0] for sheet in sheets), planes=[ROOT])
    with pytest.raises(InputError, match="there are two at the same place of the span"):
        LeadingEdgeRadius.at(two)
    named = replace(two, patches=("wing", "wing", "tail", "tail"))
    assert LeadingEdgeRadius.at(named, patches="tail").shape == (5,)


def test_grid_lines_run_on_where_four_edges_meet_and_end_elsewhere():
    # three quads about node 0: no edge has a partner there
    fan = np.array([[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 1]])
    lines = GridLines.of(fan, 7)
    assert not (lines.at == 0).any()
    assert lines.next(np.array([2, 4]), np.array([3, 5])).tolist() == [4, 6]
    ids = np.arange(20).reshape(4, 5)
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    lines = GridLines.of(quads, 20)
    np.testing.assert_array_equal(lines.walk(ids[0], ids[1])[:, :4], ids.T)
    np.testing.assert_array_equal(lines.walk(ids[:, -1], ids[:, -2])[:, :5], ids[:, ::-1])


def test_grid_lines_close_and_pass_by_collapsed_quads():
    ring = np.arange(12).reshape(2, 6)
    quads = np.stack([ring[0], ring[1], np.roll(ring[1], -1), np.roll(ring[0], -1)], axis=-1)
    assert GridLines.of(quads, 12).walk(ring[0, :1], ring[0, 1:2])[0, :6].tolist() == list(range(6))
    collapsed = np.array([[0, 0, 1, 2], [0, 2, 3, 4]])
    assert GridLines.of(collapsed, 5).next(np.array([1]), np.array([0])).tolist() == [4]
