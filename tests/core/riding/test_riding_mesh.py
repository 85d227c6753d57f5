"""Meshes ride along: bits at rest, walls, heights, derivatives, refusals."""

import numpy as np
import pytest
from riding_cases import mesh, model, moved, twisted
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, MovementError
from bspline_mdao.core.riding.riding_walls import _fading
from bspline_mdao.meshes import EmbeddedMesh, MixedMesh


@pytest.fixture
def rng():
    return np.random.default_rng(8)


@pytest.fixture(scope="module")
def riding():
    return EmbeddedMesh.of(model(), mesh())


def asked(riding):
    return twisted()[1].apply_to_nodes(riding.walls.initial)


def test_control_points_that_stay_leave_every_bit(riding):
    assert (riding.at(model().control_points).nodes == mesh().points).all()
    assert (riding.at(model().control_points, riding.walls.initial).nodes == mesh().points).all()


def test_nodes_of_walls_are_where_they_are_asked_to_be(riding):
    wall = asked(riding)
    state = riding.at(twisted()[0], wall)
    np.testing.assert_array_equal(state.nodes[riding.walls.rows], wall)
    assert np.linalg.norm(state.nodes - mesh().points, axis=1).max() > 0.05


def test_heights_are_kept_and_no_cell_folds_also_those_3000_times_as_long_as_high(riding):
    for wall in (None, asked(riding)):
        state = riding.at(twisted()[0], wall)
        ratios = riding.walls.heights(state.nodes) / riding.walls.heights(mesh().points)
        assert len(ratios) == riding.n_asked
        assert np.abs(np.quantile(ratios, [0.01, 0.99]) - 1.0).max() < 0.02
        assert not mesh().quality(state.nodes).is_inverted.any()
    sheared = mesh().points.copy()
    sheared[riding.rows] += riding.evaluator.forward(twisted()[0] - model().control_points)
    assert np.ptp(np.quantile(riding.walls.heights(sheared) / riding.walls.heights(mesh().points), [0.01, 0.99])) > 0.02


@pytest.mark.parametrize("is_asked", [False, True])
def test_nodes_stay_in_the_plane_of_symmetry_also_those_inside_the_body_by_the_error_of_the_fit(riding, is_asked):
    in_plane = mesh().points[:, 2] == 0.0
    assert riding.distances[in_plane].max() > 1e-4
    for control, deformation in (twisted(), moved("bend=15deg")):
        on_wall = np.flatnonzero(mesh().points[riding.walls.rows, 2] == 0.0)
        wall = deformation.apply_to_nodes(riding.walls.initial, [(on_wall, np.eye(3)[2])])
        state = riding.at(control, wall if is_asked else None)
        assert np.abs(state.nodes[in_plane, 2]).max() < 1e-14
        assert np.abs(state.nodes - mesh().points)[in_plane].max() > 1e-3


@pytest.mark.parametrize(("n", "reach"), [(11, 0.8), (101, 0.1 * np.sqrt(2.0))])
def test_what_volumes_miss_of_a_wall_fades_over_eight_widths_but_at_least_a_tenth_of_all_walls(n, reach, rng):
    axis, ids = np.linspace(0.0, 1.0, n), np.arange(n * n).reshape(n, n)
    wall = np.stack([*np.meshgrid(axis, axis, indexing="ij"), np.zeros((n, n))], axis=-1).reshape(-1, 3)
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    heights = reach * np.array([0.0, 0.5, 0.9, 0.98, 1.02, 2.0])
    points = np.column_stack([rng.uniform(0.3, 0.7, (len(heights), 2)), heights])
    weights = _fading(points, wall, quads).sum(axis=1)
    assert weights[0] == pytest.approx(1.0, abs=1e-12)
    assert np.all(np.diff(weights[:5]) < 0.0)
    assert np.all(weights[:4] > 0.0)
    assert not weights[4:].any()


def test_a_mesh_follows_a_rigid_motion_within_the_volumes(rng):
    points = model().evaluator().forward(model().control_points)[::11]
    inside = EmbeddedMesh.of(model(), MixedMesh(points, {}))
    turn, shift = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix(), rng.standard_normal(3)
    moved = inside.at(model().control_points @ turn.T + shift).nodes
    np.testing.assert_allclose(moved, points @ turn.T + shift, rtol=0, atol=1e-10 * np.ptp(points))


def test_walls_are_found_with_and_without_markers(riding):
    assert riding.walls.faces.names == ("wing",)
    bare = MixedMesh(mesh().points, mesh().cells)
    np.testing.assert_array_equal(EmbeddedMesh.of(model(), bare).walls.rows, riding.walls.rows)
    with pytest.raises(InputError, match=r"mesh: no marker is 'tail\*'; its markers are wing, symmetry, far"):
        EmbeddedMesh.of(model(), mesh(), walls=["tail*"])


def with_node_outside(distance):
    """The mesh with one more cell, a node of which is outside the far field."""
    far = mesh().points[np.argmax(mesh().points[:, 1])]
    points = np.concatenate([mesh().points, far + [[0.0, distance, 0.0]]])
    return MixedMesh(points, {**mesh().cells, "tetra": np.array([[0, 1, 2, mesh().n_points]])}, mesh().markers)


@pytest.mark.slow
def test_nodes_outside_are_named_held_or_moved_with_the_nearest_point():
    lone, control = with_node_outside(1e3), twisted()[0]
    with pytest.raises(InputError, match=r"1 of [\d,]+ nodes are outside .* 1e\+03 m away; .*--hold-outside") as error:
        EmbeddedMesh.of(model(), lone)
    assert "\n" not in str(error.value)
    held = EmbeddedMesh.of(model(), lone, hold_outside=True)
    assert held.left.tolist() == [mesh().n_points]
    assert (held.at(control).nodes[-1] == lone.points[-1]).all()
    with pytest.raises(
        MovementError, match=rf"beside node {lone.n_points} its boundary moves by 1 m; fix that boundary"
    ):
        held.at(control + [0.0, 1.0, 0.0])
    allowed = EmbeddedMesh.of(model(), lone, tolerance=2e3)
    np.testing.assert_allclose(allowed.at(control + [0.0, 1.0, 0.0]).nodes[-1], lone.points[-1] + [0.0, 1.0, 0.0])
    with pytest.raises(InputError, match="a tolerance of -1"):
        EmbeddedMesh.of(model(), lone, tolerance=-1.0)
