"""Heights of the first cells at walls: definition, what is left out, derivatives, reports."""

import numpy as np
import pytest

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.grids.cells.wall_heights import report_heights
from bspline_mdao.grids.cells.wall_spacing import flat_plate_y_plus, wall_spacings
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.testing import central_difference


def shell(shape=(5, 6, 4), seed=1):
    """Crooked block about an elliptic cylinder, whose wall is kmin and whose spacing off it grows."""
    t, z, r = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    r = 1e-2 * (1.0 + 0.3 * np.sin(9.0 * t + 4.0 * z)) * (np.exp(3.0 * r) - 1.0)
    x = np.stack([(2.0 + r) * np.cos(2.0 * t), (1.0 + r) * np.sin(2.0 * t), z + 0.2 * r], axis=-1)
    return x + 0.01 * np.random.default_rng(seed).uniform(-1.0, 1.0, (*shape[:2], 1, 3))


def planar():
    """One layer of a block about a cylinder, in a plane askew."""
    x = shell((7, 1, 4))
    x[..., 2] = 0.0
    return x @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def walled(*blocks, face=4):
    """Grid whose blocks each have one face that is a wall, all of one patch."""
    windows = tuple(Window.whole(n, nodes.shape).face(face) for n, nodes in enumerate(blocks))
    named = tuple(Block(np.ascontiguousarray(nodes), f"block {n}") for n, nodes in enumerate(blocks, start=1))
    return Grid(named, (Patch("skin", "wall", windows),))


def nodes_of(grid):
    return grid.to_vector().reshape(-1, 3)


def wedge():
    """Cells around the x axis: the face kmin touches the axis along a line."""
    x, r, angle = np.meshgrid(np.arange(4.0), np.arange(5.0) ** 1.3, [-0.3, 0.2, 0.6], indexing="ij")
    return np.stack([x + 0.1 * r, r * np.cos(angle), r * np.sin(angle)], axis=-1)


GRIDS = {
    "shell": lambda: walled(shell()),
    "left-handed": lambda: walled(shell()[::-1], shell((3, 4, 5), seed=2)),
    "high face": lambda: walled(shell()[:, :, ::-1], face=5),
    "two planes": lambda: walled(shell((7, 2, 4))),
    "planar": lambda: walled(planar()),
    "collapsed lines": lambda: walled(wedge()),
    "wing": lambda: onera_m6_grid((7, 6, 5)),
}
"""Grids with walls of every kind."""

every_grid = pytest.mark.parametrize("grid", GRIDS, indirect=True)


@pytest.fixture
def grid(request):
    return GRIDS[request.param]()


def moved(grid, seed=0):
    """Nodes of a grid after a smooth change, which no node of the baseline has."""
    x, rng = nodes_of(grid), np.random.default_rng(seed)
    return x + 0.1 * np.sin(x @ rng.normal(size=(3, 3)) + rng.normal(size=3))


def test_the_height_is_the_distance_along_the_mean_normal_of_the_quads_of_the_window():
    x = shell()
    cells = FirstCells.of_baseline(walled(x))
    areas = np.cross(x[1:, 1:, 0] - x[:-1, :-1, 0], x[:-1, 1:, 0] - x[1:, :-1, 0]) / 2.0
    at = (2, 3)
    normal = areas[1:3, 2:4].sum(axis=(0, 1))
    expected = (x[(*at, 1)] - x[(*at, 0)]) @ normal / np.linalg.norm(normal)
    entry = at[0] * x.shape[1] + at[1]
    assert cells.heights(x.reshape(-1, 3))[entry] == pytest.approx(expected, rel=1e-12)
    assert cells.places[entry].tolist() == [0, 3, 4, 1]
    assert expected > 0.0


@every_grid
def test_a_rigid_motion_keeps_all_heights(grid):
    cells, turn = FirstCells.of_baseline(grid), np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert len(cells.baseline) >= 7
    assert cells.baseline.min() > 0.0
    np.testing.assert_array_equal(cells.ratios(nodes_of(grid)), 1.0)
    if all(n > 1 for shape in grid.shapes for n in shape):  # the plane of a planar block is that of the baseline
        np.testing.assert_allclose(cells.ratios(nodes_of(grid) @ turn + 0.3), 1.0, rtol=1e-11)


def test_a_stretch_along_the_normal_multiplies_all_heights():
    x = np.stack(np.meshgrid(np.arange(4.0), np.arange(5.0), [0.0, 0.1, 0.5], indexing="ij"), axis=-1)
    cells = FirstCells.of_baseline(walled(x))
    np.testing.assert_allclose(cells.ratios((x * [1.0, 1.0, 1.3]).reshape(-1, 3)), 1.3, rtol=1e-13)
    np.testing.assert_allclose(cells.ratios((x * [1.0, 1.0, -0.2]).reshape(-1, 3)), -0.2, rtol=1e-13)
    np.testing.assert_allclose(cells.ratios((x + x[..., 2:] * [0.7, 0.2, 0.0]).reshape(-1, 3)), 1.0, rtol=1e-13)


def test_the_handedness_of_a_block_and_the_end_that_its_wall_is_at_change_nothing():
    x = shell()
    heights = FirstCells.of_baseline(walled(x)).baseline
    mirrored, high = FirstCells.of_baseline(walled(x[::-1])), FirstCells.of_baseline(walled(x[:, :, ::-1], face=5))
    np.testing.assert_allclose(mirrored.baseline.reshape(x.shape[:2])[::-1].ravel(), heights, rtol=1e-13)
    np.testing.assert_allclose(high.baseline, heights, rtol=1e-13)


def test_a_planar_block_has_the_heights_of_one_that_is_two_nodes_deep():
    x = planar()
    normal = np.cross(x[-1, 0, 0] - x[0, 0, 0], x[0, 0, -1] - x[0, 0, 0])
    deep = np.concatenate([x, x + 0.2 * normal / np.linalg.norm(normal)], axis=1)
    np.testing.assert_allclose(
        np.repeat(FirstCells.of_baseline(walled(x)).baseline, 2),
        FirstCells.of_baseline(walled(deep)).baseline,
        rtol=1e-12,
    )


def test_the_sides_of_a_sharp_edge_are_measured_each_along_its_own_normal():
    t, z, r = np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4), [0.0, 0.01, 0.03], indexing="ij")
    upper, lower = (np.stack([t, z, side * (0.1 * (1.0 - t) + r)], axis=-1) for side in (1.0, -1.0))
    cells = FirstCells.of_baseline(walled(upper, lower))
    np.testing.assert_allclose(cells.baseline, 0.01 / np.hypot(1.0, 0.1), rtol=1e-12)
    lower[:-1] += [0.0, 0.0, 0.08]  # all but the edge
    ratios = cells.ratios(np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])).reshape(2, 5, 4)
    np.testing.assert_array_equal(ratios[0], 1.0)
    assert np.abs(ratios[1, -1] - 1.0).min() > 1e-3


def test_lines_that_have_collapsed_or_start_into_the_wall_are_left_out_and_counted():
    cells = FirstCells.of_baseline(walled(wedge()))
    assert cells.n_left_out.tolist() == [4]  # the axis, where the wall's line and the next one are one
    assert len(cells.baseline) == 16
    x = shell()
    x[2, 3, 1] = 2.0 * x[2, 3, 0] - x[2, 3, 1]
    cells = FirstCells.of_baseline(walled(x))
    assert cells.n_left_out.tolist() == [1]
    assert [0, 3, 4, 1] not in cells.places.tolist()


def test_a_wall_that_is_folded_flat_has_no_normal_along_the_fold():
    x = np.stack(np.meshgrid(np.arange(4.0), np.arange(5.0), [0.0, 0.1], indexing="ij"), axis=-1)
    x[..., 0] = np.abs(x[..., 0] - 1.0)
    cells = FirstCells.of_baseline(walled(x[:3]))
    assert cells.n_left_out[0] >= 5


def test_a_grid_without_walls_has_no_entries():
    cells = FirstCells.of_baseline(Grid((Block(shell(), "block 1"),)))
    assert len(cells.ratios(shell().reshape(-1, 3))) == 0


@every_grid
def test_products_with_the_derivative_agree_with_differences_and_each_other(grid):
    cells, nodes = FirstCells.of_baseline(grid), moved(grid)
    rng = np.random.default_rng(1)
    d_nodes, bar = rng.standard_normal(nodes.shape), rng.standard_normal(len(cells.baseline))
    change, nodes_bar = cells.ratios_jvp(nodes, d_nodes), np.zeros_like(nodes)
    cells.ratios_vjp(nodes, bar, nodes_bar)
    scale = np.linalg.norm(change) * np.linalg.norm(bar)
    assert abs(change @ bar - np.vdot(nodes_bar, d_nodes)) < 1e-13 * scale
    exact = central_difference(lambda step: cells.ratios(nodes + step * d_nodes), 1e-4, levels=3)
    assert np.abs(exact - change).max() < 1e-8 * np.abs(change).max()


def plates(heights, n=(12, 11)):
    """Flat walls, each the floor of a block of its own with layers that grow by 1.2, whose first ones are so high."""
    x, y, layer = np.meshgrid(np.arange(float(n[0])), np.arange(float(n[1])), np.arange(4), indexing="ij")
    return [np.stack([x, y, h * (1.2**layer - 1.0) / 0.2], axis=-1) for h in heights]


def patched(*blocks, names):
    windows = [Window.whole(n, nodes.shape).face(4) for n, nodes in enumerate(blocks)]
    patches = tuple(
        Patch(name, "wall", tuple(w for w, owner in zip(windows, names) if owner == name))
        for name in dict.fromkeys(names)
    )
    return Grid(tuple(Block(nodes, f"block {n}") for n, nodes in enumerate(blocks, start=1)), patches)


def test_the_report_tells_heights_by_patch_with_places():
    blocks = plates([1e-5, 2e-5, 4e-3])
    grid = patched(*blocks, names=("wing", "wing", "body"))
    cells, moved = FirstCells.of_baseline(grid), [block.copy() for block in blocks]
    moved[1][3, 4, 1, 2] *= 0.5
    moved[2][..., 2] *= 1.2
    moved[2][7, 1, 1, 2] *= 1.5
    wing, body = report_heights(cells, np.concatenate([x.reshape(-1, 3) for x in moved]))
    assert (wing.patch, wing.n_nodes, wing.n_off, wing.is_kept) == ("wing", 264, 1, True)
    assert (wing.ratio_min, wing.ratio_p01, wing.ratio_median, wing.ratio_max) == pytest.approx((0.5, 1.0, 1.0, 1.0))
    assert (wing.height_min, wing.height_max) == pytest.approx((1e-5, 2e-5))
    assert (wing.worst[0], str(wing.worst[1])) == (pytest.approx(0.5), "node (4, 5, 1) of block 2")
    assert (body.patch, body.n_off, body.is_kept) == ("body", 132, False)
    assert (body.worst[0], str(body.worst[1])) == (pytest.approx(1.8), "node (8, 2, 1) of block 3")


def test_spacings_are_those_of_the_grid():
    (wing,) = wall_spacings(walled(*plates([1e-3])))
    assert (wing.n_nodes, wing.extents) == (132, (0.0, 10.0, 11.0))
    found = wing.height_min, wing.height_max, wing.growth_median, wing.growth_max, wing.aspect_median, wing.aspect_max
    assert found == pytest.approx((1e-3, 1e-3, 1.2, 1.2, 1000.0, 1000.0))


def test_edges_across_a_grid_that_is_one_cell_deep_are_no_part_of_the_aspect_ratio():
    (section,) = wall_spacings(walled(*(x * [0.1, 1.0, 1.0] for x in plates([1e-3], n=(12, 2)))))
    assert section.aspect_max == pytest.approx(100.0)


def test_a_block_of_one_cell_off_the_wall_has_no_growth():
    (wing,) = wall_spacings(walled(plates([1e-3])[0][:, :, :2]))
    assert np.isnan(wing.growth_median)


def test_y_plus_of_a_flat_plate_is_that_of_its_friction():
    """Friction 0.0027 at a Reynolds number of ten million."""
    assert flat_plate_y_plus(1e-5, 1e7, 1.0) == pytest.approx(100.0 * np.sqrt(0.0027 / 2.0))
    assert flat_plate_y_plus(1e-5, 1e6, 10.0) == pytest.approx(10.0 * np.sqrt(0.0027 / 2.0))
