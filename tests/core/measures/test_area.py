"""Area of bilinear quads, and their projections."""

import numpy as np
import openmdao.api as om
import pytest
from geometry_cases import (
    assert_derivatives_are_exact,
    box,
    box_sheets,
    rectangular_wing,
    roughened,
    sphere,
    surface_of,
    turned,
    with_points,
)
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import SurfaceMeasure, fit_grid
from bspline_mdao.core.measures.area import planform_normal
from bspline_mdao.errors import InputError
from bspline_mdao.generators import (
    flat_plate_grid,
    generic_blended_wing_body,
    nodes_on_shape,
    onera_m6_grid,
    onera_m6_planform,
)
from bspline_mdao.measures import ProjectedArea, SurfaceArea, SurfaceGrid

OBLIQUE = np.array([0.3, -1.0, 0.7])


@pytest.fixture(scope="module")
def m6():
    return fit_grid(onera_m6_grid((13, 9, 11)), n_control=(7, 6, 6))


def area(surface, **options):
    return SurfaceArea.of(surface, **options).evaluate(surface.points)[0]


def projected(surface, direction=None, **options):
    return ProjectedArea.of(surface, direction, **options).evaluate(surface.points)[0]


def sheet(corners, n):
    """One bilinear quad, divided into n x n."""
    s, t = np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1), indexing="ij")
    shares = [(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t]
    return surface_of(sum(share[..., None] * corner for share, corner in zip(shares, corners)))


def test_the_area_of_flat_sides_is_exact_whatever_their_quads():
    surface = box((5, 6, 7))
    assert area(surface) == pytest.approx(22.0, rel=1e-14)
    corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.2, 1.0, 0.0], [0.3, 1.4, 0.0]])
    diagonals = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    assert area(sheet(corners, 1)) == pytest.approx(0.5 * np.linalg.norm(diagonals), rel=1e-14)


def test_the_error_of_twisted_quads_goes_with_the_fourth_power_of_the_twist():
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.1, 1.0, 0.0], [0.0, 1.2, 0.0]])
    errors = []
    for lift in (0.4, 0.2, 0.1):
        corners = flat + lift * np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, -1]])
        errors.append(abs(area(sheet(corners, 1)) - area(sheet(corners, 32))))
    assert errors[1] < 1e-3
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 3.5).all()


def test_areas_of_a_sphere_are_approached_with_the_square_of_the_spacing():
    for measure, exact in ((area, 4.0), (lambda ball: projected(ball, OBLIQUE), 1.0)):
        errors = [exact * np.pi * 1.5**2 - measure(sphere(n)) for n in (9, 17, 33)]
        assert errors[-1] < 0.01 * exact
        assert (np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2.0) < 0.2).all()


def test_a_box_is_seen_as_the_projections_of_its_sides():
    direction = OBLIQUE / np.linalg.norm(OBLIQUE)
    assert projected(box(), OBLIQUE) == pytest.approx(np.abs(direction) @ [6.0, 3.0, 2.0], rel=1e-14)


def test_a_closed_body_is_seen_alike_from_both_sides():
    surface = with_points(sphere(6), roughened(sphere(6), 0.01))
    assert projected(surface, OBLIQUE) == pytest.approx(projected(surface, -OBLIQUE), rel=1e-13)


def test_sides_that_are_seen_edge_on_count_half_when_they_tilt():
    flat, surface = box(), turned(box())
    turn = np.linalg.lstsq(flat.points - flat.points[0], surface.points - surface.points[0], rcond=None)[0]
    measure = ProjectedArea.of(surface, turn[2])
    sheared = surface.points + 1e-3 * np.outer(flat.points[:, 2], turn[0])  # a parallelepiped: no change
    np.testing.assert_allclose(measure.evaluate(sheared), 2.0, rtol=1e-13)
    spread = surface.points + 1e-3 * np.outer(flat.points[:, 2] * flat.points[:, 0] / 3.0, turn[0])
    np.testing.assert_allclose(measure.evaluate(spread), 2.0 * (1.0 + 0.5e-3), rtol=1e-13)  # half of what the top gains


@pytest.mark.slow
def test_planform_areas_are_those_of_the_trapezoid(m6):
    planform, surface = onera_m6_planform(), SurfaceGrid.of(m6)
    exact = 0.5 * (planform.root_chord + planform.tip_chord) * planform.semi_span
    np.testing.assert_array_equal(planform_normal(surface), [0.0, 1.0, 0.0])
    assert projected(surface) == pytest.approx(exact, rel=1e-9)
    assert projected(rectangular_wing()) == pytest.approx(6.0, rel=1e-14)


@pytest.mark.slow
def test_a_plate_has_two_sides_and_one_planform():
    surface = SurfaceGrid.of(fit_grid(flat_plate_grid((9, 8, 7)), n_control=(5, 5, 5)))
    assert area(surface) == pytest.approx(4.0, rel=1e-12)
    assert projected(surface) == pytest.approx(2.0, rel=1e-12)


def test_a_sheet_is_seen_from_its_front_only():
    surface = surface_of(box_sheets()[5])
    assert projected(surface, [0.0, 0.0, 1.0]) == pytest.approx(2.0, rel=1e-14)
    with pytest.raises(InputError, match="projected_area: nothing of the surface faces"):
        ProjectedArea.of(surface, [0.0, 0.0, -1.0])


@pytest.mark.parametrize("direction", [[0.0, 0.0, 0.0], [1.0, 0.0], [np.nan, 0.0, 1.0]])
def test_a_direction_needs_three_numbers(direction):
    with pytest.raises(InputError, match=r"projected_area: direction is \[.*\]; give three"):
        ProjectedArea.of(box(), direction)


@pytest.mark.parametrize("make", [box, sphere, rectangular_wing])
def test_areas_do_not_change_with_a_rigid_motion(make):
    surface, moved = make(), turned(make())
    turn = np.linalg.lstsq(surface.points - surface.points[0], moved.points - moved.points[0], rcond=None)[0]
    assert area(moved) == pytest.approx(area(surface), rel=1e-13)
    assert projected(moved, OBLIQUE @ turn) == pytest.approx(projected(surface, OBLIQUE), rel=1e-12)


def test_areas_go_with_the_square_of_the_size_and_relative_ones_start_at_one():
    surface = rectangular_wing()
    for measure in (SurfaceArea, ProjectedArea):
        whole, relative = measure.of(surface), measure.of(surface, relative=True)
        assert (whole.units, relative.units) == ("m**2", None)
        assert relative.evaluate(surface.points)[0] == pytest.approx(1.0, rel=1e-15)
        np.testing.assert_allclose(relative.evaluate(3.0 * surface.points + 1.0), 9.0, rtol=1e-13)
        np.testing.assert_allclose(whole.evaluate(-2.0 * surface.points), 4.0 * whole.evaluate(surface.points))


def test_quads_without_an_area_on_the_baseline_are_left_out_for_good():
    nodes = box_sheets((3, 4, 5))[5].copy()
    nodes[1] = nodes[0]  # a strip of no width, of nodes that are apart
    surface = SurfaceGrid(nodes.reshape(-1, 3), np.arange(12), (np.arange(12).reshape(3, 4),), ("block 1",), ("wall",))
    measure = SurfaceArea.of(surface)
    assert len(measure.quads) == 3
    assert np.isfinite(measure.partials(surface.points).data).all()
    np.testing.assert_allclose(measure.evaluate(surface.points), 2.0, rtol=1e-14)


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("make", [box, sphere, rectangular_wing])
def test_derivatives_are_exact(make, relative):
    surface = turned(make())
    assert_derivatives_are_exact(SurfaceArea.of(surface, relative))
    assert_derivatives_are_exact(ProjectedArea.of(surface, OBLIQUE, relative))
    assert_derivatives_are_exact(ProjectedArea.of(surface))


@pytest.mark.slow
def test_derivatives_are_exact_on_the_wings_of_the_paper(m6):
    surface = SurfaceGrid.of(m6)
    for wing in (surface, with_points(surface, nodes_on_shape(m6, generic_blended_wing_body())[surface.rows])):
        assert_derivatives_are_exact(SurfaceArea.of(wing), size=1e-3)
        assert_derivatives_are_exact(ProjectedArea.of(wing), size=1e-3)


def test_partials_of_the_component_are_exact():
    problem = om.Problem()
    problem.model.add_subsystem("area", SurfaceMeasure(measure=SurfaceArea.of(turned(sphere(4)))))
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    assert_check_partials(problem.check_partials(method="cs", out_stream=None), atol=1e-10, rtol=1e-10)
