import numpy as np
import pytest
from topology_cases import box, grid_of, smooth_box, split, twelve_block_plate

from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.partition import Partition, Subdomain


def unequal_blocks():
    return grid_of(*split(smooth_box(18, 9, 11), [3, 9], [4], [5]))


def plane_and_line():
    plane = box(np.linspace(0, 1, 14), np.linspace(0, 1, 9), [0.0])
    line = box([2.0], np.linspace(0, 1, 5), [0.0])
    return grid_of(plane, line, plane[:, :, ::-1] + [0.0, 3.0, 0.0])


GRIDS = {
    "plate": twelve_block_plate,
    "unequal": unequal_blocks,
    "one block": lambda: grid_of(smooth_box(13, 8, 9)),
    "one cell": lambda: grid_of(smooth_box(2, 2, 2)),
    "plane": plane_and_line,
}
RANKS = (1, 2, 3, 4, 5, 17)


@pytest.fixture(scope="module", params=GRIDS)
def topology(request):
    grid = GRIDS[request.param]()
    return find_topology(grid)


def subdomains_of(topology, n_ranks):
    partition = Partition.of(topology, n_ranks)
    return [partition.subdomain(rank) for rank in range(n_ranks)]


@pytest.mark.parametrize("n_ranks", RANKS)
def test_every_cell_belongs_to_one_process_and_every_node_to_one_or_more(topology, n_ranks):
    subdomains = subdomains_of(topology, n_ranks)
    n_cells = sum(np.prod(np.maximum(np.array(s) - 1, 1)) for s in topology.shapes if sum(n > 1 for n in s) > 1)
    np.testing.assert_array_equal(
        np.sort(np.concatenate([subdomain.cells for subdomain in subdomains])), np.arange(n_cells)
    )
    np.testing.assert_array_equal(
        np.unique(np.concatenate([subdomain.rows for subdomain in subdomains])), range(topology.n_nodes)
    )


@pytest.mark.parametrize("n_ranks", RANKS)
def test_loads_are_balanced_as_far_as_blocks_can_be_cut(topology, n_ranks):
    subdomains = subdomains_of(topology, n_ranks)
    loads = np.array([subdomain.n_nodes for subdomain in subdomains])
    heaviest = subdomains[int(loads.argmax())]
    largest = max(heaviest.windows, key=lambda window: np.prod(window.shape))
    assert loads.max() <= 1.15 * loads.mean() or max(largest.shape) == 2


@pytest.mark.parametrize("n_ranks", RANKS)
def test_all_processes_deal_alike(topology, n_ranks):
    assert Partition.of(topology, n_ranks).pieces == Partition.of(topology, n_ranks).pieces


def test_blocks_stay_whole_where_the_balance_allows_it():
    topology = find_topology(twelve_block_plate())
    for n_ranks in (1, 2, 3, 4, 6, 12):
        for pieces in Partition.of(topology, n_ranks).pieces:
            assert all(piece == Window.whole(piece.block, topology.shapes[piece.block]) for piece in pieces)
    assert max(len(pieces) for pieces in Partition.of(topology, 5).pieces) > 2


def test_a_single_block_is_cut_into_as_many_pieces_as_there_are_processes():
    topology = find_topology(grid_of(smooth_box(31, 9, 11)))
    for n_ranks in (2, 3, 5):
        pieces = Partition.of(topology, n_ranks).pieces
        assert [len(of_rank) for of_rank in pieces] == [1] * n_ranks
    (low,), (high,) = Partition.of(topology, 2).pieces
    assert low.hi == (15, 8, 10)
    assert high.lo == (15, 0, 0)


def test_processes_that_no_cell_is_left_for_hold_nothing():
    subdomains = subdomains_of(find_topology(grid_of(smooth_box(2, 2, 2))), 3)
    assert [subdomain.n_nodes for subdomain in subdomains] == [8, 0, 0]
    assert subdomains[1].shapes == ()
    assert subdomains[1].starts == (0,)
    assert subdomains[1].cells.size == 0


def test_the_subdomain_of_one_process_is_the_grid(topology):
    subdomain = Subdomain.of_grid(topology)
    assert subdomain.is_grid
    assert subdomain.shapes == topology.shapes
    assert not Subdomain.of_rows(range(topology.n_nodes - 1), topology.n_nodes).is_grid


@pytest.mark.parametrize("n_ranks", RANKS)
def test_nodes_and_cells_of_a_subdomain_are_in_the_order_of_its_pieces(n_ranks):
    grid = unequal_blocks()
    nodes = grid.to_vector().reshape(-1, 3)
    q = GridQuality.of_baseline(grid).evaluate(nodes, cells=True).q
    for subdomain in subdomains_of(find_topology(grid), n_ranks):
        at = subdomain.starts
        for window, start, end in zip(subdomain.windows, at, at[1:]):
            piece = grid.blocks[window.block].nodes[window.slices]
            np.testing.assert_array_equal(nodes[subdomain.rows[start:end]].reshape(piece.shape), piece)
        if subdomain.n_nodes:
            own = grid_of(*(grid.blocks[window.block].nodes[window.slices] for window in subdomain.windows))
            values = GridQuality.of_baseline(own).evaluate(own.to_vector().reshape(-1, 3), cells=True)
            np.testing.assert_array_equal(values.q, q[subdomain.cells])


def test_a_subdomain_of_rows_keeps_the_solvers_order():
    subdomain = Subdomain.of_rows([5, 2, 2, 7], 8)
    np.testing.assert_array_equal(subdomain.rows, [5, 2, 2, 7])
    assert (subdomain.n_nodes, subdomain.n_nodes_of_grid) == (4, 8)
    assert Subdomain.of_rows([], 8).n_nodes == 0


@pytest.mark.parametrize("rows", [[8], [-1], [0.5], [[1, 2]], ["a"]])
def test_rows_that_are_none_are_refused(rows):
    with pytest.raises(InputError, match="give a list of integers from 0 to 7"):
        Subdomain.of_rows(rows, 8)


def test_a_subdomain_of_rows_has_no_cells():
    with pytest.raises(InputError, match="a list of nodes has no cells"):
        _ = Subdomain.of_rows([1], 8).cells
    with pytest.raises(InputError, match="a list of nodes has no cells"):
        _ = Subdomain.of_rows([1], 8).shapes


def test_no_process_and_no_balance_are_refused():
    topology = find_topology(grid_of(smooth_box(3, 3, 3)))
    with pytest.raises(InputError, match="0 processes"):
        Partition.of(topology, 0)
    with pytest.raises(InputError, match=r"an imbalance of 0\.0"):
        Partition.of(topology, 2, imbalance=0.0)
