import numpy as np
import pytest
from topology_cases import c_grid, grid_of, o_grid, patch, smooth_box, sphere_octants, split, twelve_block_plate

from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.node_numbering import NodeNumbering, NodesByRow, boundary_rows, face_rows, node_copies
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.grids.topology.sharing import node_sharing


def box_with_a_patch():
    return grid_of(*split(smooth_box(9, 7, 8), [4], [], []), patches=[patch("wall", Window(0, (1, 0, 2), (4, 0, 5)))])


GRIDS = {
    "plate": twelve_block_plate,
    "cube": lambda: grid_of(*split(smooth_box(9, 7, 8), [4], [3], [2, 5])),
    "segments": box_with_a_patch,
    "o": lambda: grid_of(o_grid()),
    "axis": lambda: grid_of(o_grid(radius=0.0)),
    "c": lambda: grid_of(c_grid(span=2)),
    "sphere": lambda: grid_of(*sphere_octants()) if not hasattr(sphere_octants(), "blocks") else sphere_octants(),
    "alone": lambda: grid_of(smooth_box(4, 5, 6)),
}


@pytest.fixture(scope="module", params=GRIDS)
def topology(request):
    return find_topology(GRIDS[request.param]())


def test_copies_are_those_of_the_sharing_of_all_nodes(topology):
    np.testing.assert_array_equal(node_copies(topology), node_sharing(topology).copies)


def test_all_nodes_of_a_grid_are_evaluated_where_the_sharing_says(topology):
    held, sharing = NodeNumbering.of_grid(topology), node_sharing(topology)
    assert held.n_nodes == held.n_asked == topology.n_nodes
    np.testing.assert_array_equal(held.copies, sharing.copies)
    for numbers, places, rows, own in zip(held.numbers, held.places, sharing.rows, sharing.is_evaluated):
        np.testing.assert_array_equal(numbers, rows[own])
        np.testing.assert_array_equal(places, np.flatnonzero(own))


@pytest.mark.parametrize("n_ranks", [2, 3, 5])
def test_the_nodes_of_every_subdomain_are_evaluated_once_where_the_sharing_says(topology, n_ranks):
    sharing, partition = node_sharing(topology), Partition.of(topology, n_ranks)
    source = sharing.source_rows()
    for rank in range(n_ranks):
        rows = partition.subdomain(rank).rows
        held = NodeNumbering.of(topology, rows)
        np.testing.assert_array_equal(held.rows[: held.n_asked], rows)
        values = np.full(held.n_nodes, -1)
        for numbers, places, segment_rows, own in zip(held.numbers, held.places, sharing.rows, sharing.is_evaluated):
            assert own.ravel()[places].all()
            assert (values[numbers] == -1).all()
            values[numbers] = segment_rows.ravel()[places]
        assert (values[held.copies[:, 0]] == -1).all()
        values[held.copies[:, 0]] = values[held.copies[:, 1]]
        np.testing.assert_array_equal(values, source[held.rows])


def test_needed_nodes_follow_those_asked_for():
    topology = find_topology(twelve_block_plate())
    source = node_sharing(topology).source_rows()
    rng = np.random.default_rng(3)
    rows, needed = rng.integers(topology.n_nodes, size=40), rng.integers(topology.n_nodes, size=30)
    held = NodeNumbering.of(topology, rows, [needed[:10], needed[10:]])
    assert (np.diff(held.rows[held.n_asked :]) > 0).all()
    np.testing.assert_array_equal(source[held.rows[held.numbers_of(needed)]], source[needed])
    np.testing.assert_array_equal(held.rows[held.numbers_of(rows)], source[rows])
    others = np.setdiff1d(np.arange(topology.n_nodes), np.concatenate([source[held.rows]]))
    others = others[~np.isin(source[others], held.rows)]
    assert (held.numbers_of(others) == -1).all()
    np.testing.assert_array_equal(held.sources_of(np.arange(topology.n_nodes)), source)


def test_a_process_without_nodes_holds_what_is_needed():
    topology = find_topology(twelve_block_plate())
    none = np.zeros(0, dtype=np.int64)
    assert NodeNumbering.of(topology, none).n_nodes == 0
    assert (NodeNumbering.of(topology, none).numbers_of(np.arange(3)) == -1).all()
    np.testing.assert_array_equal(NodeNumbering.of(topology, none, [np.array([5, 2])]).rows, [2, 5])


def test_rows_of_faces_are_those_of_the_blocks(topology):
    whole = topology.layout.numbers
    for face in topology.boundary:
        np.testing.assert_array_equal(face_rows(topology, face.window), whole[face.window.block][face.window.slices])
    found = boundary_rows(topology, topology.boundary)
    assert set(found) == {row for face in topology.boundary for row in face_rows(topology, face.window).ravel()}


def test_places_are_looked_up_by_rows():
    rows, points = np.array([2, 5, 9]), np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_array_equal(NodesByRow(rows, points)[np.array([[9, 2]])], points[[[2, 0]]])
    for missing in (3, 10):
        with pytest.raises(KeyError, match="not among those that are there"):
            NodesByRow(rows, points)[np.array([2, missing])]
