"""Meshes that move by a lattice in the background: identity, walls, planes, derivatives."""

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body, smooth_change

from bspline_mdao.base.numerics.rotation_group import turns
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.thin_plate import bending_energy
from bspline_mdao.core.background.turned_gradients import TurnedGradients
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.io.marker_kinds import marker_kinds, undecided


@pytest.fixture(scope="module")
def model() -> MeshModel:
    """The mesh around a body, with a lattice of few spans."""
    return MeshModel.of(*mesh_around_a_body(), LatticeSettings(spacing=0.4))


def moved(model: MeshModel, change: np.ndarray):
    """Move the walls; the movement, and the state of the mesh."""
    movement = model.mover.move(model.control_points, model.mesh.points[model.wall_rows] + change)
    return movement, model.node_map.at(movement.points)


def test_the_baseline_comes_back_to_the_last_bit(model):
    movement, state = moved(model, np.zeros((len(model.wall_rows), 3)))
    assert np.array_equal(movement.points, model.control_points)
    assert np.array_equal(state.nodes, model.mesh.points)


def test_walls_are_met_planes_are_kept_and_far_fields_stay(model):
    change = smooth_change(model, np.random.default_rng(1), 0.03)
    _, state = moved(model, change)
    assert np.array_equal(state.nodes[model.wall_rows], model.mesh.points[model.wall_rows] + change)
    (plane,) = model.planes
    assert np.array_equal(state.nodes[plane.rows, 1], model.mesh.points[plane.rows, 1])
    resting = model.rows_at_rest
    assert len(resting) > 100
    assert np.array_equal(state.nodes[resting], model.mesh.points[resting])
    assert not model.mesh.quality(state.nodes).is_inverted.any()


def test_nodes_between_move_with_the_wall(model):
    change = np.zeros((len(model.wall_rows), 3))
    change[:, 0] = 0.1
    _, state = moved(model, change)
    inner = np.setdiff1d(np.arange(model.n_nodes), np.concatenate([model.wall_rows, model.rows_at_rest]))
    part = (state.nodes - model.mesh.points)[inner, 0] / 0.1
    assert part.max() > 0.7
    assert part.min() > -0.2


def test_forward_and_reverse_products_agree_to_1e_12(model):
    rng = np.random.default_rng(2)
    movement, state = moved(model, smooth_change(model, rng, 0.05))
    d_surface, d_initial = smooth_change(model, rng, 1.0), rng.normal(size=model.control_points.shape)
    bar = rng.normal(size=state.nodes.shape)
    forward = np.vdot(bar, state.jvp(movement.jvp(d_initial, d_surface)))
    initial_bar, surface_bar = movement.vjp(state.vjp(bar)["control_points"])
    reverse = np.vdot(initial_bar, d_initial) + np.vdot(surface_bar, d_surface)
    assert abs(forward - reverse) < 1e-12 * np.linalg.norm(bar) * np.linalg.norm(d_initial)


def test_products_are_differences_of_the_nodes_to_1e_8(model):
    rng = np.random.default_rng(3)
    change, direction, step = smooth_change(model, rng, 0.05), smooth_change(model, rng, 1.0), 1e-3
    nodes = {k: moved(model, change + k * step * direction)[1].nodes for k in (-2, -1, 1, 2)}
    differences = (8.0 * (nodes[1] - nodes[-1]) - (nodes[2] - nodes[-2])) / (12.0 * step)
    movement, state = moved(model, change)
    product = state.jvp(movement.jvp(np.zeros_like(model.control_points), direction))
    assert np.abs(differences - product).max() < 1e-8 * np.abs(product).max()


def test_bending_energy_of_an_affine_displacement_is_zero_and_of_others_does_not_depend_on_the_unit():
    mesh, kinds = mesh_around_a_body()
    scaled = MixedMesh(1000.0 * mesh.points, mesh.cells, mesh.markers)
    energies = []
    for each in (mesh, scaled):
        model = MeshModel.of(each, kinds)
        energy, net = bending_energy(model.lattice), model.lattice.control_points
        affine = net @ np.array([0.3, -1.2, 0.7]) + 2.0
        scale = np.abs(energy) @ np.abs(affine) @ np.abs(affine)
        assert abs(affine @ (energy @ affine)) < 1e-13 * scale
        bent = np.sin(np.arange(len(net)) * 0.37)
        energies.append(bent @ (energy @ bent))
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_gradients_that_are_a_rotation_cost_nothing_whatever_the_unit():
    mesh, kinds = mesh_around_a_body()
    turn, energies = turns(np.array([[0.4, -1.1, 0.8]]))[0], []
    for scale in (1.0, 1000.0):
        model = MeshModel.of(MixedMesh(scale * mesh.points, mesh.cells, mesh.markers), kinds)
        turned, net = TurnedGradients(model.lattice), model.lattice.frame.to_local(model.lattice.control_points)
        everywhere = np.broadcast_to(turn, (len(turned.at_places(net)), 3, 3))
        left = turned.energy @ (net @ turn.T) - turned.pull(everywhere)
        assert np.abs(left).max() < 1e-13 * (np.abs(turned.energy) @ np.abs(net @ turn.T)).max()
        bent = np.sin(np.arange(len(net)) * 0.37)
        energies.append(bent @ (turned.energy @ bent))
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_what_walls_pull_and_where_rotations_are_known_are_transposed_exactly(model):
    turned, rng = TurnedGradients(model.lattice), np.random.default_rng(6)
    unknowns = rng.normal(size=(turned.energy.shape[0], 3))
    places = turned.at_places(unknowns)
    at_places, targets = rng.normal(size=places.shape), rng.normal(size=(len(places), 3, 3))
    assert np.vdot(at_places, places) == pytest.approx(np.vdot(turned.at_places_vjp(at_places), unknowns), rel=1e-12)
    pulled = np.vdot(turned.pull(targets), unknowns)
    assert pulled == pytest.approx(np.vdot(targets, turned.pull_vjp(unknowns)), rel=1e-11)


@pytest.mark.slow
def test_a_part_of_a_wall_that_moves_by_itself_does_not_turn_the_lattice_further_than_itself():
    """Rotations jump from node to node at its edge, which spans of the lattice cannot follow."""
    mesh, kinds = mesh_around_a_body()
    model, faces = MeshModel.of(mesh, kinds), mesh.markers["body"]
    is_nose = (mesh.points[faces][..., 0] < 0.0).any(axis=1)
    is_of = [np.isin(model.wall_rows, faces[which]) for which in (is_nose, ~is_nose)]
    movement, state = moved(model, np.stack([0.01 * is_of[0], np.zeros(len(model.wall_rows)), 0.02 * is_of[1]], axis=1))
    assert not mesh.quality(state.nodes).is_inverted.any()
    assert np.abs(movement.followed.at_places).max() < np.abs(movement.followed.vectors.values).max()


def test_a_mesh_that_is_turned_moves_as_it_does_upright():
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    (upright, kinds), (turned, _) = mesh_around_a_body(), mesh_around_a_body(turn)
    settings, found = LatticeSettings(spacing=0.5), []
    for mesh, back in ((upright, np.eye(3)), (turned, turn)):
        model = MeshModel.of(mesh, kinds, settings)
        change = np.zeros((len(model.wall_rows), 3))
        change[:, 1] = 0.2 * (mesh.points @ back)[model.wall_rows, 1]
        change[:, 0] = 0.1
        nodes = moved(model, change @ back.T)[1].nodes
        found.append((nodes - mesh.points) @ back)
        (plane,) = model.planes
        assert np.abs((nodes - mesh.points)[plane.rows] @ plane.normal).max() < 1e-15
    # but for the plane's, the directions of the lattice are those of space: boxes and spans are others
    assert np.abs(found[0] - found[1]).max() < 0.08


def test_what_cannot_be_moved_is_refused_in_one_line():
    mesh, kinds = mesh_around_a_body()
    with pytest.raises(InputError, match="no marker is a wall"):
        MeshModel.of(mesh, {"symmetry": "symmetry"})
    empty = MixedMesh(mesh.points, mesh.cells, {**(mesh.markers or {}), "tip": np.zeros((0, 4), dtype=int)})
    with pytest.raises(InputError, match="no marker is a wall, or it has no faces"):
        MeshModel.of(empty, {"tip": "wall"})
    plate = {"plate": mesh.cells["tetra"][300:301, [0, 1, 2, 2]], **(mesh.markers or {})}
    cut = MixedMesh(mesh.points, mesh.cells, plate)
    with pytest.raises(InputError, match="wall 'plate' has cells on both sides"):
        MeshModel.of(cut, {**kinds, "plate": "wall"}).node_map  # noqa: B018
    guesses = {"plate": marker_kinds(cut)["plate"]}
    assert "no marker looks like a wall but 'plate'" in undecided(cut, guesses)
    with pytest.raises(InputError, match="no marker is 'wing'; its markers are body"):
        MeshModel.of(mesh, {"wing": "wall"})
    with pytest.raises(InputError, match="symmetry marker 'body' is not at an end of the mesh"):
        MeshModel.of(mesh, {**kinds, "body": "symmetry", "far_00": "wall"})


def test_both_sides_of_a_section_may_be_one_marker_and_their_walls_move_alike():
    x, y = np.linspace(-2.0, 3.0, 12), np.linspace(-1.5, 2.0, 9)
    points = np.array([[a, b, c] for c in (0.0, 0.3) for a in x for b in y])
    ids = np.arange(len(points)).reshape(2, len(x), len(y))
    middle = np.stack(np.meshgrid(0.5 * (x[:-1] + x[1:]), 0.5 * (y[:-1] + y[1:]), indexing="ij"), axis=-1)
    is_cell = ~(np.abs(middle) < 0.6).all(axis=-1)
    ring = [ids[:, :-1, :-1], ids[:, 1:, :-1], ids[:, 1:, 1:], ids[:, :-1, 1:]]
    corners = np.stack([each[k] for k in (0, 1) for each in ring], axis=-1)[is_cell]
    used, numbers = np.unique(corners, return_inverse=True)
    points = points[used]
    bare = MixedMesh(points, {"hexahedron": numbers.reshape(corners.shape)})
    skin = bare.skin
    is_side, ends = np.ptp(points[skin][..., 2], axis=1) == 0.0, ((0, -2.0), (0, 3.0), (1, -1.5), (1, 2.0))
    is_far = np.any([np.isclose(points[skin][..., d], end).all(axis=1) for d, end in ends], axis=0)
    markers = {"sides": skin[is_side], "far": skin[is_far], "body": skin[~is_side & ~is_far]}
    mesh = MixedMesh(points, bare.cells, markers)
    model = MeshModel.of(mesh, {"sides": "symmetry", "far": "farfield", "body": "wall"})
    assert sorted((plane.axis, plane.end) for plane in model.planes) == [(2, -1), (2, 0)]
    walls, pairs = points[model.wall_rows], model.moving_mesh.copies
    assert 2 * len(pairs) == len(walls)
    assert np.array_equal(walls[pairs[:, 0], :2], walls[pairs[:, 1], :2])
    change = 0.05 * np.sin(walls @ [[1.0, 2.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 0.0]])
    nodes = moved(model, change)[1].nodes
    low, high = (nodes[points[:, 2] == z] for z in (0.0, 0.3))
    np.testing.assert_allclose(low[:, :2], high[:, :2], rtol=0, atol=1e-14)


def test_walls_that_are_sides_of_the_box_take_the_nodes_between_along():
    nodes = np.stack(np.meshgrid(np.linspace(0.0, 4.0, 9), *[np.linspace(0.0, 1.0, 6)] * 2, indexing="ij"), axis=-1)
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    a, b = slice(None, -1), slice(1, None)
    ring = [(a, a), (b, a), (b, b), (a, b)]
    corners = np.stack([ids[i, j, k] for k in (a, b) for i, j in ring], axis=-1).reshape(-1, 8)
    points = nodes.reshape(-1, 3)
    bare = MixedMesh(points, {"hexahedron": corners})
    skin = bare.skin
    inlet, outlet = ((points[skin][..., 0] == x).all(axis=1) for x in (0.0, 4.0))
    markers = {"inlet": skin[inlet], "outlet": skin[outlet], "duct": skin[~inlet & ~outlet]}
    model = MeshModel.of(MixedMesh(points, bare.cells, markers), {"duct": "wall"})
    rigid = points @ turns(np.array([[0.8, 0.0, 0.0]]))[0].T + [0.0, -0.1, 0.3]
    np.testing.assert_allclose(moved(model, rigid[model.wall_rows])[1].nodes, points + rigid, rtol=0, atol=1e-12)
    affine = points * [0.0, 0.1, -0.2] + points[:, [1, 2, 0]] * [0.0, 0.05, 0.03]
    off = moved(model, affine[model.wall_rows])[1].nodes - points - affine
    assert np.abs(off).max() < 0.04 * np.abs(affine).max()
