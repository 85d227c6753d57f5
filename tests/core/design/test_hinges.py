"""Rotation about hinges: the map, the part of a surface that turns, and grids and meshes that follow."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mesh_cases import mesh_around_two_sections, section_model

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.design.deformation import Rotate, jvp, vjp
from bspline_mdao.core.design.hinge import BehindHinge, NearestPart, RotatedPart, about_axis, about_axis_rates
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.design import (
    Hinge,
    HingePoints,
    OnPatch,
    Parametrization,
    ReferenceAxis,
    Rotation,
    Span,
    SurfaceRows,
    Twist,
    parse_deformation,
)
from bspline_mdao.generators import brick_grid, naca_section, onera_m6_grid, section_o_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import ComovingFrame, LinearElasticity, Rotations, moving_mesh

OBLIQUE = np.array([[0.3, -0.2, 0.1], [0.9, 0.4, 1.3]])
STEP = 1e-40


@cache
def section():
    """Fit of an O-grid about NACA 0012 of unit chord, x downstream and y up."""
    return fit_grid(section_o_grid(naca_section(0.12), n_around=64, far=20.0, n_away=24))


@cache
def wing():
    """Fit of a small M6."""
    return fit_grid(onera_m6_grid((15, 13, 13)), n_control=(7, 6, 6))


def deformed(model, words):
    """Control mesh, its surface, and where words put that."""
    mesh = moving_mesh(model)
    surface = mesh.points[mesh.surface_ids]
    return mesh, surface, parse_deformation(words, model, mesh).apply(surface)


def n_inverted(model, points):
    """Cells that are inverted where control points are somewhere, and on the baseline."""
    baseline = model.regenerate()
    quality = GridQuality.of_baseline(baseline)
    nodes = (grid.to_vector().reshape(-1, 3) for grid in (model.regenerate(points), baseline))
    return tuple(report_quality(quality, each).n_inverted for each in nodes)


# the map


@pytest.mark.parametrize("angle", [25.0, 200.0, 400.0, -725.0])
def test_points_turn_rigidly_by_any_angle_and_as_turns_of_parts_do(angle):
    points = np.random.default_rng(0).normal(size=(30, 3))
    turned = about_axis(points, OBLIQUE, np.radians(angle))
    apart = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (points, turned)]
    np.testing.assert_allclose(*apart, atol=1e-13)
    np.testing.assert_allclose(about_axis(OBLIQUE, OBLIQUE, np.radians(angle)), OBLIQUE, atol=1e-15)
    by_parts = points
    for _ in range(7):
        by_parts = about_axis(by_parts, OBLIQUE, np.radians(angle) / 7.0)
    np.testing.assert_allclose(turned, by_parts, atol=1e-13)


def test_positive_angles_turn_by_the_right_hand_from_the_first_point_to_the_second():
    turned = about_axis(np.array([[2.0, 0.0, 5.0]]), np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 3.0]]), np.radians(90.0))
    np.testing.assert_allclose(turned, [[1.0, 1.0, 5.0]], atol=1e-15)


def test_rates_in_points_axis_and_angles_are_exact():
    random = np.random.default_rng(1)
    points, angles = random.normal(size=(7, 3)), random.uniform(-8.0, 8.0, 7)
    d_points, d_hinge = random.normal(size=(7, 3)), random.normal(size=(2, 3))
    rates = about_axis_rates(points, OBLIQUE, angles)
    directions = d_points, *(np.broadcast_to(d, (7, 3)) for d in d_hinge)
    found = sum(np.einsum("nij,nj->ni", rate, d) for rate, d in zip(rates, directions))
    exact = about_axis(points + 1j * STEP * d_points, OBLIQUE + 1j * STEP * d_hinge, angles).imag / STEP
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_turning_fades_without_a_jump_of_its_slope_ahead_of_the_line_and_beyond_its_ends():
    hinge, stream = np.array([[0.7, 0.1, 1.0], [0.9, 0.1, 2.0]]), np.array([1.0, 0.0, 0.0])
    part = RotatedPart(behind=BehindHinge(hinge, stream, blend=0.2, ends=0.3))
    places = np.array([[0.75, 5.0, 1.0], [2.0, -3.0, 2.0], [0.0, 0.0, 1.5], [2.0, 0.0, 0.6], [2.0, 0.0, 2.4]])
    np.testing.assert_array_equal(part.weights(places), [1.0, 1.0, 0.0, 0.0, 0.0])
    for start, end in (([0.3, 0.0, 1.5], [1.0, 0.0, 1.5]), ([1.5, 0.0, 0.5], [1.5, 0.0, 2.5])):
        line = np.linspace(start, end, 4001)
        weights = part.weights(line)
        slopes = np.diff(weights) / np.linalg.norm(np.diff(line, axis=0), axis=1)
        assert weights.min() == 0.0
        assert weights.max() == 1.0
        assert np.abs(np.diff(slopes)).max() < 0.02 * np.abs(slopes).max()


def test_ends_of_a_swept_hinge_are_cut_along_the_stream():
    hinge, stream = np.array([[0.7, 0.0, 1.0], [1.2, 0.0, 2.0]]), np.array([1.0, 0.0, 0.0])
    sharp = BehindHinge(hinge, stream, blend=0.1, ends=0.0)
    behind = np.array([[x, 0.0, z] for z in (0.999, 1.001, 1.999, 2.001) for x in (1.3, 4.0)])
    np.testing.assert_array_equal(sharp.weights(behind), [0, 0, 1, 1, 1, 1, 0, 0])


def test_other_points_are_of_the_part_whose_known_points_are_nearest():
    points = np.random.default_rng(2).uniform(size=(40, 3))
    part = NearestPart.of(points, points[:, 0] > 0.6)
    np.testing.assert_array_equal(part.contains(points), points[:, 0] > 0.6)
    np.testing.assert_array_equal(part.contains(points + 1e-9), points[:, 0] > 0.6)


# words


def test_a_flap_turns_whole_behind_its_line_and_nothing_does_ahead_of_the_blend():
    _, surface, moved = deformed(section(), "rotate=-25deg@hinge(0.7,0,0 -> 0.7,0,1),blend=0.1")
    behind, ahead = surface[:, 0] >= 0.7, surface[:, 0] <= 0.6
    hinge = np.array([[0.7, 0.0, 0.0], [0.7, 0.0, 1.0]])
    np.testing.assert_allclose(moved[behind], about_axis(surface[behind], hinge, np.radians(-25.0)), atol=1e-12)
    np.testing.assert_array_equal(moved[ahead], surface[ahead])
    assert 0 < np.count_nonzero(~behind & ~ahead) < len(surface)


def test_a_part_of_the_chord_is_the_line_through_it_and_turns_the_trailing_edge_down():
    model = wing()
    mesh = moving_mesh(model)
    surface = mesh.points[mesh.surface_ids]
    deformation = parse_deformation("rotate=20deg@chord 0.7,span=0.5:0.8,blend=0.1,ends=0.1", model, mesh)
    (rotate,) = deformation.maps
    along = np.sort(rotate.hinge[:, 2]) / surface[:, 2].max()
    np.testing.assert_allclose(along, [0.5, 0.8], atol=1e-3)
    moved = deformation.apply(surface)
    lowest = np.argmin((moved - surface)[:, 1])
    assert (moved - surface)[lowest, 1] < -0.03
    assert np.abs((moved - surface)[surface[:, 2] < 0.3 * surface[:, 2].max()]).max() == 0.0


AXES = {
    "span -y, z up": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "span y, z up": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),  # a mirror
    "in millimetres": 1000.0 * np.eye(3),
}


@pytest.mark.parametrize("axes", AXES)
def test_a_part_of_the_chord_turns_down_whatever_the_axes_and_the_unit(axes):
    grid, matrix = onera_m6_grid((9, 7, 9)), AXES[axes]
    blocks = tuple(replace(block, nodes=block.nodes @ matrix) for block in grid.blocks)
    models = [fit_grid(each, n_control=(7, 5, 7)) for each in (grid, replace(grid, blocks=blocks))]
    size = np.linalg.norm(matrix[0])
    changes = []
    for model, unit in zip(models, (1.0, size)):
        _, surface, moved = deformed(model, f"rotate=20deg@chord 0.7,span=0.3:0.8,blend={0.2 * unit}")
        changes.append(moved - surface)
    np.testing.assert_allclose(changes[1], changes[0] @ matrix, atol=1e-9 * size)
    assert changes[0][:, 1].min() < -0.03
    assert -changes[0][:, 1].min() > 3.0 * changes[0][:, 1].max()  # what is ahead of the line hardly rises


def test_words_mean_the_same_whatever_comes_before_since_patches_go_along():
    model = wing()
    mesh, surface, moved = deformed(model, "stretch=2+rotate=30deg@hinge(0.2,0,0 -> 0.2,0,1),patches=wing_upper")
    (upper,) = parse_deformation("rotate=1@hinge(0,0,0->0,0,1),patches=*upper", model, mesh).maps
    is_upper = upper.part.weights(surface)
    stretched = surface * [1.0, 1.0, 2.0]
    hinge = np.array([[0.2, 0.0, 0.0], [0.2, 0.0, 1.0]])
    wanted = np.where(is_upper[:, None] > 0.0, about_axis(stretched, hinge, np.radians(30.0)), stretched)
    assert 0 < np.count_nonzero(is_upper) < len(surface)
    np.testing.assert_allclose(moved, wanted, atol=1e-12)


def test_nodes_of_the_patches_turn_and_all_others_stay():
    model = wing()
    deformation = parse_deformation("rotate=20deg@hinge(0.7,0,0 -> 0.7,0,1),patches=*upper", model, moving_mesh(model))
    walls = SurfaceGrid.of(model)
    is_upper = np.zeros(walls.n_points, dtype=bool)
    is_upper[walls.parts[walls.patches.index("wing_upper")]] = True
    hinge = np.array([[0.7, 0.0, 0.0], [0.7, 0.0, 1.0]])
    moved = deformation.apply_to_nodes(walls.points)
    np.testing.assert_allclose(moved[is_upper], about_axis(walls.points[is_upper], hinge, np.radians(20.0)), atol=1e-12)
    np.testing.assert_array_equal(moved[~is_upper], walls.points[~is_upper])


def test_derivatives_where_turning_fades_are_those_of_differences_and_transposed():
    hinge, stream = np.array([[0.7, 0.1, 1.0], [0.9, 0.2, 2.0]]), np.array([1.0, 0.0, 0.0])
    random = np.random.default_rng(5)
    points = random.uniform([0.2, -0.3, 0.4], [1.5, 0.3, 2.6], (400, 3))
    behind = BehindHinge(hinge, stream, blend=0.4, ends=0.5)
    rotate = Rotate(hinge, np.radians(200.0), RotatedPart(NearestPart.of(points, points[:, 1] > 0.2), behind))
    d_points, bar = random.normal(size=(2, *points.shape))
    exact = jvp(rotate, points, d_points)
    assert np.sum(exact * bar) == pytest.approx(np.sum(d_points * vjp(rotate, points, bar)), rel=1e-12)
    difference = 0.0
    for step, factor in ((1e-4, 8.0), (2e-4, -1.0)):
        ends = (rotate.apply(points + sign * step * d_points) for sign in (1.0, -1.0))
        difference = difference + factor * np.subtract(*ends) / (12.0 * 1e-4)
    off = np.abs(difference - exact).max(axis=1)
    assert (off < 1e-8).mean() > 0.98  # the others are where the fading begins and ends, or parts meet
    is_faded = (behind.weights(points) > 0.1) & (behind.weights(points) < 0.9)
    assert np.count_nonzero(is_faded & (off < 1e-8)) > 50


REFUSED = {
    "rotate=25": "no axis is named; write @hinge",
    "rotate=25@axis(0,0,0 -> 0,0,1)": "is no axis; write @hinge",
    "rotate=25@chord 1.7": "is no part of the chord from 0 to 1",
    "rotate=25@hinge(0,0,0->0,0,1)": "say what turns: blend=LENGTH",
    "rotate=25,blend=0.1": "no axis is named; write @hinge",
    "rotate=25@0.7,blend=0.1": "'0.7' is no axis; write @hinge",
    "rotate=25@hinge(0,0,0;0,0,1),blend=0.1": "is no axis; write @hinge",
    "rotate=25@hinge(0,0->0,0,1),blend=0.1": "is no axis; write @hinge",
    "rotate=25@hinge(0,0,0->0,0,1,blend=0.1": "not of the form name=value",
    "rotate=25@hinge(0,0,0->0,0,0),blend=0.1": "both of its points are .*; give two different ones",
    "rotate=25@hinge(1e999,0,0->0,0,1),blend=0.1": "its first point is .inf, .*; give three finite numbers",
    "rotate=25@hinge(0,0,0->1,0,0),blend=0.1": "along the stream, so that nothing lies behind it",
    "rotate=25@hinge(0,0,0->0,0,1),patches=flap*": "no patch is called 'flap.*'; the patches are .*wing_upper",
    "rotate=25@hinge(0,0,0->0,0,1),patches=*,ends=1": "ends is of what is behind the hinge line; give blend",
    "rotate=25@hinge(0,0,0->0,0,1),blend=0": "give a number above 0",
    "rotate=25@hinge(0,0,0->0,0,1),blend=1,ends=-1": "ends -1 is no length; give one, or 0 for none",
    "rotate=25@hinge(0,0,0->0,0,1),blend=1,span=0:1": "'span' is not known here; rotate takes @ and patches",
    "rotate=25@chord 1.7,blend=0.1": "is no part of the chord from 0 to 1; write for example @chord 0.7",
    "rotate=25@chord 0.7,span=0.9:0.6,blend=0.1": "span '0.9:0.6' is not two rising parts from 0 to 1",
    "rotate=25@chord 0.7,span=0.3:0.6,blend=0.01": r"folds in this blend; give a blend above 0\.0",
    "rotate=25@hinge(__import__('os'),0,0->0,0,1),blend=1": "not of the form|is no axis",
    "rotate=lots@hinge(0,0,0->0,0,1),blend=1": "'lots' is not an angle",
}


@pytest.mark.parametrize("words", REFUSED)
def test_words_that_turn_nothing_or_are_not_understood_are_refused_in_one_line(words):
    model = wing()
    with pytest.raises(InputError, match=REFUSED[words]) as error:
        parse_deformation(words, model, moving_mesh(model))
    assert "\n" not in str(error.value)
    assert str(error.value).startswith("deformation '")


# grids and meshes that follow


@pytest.mark.parametrize("angle", [-25.0, 25.0])
def test_the_grid_of_a_section_follows_its_flap_without_an_inverted_cell(angle):
    model = section()
    mesh, _, moved = deformed(model, f"rotate={angle}deg@hinge(0.7,0,0 -> 0.7,0,1),blend=0.1")
    points = Rotations(mesh).move(mesh.points, moved).points
    assert n_inverted(model, points) == (0, 0)


@pytest.mark.parametrize("angle", [200.0, 400.0])
def test_a_whole_body_turns_by_any_angle_with_an_outer_boundary_that_goes_along(angle):
    model = section()
    mesh, _, moved = deformed(model, f"rotate={angle}deg@hinge(0.4,0,0 -> 0.4,0,1),patches=*")
    points = ComovingFrame(LinearElasticity(mesh, n_increments=1)).move(mesh.points, moved).points
    hinge = np.array([[0.4, 0.0, 0.0], [0.4, 0.0, 1.0]])
    np.testing.assert_allclose(points, about_axis(mesh.points, hinge, np.radians(angle)), atol=1e-10)


def test_a_body_turns_about_an_oblique_axis_with_its_outer_boundary_by_any_angle():
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    mesh = moving_mesh(model)
    surface = mesh.points[mesh.surface_ids]
    for angle in (200.0, -725.0):
        shape = Parametrization(mesh, [Rotation("all", Hinge(*OBLIQUE))])
        moved = shape.apply(surface, {"all": np.array([angle])})
        points = ComovingFrame(Rotations(mesh)).move(mesh.points, moved).points
        np.testing.assert_allclose(points, about_axis(mesh.points, OBLIQUE, np.radians(angle)), atol=1e-10)
        assert n_inverted(model, points) == (0, 0)


def test_within_an_outer_boundary_that_stays_a_body_turned_by_400_degrees_is_taken_for_40():
    model = section()
    words = "rotate={}deg@hinge(0.4,0,0 -> 0.4,0,1),patches=*"
    mesh, _, by_400 = deformed(model, words.format(400))
    by_40 = deformed(model, words.format(40))[2]
    mover = Rotations(mesh)
    points = [mover.move(mesh.points, surface).points for surface in (by_400, by_40)]
    np.testing.assert_allclose(*points, atol=1e-9)
    assert n_inverted(model, points[0]) == (0, 0)


@pytest.mark.parametrize("angle", [-25.0, 25.0])
def test_a_mesh_without_structure_takes_the_same_words_about_a_flap_in_one_piece(angle):
    model = section_model()  # an ellipse, z up
    design = model.design_mesh()
    words = f"rotate={angle}deg@hinge(0.2,0,0 -> 0.2,1,0),blend=0.2"
    walls = model.deformed(parse_deformation(words, model, design))
    surface = design.points[design.surface_ids]
    hinge, behind = np.array([[0.2, 0.0, 0.0], [0.2, 1.0, 0.0]]), surface[:, 0] >= 0.2
    np.testing.assert_allclose(walls[behind], about_axis(surface[behind], hinge, np.radians(angle)), atol=1e-12)
    np.testing.assert_array_equal(walls[surface[:, 0] < 0.0], surface[surface[:, 0] < 0.0])
    movement = model.mover_of(design).move(model.control_points, walls)
    nodes = model.node_map.at(movement.points).nodes
    assert not model.mesh.quality(nodes).is_inverted.any()


@pytest.mark.parametrize("angle", [-25.0, 25.0])
def test_a_flap_behind_a_gap_turns_as_a_whole_and_the_main_element_stays(angle):
    model = MeshModel.of(*mesh_around_two_sections(0.04))
    design = model.design_mesh()
    surface = design.points[design.surface_ids]
    words = f"rotate={angle}deg@hinge(0.3,-0.108,0 -> 0.3,-0.108,1),patches=fl*"
    walls = model.deformed(parse_deformation(words, model, design))
    is_flap = np.isin(design.surface_ids, np.searchsorted(model.wall_rows, np.unique(model.mesh.markers["flap"])))
    hinge = np.array([[0.3, -0.108, 0.0], [0.3, -0.108, 1.0]])
    np.testing.assert_allclose(walls[is_flap], about_axis(surface[is_flap], hinge, np.radians(angle)), atol=1e-12)
    np.testing.assert_array_equal(walls[~is_flap], surface[~is_flap])
    movement = model.mover_of(design).move(model.control_points, walls)
    assert not model.mesh.quality(model.node_map.at(movement.points).nodes).is_inverted.any()


# design variables

FLAP = Hinge((0.6, 0.0, 0.3), (0.9, 0.05, 0.9))


def with_a_flap(where=None, blend=0.15):
    """Twist and span of a wing, then the place of a flap's hinge, its angle, and a tab's behind it."""
    mesh = moving_mesh(wing())
    axis, tab = ReferenceAxis.of(mesh, n=3), Hinge((0.85, 0.0, 0.4), (0.95, 0.0, 0.7))
    variables = [
        Twist("twist", axis, 3),
        Span("span", axis),
        HingePoints("line", FLAP, "xy"),
        Rotation("flap", FLAP, where, blend=blend),
        Rotation("tab", tab, blend=0.05, ends=0.1),
    ]
    return Parametrization(mesh, variables)


def away(parametrization, angle=37.0):
    """Surface points off the baseline, and values off those at which nothing moves."""
    random = np.random.default_rng(3)
    surface = parametrization.mesh.points[parametrization.mesh.surface_ids]
    values = {name: v + 0.05 * random.normal(size=v.shape) for name, v in parametrization.initial.items()}
    return surface + 0.01 * random.normal(size=surface.shape), values | {"flap": np.array([angle])}


@pytest.mark.parametrize("angle", [37.0, 400.0])
@pytest.mark.parametrize("where", [None, "wing_upper"])
def test_derivatives_in_angle_hinge_points_and_surface_are_exact_and_transposed(where, angle):
    shape = with_a_flap(where and OnPatch(wing(), where))
    (initial, values), random = away(shape, angle), np.random.default_rng(4)
    partials, bar = shape.partials(initial, values), random.normal(size=initial.size)
    for name, matrix in {None: partials.initial, **partials.values}.items():
        direction = random.normal(size=matrix.shape[1])
        step = 1j * STEP * direction
        at = (initial, values | {name: values[name] + step}) if name else (initial + step.reshape(-1, 3), values)
        exact, forward = shape.apply(*at).imag.ravel() / STEP, matrix @ direction
        assert np.abs(exact).max() > 1e-4
        np.testing.assert_allclose(forward, exact, rtol=0, atol=1e-12 * np.abs(exact).max(), err_msg=str(name))
        assert bar @ forward == pytest.approx((matrix.T @ bar) @ direction, rel=1e-10)


def test_a_variable_and_words_turn_a_flap_alike():
    model = wing()
    mesh, surface, moved = deformed(model, "rotate=20deg@hinge(0.7,0,0 -> 0.7,0,1),blend=0.1,ends=0.2")
    hinge = Hinge((0.7, 0.0, 0.0), (0.7, 0.0, 1.0))
    shape = Parametrization(mesh, [Rotation("flap", hinge, blend=0.1, ends=0.2)])
    np.testing.assert_allclose(shape.apply(surface, {"flap": np.array([20.0])}), moved, atol=1e-14)


def test_a_hinge_goes_along_with_what_moves_the_wing_before():
    mesh = moving_mesh(wing())
    surface, axis = mesh.points[mesh.surface_ids], ReferenceAxis.of(mesh, n=3)
    hinge, spread = Hinge((0.7, 0.0, 0.4), (0.9, 0.0, 0.8)), np.array([1.0, 1.0, 2.0])
    shape = Parametrization(mesh, [Span("span", axis), Rotation("flap", hinge, SurfaceRows([31, 40, 41]))])
    moved = shape.apply(surface, {"span": np.array([2.0]), "flap": np.array([50.0])})
    wanted = about_axis(surface[[31, 40, 41]] * spread, hinge.points * spread, np.radians(50.0))
    np.testing.assert_allclose(moved[[31, 40, 41]], wanted, atol=1e-12)


def test_the_hinge_of_a_tab_turns_with_the_flap_and_its_own_hinge_stays():
    mesh = moving_mesh(wing())
    tab = Hinge((0.95, 0.001, 0.5), (0.95, 0.001, 0.7))  # just below the upper side
    flap = Rotation("flap", FLAP, OnPatch(wing(), "*upper"))
    layout = Layout(mesh, (FLAP, tab))
    turned = flap.bind(layout).apply(layout.points, np.array([30.0]))
    np.testing.assert_array_equal(turned[layout.rows(FLAP)], FLAP.points)
    np.testing.assert_allclose(
        turned[layout.rows(tab)], about_axis(tab.points, FLAP.points, np.radians(30.0)), atol=1e-14
    )


def test_a_hinge_that_moves_turns_the_flap_about_where_it_goes():
    mesh = moving_mesh(wing())
    surface = mesh.points[mesh.surface_ids]
    shape = Parametrization(mesh, [HingePoints("line", FLAP, "xy"), Rotation("all", FLAP, np.arange(20, 40))])
    values = {"line": np.array([0.1, 0.2, -0.3, 0.4]), "all": np.array([-70.0])}
    hinge = FLAP.points + [[0.1, 0.2, 0.0], [-0.3, 0.4, 0.0]]
    moved = shape.apply(surface, values)
    free = np.setdiff1d(np.arange(20, 40), mesh.in_plane_rows)
    np.testing.assert_allclose(moved[free], about_axis(surface[free], hinge, np.radians(-70.0)), atol=1e-13)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Hinge((0, 0, 0), (0, 0, 0)), "both of its points are .*; give two different ones"),
        (lambda: Hinge((0, 0, 0), (0, 0)), "its second point is .*; give three finite numbers"),
        (lambda: Rotation("flap", ((0, 0, 0), (0, 0, 1))), "'flap': the hinge is of type tuple; give a Hinge"),
        (lambda: HingePoints("line", None), "'line': the hinge is of type NoneType; give a Hinge"),
        (lambda: Rotation("flap", FLAP, blend=-0.1), "'flap': blend -0.1; give a distance in metres"),
        (lambda: Rotation("flap", FLAP, blend=0.0), "give a positive blend, or neither"),
        (lambda: Rotation("flap", FLAP, ends=0.1), "give a positive blend, or neither"),
        (lambda: _bound(Rotation("flap", FLAP, OnPatch(wing(), "flap*"))), "no patch is called 'flap"),
        (lambda: _bound(Rotation("flap", Hinge((9, 0, 0), (9, 0, 1)), blend=0.1)), "no point of the surface is behind"),
        (lambda: _bound(HingePoints("line", FLAP, "abc")), "'line': no direction is called 'abc'"),
        (lambda: _bound(HingePoints("line", FLAP)), r"'?line'?.* moves nothing \(no point of the surface\)"),
        (lambda: Hinge.on_chord(moving_mesh(wing()), 0.7, (0.9, 0.2)), "give two rising parts"),
    ],
)
def test_hinges_and_rotations_that_cannot_be_are_refused(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def _bound(variable):
    return Parametrization(moving_mesh(wing()), [variable])
