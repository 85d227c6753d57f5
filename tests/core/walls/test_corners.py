"""Points in the corner of two walls keep their heights above both."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao.core.walls.layer import WallLayer
from bspline_mdao.core.walls.wall import Wall
from bspline_mdao.grids.topology.boundary_surface import corners_in_turn, quads_in_turn

FIRST = 1e-4
"""Height of the first cells."""


def corner_block(shape, ratio=1.4):
    """Rows and nodes of a block between the walls x = 0 and z = 0, with a plane of symmetry y = 0."""
    r = np.concatenate([[0.0], np.cumsum(FIRST * ratio ** np.arange(shape[0] - 1))])
    x, y, z = np.meshgrid(r, 0.05 * np.arange(shape[1]), r[: shape[2]], indexing="ij")
    return np.arange(x.size).reshape(shape), np.stack([x, y, z], axis=-1).reshape(-1, 3)


def layer_of(rows, nodes, planes=False, **options):
    """Layer of the walls of a block, and the rows of these."""
    wall_rows = np.unique(np.concatenate([rows[:, :, 0].ravel(), rows[0].ravel()]))
    ids = np.searchsorted(wall_rows, rows)
    sides = quads_in_turn(ids[:, :, 0]), quads_in_turn(ids[0])
    faces, heights = np.repeat([0, 1], [len(side) for side in sides]), np.full(len(wall_rows), FIRST)
    normal = np.array([0.0, 1.0, 0.0])
    of_wall = [(np.flatnonzero(np.isin(wall_rows, rows[:, 0])), normal)] if planes else []
    wall = Wall.of(nodes[wall_rows], np.concatenate(sides), heights, of_wall, faces=faces)
    return WallLayer.of(wall, nodes, wall_rows, [(rows[:, 0].ravel(), normal)] if planes else [], **options), wall_rows


def volumes(nodes, rows):
    """Smallest corner volume of each cell of a block."""
    cells = np.stack([corners_in_turn(rows[:, :, m]) for m in range(rows.shape[2])], axis=2)
    low, high = nodes[cells[:, :, :-1]], nodes[cells[:, :, 1:]]
    corner = []
    for n in range(4):
        for layer in (low, high):
            edges = (layer[..., m, :] - layer[..., n, :] for m in ((n + 1) % 4, n - 1))
            corner.append(np.linalg.det(np.stack([*edges, high[..., n, :] - low[..., n, :]], axis=-1)))
    return np.min(corner, axis=0)


@pytest.mark.parametrize("least_slope", [None, 0.0])
@pytest.mark.parametrize(
    ("angle", "least"), [(-30.0, 0.1), (-10.0, 0.6), (-3.0, 0.85), (3.0, 0.95), (10.0, 0.95), (30.0, 0.8)]
)
def test_a_corner_that_opens_and_closes_keeps_its_heights_without_folding(angle, least, least_slope):
    rows, nodes = corner_block((25, 3, 25))
    x, y, z = nodes.T
    # the wall z = 0 turns about the corner and the other one stays; cells between them are sheared evenly
    turn = np.radians(angle) * (1.0 - np.arctan2(z, np.maximum(x, 1e-300)) / (np.pi / 2))
    turn[np.hypot(x, z) == 0.0] = 0.0
    c, s = np.cos(turn), np.sin(turn)
    mapped = np.stack([c * x + s * z, y, c * z - s * x], axis=1)
    layer, wall_rows = layer_of(rows, nodes, least_slope=least_slope)
    found = layer.at(nodes, mapped.copy(), nodes[wall_rows], mapped[wall_rows]).nodes
    assert (volumes(found, rows) / volumes(nodes, rows)).min() > least
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    up = (found[rows[:, :, 1]] - found[rows[:, :, 0]])[1:] @ [s, 0.0, c] / FIRST
    across = (found[rows[1]] - found[rows[0]])[:, 1:, 0] / FIRST
    # what is left is what the narrow reach there leaves of the map of the others
    for heights in (up, across):
        np.testing.assert_allclose(heights, 1.0, rtol=0, atol=1.2e-3 * abs(angle))


def moved_case(rng, least_slope):
    """Layer of a block with bumpy walls, its nodes, and a move of walls and nodes that are not near to each other."""
    rows, nodes = corner_block((11, 4, 9), 2.0)
    nodes[rows[:, 1:]] += 0.2 * FIRST * rng.standard_normal((11, 3, 9, 3))
    layer, wall_rows = layer_of(rows, nodes, planes=True, least_slope=least_slope)
    turn = Rotation.from_rotvec(0.5 * rng.standard_normal(3)).as_matrix()
    mapped = nodes @ turn.T + 0.1 * FIRST * rng.standard_normal(nodes.shape)
    asked = mapped[wall_rows] + 0.1 * FIRST * rng.standard_normal((len(wall_rows), 3))
    return layer, rows, nodes, wall_rows, mapped, asked


ALL_WAYS = pytest.mark.parametrize("least_slope", [None, 0.0, 3.0])


@ALL_WAYS
def test_jvp_is_the_complex_step_and_vjp_its_transpose(least_slope):
    rng = np.random.default_rng(4)
    layer, _, nodes, wall_rows, mapped, asked = moved_case(rng, least_slope)
    assert len(layer.corners.rows) > 50
    values = nodes, mapped, nodes[wall_rows], asked, np.array([[0.0, 1.0, 0.0]]) + 0.1 * rng.standard_normal((1, 3))
    changes = [rng.standard_normal(value.shape) for value in values]
    state = layer.at(values[0], values[1].copy(), *values[2:])
    exact = layer.at(*(v + 1e-30j * d for v, d in zip(values, changes))).nodes.imag / 1e-30
    found = state.jvp(changes[0], changes[1].copy(), *changes[2:])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    bar = rng.standard_normal(nodes.shape)
    bars = state.vjp(bar.copy())
    order = ("initial", "mapped", "wall_initial", "wall_moved", "normals")
    back = sum((bars[name] * change).sum() for name, change in zip(order, changes))
    assert abs((bar * found).sum() - back) < 1e-12 * np.abs(bar * found).sum()


@ALL_WAYS
def test_walls_that_move_as_one_body_take_their_corner_along(least_slope):
    rng = np.random.default_rng(5)
    layer, _, nodes, wall_rows, _, _ = moved_case(rng, least_slope)
    c, s = np.cos(0.7), np.sin(0.7)
    moved = nodes @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + [0.3, 0.0, -0.2]
    assert len(layer.corners.rows) > 50
    found = layer.at(nodes, moved.copy(), nodes[wall_rows], moved[wall_rows])
    np.testing.assert_allclose(found.nodes, moved, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.corners.found, 0.0, rtol=0, atol=1e-13)


def test_points_in_corners_stay_in_planes():
    layer, rows, nodes, wall_rows, mapped, asked = moved_case(np.random.default_rng(6), 0.0)
    found = layer.at(nodes, mapped.copy(), nodes[wall_rows], asked).nodes
    in_plane = rows[1:, 0, 1:].ravel()
    assert np.isin(layer.corners.rows, in_plane).any()
    np.testing.assert_array_equal(found[in_plane, 1], mapped[in_plane, 1])


def test_between_opposite_walls_that_part_points_stay_at_their_mean():
    x, y = (part.ravel() for part in np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij"))
    sheet, ids = np.stack([x, y, 0.0 * x], axis=1), np.arange(20).reshape(5, 4)
    quads = np.concatenate([quads_in_turn(ids), quads_in_turn(ids + 20)[:, ::-1]])
    points = np.concatenate([sheet, sheet + [0.0, 0.0, 1e-3]])
    wall = Wall.of(points, quads, np.full(40, 1e-4), faces=np.repeat([0, 1], 12))
    between = np.array([[1.6, 1.7, 5e-4]])
    layer = WallLayer.of(wall, between)
    np.testing.assert_allclose(layer.corners.fractions, 0.5)
    moved = points + np.repeat([[0.0, 0.0, 0.0], [0.0, 0.0, 1e-3]], 20, axis=0)
    found = layer.at(between, between.copy(), points, moved).nodes
    np.testing.assert_allclose(found, [[1.6, 1.7, 1e-3]], rtol=0, atol=1e-12)


def test_points_on_a_wall_are_in_no_corner():
    rows, nodes = corner_block((11, 3, 9), 2.0)
    layer, _ = layer_of(rows, nodes)
    beside = WallLayer.of(layer.wall, np.array([[0.0, 0.07, 0.0], [FIRST, 0.07, 0.0], [FIRST, 0.07, FIRST]]))
    np.testing.assert_array_equal(beside.corners.rows, [2])
