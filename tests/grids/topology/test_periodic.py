"""Periodic faces are found from the nodes, and nothing else is taken for them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao.generators import ball_grid, brick_grid
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.periodic import find_periodic
from bspline_mdao.grids.topology.periodic_gap import periodic_gaps
from bspline_mdao.studio.cli.inspect import grid_numbers

ANGLE = 0.3


def boundary(grid):
    return [face.window for face in find_topology(grid).boundary if face.patch is None]


def passage(shape=(7, 6, 5), axis=0, angle=ANGLE, bend=0.4):
    """An annular passage whose periodic sides, jmin and jmax, are curved unless it has no bend."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    turn, radius = angle * (j + bend * i**2 - 0.2), 2.0 + k + 0.1 * np.sin(3.0 * i)
    nodes = np.stack([3.0 * i, radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    return np.roll(nodes, axis, axis=-1)


def cascade(shape=(7, 6, 3), n_blocks=1):
    """Passages one above the other, between curved lines."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    nodes = np.stack([3.0 * i, j + 0.5 * np.sin(2.0 * i), 0.2 * k], axis=-1)
    return Grid(tuple(Block(nodes + [0.0, float(n), 0.0], f"block {n + 1}") for n in range(n_blocks)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sides_of_an_annular_passage_are_a_pair(axis):
    grid = Grid((Block(passage(axis=axis), "block 1"),))
    (pair,) = find_periodic(grid, boundary(grid))
    low, high = Window.whole(0, (7, 6, 5)).face(2), Window.whole(0, (7, 6, 5)).face(3)
    assert {*pair.windows, *pair.others} == {low, high}
    np.testing.assert_array_equal(pair.motion.axis, np.eye(3)[axis])
    assert abs(abs(pair.motion.angle) - ANGLE) < 1e-12
    nodes = grid.blocks[0].nodes
    one, other = (nodes[side[0].slices].reshape(-1, 3) for side in (pair.windows, pair.others))
    np.testing.assert_allclose(pair.motion.move(one), other, atol=1e-12)
    np.testing.assert_allclose(pair.motion.inverse().move(other), one, atol=1e-12)


@pytest.mark.parametrize("bend", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_sides_of_a_passage_about_any_axis_are_a_pair_planar_or_not(bend, seed):
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(-9.0, 9.0, 3)
    grid = Grid((Block(passage(bend=bend) @ turn.T + shift, "block 1"),))
    (pair,) = find_periodic(grid, boundary(grid))
    low, high = Window.whole(0, (7, 6, 5)).face(2), Window.whole(0, (7, 6, 5)).face(3)
    assert {*pair.windows, *pair.others} == {low, high}
    assert abs(pair.motion.angle - ANGLE) < 1e-11
    assert abs(abs(pair.motion.axis @ turn[:, 0]) - 1.0) < 1e-12
    off = shift - pair.motion.point
    np.testing.assert_allclose(np.cross(off, pair.motion.axis), 0.0, atol=1e-10)
    nodes = grid.blocks[0].nodes
    one, other = (nodes[side[0].slices].reshape(-1, 3) for side in (pair.windows, pair.others))
    np.testing.assert_allclose(pair.motion.move(one), other, atol=1e-11)
    np.testing.assert_allclose(pair.motion.inverse().move(other), one, atol=1e-11)
    assert "through" in str(pair.motion)
    assert "17.1887 deg" in str(pair.motion)


def test_sides_of_a_thin_sector_are_a_pair():
    grid = Grid((Block(passage(angle=0.01), "block 1"),))
    (pair,) = find_periodic(grid, boundary(grid))
    assert abs(pair.motion.angle) == pytest.approx(0.01, rel=1e-9)


def with_one_side_off(distance, places):
    """A passage of which these nodes of jmax, of shape (n_i, n_k), are off by a distance around the axis (m)."""
    nodes = passage()
    radius = np.hypot(nodes[:, -1, :, 1], nodes[:, -1, :, 2])
    turn = np.where(places, distance / radius, 0.0)
    nodes[:, -1, :, 1:] = np.stack(_turned(nodes[:, -1, :, 1], nodes[:, -1, :, 2], turn), axis=-1)
    return Grid((Block(nodes, "block 1"),))


def size_of(grid):
    """Twice the distance of the farthest node from the middle, roughly: that of a passage (m)."""
    nodes = grid.to_vector().reshape(-1, 3)
    return 2.0 * np.linalg.norm(nodes - nodes.mean(axis=0), axis=1).max()


@pytest.mark.parametrize(("part", "n_pairs"), [(5e-6, 1), (2e-5, 0)])
def test_nodes_of_both_sides_lie_on_each_other_to_a_hundred_thousandth_of_the_grid(part, n_pairs):
    one = np.zeros((7, 5), dtype=bool)
    one[3, 2] = True
    grid = with_one_side_off(part * size_of(with_one_side_off(0.0, one)), one)
    assert len(find_periodic(grid, boundary(grid))) == n_pairs


def test_the_rotation_is_that_of_all_nodes_and_not_of_the_corners():
    corners = np.zeros((7, 5), dtype=bool)
    corners[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    off = 4e-6 * size_of(with_one_side_off(0.0, corners))
    grid = with_one_side_off(off, corners)
    (pair,) = find_periodic(grid, boundary(grid))
    nodes = grid.blocks[0].nodes
    one, other = (nodes[side[0].slices].reshape(-1, 3) for side in (pair.windows, pair.others))
    assert np.median(np.linalg.norm(pair.motion.move(one) - other, axis=1)) < 0.3 * off


def test_faces_of_a_wedge_in_the_flow_are_walls():
    """A rotation about its edge lays one onto the other, and they look away from each other on both ways around."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in (6, 5, 4)), indexing="ij")
    above = np.stack([i, 0.2 * i + (2.0 - 0.2 * i) * j, 0.5 * k], axis=-1)
    grid = Grid((Block(above, "above"), Block(above * [1.0, -1.0, 1.0], "below")))
    assert find_periodic(grid, boundary(grid)) == ()


def test_sides_that_are_cut_differently_are_a_pair():
    nodes = passage((9, 6, 5))
    whole = Grid((Block(nodes, "block 1"),))
    far = passage((9, 4, 5)).copy()
    far[..., 1:] = np.stack([*_turned(far[..., 1], far[..., 2], ANGLE)], axis=-1)
    grid = Grid((whole.blocks[0], Block(far[:4], "block 2"), Block(far[3:], "block 3")))
    (pair,) = find_periodic(grid, boundary(grid))
    assert sorted(len(side) for side in (pair.windows, pair.others)) == [1, 2]
    assert abs(abs(pair.motion.angle) - 2.0 * ANGLE) < 1e-12


@pytest.mark.parametrize("seed", range(2))
def test_sides_both_of_which_are_cut_are_a_pair(seed):
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(-9.0, 9.0, 3)
    low, high = (passage((9, 4, 5)).copy() for _ in range(2))
    high[..., 1:] = np.stack([*_turned(high[..., 1], high[..., 2], ANGLE)], axis=-1)
    parts = [low[:3], low[2:], high[:6], high[5:]]
    grid = Grid(tuple(Block(part @ turn.T + shift, f"block {n + 1}") for n, part in enumerate(parts)))
    (pair,) = find_periodic(grid, boundary(grid))
    assert {tuple(window.block for window in side) for side in (pair.windows, pair.others)} == {(0, 1), (2, 3)}
    assert abs(pair.motion.angle - 2.0 * ANGLE) < 1e-11


@pytest.mark.parametrize("motion", ["translation", "rotation"])
def test_planar_parts_of_a_curved_side_belong_to_it(motion):
    i, j, k = np.meshgrid(
        *(np.linspace(*ends, n) for n, ends in ((13, (-1, 2)), (6, (0, 1)), (5, (0, 1)))), indexing="ij"
    )
    across = ANGLE * (j + 0.4 * np.maximum(i, 0.0) ** 2)
    nodes = np.stack([3.0 * i, across, k], axis=-1)
    if motion == "rotation":
        nodes = np.stack([3.0 * i, (2.0 + k) * np.cos(across), (2.0 + k) * np.sin(across)], axis=-1)
    grid = Grid((Block(nodes[:5], "straight"), Block(nodes[4:], "curved")))
    (pair,) = find_periodic(grid, boundary(grid))
    sides = [Window.whole(block, shape) for block, shape in enumerate(grid.shapes)]
    assert {pair.windows, pair.others} == {tuple(side.face(face) for side in sides) for face in (2, 3)}
    straight = Grid((Block(nodes[:5], "straight"),))
    assert len(find_periodic(straight, boundary(straight))) == (motion == "rotation")


def _turned(y, z, angle):
    return np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z


@pytest.mark.parametrize("n_blocks", [1, 3])
def test_sides_of_a_cascade_are_a_pair_however_many_passages_it_has(n_blocks):
    grid = cascade(n_blocks=n_blocks)
    (pair,) = find_periodic(grid, boundary(grid))
    assert [window.block for window in (*pair.windows, *pair.others)] == [0, n_blocks - 1]
    np.testing.assert_allclose(pair.motion.shift, [0.0, n_blocks, 0.0], atol=1e-12)
    guessed = {patch.name: patch for patch in guess_patches(grid, boundary(grid))}
    for name, side in (("periodic_1a", pair.windows), ("periodic_1b", pair.others)):
        assert (guessed[name].kind, guessed[name].windows) == ("other", side)
    assert sum(len(patch.windows) for patch in guessed.values()) == len(boundary(grid))


def test_blades_that_repeat_are_walls():
    """They look the same way: a translation lays them onto each other, and nothing comes back."""
    nodes = cascade().blocks[0].nodes
    grid = Grid(tuple(Block(nodes + [0.0, 5.0 * n, 0.0], f"block {n + 1}") for n in range(2)))
    blade = [Window.whole(block, (7, 6, 3)).face(2) for block in (0, 1)]
    assert find_periodic(grid, blade) == ()


@pytest.mark.parametrize("make", [ball_grid, brick_grid])
@pytest.mark.parametrize("octant", [False, True])
def test_boxes_and_balls_have_no_periodic_faces(make, octant):
    grid = replace(make((5, 5, 5, 5), octant=octant), patches=())
    assert find_periodic(grid, boundary(grid)) == ()


@pytest.mark.parametrize("seed", range(2))
def test_sides_that_drift_apart_are_found_with_the_gap_and_the_node(seed):
    rng = np.random.default_rng(seed)
    grid = Grid((Block(passage(), "block 1"),))
    topology = find_topology(grid)
    pitch = np.array([[1, 0, 0], [0, np.cos(0.7), -np.sin(0.7)], [0, np.sin(0.7), np.cos(0.7)]])
    alike = replace(grid, blocks=(Block(grid.blocks[0].nodes @ pitch.T, "block 1"),))  # about the axis of the pair
    assert periodic_gaps(topology, grid, grid) == periodic_gaps(topology, grid, alike) == ()
    nodes, step = grid.blocks[0].nodes.copy(), rng.normal(0.0, 0.01, 3)
    place = (int(rng.integers(7)), int(rng.choice([0, 5])), int(rng.integers(5)))
    nodes[place] += step
    (found,) = periodic_gaps(topology, grid, replace(grid, blocks=(Block(nodes, "block 1"),)))
    assert found.gap == pytest.approx(np.linalg.norm(step), rel=1e-9)
    assert (found.node.lo[0], found.node.lo[2]) == (place[0], place[2])
    assert f"{found.gap:.3g} m apart" in str(found)
    declared = replace(grid, patches=(Patch("sides", "wall", found.pair.windows),))
    assert periodic_gaps(find_topology(declared), grid, replace(grid, blocks=(Block(nodes, "block 1"),))) == ()


def test_sides_that_were_as_far_apart_before_have_not_drifted():
    one = np.zeros((7, 5), dtype=bool)
    one[3, 2] = True
    off = 0.9e-5 * size_of(with_one_side_off(0.0, one))
    grid = with_one_side_off(off, one)
    topology = find_topology(grid)
    assert off > 1e-5 * np.ptp(grid.to_vector().reshape(-1, 3), axis=0).max()  # more than the size of the sides allows
    assert periodic_gaps(topology, grid, with_one_side_off(1.05 * off, one)) == ()
    assert len(periodic_gaps(topology, grid, with_one_side_off(3.0 * off, one))) == 1


@pytest.mark.slow
def test_periodic_planes_of_real_grids_are_named(real_grids):
    rotor = read_grid(real_grids / "cfl3d_rotorstator.fmt")
    (pair,) = find_periodic(rotor, boundary(rotor))
    assert [[window.block + 1 for window in side] for side in (pair.windows, pair.others)] == [[1, 7], [5, 13]]
    bump = read_grid(real_grids / "cfl3d_axibump.fmt")
    (pair,) = find_periodic(bump, boundary(bump))
    assert str(pair.motion) == "rotation about x by 1 deg"
    found = grid_numbers(bump, find_topology(bump))["periodic"]
    assert found[0]["motion"] == str(pair.motion)
    for name in ("cfl3d_sduct.bin", "vtk_bluntfin.bin", "aither_uniform_10blocks.xyz", "cgns_5blocks.cgns"):
        grid = read_grid(real_grids / name)
        assert find_periodic(grid, boundary(grid)) == (), name
