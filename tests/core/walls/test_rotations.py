import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao.core.walls.rotations import CHUNK_POINTS, LocalRotations
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.grids.topology.boundary_surface import quads_in_turn


def bumpy_face(rng, ni=6, nj=7, spacing=1e-3):
    """A structured face, strongly stretched, with an edge collapsed to a point; points and quads."""
    s, t = np.meshgrid(np.linspace(0.0, 1.0, ni) ** 2, spacing * np.arange(nj) ** 1.5, indexing="ij")
    points = np.stack([s, t, 0.2 * s**2 + 3.0 * s * t], axis=-1).reshape(-1, 3)
    points += 1e-2 * spacing * rng.standard_normal(points.shape)
    ids = np.arange(ni * nj).reshape(ni, nj)
    ids[0] = ids[0, 0]
    return points, quads_in_turn(ids)


def a_rotation(rng):
    return Rotation.random(random_state=rng.integers(1000)).as_matrix()


def random_case(rng):
    """Rotations of a face with a symmetry plane and fixed points, and a random move of it."""
    points, quads = bumpy_face(rng)
    points[:7, 1] = 0.0
    planes = [(np.array([0, 1, 2, 3]), np.array([0.0, 2.0, 0.0]))]
    rotations = LocalRotations.of(points, np.array([[7, 20], [3, 30]]), quads, planes, fixed=np.array([11]))
    return rotations, points, points @ a_rotation(rng).T + 1e-4 * rng.standard_normal(points.shape)


def test_a_rigid_motion_turns_every_point_alike():
    rng = np.random.default_rng(1)
    points, quads = bumpy_face(rng)
    turn = a_rotation(rng)
    moved = points @ turn.T + rng.standard_normal(3)
    found = LocalRotations.of(points, quads=quads).at(points, moved).matrices
    is_used = np.isin(np.arange(len(points)), quads)
    # round-off of the coordinates, by the shortest edge
    np.testing.assert_allclose(found[is_used], np.broadcast_to(turn, found[is_used].shape), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found[~is_used], np.broadcast_to(np.eye(3), found[~is_used].shape))


def test_points_at_rest_do_not_turn():
    points, quads = bumpy_face(np.random.default_rng(2))
    found = LocalRotations.of(points, quads=quads).at(points, points).matrices
    np.testing.assert_allclose(found, np.broadcast_to(np.eye(3), found.shape), rtol=0, atol=1e-15)


def test_the_normal_of_a_plane_is_the_normal_of_its_affine_image():
    rng = np.random.default_rng(3)
    ids = np.arange(20).reshape(4, 5)
    flat = np.stack(
        [*np.meshgrid(np.arange(4.0) ** 2, 0.01 * np.arange(5.0), indexing="ij"), np.zeros((4, 5))], axis=-1
    )
    points = flat.reshape(-1, 3)
    image = points @ (np.eye(3) + 0.3 * rng.standard_normal((3, 3))).T
    found = LocalRotations.of(points, quads=quads_in_turn(ids)).at(points, image).matrices
    normal = np.cross(image[5] - image[0], image[1] - image[0])
    np.testing.assert_allclose(found[:, :, 2], np.tile(normal / np.linalg.norm(normal), (20, 1)), rtol=0, atol=1e-12)


def test_both_sides_of_a_thin_plate_and_its_edge_turn_with_it():
    rng = np.random.default_rng(4)
    top, bottom = np.arange(12).reshape(3, 4), np.arange(12, 24).reshape(3, 4)
    bottom[0] = top[0]  # the leading edge, which both sides share
    surface = np.stack([*np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij"), np.zeros((3, 4))], axis=-1)
    points = np.concatenate([surface.reshape(-1, 3)] * 2)
    turn = a_rotation(rng)
    rotations = LocalRotations.of(points, quads=np.concatenate([quads_in_turn(top), quads_in_turn(bottom.T)]))
    found = rotations.at(points, points @ turn.T).matrices
    used = np.unique(np.concatenate([top, bottom]))
    np.testing.assert_allclose(found[used], np.broadcast_to(turn, (len(used), 3, 3)), rtol=0, atol=1e-14)


def test_edges_in_a_plane_are_enough():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0]])
    turn = a_rotation(np.random.default_rng(5))
    rotations = LocalRotations.of(points, np.array([[0, 1], [0, 2], [1, 3], [3, 2]]))
    found = rotations.at(points, points @ turn.T).matrices
    np.testing.assert_allclose(found, np.broadcast_to(turn, (4, 3, 3)), rtol=0, atol=1e-14)


def test_a_point_with_edges_along_one_line_turns_with_its_neighbours():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 0, 3]])
    turn = a_rotation(np.random.default_rng(6))
    rotations = LocalRotations.of(points, np.array([[1, 2], [2, 3], [2, 4]]))
    found = rotations.at(points, points @ turn.T).matrices
    np.testing.assert_allclose(found[[1, 2, 3, 4]], np.broadcast_to(turn, (4, 3, 3)), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(found[0], np.eye(3))


def test_points_in_a_plane_of_symmetry_keep_it():
    rotations, initial, moved = random_case(np.random.default_rng(7))
    found = rotations.at(initial, initial + 0.3 * (moved - initial)).matrices[rotations.planes[0][0]]
    np.testing.assert_allclose(found[:, 1], np.tile([0.0, 1.0, 0.0], (4, 1)), rtol=0, atol=1e-15)
    assert np.abs(found - np.eye(3)).max() > 0.05


def test_rotations_stay_smooth_where_surroundings_are_flattened():
    points = np.random.default_rng(8).uniform(-1.0, 1.0, (5, 3))
    rotations = LocalRotations.of(points, np.array([[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [3, 4], [1, 3], [2, 4]]))
    flat = points * [1.0, 1.0, 0.0]
    found = [rotations.at(points, flat + [0.0, 0.0, h] * points).matrices for h in (-1e-6, 1e-6)]
    assert np.abs(found[1] - found[0]).max() < 1e-5


def test_surroundings_turned_inside_out_are_named():
    points = np.concatenate([np.zeros((1, 3)), np.eye(3), [[1.0, 1.0, 1.0]]])
    rotations = LocalRotations.of(points, np.array([[0, 1], [0, 2], [0, 3], [1, 4], [2, 4], [3, 4]]))
    with pytest.raises(MovementError, match=r"point \d at .* inside out"):
        rotations.at(points, -points)


@pytest.mark.parametrize("seed", range(3))
def test_jvp_is_the_complex_step(seed):
    rng = np.random.default_rng(20 + seed)
    rotations, initial, moved = random_case(rng)
    d_initial, d_moved = 1e-3 * rng.standard_normal((2, *initial.shape))
    state = rotations.at(initial, moved)
    h = 1e-30
    exact = rotations.at(initial + 1j * h * d_initial, moved + 1j * h * d_moved).matrices.imag / h
    scale = np.abs(exact).max()
    np.testing.assert_allclose(state.jvp(d_initial, d_moved), exact, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(
        state.jvp(None, d_moved), rotations.at(initial, moved + 1j * h * d_moved).matrices.imag / h, atol=1e-12 * scale
    )
    assert scale > 1e-2


@pytest.mark.parametrize("seed", range(3))
def test_vjp_is_the_transpose_of_jvp(seed):
    rng = np.random.default_rng(30 + seed)
    rotations, initial, moved = random_case(rng)
    state = rotations.at(initial, moved)
    d_initial, d_moved = rng.standard_normal((2, *initial.shape))
    bar = rng.standard_normal((len(initial), 3, 3))
    terms = state.jvp(d_initial, d_moved) * bar
    bars = state.vjp(bar)
    back = (bars["initial"] * d_initial).sum() + (bars["moved"] * d_moved).sum()
    assert abs(terms.sum() - back) < 1e-12 * np.abs(terms).sum()
    np.testing.assert_array_equal(state.vjp(bar, ("moved",))["moved"], bars["moved"])


def test_rotations_do_not_depend_on_the_number_of_threads():
    rng = np.random.default_rng(10)
    ids = np.arange(61 * 71).reshape(61, 71)
    assert ids.size > 2 * CHUNK_POINTS
    points = np.stack([*np.meshgrid(np.arange(61.0), np.arange(71.0), indexing="ij"), np.zeros(ids.shape)], axis=-1)
    points = points.reshape(-1, 3) + 0.2 * rng.standard_normal((ids.size, 3))
    moved = points + 0.2 * rng.standard_normal(points.shape)
    bar = rng.standard_normal((ids.size, 3, 3))
    found = []
    for n_threads in (1, 2):
        state = LocalRotations.of(points, quads=quads_in_turn(ids), n_threads=n_threads).at(points, moved)
        found.append([state.matrices, state.jvp(points, moved), *state.vjp(bar).values()])
    for one, two in zip(*found):
        np.testing.assert_array_equal(one, two)


def test_wrong_arrays_are_refused():
    points = np.zeros((4, 3))
    with pytest.raises(InputError, match=r"quads number points from 0 to 4; there are 4"):
        LocalRotations.of(points, quads=np.array([[0, 1, 2, 4]]))
    with pytest.raises(InputError, match=r"edges of shape \(1, 3\)"):
        LocalRotations.of(points, np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match=r"give shape \(4, 3\)"):
        LocalRotations.of(points, np.array([[0, 1]])).at(points, points[:2])
