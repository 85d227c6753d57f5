"""Nodes of a grid are found in the order of another program."""

import numpy as np
import pytest
from component_cases import two_blocks

from bspline_mdao import InputError, find_topology
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.sharing import node_sharing, numbers_of_points, rows_of_points
from bspline_mdao.grids.topology.stored_grid import StoredBlock, StoredGrid


def test_rows_give_the_points_back_in_any_order_as_often_as_asked_and_in_single_precision():
    grid, rng = two_blocks(), np.random.default_rng(0)
    nodes = grid.to_vector().reshape(-1, 3)
    wanted = rng.integers(0, len(nodes), 2 * len(nodes))
    rows = rows_of_points(grid, find_topology(grid), np.float32(nodes[wanted]))
    np.testing.assert_allclose(nodes[rows], nodes[wanted], atol=1e-12)


def test_nodes_that_blocks_share_are_found_in_one_row():
    grid = two_blocks()
    nodes = grid.to_vector().reshape(-1, 3)
    rows = rows_of_points(grid, find_topology(grid), nodes)
    n_shared = np.prod(grid.shapes[0][1:])
    assert len(np.unique(rows)) == len(nodes) - n_shared


def test_a_search_block_by_block_finds_what_one_of_all_nodes_finds():
    grid = onera_m6_grid((7, 6, 5))
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    unique = np.unique(node_sharing(topology).source_rows())
    points = np.float32(np.random.default_rng(2).permutation(nodes)[:500])
    expected = unique[numbers_of_points(nodes[unique], points, "volume")]
    np.testing.assert_array_equal(rows_of_points(grid, topology, points), expected)
    np.testing.assert_array_equal(rows_of_points(grid, topology, np.zeros((0, 3))), np.zeros(0))


def test_only_blocks_that_points_may_be_in_are_searched():
    grid, read = two_blocks(), []

    def stored(number, block):
        return StoredBlock(block.shape, block.name, lambda window: read.append(number) or block)

    on_disk = StoredGrid(tuple(stored(*numbered) for numbered in enumerate(grid.blocks)), grid.patches)
    points = grid.blocks[1].nodes[-2:].reshape(-1, 3)
    rows = rows_of_points(on_disk, find_topology(grid), points)
    np.testing.assert_array_equal(grid.to_vector().reshape(-1, 3)[rows], points)
    assert read == [0, 1, 1]


def test_a_point_that_is_no_node_is_refused():
    grid = two_blocks()
    points = grid.to_vector().reshape(-1, 3).copy()
    points[11] = 0.5 * (points[11] + points[12])
    with pytest.raises(InputError, match=r"^volume: point 12 is .* m from one node and .* m from another"):
        rows_of_points(grid, find_topology(grid), points)


@pytest.mark.slow
def test_nodes_on_both_sides_of_a_plate_cannot_be_reported_apart_and_are_refused():
    grid = flat_plate_grid((5, 5, 5))
    topology = find_topology(grid)
    with pytest.raises(InputError, match="0 m from one node and 0 m from another") as error:
        rows_of_points(grid, topology, grid.to_vector())
    assert "\n" not in str(error.value)


def test_flat_vectors_are_points_too():
    nodes = np.random.default_rng(1).normal(size=(7, 3))
    np.testing.assert_array_equal(numbers_of_points(nodes, nodes[::-1].ravel(), "surface"), np.arange(7)[::-1])
