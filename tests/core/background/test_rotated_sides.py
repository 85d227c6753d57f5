"""Periodic sides that are copies of each other by a rotation move alike, in cylindrical coordinates."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_cases import nozzle_wedge, periodic_model, sector_mesh, sector_model
from scipy.spatial.transform import Rotation

from bspline_mdao.core.background.lattice_frame import LatticeFrame
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.node_copies import TiedNodes
from bspline_mdao.core.background.thin_gaps import thin_gaps
from bspline_mdao.core.design.deformation import Deformation, Translate
from bspline_mdao.core.design.elimination import eliminate
from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.topology.periodic_pair import Motion

ANGLES = (0.5, -0.5, 2.0 * np.pi / 9.0, 2.0, np.pi, 3.6)
"""To either side, a part of a full turn, and more than a quarter and than half of one."""


def asked(model: MeshModel, size: float) -> np.ndarray:
    """Displacements of the walls that are the same on copies but turned, and none at both ends of the floor."""
    walls, frame, line = model.mesh.points[model.wall_rows], model.lattice.frame, model.lattice.lines[0]
    x, r, s = frame.to_local(walls).T
    phase = 2.0 * np.pi * s / frame.period
    change = size * np.stack([np.sin(x + phase), 0.7 * np.cos(2.0 * x + phase), np.sin(2.0 * r + phase + x)], axis=1)
    change *= ((x - line.breaks[0]) * (line.breaks[-1] - x) / (0.5 * line.length) ** 2)[:, None]
    return model.moving_mesh.with_copies(frame.directions(walls).space(change))


def in_planes(model: MeshModel, change: np.ndarray) -> np.ndarray:
    """Displacements of the walls without what leaves planes."""
    mesh = model.moving_mesh
    for row, normal in zip(mesh.in_plane_rows, mesh.in_plane_normals):
        change[row] -= change[row] @ normal * normal
    return change


@pytest.mark.parametrize("angle", ANGLES)
def test_both_sides_move_alike_and_the_cells_between_stay_valid(angle):
    model = sector_model(angle)
    (sides,) = model.periodic
    assert abs(sides.motion.angle) == pytest.approx(abs(angle), abs=1e-12)
    assert model.lattice.lines[2].length == pytest.approx(abs(angle) * model.lattice.frame.radius)
    walls, change = model.mesh.points[model.wall_rows], asked(model, 0.05)
    nodes = model.node_map.at(model.mover.move(model.control_points, walls + change).points).nodes
    first, second = (nodes - model.mesh.points)[sides.pairs.T]
    assert np.abs(first).max() > 0.04
    np.testing.assert_allclose(sides.motion.turn(first), second, rtol=0, atol=2e-15)
    assert sides.gap(nodes) < 1e-14
    np.testing.assert_allclose(nodes[model.wall_rows], walls + change, rtol=0, atol=2e-15)
    assert not model.mesh.quality(nodes).is_inverted.any()
    assert np.array_equal(model.node_map.at(model.control_points).nodes, model.mesh.points)


def test_the_lattice_itself_is_what_moves_both_sides_alike():
    model = sector_model()
    (sides,) = model.periodic
    walls = model.mesh.points[model.wall_rows]
    displacement = model.mover.follow(walls, walls + asked(model, 0.05)).displacement
    on = [model.lattice.evaluator(model.mesh.points[sides.pairs[:, k]]).forward(displacement) for k in (0, 1)]
    np.testing.assert_allclose(sides.motion.turn(on[0]), on[1], rtol=0, atol=1e-14)
    assert np.abs(on[0]).max() > 0.02


def test_nodes_of_walls_that_are_given_differently_on_copies_take_their_mean():
    model, rng = sector_model(), np.random.default_rng(0)
    (sides,) = model.periodic
    walls = model.mesh.points[model.wall_rows]
    given = walls + asked(model, 0.05) + in_planes(model, 1e-3 * rng.normal(size=walls.shape))
    nodes = model.node_map.at(model.mover.move(model.control_points, given).points).nodes
    assert sides.gap(nodes) < 1e-14
    first, second = model.moving_mesh.copies.T
    turns, change = model.moving_mesh.copy_turns, given - walls
    means = 0.5 * (np.einsum("nij,nj->ni", turns, change[first]) + change[second])
    np.testing.assert_allclose((nodes - model.mesh.points)[model.wall_rows[second]], means, rtol=0, atol=1e-14)


def test_products_agree_and_are_differences_of_the_nodes():
    model, rng, step = sector_model(), np.random.default_rng(1), 1e-3
    walls, change = model.mesh.points[model.wall_rows], asked(model, 0.05)
    direction = in_planes(model, 0.1 * rng.normal(size=change.shape))  # other on copies
    movement = model.mover.move(model.control_points, walls + change)
    state = model.node_map.at(movement.points)
    forward = state.jvp(movement.jvp(np.zeros_like(model.control_points), direction))
    nodes = {
        k: model.node_map.at(model.mover.move(model.control_points, walls + change + k * step * direction).points).nodes
        for k in (-2, -1, 1, 2)
    }
    differences = (8.0 * (nodes[1] - nodes[-1]) - (nodes[2] - nodes[-2])) / (12.0 * step)
    assert np.abs(differences - forward).max() < 1e-8 * np.abs(forward).max()
    bar = rng.normal(size=state.nodes.shape)
    reverse = movement.vjp(state.vjp(bar)["control_points"])[1]
    size = np.linalg.norm(bar) * np.linalg.norm(forward)
    assert abs(np.vdot(bar, forward) - np.vdot(reverse, direction)) < 1e-12 * size


def test_deformations_and_design_variables_move_copies_of_walls_by_the_turned_displacement():
    model, rng = sector_model(), np.random.default_rng(2)
    mesh, points = model.moving_mesh, model.mesh.points[model.wall_rows]
    shift = Deformation(mesh, (Translate(np.array([0.02, 0.03, -0.01])),))
    change = model.deformed(shift) - points
    first, second = mesh.copies.T
    (sides,) = model.periodic
    ahead = sides.motion if np.isin(model.wall_rows[first], sides.pairs[:, 0]).all() else sides.motion.inverse()
    np.testing.assert_allclose(ahead.turn(change[first]), change[second], rtol=0, atol=1e-15)
    found = eliminate(mesh, points)
    moved = (found.matrix @ rng.normal(size=points.size)).reshape(-1, 3)
    np.testing.assert_allclose(ahead.turn(moved[first]), moved[second], rtol=0, atol=1e-13)
    assert np.abs(moved[second]).max() > 0.1


@pytest.mark.parametrize("angle", [5.0, 30.0, 120.0])
def test_nodes_on_the_axis_of_a_wedge_move_along_it_alone(angle):
    marked = marked_grid(nozzle_wedge(np.radians(angle)))
    kinds = {name: guess.kind for name, guess in marked.kinds.items()}
    model = MeshModel.of(marked.mesh, kinds, LatticeSettings(spacing=0.3))
    (sides,), frame = model.periodic, model.lattice.frame
    walls = model.mesh.points[model.wall_rows]
    x, _, s = frame.to_local(walls).T
    up = 0.3 * np.sin(np.pi * x / 3.0) ** 2 * (1.0 + 0.3 * np.sin(2.0 * np.pi * s / frame.period))
    change = frame.directions(walls).space(np.stack([0.0 * x, up, 0.0 * x], axis=1))
    nodes = model.node_map.at(model.mover.move(model.control_points, walls + change).points).nodes
    moved, is_on_axis = nodes - model.mesh.points, frame.is_on_axis(model.mesh.points)
    assert is_on_axis.sum() == 15
    assert np.abs(moved[is_on_axis, 0]).max() > 1e-3
    assert np.abs(moved[is_on_axis, 1:]).max() == 0.0
    assert sides.gap(nodes) < 1e-15
    assert not model.mesh.quality(nodes).is_inverted.any()


def test_coordinates_and_directions_are_those_of_a_cylinder():
    frame, rng = sector_model().lattice.frame, np.random.default_rng(3)
    points, step = sector_model().mesh.points[::7], 1e-6
    local = frame.to_local(points)
    np.testing.assert_allclose(frame.to_space(local), points, atol=1e-13)
    vectors = rng.normal(size=points.shape)
    moved = (frame.to_local(points + step * vectors) - frame.to_local(points - step * vectors)) / (2.0 * step)
    moved[:, 2] *= local[:, 1] / frame.radius
    np.testing.assert_allclose(frame.directions(points).local(vectors), moved, atol=1e-8)
    evaluator = sector_model().lattice.evaluator(points)
    control, bar = rng.normal(size=(sector_model().lattice.n_control, 3)), rng.normal(size=points.shape)
    there, back = np.vdot(bar, evaluator.forward(control)), np.vdot(evaluator.adjoint(bar), control)
    assert abs(there - back) < 1e-12 * abs(there)


def test_sides_that_no_rotation_lays_onto_each_other_stay():
    mesh, kinds = sector_mesh()
    points = mesh.points.copy()
    rows = np.unique((mesh.markers or {})["per_1"])
    points[rows] += 0.02 * np.sin(7.0 * points[rows])
    model = MeshModel.of(replace(mesh, points=points), kinds, LatticeSettings(spacing=0.4))
    assert model.periodic == ()
    assert model.lattice.frame.is_cartesian
    assert np.isin(np.setdiff1d(rows, model.wall_rows), model.rows_at_rest).all()


def test_ends_that_are_no_planes_across_the_axis_are_refused_where_they_are_symmetry_and_stay_otherwise():
    mesh, kinds = sector_mesh()
    frame = sector_model().lattice.frame
    local = frame.to_local(mesh.points)
    local[:, 0] += 0.2 * local[:, 1]
    cones = replace(mesh, points=frame.to_space(local))
    with pytest.raises(InputError, match="plane of in is not at right angles to the axis of the rotation"):
        MeshModel.of(cones, {**kinds, "in": "symmetry"})
    model = MeshModel.of(cones, kinds, LatticeSettings(spacing=0.4))
    assert len(model.periodic) == 1
    rows = np.unique((mesh.markers or {})["in"])
    assert np.isin(np.setdiff1d(rows, model.wall_rows), np.union1d(model.rows_at_rest, model.periodic[0].pairs)).all()


def test_a_shift_along_the_axis_is_tied_as_well():
    mesh, kinds = sector_mesh(lean=0.0)
    model = MeshModel.of(mesh, {**kinds, "in": "periodic", "out": "periodic"}, LatticeSettings(spacing=0.4))
    assert {each.axis for each in model.periodic} == {0, 2}
    walls, rng = model.mesh.points[model.wall_rows], np.random.default_rng(4)
    given = walls + model.moving_mesh.with_copies(0.01 * rng.normal(size=walls.shape))
    nodes = model.node_map.at(model.mover.move(model.control_points, given).points).nodes
    assert max(each.gap(nodes) for each in model.periodic) < 1e-14
    assert any(each.motion == Motion(shift=each.motion.shift, unit=each.motion.unit) for each in model.periodic)


def test_a_deformation_that_differs_on_both_sides_is_named_with_a_node():
    model = sector_model()
    mesh, frame = model.moving_mesh, model.lattice.frame
    alike = Deformation(mesh, (Translate(0.1 * frame.axes[0]),))
    assert model.split_copies(alike)[0] < 1e-15
    off, where = model.split_copies(Deformation(mesh, (Translate(0.1 * frame.axes[1]),)))
    assert off == pytest.approx(0.2 * np.sin(0.25), rel=1e-6)
    assert where.startswith("node ")
    assert where.endswith("of marker 'floor'")


def test_a_body_that_reaches_beyond_the_cut_of_the_period_has_spans_as_well():
    mesh, kinds = sector_mesh()
    model = MeshModel.of(mesh, {**kinds, "floor": "farfield"}, LatticeSettings(spacing=0.3))
    local = model.lattice.frame.to_local(model.mesh.points[model.wall_rows])[:, 2]
    first, last = model.lattice.lines[2].spans(np.array([local.min(), local.max()]))
    assert first > last
    assert (
        thin_gaps(model.lattice, mesh.points[model.wall_rows], np.searchsorted(model.wall_rows, model.walls.faces))
        == ()
    )


@pytest.mark.parametrize("make", [sector_model, periodic_model])
def test_what_follows_walls_sees_those_beyond_the_sides(make):
    model = make()
    (sides,), walls = model.periodic, model.mesh.points[model.wall_rows]
    rng = np.random.default_rng(5)
    given = walls + model.moving_mesh.with_copies(in_planes(model, 0.01 * rng.normal(size=walls.shape)))
    points = np.concatenate([given, model.lattice.control_points])  # all that moves is what follows walls
    whole = model.node_map
    nodes = replace(whole, tied=TiedNodes.of(np.zeros((0, 2), dtype=int), model.mesh.points, LatticeFrame(np.eye(3))))
    first, second = (nodes.at(points).nodes - model.mesh.points)[sides.pairs.T]
    np.testing.assert_allclose(sides.motion.turn(first), second, rtol=0, atol=1e-12)
    inner = np.setdiff1d(sides.pairs[:, 0], model.wall_rows)
    assert np.abs((whole.at(points).nodes - model.mesh.points)[inner]).max() > 1e-3


@pytest.mark.parametrize(("angle", "turn"), [(5.0, 0.0), (30.0, 1.0), (135.0, -0.5)])
def test_nodes_stay_in_both_planes_of_symmetry_of_a_wedge_and_on_its_axis(angle, turn):
    marked = marked_grid(nozzle_wedge(np.radians(angle)))
    rotation = Rotation.from_rotvec(turn * np.array([0.3, 1.0, -0.6])).as_matrix()
    mesh = replace(marked.mesh, points=marked.mesh.points @ rotation.T + [0.1, -0.3, 2.0])
    kinds = {
        "nozzle": "wall",
        "in": "farfield",
        "out": "farfield",
        "periodic_1a": "symmetry",
        "periodic_1b": "symmetry",
    }
    model = MeshModel.of(mesh, kinds, LatticeSettings(spacing=0.3))
    frame, walls, rng = model.lattice.frame, mesh.points[model.wall_rows], np.random.default_rng(7)
    assert {plane.axis for plane in model.planes} == {0, 2}
    assert not any(line.is_periodic for line in model.lattice.lines)
    x, _, s = frame.to_local(walls).T
    up = 0.2 * np.sin(np.pi * (x - x.min()) / 3.0) ** 2 * (1.0 + 0.3 * s)
    change = in_planes(model, frame.directions(walls).space(np.stack([0.0 * x, up, 0.0 * x], axis=1)))
    movement = model.mover.move(model.control_points, walls + change)
    state = model.node_map.at(movement.points)
    moved = state.nodes - mesh.points
    for plane in model.planes:
        assert np.abs(moved[plane.rows] @ plane.normal).max() < 1e-14
    is_on_axis = frame.is_on_axis(mesh.points)
    assert is_on_axis.sum() == 15
    assert np.abs(moved[is_on_axis] @ frame.axes[0]).max() > 1e-3
    assert np.abs(moved[is_on_axis] @ frame.axes[1:].T).max() < 1e-15
    assert not mesh.quality(state.nodes).is_inverted.any()
    direction = in_planes(model, 0.1 * rng.normal(size=walls.shape))
    bar = rng.normal(size=state.nodes.shape)
    forward = state.jvp(movement.jvp(np.zeros_like(model.control_points), direction))
    reverse = movement.vjp(state.vjp(bar)["control_points"])[1]
    size = np.linalg.norm(bar) * np.linalg.norm(forward)
    assert abs(np.vdot(bar, forward) - np.vdot(reverse, direction)) < 1e-12 * size
