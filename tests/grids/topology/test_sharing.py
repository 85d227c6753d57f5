import numpy as np
import pytest
from topology_cases import (
    ORIENTATIONS,
    are_same_partition,
    box,
    c_grid,
    connected_rows,
    declared_connections,
    grid_of,
    labels_of_rows,
    o_grid,
    smooth_box,
    sphere_octants,
    split,
    twelve_block_plate,
)

from bspline_mdao.errors import InputError
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Orientation
from bspline_mdao.grids.topology.sharing import direction_classes, node_sharing
from bspline_mdao.grids.topology.topology import Collapse, Link, shared_ids

SIDE_BY_SIDE = Link(0, (-1, None, None), 1, (0, None, None), Orientation())


def test_ids_count_up_by_first_occurrence():
    first, second = shared_ids([(2, 1, 3), (2, 1, 3)], [SIDE_BY_SIDE])
    np.testing.assert_array_equal(first.ravel(), [0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(second.ravel(), [3, 4, 5, 6, 7, 8])
    assert first.dtype == np.int32


def test_without_links_every_point_has_its_own_id():
    ids = shared_ids([(2, 3, 4), (1, 2, 2)], [])
    np.testing.assert_array_equal(np.concatenate([part.ravel() for part in ids]), np.arange(28))


@pytest.mark.parametrize("orientation", ORIENTATIONS[::5])
def test_a_link_joins_points_by_its_orientation(orientation):
    shape = (4, 5, 6)
    there = tuple(np.array(shape)[np.argsort(orientation.perm)])
    end = tuple(-int(orientation.flip[d]) if d == 1 else None for d in range(3))
    b_section = tuple(end[np.argsort(orientation.perm)[p]] for p in range(3))
    first, second = shared_ids([shape, there], [Link(0, (None, 0, None), 1, b_section, orientation)])
    np.testing.assert_array_equal(first[:, 0], orientation.apply(second)[:, 0])
    assert second.max() == 4 * 5 * 6 + 4 * 5 * 6 - 4 * 6 - 1


def test_links_between_edges_and_corners_join_only_these():
    edge = Link(0, (-1, -1, None), 1, (0, 0, None), Orientation(flip=(False, False, True)))
    corner = Link(0, (0, 0, 0), 2, (-1, -1, -1), Orientation())
    a, b, c = shared_ids([(3, 4, 5)] * 3, [edge, corner])
    np.testing.assert_array_equal(a[-1, -1], b[0, 0, ::-1])
    assert a[0, 0, 0] == c[-1, -1, -1]
    assert max(part.max() for part in (a, b, c)) + 1 == 3 * 60 - 5 - 1


def test_a_collapsed_face_is_a_line_and_twice_collapsed_a_point():
    (line,) = shared_ids([(4, 5, 6)], [], [Collapse(0, (0, None, None), 1)])
    assert (line[0] == line[0, 0]).all()
    assert line.max() + 1 == 120 - 4 * 6
    (point,) = shared_ids([(4, 5, 6)], [], [Collapse(0, (0, None, None), d) for d in (1, 2)])
    assert (point[0] == 0).all()
    assert point.max() + 1 == 120 - 29


def test_neighbours_that_disagree_are_named_with_their_directions():
    turn = Orientation((1, 0, 2))
    link = Link(0, (-1, None, None), 1, (None, 0, None), turn)
    with pytest.raises(InputError, match="block 1 has 5 points in direction j and block 2 has 7 in direction i"):
        shared_ids([(4, 5, 6), (7, 4, 6)], [link])
    with pytest.raises(InputError, match="wing has 6 points in direction k and wake has 8 in direction k"):
        shared_ids([(4, 5, 6), (5, 4, 8)], [link], names=["wing", "wake"])


def test_control_points_are_shared_as_nodes_are():
    topology = find_topology(grid_of(*sphere_octants()))
    n_control = (4, 5, 6)
    ids = shared_ids([n_control] * 8, topology.links, topology.collapses)
    nodes = shared_ids([segment.shape for segment in topology.segments], topology.links, topology.collapses)
    for control, node in zip(ids, nodes):
        np.testing.assert_array_equal(control, node)


SHARED = {
    "boxes": split(smooth_box(9, 7, 8), [3, 5], [4], [2, 5]),
    "o_grid": [o_grid()],
    "axis": [o_grid(radius=0.0)],
    "c_grid": [c_grid(span=2, n_span=6)],
    "octants": sphere_octants(inner=0.0),
    "plate": [block.nodes for block in twelve_block_plate().blocks],
}


@pytest.mark.parametrize("name", SHARED)
def test_every_row_is_evaluated_once_or_copied_from_one_that_is(name):
    grid = grid_of(*SHARED[name])
    sharing = node_sharing(find_topology(grid))
    evaluated = np.concatenate([rows[mask] for rows, mask in zip(sharing.rows, sharing.is_evaluated)])
    assert len(np.unique(evaluated)) == len(evaluated)
    assert sorted([*evaluated, *sharing.copies[:, 0]]) == list(range(grid.n_nodes))
    assert np.isin(sharing.copies[:, 1], evaluated).all()


@pytest.mark.parametrize("name", SHARED)
def test_copies_have_the_coordinates_of_their_source(name):
    grid = grid_of(*SHARED[name])
    nodes = grid.to_vector().reshape(-1, 3)
    copies = node_sharing(find_topology(grid)).copies
    np.testing.assert_allclose(nodes[copies[:, 0]], nodes[copies[:, 1]], atol=1e-12)


def test_rows_of_segments_are_those_of_their_nodes():
    nodes = c_grid()
    topology = find_topology(grid_of(nodes))
    for segment, rows in zip(topology.segments, node_sharing(topology).rows):
        np.testing.assert_array_equal(nodes.reshape(-1, 3)[rows], nodes[segment.slices])


def test_directions_joined_by_links_are_of_one_class():
    blocks = split(smooth_box(9, 7, 8), [3], [4], [])
    turned = [blocks[0], blocks[1].transpose(2, 0, 1, 3), blocks[2][::-1], blocks[3].transpose(1, 0, 2, 3)]
    classes = direction_classes(find_topology(grid_of(*turned)))
    np.testing.assert_array_equal(classes, [[0, 1, 2], [2, 0, 3], [4, 1, 2], [3, 4, 2]])


def test_directions_of_an_o_grid_are_of_three_classes():
    np.testing.assert_array_equal(direction_classes(find_topology(grid_of(o_grid()))), [[0, 1, 2]])


def test_directions_across_a_cut_are_free():
    classes = direction_classes(find_topology(grid_of(c_grid())))
    np.testing.assert_array_equal(classes, [[0, 1, 2], [3, 1, 2], [0, 1, 2]])


def test_an_edge_link_joins_one_direction_only():
    nodes = box(np.linspace(0, 1, 5), np.linspace(0, 1, 5), np.linspace(0, 1, 4))
    grid = grid_of(nodes, nodes + [1.0, 1.0, 0.0])
    np.testing.assert_array_equal(direction_classes(find_topology(grid)), [[0, 1, 2], [3, 4, 2]])


@pytest.mark.parametrize("name", ["cgns_5blocks.cgns", "cgns_nozzle.cgns", "hopr_sphere_20blocks.cgns"])
def test_nodes_are_shared_as_the_connectivity_in_the_file_says(real_grids, name):
    names, nodes, links = declared_connections(real_grids / name)
    assert links
    topology = find_topology(grid_of(*nodes))
    starts = np.cumsum([0, *(block.size // 3 for block in nodes)])
    rows = [np.arange(start, end).reshape(block.shape[:3]) for start, end, block in zip(starts, starts[1:], nodes)]
    declared = np.arange(starts[-1])
    for a, a_range, b, b_range, transform in links:
        here, there = connected_rows(rows[names.index(a)], rows[names.index(b)], a_range, b_range, transform)
        declared = join_labels(declared, here, there)
    assert are_same_partition(labels_of_rows(topology, node_sharing(topology)), declared)
    assert 2 * len(topology.interfaces) == len(links)


def join_labels(labels, a, b):
    """Labels with those of each pair of members made one."""
    while (labels[a] != labels[b]).any():
        low = np.minimum(labels[a], labels[b])
        for members in (a, b):
            new = np.arange(len(labels))
            np.minimum.at(new, labels[members], low)
            labels = new[labels]
    return labels
