"""The residual by the width of the cells where it is."""

from dataclasses import replace

import numpy as np
import pytest
from fit_cases import bend, c_grid, grid_of, lattice, two_blocks

from bspline_mdao import FittedModel, fit_grid
from bspline_mdao.core.fit.fit_nodes import FitNodes
from bspline_mdao.core.fit.local_errors import flattest_cell, worst_local_errors
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.splines import fit_blocks


def shortest_edges(nodes):
    """Of every node the shortest edge that has a length in each direction, shape (..., 3); infinite where none has."""
    found = np.full((*nodes.shape[:3], 3, 2), np.inf)
    for d in range(3):
        edge = np.linalg.norm(np.diff(nodes, axis=d), axis=-1)
        edge[edge == 0.0] = np.inf
        for side, ends in enumerate((slice(None, -1), slice(1, None))):
            found[(slice(None),) * d + (ends,)][..., d, side] = edge
    return found.min(axis=-1)


def with_walls(grid, *windows):
    return replace(grid, patches=(Patch("skin", "wall", windows),))


def in_widths(blocks, residuals, width_of):
    """Residual of all nodes by their widths, an array for each block."""
    return [np.linalg.norm(r, axis=-1) / width_of(x) for x, r in zip(blocks, residuals)]


def layered():
    """Two blocks with cells a thousandth as high as long at the wall jmin of the first one."""
    grid = two_blocks()
    nodes = grid.blocks[0].nodes
    squeezed = nodes[:, :1] + (nodes - nodes[:, :1]) * np.linspace(0, 1, 13)[:, None, None] ** 3
    return with_walls(grid_of(squeezed, grid.blocks[1].nodes + [9, 0, 0]), Window(0, (0, 0, 0), (8, 0, 10)))


def found_by_hand(grid, residuals):
    """Places from 1 and values of the worst nodes anywhere and on the wall jmin of the first block."""
    blocks = [block.nodes for block in grid.blocks]
    middle = in_widths(blocks, residuals, lambda x: np.sort(shortest_edges(x), axis=-1)[..., 1])
    wall = in_widths(blocks, residuals, lambda x: shortest_edges(x)[..., [0, 2]].min(axis=-1))[0][:, :1]
    block = int(np.argmax([part.max() for part in middle]))
    worst = np.unravel_index(middle[block].argmax(), middle[block].shape)
    on_wall = np.unravel_index(wall.argmax(), wall.shape)
    return (block, *worst), middle[block].max(), (0, *on_wall), wall.max()


@pytest.mark.parametrize("seed", range(4))
def test_the_worst_nodes_are_those_of_the_largest_residual_by_the_width_of_their_cells(seed):
    grid, random = layered(), np.random.default_rng(seed)
    topology = find_topology(grid)
    residuals = [random.normal(size=block.nodes.shape) ** 3 for block in grid.blocks]
    stacked = np.concatenate([part.reshape(-1, 3) for part in residuals])
    anywhere, on_walls = worst_local_errors(FitNodes.of(topology), grid.to_vector().reshape(-1, 3), stacked)
    for error, place, value in zip((anywhere, on_walls), *[found_by_hand(grid, residuals)[n::2] for n in (0, 1)]):
        assert (error.block, error.i, error.j, error.k) == tuple(n + 1 for n in place)
        np.testing.assert_allclose(error.in_widths, value, rtol=1e-14)
        np.testing.assert_allclose(error.error, np.linalg.norm(residuals[place[0]][place[1:]]), rtol=1e-14)
        np.testing.assert_allclose(error.error / error.width, value, rtol=1e-14)
    assert (anywhere.patch, on_walls.patch) == ("", "skin")


def test_the_height_of_first_cells_does_not_count():
    grid, errors = layered(), []
    for squeeze in (1.0, 1e-3):
        nodes = grid.blocks[0].nodes.copy()
        nodes[:, 1] = nodes[:, 0] + squeeze * (nodes[:, 1] - nodes[:, 0])
        squeezed = with_walls(grid_of(nodes, grid.blocks[1].nodes), *grid.patches[0].windows)
        residual = np.zeros((squeezed.n_nodes, 3))
        residual[: nodes[..., 0].size].reshape(nodes.shape)[4, :2, 5] = [0.01, 0.02, 0.0]  # at the wall and next to it
        sharing = FitNodes.of(find_topology(squeezed))
        errors.append(worst_local_errors(sharing, squeezed.to_vector().reshape(-1, 3), residual))
    for error, same in zip(*errors):
        np.testing.assert_allclose(error.in_widths, same.in_widths, rtol=0.01)


def test_edges_without_length_and_directions_of_one_node_have_no_width():
    nodes = bend(lattice(7, 1, 5))
    nodes[3] = nodes[2]  # two lines of nodes in one place
    nodes[:, :, 4] = nodes[0, 0, 4]  # and a pole
    grid = with_walls(grid_of(nodes), Window(0, (0, 0, 0), (6, 0, 0)))
    residual = np.random.default_rng(5).normal(size=(35, 3))
    residual[29] *= 1e3  # at the pole, where one direction alone has edges
    anywhere, on_walls = worst_local_errors(FitNodes.of(find_topology(grid)), nodes.reshape(-1, 3), residual)
    edges = np.sort(shortest_edges(nodes), axis=-1)
    widths = np.where(np.isfinite(edges[..., 1]), edges[..., 1], edges[..., 0])
    values = np.linalg.norm(residual.reshape(nodes.shape), axis=-1) / widths
    np.testing.assert_allclose(anywhere.in_widths, values.max(), rtol=1e-14)
    along = np.linalg.norm(residual.reshape(nodes.shape), axis=-1)[:, 0, 0] / shortest_edges(nodes)[:, 0, 0, 0]
    np.testing.assert_allclose(on_walls.in_widths, along.max(), rtol=1e-14)
    assert worst_local_errors(FitNodes.of(find_topology(grid)), np.zeros((35, 3)), residual) == (None, None)


def test_the_report_of_a_fit_has_them_and_a_file_keeps_them(tmp_path):
    model = fit_grid(brick_grid((9, 7, 11, 8)), n_control=5)
    report = model.report
    assert 0.0 < report.worst_on_walls.in_widths <= report.worst_local.in_widths
    assert report.worst_on_walls.patch
    nodes, starts = model.regenerate(), np.cumsum([0, *map(np.prod, model.topology.shapes)])
    for error in (report.worst_local, report.worst_on_walls):
        block = error.block - 1
        place = np.ravel_multi_index((error.i - 1, error.j - 1, error.k - 1), nodes.shapes[block])
        np.testing.assert_allclose(np.linalg.norm(model.residual[starts[block] + place]), error.error, rtol=1e-10)
    model.save(tmp_path / "brick.h5")
    assert FittedModel.load(tmp_path / "brick.h5").report == report
    assert fit_blocks(brick_grid((9, 7, 11, 8)), n_control=5).report.worst_local == report.worst_local


def test_a_grid_without_walls_has_none_on_walls():
    report = fit_grid(c_grid()).report
    assert report.worst_on_walls is None
    assert report.worst_local.in_widths > 0.0


def test_the_flattest_cell_is_the_least_shortest_edge_by_the_middle_one():
    grid = layered()
    edges = [np.sort(shortest_edges(block.nodes), axis=-1) for block in grid.blocks]
    expected = min((edge[..., 0] / edge[..., 1]).min() for edge in edges)
    found = flattest_cell(FitNodes.of(find_topology(grid)), grid.to_vector().reshape(-1, 3))
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    line = grid_of(lattice(5, 1, 1))
    assert flattest_cell(FitNodes.of(find_topology(line)), np.zeros((5, 3))) == np.inf
