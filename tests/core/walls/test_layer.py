from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import read_grid
from bspline_mdao.core.walls.closest_points import TriangleTree
from bspline_mdao.core.walls.frames import WallFrames
from bspline_mdao.core.walls.layer import WallLayer
from bspline_mdao.core.walls.layer_pieces import CHUNK_NODES
from bspline_mdao.core.walls.settings import LAYER
from bspline_mdao.core.walls.triangle_places import SAME_DISTANCE, _by_lines, closest_place
from bspline_mdao.core.walls.wall import Wall
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.boundary_surface import BoundarySurface, quads_in_turn
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.sharing import node_sharing

ROWS = np.arange(7 * 6 * 9).reshape(7, 6, 9)
"""Rows of a block: its wall is k = 0, and j = 0 lies in a plane of symmetry."""

NORMALS = np.array([[0.0, 1.0, 0.0]])
"""Normal of that plane."""


def stretched(n, first, ratio=1.5):
    """Distances from 0, the first cell of a given height, growing."""
    return np.concatenate([[0.0], np.cumsum(first * ratio ** np.arange(n - 1))])


def bumpy_block(rng, first=1e-4):
    """Nodes of a viscous block over a bumpy wall, shape (n, 3)."""
    i, j, k = np.meshgrid(np.linspace(0, 1, 7), np.linspace(0, 2, 6) ** 2, stretched(9, first, 2.2), indexing="ij")
    nodes = np.stack([i + 0.1 * j, j, k + 0.1 * np.sin(3 * i + j)], axis=-1)
    nodes[:, 1:] += 0.02 * rng.standard_normal((7, 5, 1, 3))
    return nodes.reshape(-1, 3)


def bumpy_case(rng, n_threads=None, **options):
    """Layer of that block with a plane of symmetry, fixed nodes at its far end and some copies; nodes and wall rows."""
    nodes = bumpy_block(rng)
    wall_rows = ROWS[:, :, 0].ravel()
    spare = nodes[ROWS[3, 2, :4]]
    nodes, copies = np.concatenate([nodes, spare]), np.stack([ROWS.size + np.arange(4), ROWS[3, 2, :4]], axis=1)
    fixed = np.flatnonzero(np.isin(wall_rows, ROWS[-1]))
    planes = [(np.flatnonzero(np.isin(wall_rows, ROWS[:, 0])), np.array([0.0, 1.0, 0.0]))]
    heights = np.linalg.norm(nodes[ROWS[:, :, 1].ravel()] - nodes[wall_rows], axis=1)
    quads, faces = quads_in_turn(np.arange(42).reshape(7, 6)), np.repeat([1, 0], [10, 20])
    wall = Wall.of(nodes[wall_rows], quads, heights, planes, fixed, faces, n_threads)
    planes = [(ROWS[:, 0].ravel(), np.array([0.0, -3.0, 0.0]))]
    layer = WallLayer.of(wall, nodes, wall_rows, planes, ROWS[-1].ravel(), copies, n_threads, **options)
    return layer, nodes, wall_rows


def random_move(rng, nodes, wall_rows, size=0.02):
    """Mapped nodes and a moved wall, not near to each other."""
    turn = Rotation.from_rotvec(0.5 * rng.standard_normal(3)).as_matrix()
    mapped = nodes @ turn.T + size * rng.standard_normal(nodes.shape)
    return mapped, mapped[wall_rows] + size * rng.standard_normal((len(wall_rows), 3))


def brute_closest(points, triangles, p, n=40):
    """Distance from p to samples of triangles, shape (n_triangles,)."""
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    w = np.stack([u, (1 - u) * v, (1 - u) * (1 - v)], axis=-1).reshape(-1, 3)
    return np.array([np.linalg.norm(w @ points[t] - p, axis=1).min() for t in triangles])


def test_the_first_closest_point_is_the_nearest_of_the_wall():
    rng = np.random.default_rng(1)
    points = np.stack([*np.meshgrid(np.arange(5.0), 0.3 * np.arange(4.0), indexing="ij"), np.zeros((5, 4))], axis=-1)
    points = points.reshape(-1, 3) + 0.1 * rng.standard_normal((20, 3))
    tree = TriangleTree.of(points, quads_in_turn(np.arange(20).reshape(5, 4)), np.full(20, 10.0))
    at = rng.uniform([-1, -1, 0.2], [5, 2, 1], (25, 3))
    closest = tree.closest_points(at)
    np.testing.assert_array_equal(closest.points, np.arange(25))
    first = closest.starts[:-1]
    found = np.einsum("nc,ncd->nd", closest.barycentric[first], points[tree.triangles[closest.triangles[first]]])
    assert closest.barycentric.min() >= 0.0
    for p, point in zip(at, found):
        nearest = brute_closest(points, tree.triangles, p).min()
        assert nearest - 0.02 < np.linalg.norm(point - p) <= nearest + 1e-12


def test_points_between_two_walls_follow_both_smoothly():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    points = np.concatenate([square, square + [0.0, 0, 1]])
    tree = TriangleTree.of(points, np.array([[0, 1, 2, 3], [4, 7, 6, 5]]), np.full(8, 1.5))
    z = np.linspace(0.01, 0.99, 981)
    closest = tree.closest_points(np.stack([np.full(981, 0.3), np.full(981, 0.4), z], axis=1))
    low = np.zeros(981)
    is_low = closest.barycentric @ [1.0, 1.0, 1.0] * points[tree.triangles[closest.triangles]][:, 0, 2] < 0.5
    np.add.at(low, np.repeat(closest.points, np.diff(closest.starts))[is_low], closest.weights[is_low])
    np.testing.assert_array_equal(low[z > LAYER.farthest / (1 + LAYER.farthest)], 0.0)
    assert low[0] == pytest.approx(1.0, abs=1e-4)
    assert np.all(np.diff(low) <= 0.0)
    assert np.abs(np.diff(low, 2)).max() < 1e-4


def test_points_beside_a_plate_without_thickness_stand_on_their_own_side():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    tree = TriangleTree.of(np.concatenate([square, square]), np.array([[4, 7, 6, 5], [0, 1, 2, 3]]), np.ones(8))
    closest = tree.closest_points(np.array([[0.3, 0.4, 0.1], [0.3, 0.4, -0.1], [0.5, 0.5, 0.2]]))
    np.testing.assert_array_equal(np.diff(closest.starts), 1)
    np.testing.assert_array_equal(tree.triangles[closest.triangles].max(axis=1) < 4, [True, False, True])


def wavy_body(rng, n_around, n_along):
    """Nodes and quads of a thin wavy body, open at both ends, with a sharp edge behind."""
    turn, z = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, n_around), np.linspace(0.0, 2.0, n_along))
    x, y = np.cos(0.5 * turn) ** 2, 0.06 * np.sin(turn) * (1.0 + 0.3 * np.cos(9.0 * turn + 4.0 * z))
    ids = np.arange(turn.size).reshape(turn.shape)
    ids[:, -1] = ids[:, 0]
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3) + 1e-4 * rng.standard_normal((turn.size, 3))
    return points, ids


def test_closest_points_do_not_depend_on_the_order_of_points():
    rng = np.random.default_rng(7)
    points, ids = wavy_body(rng, 30, 7)
    tree = TriangleTree.of(points, quads_in_turn(ids), rng.uniform(0.1, 0.5, len(points)))
    at = rng.uniform([-0.6, -0.6, -0.5], [1.6, 0.6, 2.5], (701, 3))
    order, alone = rng.permutation(len(at)), [tree.closest_points(p[None]) for p in at]
    sorted_back = tree.closest_points(at[order])
    counts = np.zeros(len(at), dtype=int)
    counts[order[sorted_back.points]] = np.diff(sorted_back.starts)
    np.testing.assert_array_equal(counts, [len(each.triangles) for each in alone])
    assert counts.max() > 1
    assert 100 < np.count_nonzero(counts == 0) < 600
    for p, first, last in zip(order[sorted_back.points], sorted_back.starts[:-1], sorted_back.starts[1:]):
        for name in ("triangles", "barycentric", "weights"):
            np.testing.assert_array_equal(getattr(sorted_back, name)[first:last], getattr(alone[p], name))


@pytest.mark.slow
def test_boxes_that_are_left_out_hold_no_closest_point():
    rng = np.random.default_rng(5)
    points, ids = wavy_body(rng, 60, 17)
    for quads in (quads_in_turn(ids), quads_in_turn(ids)[:, ::-1]):  # seen from outside and from inside
        tree = TriangleTree.of(points, quads, np.full(len(points), 0.5))
        at = rng.uniform([-0.2, -0.2, -0.1], [1.2, 0.2, 2.1], (2011, 3))
        bare = replace(tree, cones=np.zeros_like(tree.cones), cosines=np.full(len(tree.triangles), -1.0))
        with_cones, without = (t.closest_points(at) for t in (tree, bare))
        assert np.diff(with_cones.starts).max() > 1
        for name in ("points", "starts", "triangles", "barycentric", "weights"):
            np.testing.assert_array_equal(getattr(with_cones, name), getattr(without, name))
    assert np.count_nonzero(tree.cones[:, 3]) > 0.3 * len(tree.cones)
    assert np.count_nonzero(tree.cosines > 0.0) > 0.5 * len(tree.cosines)


def test_lines_to_corners_settle_what_distances_do():
    rng = np.random.default_rng(6)
    points, ids = wavy_body(rng, 14, 5)
    tree = TriangleTree.of(points, quads_in_turn(ids), np.full(len(points), 0.5))
    mesh, around, verdicts = (tree.points, tree.triangles), (tree.around_starts, tree.around), []
    for p in points[::2] + rng.uniform([-0.01, 0.0, -0.01], [0.01, 0.1, 0.01], (35, 3)):
        squares, *places = np.array([closest_place(*mesh, t, *p) for t in range(len(tree.triangles))]).T
        for t in np.argsort(squares)[:20]:
            near, place = np.sqrt(squares[t]) * (1.0 - SAME_DISTANCE), np.array(places)[:, t]
            if place.min() == 0.0:
                beside = np.all([(tree.triangles == k).any(axis=1) for k in tree.triangles[t, place > 0.0]], axis=0)
                verdict = _by_lines(*p, t, near, *place, *mesh, *around)
                verdicts.append((verdict, np.sqrt(squares[beside].min()) >= near))
    verdict, is_least = np.array(verdicts).T
    np.testing.assert_array_equal(verdict[verdict != 0] > 0, is_least[verdict != 0] > 0)
    assert np.count_nonzero(verdict == 0) < 0.1 * len(verdict)
    assert np.count_nonzero(is_least) > 0.02 * len(verdict)


def test_ahead_of_a_nose_of_narrow_faces_no_farther_place_steps_in():
    x = np.array([1.0, 0.5, 0.1, 0.001, 0.0, 0.001, 0.1, 0.5, 1.0])
    y = 0.3 * np.sqrt(x) * np.sign(np.arange(9) - 4)
    nodes = np.stack([np.stack([x, y, np.full(9, z)], axis=1) for z in (0.0, 1.0)], axis=1).reshape(-1, 3)
    reach = np.repeat(0.01 + 2.0 * x, 2)
    tree = TriangleTree.of(nodes, quads_in_turn(np.arange(18).reshape(9, 2)), reach)
    ahead = np.stack([np.linspace(-0.4, -1e-6, 1001), np.zeros(1001), np.full(1001, 0.4)], axis=1)
    across = np.stack([np.full(1001, -0.02), np.linspace(-0.2, 0.2, 1001), np.full(1001, 0.4)], axis=1)
    for points in (ahead, across):
        closest, total = tree.closest_points(points), np.zeros(1001)
        np.add.at(total, np.repeat(closest.points, np.diff(closest.starts)), closest.weights)
        assert np.abs(np.diff(total)).max() < 0.1
    assert total.max() > 0.005
    assert tree.closest_points(ahead[ahead[:, 0] < -0.01]).points.size == 0


ALL_WAYS = pytest.mark.parametrize("least_slope", [None, 0.0, 3.0])
"""Points turn about the closest point, or about the corners of its triangle, or some so and others so."""


@ALL_WAYS
def test_nothing_moves_at_rest(least_slope):
    layer, nodes, wall_rows = bumpy_case(np.random.default_rng(2), least_slope=least_slope)
    found = layer.at(nodes, nodes.copy(), nodes[wall_rows], nodes[wall_rows])
    np.testing.assert_allclose(found.nodes, nodes, rtol=0, atol=1e-14)


@ALL_WAYS
def test_a_rigid_motion_of_the_wall_is_one_of_its_layer(least_slope):
    rng = np.random.default_rng(3)
    nodes = bumpy_block(rng)
    wall_rows = ROWS[:, :, 0].ravel()
    wall = Wall.of(nodes[wall_rows], quads_in_turn(np.arange(42).reshape(7, 6)), np.full(42, 1e-4))
    layer = WallLayer.of(wall, nodes, wall_rows, least_slope=least_slope)
    turn, shift = Rotation.random(random_state=4).as_matrix(), rng.standard_normal(3)
    moved = nodes @ turn.T + shift
    # nodes that are mapped to one place are put right where they follow fully
    found = layer.at(nodes, np.zeros_like(nodes), nodes[wall_rows], moved[wall_rows]).nodes
    np.testing.assert_array_equal(found[wall_rows], moved[wall_rows])
    assert np.abs(found - moved)[ROWS[:, :, 1]].max() < 1e-2
    assert np.abs(found - moved)[ROWS[:, :, -1]].max() > 0.5
    # those that are mapped by the same motion stay
    found = layer.at(nodes, moved.copy(), nodes[wall_rows], moved[wall_rows]).nodes
    np.testing.assert_allclose(found, moved, rtol=0, atol=1e-13)


def test_wall_nodes_go_exactly_where_they_are_asked():
    rng = np.random.default_rng(5)
    layer, nodes, wall_rows = bumpy_case(rng)
    mapped, asked = random_move(rng, nodes, wall_rows)
    np.testing.assert_array_equal(layer.at(nodes, mapped, nodes[wall_rows], asked).nodes[wall_rows], asked)


def test_nodes_in_planes_stay_there_and_held_nodes_do_not_move():
    rng = np.random.default_rng(6)
    layer, nodes, wall_rows = bumpy_case(rng)
    mapped, asked = random_move(rng, nodes, wall_rows)
    found = layer.at(nodes, mapped.copy(), nodes[wall_rows], asked).nodes
    plane, fixed = ROWS[:, 0, 1:].ravel(), ROWS[-1, :, 1:].ravel()
    np.testing.assert_array_equal(found[plane, 1], mapped[plane, 1])
    np.testing.assert_array_equal(found[fixed], mapped[fixed])
    assert np.all(np.any(found[ROWS[:-1, :, 1]] != mapped[ROWS[:-1, :, 1]], axis=-1))


def test_copies_have_the_bits_of_what_they_copy():
    rng = np.random.default_rng(7)
    layer, nodes, wall_rows = bumpy_case(rng)
    mapped, asked = random_move(rng, nodes, wall_rows)
    mapped[-4:] = mapped[ROWS[3, 2, :4]]
    found = layer.at(nodes, mapped, nodes[wall_rows], asked).nodes
    np.testing.assert_array_equal(found[-4:], found[ROWS[3, 2, :4]])


@pytest.mark.slow
@ALL_WAYS
@pytest.mark.parametrize("seed", range(3))
def test_jvp_is_the_complex_step(seed, least_slope):
    rng = np.random.default_rng(10 + seed)
    layer, nodes, wall_rows = bumpy_case(rng, least_slope=least_slope)
    mapped, asked = random_move(rng, nodes, wall_rows)
    normals = NORMALS + 0.1 * rng.standard_normal((1, 3))
    state = layer.at(nodes, mapped.copy(), nodes[wall_rows], asked, normals)
    changes = [rng.standard_normal(a.shape) for a in (nodes, mapped, asked, asked, normals)]
    h = 1e-30
    stepped = [a + 1j * h * d for a, d in zip((nodes, mapped, nodes[wall_rows], asked, normals), changes)]
    exact = layer.at(*stepped).nodes.imag / h
    found = state.jvp(changes[0], changes[1].copy(), *changes[2:])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    exact = layer.at(nodes, mapped + 1j * h * changes[1], nodes[wall_rows], stepped[3], normals).nodes.imag / h
    found = state.jvp(None, changes[1].copy(), None, changes[3])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@ALL_WAYS
@pytest.mark.parametrize("seed", range(3))
def test_vjp_is_the_transpose_of_jvp(seed, least_slope):
    rng = np.random.default_rng(20 + seed)
    layer, nodes, wall_rows = bumpy_case(rng, least_slope=least_slope)
    mapped, asked = random_move(rng, nodes, wall_rows)
    state = layer.at(nodes, mapped, nodes[wall_rows], asked, NORMALS + 0.1 * rng.standard_normal((1, 3)))
    changes = [rng.standard_normal(a.shape) for a in (nodes, mapped, asked, asked, NORMALS)]
    bar = rng.standard_normal(nodes.shape)
    bars = state.vjp(bar.copy())
    terms = bar * state.jvp(changes[0], changes[1].copy(), *changes[2:])
    back = sum((b * d).sum() for b, d in zip(bars.values(), changes))
    assert abs(terms.sum() - back) < 1e-13 * np.abs(terms).sum()
    frozen = state.vjp(bar.copy(), ("mapped", "wall_moved", "normals"))
    for name, part in frozen.items():
        np.testing.assert_array_equal(part, bars[name])


def test_results_do_not_depend_on_the_number_of_threads():
    rng = np.random.default_rng(30)
    i, j, k = np.meshgrid(np.arange(31.0), np.arange(29.0), stretched(19, 1e-3), indexing="ij")
    nodes = np.stack([i, j, k], axis=-1).reshape(-1, 3) + 1e-4 * rng.standard_normal((i.size, 3))
    wall_rows = np.arange(i.size).reshape(i.shape)[:, :, 0].ravel()
    mapped, asked = random_move(rng, nodes, wall_rows)
    bar, found = rng.standard_normal(nodes.shape), []
    for n_threads in (1, 2):
        quads = quads_in_turn(np.arange(len(wall_rows)).reshape(31, 29))
        wall = Wall.of(nodes[wall_rows], quads, np.full(len(wall_rows), 1e-3), n_threads=n_threads)
        layer = WallLayer.of(wall, nodes, wall_rows, n_threads=n_threads)
        assert layer.n_followers > CHUNK_NODES
        state = layer.at(nodes, mapped.copy(), nodes[wall_rows], asked)
        found.append([state.nodes, state.jvp(nodes, mapped.copy(), asked, asked), *state.vjp(bar.copy()).values()])
    for one, two in zip(*found):
        np.testing.assert_array_equal(one, two)


def test_nodes_on_oblique_lines_keep_their_heights_where_the_wall_curves():
    x, y = np.meshgrid(np.linspace(0.0, 3.0, 13), np.linspace(0.0, 1.0, 4), indexing="ij")
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    wavy = np.stack([x, y, 0.15 * np.sin(2.5 * x)], axis=-1).reshape(-1, 3)
    slopes = 0.375 * np.cos(2.5 * x).ravel()
    normals = np.stack([-slopes, 0.0 * slopes, np.ones_like(slopes)], axis=1) / np.hypot(1.0, slopes)[:, None]
    quads, first = quads_in_turn(np.arange(52).reshape(13, 4)), 1e-3
    nodes = np.concatenate([flat, flat + first * np.array([1.0, 0.0, 1.0])])  # lines at 45 degrees
    wall, misses = Wall.of(flat, quads, np.full(52, first)), []
    for least_slope in (None, 0.0, 0.5):
        layer = WallLayer.of(wall, nodes, np.arange(52), least_slope=least_slope)
        mapped = np.concatenate([wavy, wavy + [0.0, 0.0, first]])
        found = layer.at(nodes, mapped, flat, wavy).nodes
        heights = np.sum((found[52:] - found[:52]) * normals, axis=1).reshape(13, 4)[1:-1] / first
        misses.append(np.abs(heights - 1.0).max())
    assert misses[1] < 0.03
    assert misses[2] == misses[1]
    assert misses[0] > 0.1


def test_points_on_a_facet_stay_on_it_where_they_turn_about_their_closest_point():
    rng = np.random.default_rng(5)
    nodes = bumpy_block(rng)
    wall_rows = ROWS[:, :, 0].ravel()
    wall = Wall.of(nodes[wall_rows], quads_in_turn(np.arange(42).reshape(7, 6)), np.full(42, 1e-4))
    weights = rng.dirichlet(np.ones(3), len(wall.tree.triangles))
    moved = nodes[wall_rows] + 0.02 * rng.standard_normal((42, 3))
    before, after = (np.einsum("nk,nkd->nd", weights, x[wall.tree.triangles]) for x in (nodes[wall_rows], moved))
    for least_slope in (None, 0.5):
        layer = WallLayer.of(wall, before, least_slope=least_slope)
        found = layer.at(before, before.copy(), nodes[wall_rows], moved).nodes
        np.testing.assert_allclose(found, after, rtol=0, atol=1e-6)


def test_slopes_tell_points_that_turn_about_corners_from_others():
    layer, nodes, wall_rows = bumpy_case(np.random.default_rng(4), least_slope=3.0)
    for turns in (True, False):
        assert sum(len(part.rows) for part in layer.pieces if part.by_corners == turns) > 10
    mapped, asked = random_move(np.random.default_rng(5), nodes, wall_rows)
    about_corners, about_points, some_so = (
        bumpy_case(np.random.default_rng(4), least_slope=slope)[0].at(nodes, mapped.copy(), nodes[wall_rows], asked)
        for slope in (0.0, None, 3.0)
    )
    for part in layer.pieces:
        same = about_corners if part.by_corners else about_points
        np.testing.assert_array_equal(some_so.nodes[part.rows], same.nodes[part.rows])
    assert np.abs(about_corners.nodes - about_points.nodes).max() > 1e-3


def test_heights_are_kept_in_a_plane_that_a_wall_meets_at_another_angle():
    # a wall along y that is swept by shearing it: its normal leaves the plane y = 0, where the points must stay
    z, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    wall, swept = (np.stack([a * y, y, z], axis=-1).reshape(-1, 3) for a in (0.3, 1.2))
    quads = quads_in_turn(np.arange(20).reshape(5, 4))
    planes = [(np.arange(0, 20, 4), np.array([0.0, 1.0, 0.0]))]
    frames = WallFrames.of(wall, quads, planes).at(wall, swept).matrices
    found = frames[::4] @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(found[:, 1:], 0.0, rtol=0, atol=1e-14)
    heights = found[:, 0] / np.hypot(1.0, 1.2)
    np.testing.assert_allclose(heights, 1.0 / np.hypot(1.0, 0.3), rtol=2e-2)
    # a rotation alone would leave a third less
    assert 1.0 / np.hypot(1.0, 1.2) < 0.7 * heights.min()


def test_heights_are_kept_above_both_faces_of_an_edge_whose_angle_changes():
    i, j = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(0, 1, 4), indexing="ij")
    sharp, blunt = (np.stack([i, j, -a * np.abs(i)], axis=-1).reshape(-1, 3) for a in (1.0, 0.6))
    quads, faces = quads_in_turn(np.arange(28).reshape(7, 4)), np.repeat([0, 1], 9)
    edge = np.arange(12, 16)
    matrices = WallFrames.of(sharp, quads, faces=faces).at(sharp, blunt).matrices[edge]
    up = matrices @ [0.0, 0.0, 1.0]
    for side in (-1.0, 1.0):
        old, new = (np.array([side * a, 0.0, 1.0]) / np.hypot(1.0, a) for a in (1.0, 0.6))
        np.testing.assert_allclose(up @ new, old[2], rtol=2e-2)
        assert abs(new[2] / old[2] - 1.0) > 0.2
    turned = WallFrames.of(sharp, quads, faces=faces).at(sharp, sharp[:, [1, 2, 0]]).matrices
    np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3)[[1, 2, 0]], (28, 3, 3)), rtol=0, atol=1e-13)


def test_a_surface_folded_upon_itself_has_two_sides():
    i, j = np.meshgrid(np.abs(np.linspace(-1, 1, 7)), np.linspace(0, 1, 4), indexing="ij")
    side = np.sign(np.linspace(-1, 1, 7))[:, None]
    wedge = np.stack([i, j, 0.1 * side * i], axis=-1).reshape(-1, 3)
    frames = WallFrames.of(wedge, quads_in_turn(np.arange(28).reshape(7, 4)))
    np.testing.assert_array_equal(np.diff(frames.first_sides)[12:16], 2)
    np.testing.assert_array_equal(np.delete(np.diff(frames.first_sides), np.arange(12, 16)), 1)
    np.testing.assert_allclose(frames.weights, 1.0, rtol=1e-12)


def test_walls_of_inviscid_grids_have_no_layer():
    nodes = bumpy_block(np.random.default_rng(8), first=0.05)
    wall_rows = ROWS[:, :, 0].ravel()
    quads, found = quads_in_turn(np.arange(42).reshape(7, 6)), []
    for height in (0.05, 1e-4):
        wall = Wall.of(nodes[wall_rows], quads, np.full(42, height))
        found.append(WallLayer.of(wall, nodes, wall_rows).n_followers)
    assert found[0] == 42 < found[1]


def test_each_setting_of_the_layer_changes_what_it_is_for():
    nodes = bumpy_block(np.random.default_rng(9))[ROWS[:, :, 0].ravel()]
    nodes[-6:] = nodes[-18:-12] - [0.0, 0.0, 0.3]  # folds back at 120 degrees and more

    def wall(**settings):
        quads = quads_in_turn(np.arange(42).reshape(7, 6))
        return Wall.of(nodes, quads, np.full(42, 0.005), settings=replace(LAYER, **settings))

    def reach(**settings):
        return wall(**settings).tree.reach

    assert (reach() > 0.0).all()
    assert (reach(inviscid=30.0) < reach()).all()
    assert (reach(viscous=50.0) < reach()).all()
    assert (reach(first_heights=80.0) >= reach()).all()
    assert (reach(first_heights=80.0) > reach()).any()
    np.testing.assert_allclose(reach(first_heights=1e3, widths=4.0), 4.0 * reach(widths=0.0), rtol=1e-14)
    assert np.ptp(reach(smoothings=10)) < np.ptp(reach()) < np.ptp(reach(smoothings=0))
    assert wall(farthest=7.0).tree.farthest == 7.0
    assert wall(rotation_weight=0.1).frames.rotation_weight == 0.1
    assert wall(folded=-1.0).frames.first_sides[-1] < wall().frames.first_sides[-1]


@pytest.mark.slow
def test_first_cells_of_a_real_grid_keep_their_heights(real_grids):
    grid = read_grid(real_grids / "aither_rae2822.xyz")
    faces = [face.window for face in find_topology(grid).boundary if face.patch is None]
    grid = replace(grid, patches=(*grid.patches, *guess_patches(grid, faces)))
    topology, cells = find_topology(grid), FirstCells.of_baseline(grid)
    nodes = grid.to_vector().reshape(-1, 3)[node_sharing(topology).source_rows()]
    sheet = BoundarySurface.of(topology, nodes, [face for face in topology.boundary if face.kind == "wall"])
    points = nodes[sheet.rows]
    wall = Wall.of(points, sheet.quads, sheet.heights, faces=sheet.quad_faces)
    layer = WallLayer.of(wall, nodes, sheet.rows, copies=node_sharing(topology).copies)
    # the section is made thinner and bent, and the cells with it
    mapped = nodes * [1.0, 0.8, 1.0] + 0.05 * np.sin(2.0 * nodes[:, :1]) * [0.0, 1.0, 0.0]
    found = layer.at(nodes, mapped.copy(), points, mapped[sheet.rows]).nodes
    before, after = cells.ratios(mapped), cells.ratios(found)
    assert np.quantile(np.abs(before - 1.0), 0.5) > 0.1
    assert np.quantile(np.abs(after - 1.0), 0.99) < 2e-3
    assert np.abs(after - 1.0).max() < 3e-2


def test_wrong_arrays_are_refused():
    nodes = np.random.default_rng(40).standard_normal((4, 3))
    quads = np.array([[0, 1, 2, 3]])
    with pytest.raises(InputError, match=r"heights of shape \(3,\); give shape \(4,\)"):
        Wall.of(nodes, quads, np.ones(3))
    wall = Wall.of(nodes, quads, np.ones(4))
    with pytest.raises(InputError, match=r"2 rows of 4 nodes of the wall; give one each"):
        WallLayer.of(wall, nodes, np.array([0, 1]))
    with pytest.raises(InputError, match=r"points of shape \(4, 2\); give shape \(n, 3\)"):
        WallLayer.of(wall, nodes[:, :2])
