"""Thickness at probes, and of sections by their chord."""

import numpy as np
import openmdao.api as om
import pytest
from geometry_cases import (
    assert_derivatives_are_exact,
    box,
    rectangular_wing,
    roughened,
    sphere,
    turned,
    with_points,
)
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import SurfaceMeasure, fit_grid
from bspline_mdao.core.measures.section_thickness import Cut, cuts_along_span
from bspline_mdao.errors import InputError
from bspline_mdao.generators import (
    flat_plate_grid,
    generic_blended_wing_body,
    naca_section,
    nodes_on_shape,
    onera_m6_grid,
)
from bspline_mdao.measures import SectionThickness, SurfaceGrid, Thickness

LEADING, TRAILING = [[0.1, 0.0, 0.0], [0.1, 0.0, 2.8]], [[1.8, 0.0, 0.0], [1.8, 0.0, 2.8]]
LINES = {"leading": LEADING, "trailing": TRAILING}
"""Polylines in the rectangular wing, a little within its edges."""


@pytest.fixture(scope="module")
def m6():
    return fit_grid(onera_m6_grid((17, 9, 11)), n_control=(9, 6, 6))


@pytest.fixture(scope="module")
def plate():
    return SurfaceGrid.of(fit_grid(flat_plate_grid((9, 8, 7)), n_control=(5, 5, 5)))


def measured(measure):
    return measure.evaluate(measure.surface.points)


def naca_thickness(x, thickness=0.12):
    """Thickness of a NACA section with a closed trailing edge, in chords."""
    upper = naca_section(thickness).upper
    return 2.0 * np.interp(x, *upper.T)


def test_a_box_is_as_thick_as_its_edges_and_more_at_an_angle():
    points = [[0.5, 1.0, 1.0], [0.3, 1.2, 2.0]]
    for axis, edge in enumerate([1.0, 2.0, 3.0]):
        thickness = Thickness.at(box(), points, np.eye(3)[axis])
        np.testing.assert_allclose(measured(thickness), edge, rtol=1e-14)
        assert (thickness.units, thickness.shape) == ("m", (2,))
    oblique = Thickness.at(box(), points, [[0.0, 0.0, -2.0], [1.0, 0.0, 1.0]])
    np.testing.assert_allclose(measured(oblique), [3.0, np.sqrt(2.0)], rtol=1e-14)


def test_the_thickness_of_a_sphere_is_approached_with_the_square_of_the_spacing():
    points = np.random.default_rng(1).uniform(-0.7, 0.7, (9, 3))
    exact = 2.0 * np.sqrt(1.5**2 - points[:, 0] ** 2 - points[:, 1] ** 2)
    errors = [np.abs(measured(Thickness.at(sphere(n), points, [0, 0, 1])) - exact).mean() for n in (9, 17, 33, 65)]
    assert errors[-1] < 2e-3
    assert abs(np.log2(errors[0] / errors[-1]) / 3.0 - 2.0) < 0.3


def test_a_wing_is_as_thick_as_its_section():
    thickness = Thickness.grid(rectangular_wing(n_chord=201), n_chord=12, n_span=4, **LINES)
    assert thickness.shape == (4, 12)
    expected = 2.0 * naca_thickness(np.linspace(0.05, 0.9, 12))
    np.testing.assert_allclose(measured(thickness), np.tile(expected, (4, 1)), atol=2e-5)


def test_the_lines_of_a_grid_stand_on_the_sheet_between_its_polylines():
    surface = turned(rectangular_wing())
    wing = rectangular_wing()
    turn = np.linalg.lstsq(wing.points - wing.points[0], surface.points - surface.points[0], rcond=None)[0]
    lines = [np.array(line) @ turn + (surface.points[0] - wing.points[0] @ turn) for line in (LEADING, TRAILING)]
    thickness = Thickness.grid(surface, n_chord=5, n_span=4, leading=lines[0], trailing=lines[1])
    np.testing.assert_allclose(np.abs(thickness.directions @ turn[1]), 1.0, rtol=1e-12)
    np.testing.assert_allclose(measured(thickness), measured(Thickness.grid(wing, 5, 4, **LINES)), rtol=1e-10)


def test_lines_are_found_between_the_edges_of_the_surface_unless_they_are_given():
    wing = rectangular_wing(n_chord=201)
    x, z = 2.0 * np.linspace(0.05, 0.95, 7), 3.0 * np.linspace(0.02, 0.98, 4)
    thickness = measured(Thickness.grid(wing, 7, 4))
    np.testing.assert_allclose(thickness, np.tile(2.0 * naca_thickness(x / 2.0), (4, 1)), atol=2e-4)
    given = {"leading": [[x[0], 0.0, z[0]], [x[0], 0.0, z[-1]]]}
    np.testing.assert_allclose(measured(Thickness.grid(wing, 7, 4, **given)), thickness, atol=2e-4)
    inner = measured(Thickness.grid(turned(wing), 3, 2, chord=(0.2, 0.6), span=(0.0, 0.5)))
    np.testing.assert_allclose(inner, np.tile(2.0 * naca_thickness(np.array([0.2, 0.4, 0.6])), (2, 1)), atol=2e-4)
    with pytest.raises(InputError, match=r"^thickness: chord \(0.9, 0.1\); give two rising parts of it within 0 to 1"):
        Thickness.grid(wing, 3, 3, chord=(0.9, 0.1))


@pytest.mark.slow
def test_the_direction_is_normal_to_the_planform_unless_told_otherwise(m6):
    surface = SurfaceGrid.of(m6)
    points = np.array([[[0.3, 0.0, 0.1], [0.5, 0.0, 0.3]]])
    thickness = Thickness.at(surface, points)
    assert thickness.shape == (1, 2)
    np.testing.assert_allclose(measured(thickness), measured(Thickness.at(surface, points, [0.0, 1.0, 0.0])))
    np.testing.assert_allclose(measured(thickness), [[0.09, 0.085]], atol=5e-3)


@pytest.mark.parametrize("relative", [False, True])
def test_thickness_does_not_change_with_a_rigid_motion_and_goes_with_the_size(relative):
    thickness = Thickness.grid(rectangular_wing(), 5, 4, relative=relative, **LINES)
    before, points = measured(thickness), thickness.surface.points
    np.testing.assert_allclose(thickness.evaluate(turned(thickness.surface).points), before, rtol=1e-11)
    np.testing.assert_allclose(thickness.evaluate(3.0 * points), 3.0 * before, rtol=1e-13)
    if relative:
        assert thickness.units is None
        np.testing.assert_allclose(before, 1.0, rtol=1e-15)


@pytest.mark.slow
def test_a_plate_has_no_thickness_and_opens_along_the_line(plate):
    thickness = Thickness.at(plate, [[0.3, 0.0, 0.5], [0.6, 0.0, 1.4]], [0.0, 2.0, 0.0])
    assert (measured(thickness) < 1e-14).all()
    normals = np.zeros_like(plate.points)
    upper = [ids for patch, ids in zip(plate.patches, plate.faces) if patch == "wing_upper"]
    normals[np.concatenate([ids.ravel() for ids in upper]), 1] = 1.0
    np.testing.assert_allclose(thickness.partials(plate.points) @ normals.ravel(), 1.0, rtol=1e-12)
    with pytest.raises(InputError, match=r"no thickness on the baseline at probe 1 of 1, \(0.3, 0, 0.5\), to be relat"):
        Thickness.at(plate, [0.3, 0.0, 0.5], relative=True)


def test_a_probe_beside_the_wing_is_named():
    with pytest.raises(InputError, match=r"^spar: the line of probe 2 of 2, through \(9, 0, 1\), does not cross"):
        Thickness.at(rectangular_wing(), [[1.0, 0.0, 1.0], [9.0, 0.0, 1.0]], name="spar")


@pytest.mark.parametrize(("n_chord", "n_span"), [(1, 3), (3, 0)])
def test_a_grid_has_two_lines_along_the_chord_and_one_along_the_span_at_least(n_chord, n_span):
    with pytest.raises(InputError, match="give at least 2"):
        Thickness.grid(rectangular_wing(), n_chord, n_span, **LINES)


def test_one_line_along_the_span_is_the_middle_one_of_three():
    wing = rectangular_wing()
    one, three = (Thickness.grid(wing, 4, n, **LINES).evaluate(wing.points) for n in (1, 3))
    assert one.shape == (1, 4)
    np.testing.assert_array_equal(one, three[1:2])


def test_a_polyline_has_a_length():
    with pytest.raises(InputError, match="thickness, leading: a polyline without length"):
        Thickness.grid(rectangular_wing(), 3, 3, leading=[[0.1, 0.0, 0.0]], trailing=TRAILING)


def test_sections_of_a_naca_0012_wing_are_12_percent_thick():
    sections = SectionThickness.at(rectangular_wing(n_chord=201), [0.0, 0.4, 0.9])
    largest = sections.ratios(sections.surface.points).max(axis=1)
    np.testing.assert_allclose(largest, 0.12, atol=1e-4)
    bound = measured(sections)
    assert sections.shape == (3,)
    assert (largest <= bound).all()
    assert (bound <= largest * (1.0 + np.log(19) / 200.0)).all()
    sharp = SectionThickness.at(rectangular_wing(n_chord=201), [0.4], rho=1e5)
    np.testing.assert_allclose(measured(sharp), largest[1], rtol=1e-4)


def test_the_smallest_thickness_is_bounded_from_below():
    sections = SectionThickness.at(rectangular_wing(), [0.2, 0.7], chordwise=[0.1, 0.3, 0.8], smallest=True)
    smallest = sections.ratios(sections.surface.points).min(axis=1)
    assert (measured(sections) <= smallest).all()
    assert (measured(sections) >= smallest - sections.scales * np.log(3) / 200.0).all()


def test_thickness_over_chord_does_not_change_when_a_section_is_scaled_turned_and_moved():
    sections = SectionThickness.at(rectangular_wing(), [0.2, 0.7])
    points = 2.5 * turned(sections.surface).points - 1.0
    np.testing.assert_allclose(sections.evaluate(points), measured(sections), rtol=1e-11)
    stretched = sections.surface.points * [2.0, 1.0, 1.0]
    np.testing.assert_allclose(sections.ratios(stretched), 0.5 * sections.ratios(sections.surface.points), rtol=1e-12)


@pytest.mark.slow
def test_sections_of_the_m6_are_alike_along_the_span(m6):
    sections = SectionThickness.at(SurfaceGrid.of(m6), [0.0, 0.3, 0.6, 0.9])
    np.testing.assert_allclose(measured(sections), 0.0965, atol=1.5e-3)


@pytest.mark.slow
def test_winglets_are_measured_across_their_own_span(m6):
    model = fit_grid(onera_m6_grid((21, 9, 21)), n_control=(9, 6, 9))
    surface, body = SurfaceGrid.of(model), generic_blended_wing_body()
    surface = with_points(surface, nodes_on_shape(model, body)[surface.rows])
    tip = surface.points[np.argmax(surface.points[:, 1])]
    cant = np.radians(body.ribs[-1].cant)
    spine = np.array([0.0, np.sin(cant), np.cos(cant)])
    winglet = Cut(tip - 0.4 * (body.ribs[-1].span - body.ribs[-2].span) * spine, spine, np.array([1.0, 0.0, 0.0]))
    sections = SectionThickness.at(surface, [*cuts_along_span(surface, [0.1, 0.5]), winglet])
    ratios = sections.ratios(surface.points).max(axis=1)
    assert 0.05 < ratios[2] < ratios[0] < 0.25
    assert_derivatives_are_exact(sections, size=1e-3)


@pytest.mark.slow
def test_a_plate_has_thin_sections(plate):
    sections = SectionThickness.at(plate, [0.3, 0.6])
    assert (measured(sections) < 2e-4).all()
    opened = plate.points.copy()
    upper = np.concatenate([ids.ravel() for patch, ids in zip(plate.patches, plate.faces) if patch == "wing_upper"])
    opened[upper, 1] += 0.05 * np.sin(np.pi * np.clip(opened[upper, 0], 0.0, 1.0))
    assert (sections.evaluate(opened) > 0.04).all()


@pytest.mark.parametrize("chordwise", [0, [0.2, 1.0], [[0.2]], [-0.1]])
def test_probes_of_a_section_are_between_its_edges(chordwise):
    with pytest.raises(InputError, match="section_thickness: fractions of the chord"):
        SectionThickness.at(rectangular_wing(), [0.5], chordwise)


def test_sections_need_a_station():
    with pytest.raises(InputError, match="no station is given"):
        SectionThickness.at(rectangular_wing(), [])


@pytest.mark.parametrize("relative", [False, True])
def test_derivatives_are_exact(relative):
    points, directions = np.random.default_rng(7).uniform(-0.6, 0.6, (2, 11, 3))
    rough = with_points(sphere(6), roughened(sphere(6), 0.01))
    assert_derivatives_are_exact(Thickness.at(rough, points, directions, relative))
    assert_derivatives_are_exact(Thickness.grid(rectangular_wing(), 4, 5, relative, **LINES))


@pytest.mark.parametrize("smallest", [False, True])
def test_derivatives_of_sections_are_exact(smallest):
    surface = with_points(rectangular_wing(), roughened(rectangular_wing(), 1e-3))
    assert_derivatives_are_exact(SectionThickness.at(surface, [0.15, 0.5, 0.8], 7, smallest), size=1e-3)


@pytest.mark.slow
def test_derivatives_are_exact_on_plates_and_wings(plate, m6):
    assert_derivatives_are_exact(Thickness.at(plate, [[0.3, 0.0, 0.5], [0.6, 0.0, 1.4]]))
    assert_derivatives_are_exact(SectionThickness.at(plate, [0.3, 0.6]))
    assert_derivatives_are_exact(SectionThickness.at(SurfaceGrid.of(m6), [0.0, 0.3, 0.6]), size=1e-3)


def test_partials_of_the_components_are_exact():
    problem, surface = om.Problem(), rectangular_wing()
    measures = Thickness.grid(surface, 3, 4, **LINES), SectionThickness.at(surface, [0.2, 0.6], 5)
    for number, measure in enumerate(measures):
        problem.model.add_subsystem(f"measure{number}", SurfaceMeasure(measure=measure))
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    assert problem.get_val("measure0.thickness").shape == (4, 3)
    assert_check_partials(problem.check_partials(method="cs", out_stream=None), atol=1e-10, rtol=1e-10)
