"""Probes: where lines cross bilinear quads, and how they go with the surface."""

import numpy as np
import pytest
from geometry_cases import (
    box,
    box_sheets,
    rectangular_wing,
    roughened,
    sphere,
    surface_of,
    turned,
    with_points,
)

from bspline_mdao import fit_grid
from bspline_mdao.core.measures.probes import Probes, opposite_probes
from bspline_mdao.core.measures.section_thickness import Cut, cuts_along_span, section_edges
from bspline_mdao.errors import InputError
from bspline_mdao.generators import generic_blended_wing_body, nodes_on_shape, onera_m6_grid, onera_m6_planform
from bspline_mdao.measures import SurfaceGrid


def rough_sphere(n=6):
    return with_points(sphere(n), roughened(sphere(n), 0.01))


def random_lines(n=40, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (n, 3)), rng.normal(size=(n, 3))


def test_probes_lie_on_their_line_and_on_either_side_of_its_point():
    surface = rough_sphere()
    points, directions = random_lines()
    units = directions / np.linalg.norm(directions, axis=1)[:, None]
    for probes, side in zip(opposite_probes(surface, points, directions), (-1.0, 1.0)):
        way = probes.at(surface.points) - points
        np.testing.assert_allclose(np.cross(way, units), 0.0, atol=1e-13)
        assert (side * np.sum(way * units, axis=1) > 0.5).all()
        assert np.abs(np.linalg.norm(probes.at(surface.points), axis=1) - 1.4).max() < 0.2


def test_weights_are_shares():
    for probes in opposite_probes(rough_sphere(), *random_lines()):
        np.testing.assert_allclose(probes.weights.sum(axis=1), 1.0, rtol=1e-14)
        assert probes.weights.min() >= 0.0


def test_probes_follow_affine_motions():
    surface, rng = rough_sphere(), np.random.default_rng(2)
    matrix, offset = rng.normal(size=(3, 3)), rng.normal(size=3)
    for probes in opposite_probes(surface, *random_lines()):
        moved = probes.at(surface.points @ matrix.T + offset)
        np.testing.assert_allclose(moved, probes.at(surface.points) @ matrix.T + offset, atol=1e-13)
        np.testing.assert_allclose(
            probes.matrix(surface.n_points) @ surface.points, probes.at(surface.points), atol=1e-14
        )


def test_every_point_of_a_twisted_quad_is_found():
    rng = np.random.default_rng(3)
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    for _ in range(20):
        corners = flat + rng.uniform(-0.2, 0.2, (4, 3))
        top = np.array([[corners[0], corners[3]], [corners[1], corners[2]]])
        surface = surface_of(top + [0.0, 0.0, 1.0], (top - [0.0, 0.0, 1.0]).swapaxes(0, 1))
        parameters = np.concatenate([rng.uniform(size=(20, 2)), np.eye(2), [[0.5, 0.0], [1.0, 0.3]]])
        places = Probes.on_quads(np.tile(np.arange(4), (len(parameters), 1)), parameters).at(corners)
        _, upper = opposite_probes(surface, places, [0.0, 0.0, 1.0])
        np.testing.assert_allclose(upper.at(surface.points), places + [0.0, 0.0, 1.0], atol=1e-12)


def test_lines_through_seams_and_corners_are_found_alike_in_any_order_of_the_faces():
    sheets = box_sheets((4, 5, 6))
    surface, other = surface_of(*sheets), surface_of(*sheets[::-1])
    points = surface.points[surface.points[:, 2] == 3.0] - [0.0, 0.0, 1.0]
    for a, b in zip(opposite_probes(surface, points, [0, 0, 1]), opposite_probes(other, points, [0, 0, 1])):
        np.testing.assert_allclose(a.at(surface.points), b.at(other.points), atol=1e-14)
        np.testing.assert_array_equal(a.at(surface.points)[:, :2], points[:, :2])


def test_sides_along_which_a_line_runs_do_not_count():
    wing = box((4, 5, 6))
    surface = turned(wing)
    turn = np.linalg.lstsq(wing.points - wing.points[0], surface.points - surface.points[0], rcond=None)[0]
    top = wing.points[:, 2] == 3.0
    lower, upper = opposite_probes(surface, surface.points[top] - 1.3 * turn[2], turn[2])
    np.testing.assert_allclose(upper.at(surface.points), surface.points[top], atol=1e-8)
    np.testing.assert_allclose(lower.at(surface.points), surface.points[top] - 3.0 * turn[2], atol=1e-8)


def test_lines_in_the_plane_of_symmetry_are_found():
    wing = rectangular_wing()
    surface = turned(wing)
    turn = np.linalg.lstsq(wing.points - wing.points[0], surface.points - surface.points[0], rcond=None)[0]
    is_upper = (wing.points[:, 2] == 0.0) & (wing.points[:, 1] > 0.0)
    middles = surface.points[is_upper] - wing.points[is_upper, 1:2] * turn[1]
    lower, upper = opposite_probes(surface, middles, turn[1])
    np.testing.assert_allclose(upper.at(surface.points), surface.points[is_upper], atol=1e-12)
    np.testing.assert_allclose(lower.at(surface.points), 2.0 * middles - surface.points[is_upper], atol=1e-12)


def test_a_line_is_cut_off_at_the_body_that_holds_its_point_or_is_nearest():
    far = [sheet + [0.0, 0.0, 10.0] for sheet in box_sheets()]
    surface = surface_of(*box_sheets(), *far)
    points = [[0.5, 1.0, 12.0], [0.5, 1.0, 4.0], [0.5, 1.0, 9.0], [0.5, 1.0, -2.0], [0.5, 1.0, 20.0]]
    lower, upper = opposite_probes(surface, points, [0.0, 0.0, 2.0])
    np.testing.assert_allclose(lower.at(surface.points)[:, 2], [10, 0, 10, 0, 10], atol=1e-14)
    np.testing.assert_allclose(upper.at(surface.points)[:, 2], [13, 3, 13, 3, 13], atol=1e-14)


def test_a_line_that_misses_is_named():
    with pytest.raises(InputError, match=r"^probes: the line of probe 2 of 3, through \(0.5, 5, 1\), does not cross"):
        opposite_probes(box(), [[0.5, 1.0, 1.0], [0.5, 5.0, 1.0], [0.5, 7.0, 1.0]], [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("points", "direction", "message"),
    [
        ([[0.0, 1.0]], [0.0, 0.0, 1.0], r"points of shape \(1, 2\)"),
        (np.empty((0, 3)), [0.0, 0.0, 1.0], r"points of shape \(0, 3\)"),
        ([[0.0, 1.0, np.inf]], [0.0, 0.0, 1.0], "point 1 is not finite"),
        ([[0.0, 1.0, 1.0]], [0.0, 0.0, 0.0], "a direction has no length"),
        ([[0.0, 1.0, 1.0]], np.ones((2, 3)), r"directions of shape \(2, 3\)"),
    ],
)
def test_what_is_no_line_is_refused(points, direction, message):
    with pytest.raises(InputError, match=message):
        opposite_probes(box(), points, direction)


@pytest.mark.slow
def test_sections_have_the_edges_of_the_planform():
    surface = SurfaceGrid.of(fit_grid(onera_m6_grid((13, 9, 11)), n_control=(7, 6, 6)))
    planform, fractions = onera_m6_planform(), np.array([0.0, 0.31, 0.77, 1.0])
    leading, trailing = section_edges(surface, cuts_along_span(surface, fractions))
    for probes, edge in ((leading, 0.0), (trailing, 1.0)):
        span = fractions * planform.semi_span
        expected = np.stack([planform.x(edge, span), 0.0 * span, span], axis=-1)
        np.testing.assert_allclose(probes.at(surface.points), expected, atol=1e-9)


def test_a_blunt_trailing_edge_is_taken_in_the_middle():
    surface = box()
    cut = Cut(np.array([0.0, 0.0, 1.3]), np.array([0.0, 0.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    leading, trailing = section_edges(surface, [cut])
    np.testing.assert_allclose(trailing.at(surface.points), [[0.5, 2.0, 1.3]], atol=1e-14)
    assert leading.at(surface.points)[0, 1] == 0.0


def test_a_plane_beside_the_wing_is_named():
    surface = rectangular_wing()
    with pytest.raises(InputError, match=r"section 2 of 2: the plane through \(.*\) does not cut the surface; move it"):
        section_edges(surface, cuts_along_span(surface, [0.5, 1.2]), "t/c")


def test_a_plane_that_touches_a_body_is_named():
    surface = sphere(5)
    top = surface.points[np.argmax(surface.points[:, 2])]
    with pytest.raises(InputError, match="section 1 of 1: the plane only touches the surface"):
        section_edges(surface, [Cut(top, np.eye(3)[2], np.eye(3)[0])])
    with pytest.raises(InputError, match=r"cut: .*; give two different directions"):
        Cut(np.zeros(3), np.eye(3)[2], -2.0 * np.eye(3)[2])


@pytest.mark.slow
def test_winglets_are_cut_across_their_own_span():
    model = fit_grid(onera_m6_grid((13, 9, 17)), n_control=(7, 6, 8))
    surface = SurfaceGrid.of(model)
    body = generic_blended_wing_body()
    surface = with_points(surface, nodes_on_shape(model, body)[surface.rows])
    tip = surface.points[np.argmax(surface.points[:, 1])]
    cut = Cut(tip - [0.0, 0.02, 0.0], np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    leading, trailing = section_edges(surface, [cut])
    chord = trailing.at(surface.points) - leading.at(surface.points)
    assert 0.5 * body.ribs[-1].chord < np.linalg.norm(chord) < 2.0 * body.ribs[-1].chord
    assert abs(chord[0, 1]) < 1e-12
