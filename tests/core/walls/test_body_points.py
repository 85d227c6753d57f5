"""Points inside a body ride on its surface: affine motions, nodes of the surface, wing boxes, derivatives, refusals."""

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.walls import body_points
from bspline_mdao.core.walls.body_points import Body, BodyPoints
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.measures import SurfaceGrid

SPAN = 1.4843


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((17, 13, 7)))


@pytest.fixture(scope="module")
def body(model):
    surface = SurfaceGrid.of(model)
    return Body(surface.points, surface.quads)


def chord_line(z):
    """Leading edge and chord of the M6 at stations along the span (m)."""
    return 0.857753 * z / SPAN, 0.805891 + (0.4535 - 0.805891) * z / SPAN  # to the mm, as the box needs it


def wing_box():
    """Nodes of seven ribs between two spars, one rib in the plane of symmetry; every rib has nine nodes."""
    z, xi, eta = np.meshgrid(np.linspace(0.0, 0.95 * SPAN, 7), [0.2, 0.4, 0.6], [-0.02, 0.0, 0.02], indexing="ij")
    front, chord = chord_line(z)
    return np.stack([front + xi * chord, eta * chord, z], axis=-1).reshape(-1, 3)


def twisted(points, degrees=5.0):
    """Sections turned about their quarter chords, in proportion to the span."""
    z = points[:, 2]
    front, chord = chord_line(z)
    x, y, angle = points[:, 0] - front - 0.25 * chord, points[:, 1], np.radians(degrees) * z / SPAN
    turned = np.stack([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle), z], axis=1)
    return turned + np.outer(front + 0.25 * chord, [1.0, 0.0, 0.0])


def test_a_wing_box_is_inside_and_what_is_around_it_is_not(body):
    assert body.surrounds(wing_box()).all()
    around = wing_box() + [0.0, 0.2, 0.0], wing_box() + [1.0, 0.0, 0.0], wing_box() - [0.0, 0.0, 1.5]
    assert not body.surrounds(np.concatenate(around)).any()


@pytest.mark.parametrize("most", [16, 128])
def test_points_follow_every_affine_motion_of_the_surface(body, most, monkeypatch):
    monkeypatch.setattr(body_points, "MOST", most)
    rng = np.random.default_rng(0)
    matrix, shift, ride = rng.standard_normal((3, 3)), rng.standard_normal(3), BodyPoints.of(body, wing_box())
    np.testing.assert_allclose(ride.at(body.points @ matrix + shift).nodes, wing_box() @ matrix + shift, atol=1e-13)
    np.testing.assert_allclose(ride.at(body.points).nodes, wing_box(), atol=1e-15)


def test_ribs_keep_their_place_in_the_section_when_the_wing_twists(body):
    ride, (_, chord) = BodyPoints.of(body, wing_box()), chord_line(wing_box()[:, 2])
    off = np.linalg.norm(ride.at(twisted(body.points)).nodes - twisted(wing_box()), axis=1) / chord
    assert off.max() < 2e-3  # of the chord, where nodes move by 0.02 chords
    assert off.mean() < 4e-4
    assert np.linalg.norm(twisted(wing_box()) - wing_box(), axis=1).max() > 0.01


def test_points_on_the_surface_and_in_its_plane_stay_there(body):
    rng = np.random.default_rng(1)
    numbers, quads = rng.integers(0, len(body.points), 20), body.quads[rng.integers(0, len(body.quads), 20)]
    diagonals = body.points[quads[:, [0, 2]]].mean(axis=1)
    in_plane = wing_box()[wing_box()[:, 2] == 0.0]
    moved = body.points + 0.02 * rng.standard_normal(body.points.shape)
    moved[body.points[:, 2] == 0.0, 2] = 0.0
    found = BodyPoints.of(body, np.concatenate([body.points[numbers], diagonals, in_plane])).at(moved).nodes
    np.testing.assert_allclose(found[:20], moved[numbers], atol=1e-15)
    np.testing.assert_allclose(found[20:40], moved[quads[:, [0, 2]]].mean(axis=1), atol=1e-14)
    np.testing.assert_allclose(found[40:, 2], 0.0, atol=1e-15)


def test_the_ride_is_smooth_from_the_middle_to_the_wall(body):
    """Along a line from wall to wall no step is much larger than its neighbours."""
    front, chord = chord_line(0.5 * SPAN)
    line = np.linspace([0.0, -0.048, 0.0], [0.0, 0.048, 0.0], 400) * chord + [front + 0.4 * chord, 0.0, 0.5 * SPAN]
    bumps = body.points + 0.02 * np.sin(9.0 * body.points[:, [2, 0, 1]])
    steps = np.linalg.norm(np.diff(BodyPoints.of(body, line).at(bumps).nodes - line, axis=0), axis=1)
    assert steps.max() < 5.0 * np.median(steps) + 1e-5


def test_nodes_that_are_dropped_from_a_point_have_faded_so_that_it_does_not_jump(body, monkeypatch):
    """Along a line on which the nodes that a point rides on change, its slope is bounded whatever the step."""
    monkeypatch.setattr(body_points, "MOST", 8)
    front, chord = chord_line(0.5 * SPAN)
    ends = np.array([[front + 0.3 * chord, 0.0, 0.3 * SPAN], [front + 0.5 * chord, 0.02 * chord, 0.6 * SPAN]])
    bumps = body.points + 0.02 * np.random.default_rng(3).standard_normal(body.points.shape)
    largest = []
    for n_steps in (200, 800):
        ride = BodyPoints.of(body, np.linspace(*ends, n_steps + 1))
        largest.append(np.linalg.norm(np.diff(ride.at(bumps).nodes, axis=0), axis=1).max())
    assert (np.diff((ride.weights != 0.0).toarray().astype(int), axis=0) != 0).sum() > 20
    assert largest[1] == pytest.approx(0.25 * largest[0], rel=0.02)


def test_the_weights_of_a_point_are_bounded_in_number(body):
    ride = BodyPoints.of(body, wing_box())
    assert ride.weights.nnz <= body_points.MOST * len(wing_box())
    assert np.diff(ride.weights.indptr).max() <= body_points.MOST


def test_one_call_tells_points_in_the_body_from_those_in_the_volumes(model):
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    volume = model.evaluator().forward(model.control_points)[::101]
    points = np.concatenate([volume, wing_box(), nodes[SurfaceGrid.of(model).rows][::7]])
    embedded = model.embed_points(points, 1e-6)
    n = len(volume)
    assert set(range(n, n + 63)) <= set(embedded.in_body)
    assert set(range(n + 63, len(points))) <= set(embedded.in_body)
    assert len(embedded.in_volume) > 0.8 * n
    matrix = np.diag([1.1, 0.9, 1.2]) + [[0.0, 0.02, 0.0], [0.0, 0.0, 0.0], [0.1, 0.05, 0.0]]
    control_points = model.control_points @ matrix
    found = embedded.at(control_points, model.grid_map().at(control_points).nodes).nodes[embedded.in_body]
    walls = SurfaceGrid.of(model).rows
    expected = model.grid_map().at(control_points).nodes[walls]
    np.testing.assert_allclose(found[-len(nodes[walls][::7]) :], expected[::7], atol=1e-14)
    np.testing.assert_allclose(found[:63], (points @ matrix)[n : n + 63], atol=2e-4)  # as the residual of the fit turns


def test_points_that_are_nowhere_are_named(model):
    points = np.concatenate([wing_box(), [[0.5, 0.0, -0.3]]])
    with pytest.raises(InputError, match=r"1 of 64 points lie outside .* not inside the walls: point 64 at") as error:
        model.embed_points(points)
    assert "\n" not in str(error.value)


def test_a_closed_body_needs_no_fan():
    surface = SurfaceGrid.of(fit_grid(ball_grid((7, 7, 7, 5)), n_control=5))
    ball = Body(surface.points, surface.quads)
    assert ball.means.shape[0] == 0
    rng, radius = np.random.default_rng(4), np.linalg.norm(surface.points, axis=1).max()
    inside = 0.5 * radius * rng.uniform(-1.0, 1.0, (20, 3))
    assert ball.surrounds(inside).all()
    matrix = rng.standard_normal((3, 3))
    np.testing.assert_allclose(BodyPoints.of(ball, inside).at(ball.points @ matrix).nodes, inside @ matrix, atol=1e-13)
