"""Orders of elimination, elimination trees and supernodes."""

import numpy as np
import pytest
from sparse_cases import box_elements, random_pattern

from bspline_mdao.base.sparse.blocks import BlockPattern, graph_of
from bspline_mdao.base.sparse.ordering import (
    LARGEST_FOR_MINIMUM_DEGREE,
    fill_reducing_order,
    minimum_degree,
    nested_dissection,
)
from bspline_mdao.base.sparse.separators import SEPARATOR, common_neighbours, find_separator
from bspline_mdao.base.sparse.symbolic import column_counts, elimination_tree, find_supernodes, postorder


def box_graph(shape, periodic=False):
    elements, points = box_elements(shape, periodic)
    return graph_of(BlockPattern.of_elements(elements, len(points)))


def eliminated(pattern, order):
    """Dense pattern of the factor, the slow way."""
    n = pattern.n
    full = np.zeros((n, n), bool)
    full[np.repeat(np.arange(n), np.diff(pattern.indptr)), pattern.indices] = True
    full = (full | full.T)[np.ix_(order, order)]
    for column in range(n):
        rows = column + 1 + np.flatnonzero(full[column + 1 :, column])
        full[np.ix_(rows, rows)] = True
    return np.tril(full)


def n_in_factor(supernodes):
    sizes, rows = np.diff(supernodes.firsts), np.diff(supernodes.row_starts)
    return int((sizes * (sizes + 1) // 2 + sizes * rows).sum())


@pytest.mark.parametrize(("n", "density"), [(1, 0.0), (9, 0.0), (40, 0.03), (40, 0.1), (25, 1.0)])
def test_tree_and_counts_are_those_of_the_factor(n, density):
    rng = np.random.default_rng(n)
    pattern = random_pattern(n, density, rng)
    graph = graph_of(pattern)
    for order in (np.arange(n), rng.permutation(n)):
        order = order.astype(np.int32)
        rank = np.argsort(order).astype(np.int32)
        order = order[postorder(elimination_tree(*graph, order, rank))]
        rank = np.argsort(order).astype(np.int32)
        parent, factor = elimination_tree(*graph, order, rank), eliminated(pattern, order)
        assert (column_counts(*graph, order, rank, parent) == factor.sum(axis=0)).all()
        below = [np.flatnonzero(factor[column + 1 :, column]) for column in range(n)]
        assert parent.tolist() == [column + 1 + rows[0] if len(rows) else -1 for column, rows in enumerate(below)]


@pytest.mark.parametrize(("n", "density"), [(1, 0.0), (60, 0.02), (150, 0.02), (30, 1.0)])
def test_fronts_hold_the_whole_factor(n, density):
    rng = np.random.default_rng(n)
    pattern = random_pattern(n, density, rng)
    supernodes = find_supernodes(*graph_of(pattern), rng.permutation(n).astype(np.int32))
    assert sorted(supernodes.order) == list(range(n))
    stored = np.zeros((n, n), bool)
    for s, (first, last) in enumerate(zip(supernodes.firsts, supernodes.firsts[1:])):
        rows = supernodes.rows[supernodes.row_starts[s] : supernodes.row_starts[s + 1]]
        assert (np.diff(rows) > 0).all()
        stored[np.ix_(np.concatenate((np.arange(first, last), rows)), np.arange(first, last))] = True
    assert not (eliminated(pattern, supernodes.order) & ~stored).any()


@pytest.mark.parametrize("periodic", [False, True])
def test_no_edge_joins_the_sides_of_a_separator(periodic):
    graph = box_graph((14, 11, 9), periodic)
    parts = find_separator(*graph, common_neighbours(*graph))
    ends = np.repeat(parts, np.diff(graph.starts)), parts[graph.neighbours]
    assert not (((ends[0] == 0) & (ends[1] == 1)) | ((ends[0] == 1) & (ends[1] == 0))).any()
    assert (np.bincount(parts, minlength=3)[:2] > 0.3 * len(parts)).all()


def test_box_is_cut_across_its_longest_side():
    graph = box_graph((21, 9, 8))
    parts = find_separator(*graph, common_neighbours(*graph))
    assert (parts == SEPARATOR).sum() == 72


def test_disconnected_pieces_need_no_separator():
    elements, points = box_elements((5, 6, 7))
    both = np.concatenate((elements, elements + len(points)))
    graph = graph_of(BlockPattern.of_elements(both, 2 * len(points)))
    assert not (find_separator(*graph, common_neighbours(*graph)) == SEPARATOR).any()


def test_dissection_fills_little_whatever_the_numbering():
    elements, points = box_elements((16, 15, 14))
    n = len(points)
    shuffled = np.random.default_rng(5).permutation(n).astype(np.int32)[elements]
    fill = []
    for numbering in (elements, shuffled):
        graph = graph_of(BlockPattern.of_elements(numbering, n))
        fill.append(n_in_factor(find_supernodes(*graph, nested_dissection(*graph))))
    natural = n_in_factor(find_supernodes(*graph, np.arange(n, dtype=np.int32)))
    assert max(fill) < 1.1 * min(fill)
    assert max(fill) < 0.3 * natural


def test_order_is_a_permutation_also_of_a_complete_graph():
    graph = graph_of(random_pattern(230, 1.0, np.random.default_rng(0)))
    assert sorted(nested_dissection(*graph)) == list(range(230))


def test_minimum_degree_fills_little_more_than_dissection_on_small_meshes():
    for shape in ((5, 6, 7), (9, 12, 11)):
        elements, points = box_elements(shape)
        graph = graph_of(BlockPattern.of_elements(elements, len(points)))
        fill = [n_in_factor(find_supernodes(*graph, order(*graph))) for order in (minimum_degree, nested_dissection)]
        assert fill[0] < 1.4 * fill[1]


def test_graphs_without_edges_and_in_pieces_are_ordered_by_minimum_degree():
    rng = np.random.default_rng(3)
    for n, density in ((0, 0.0), (1, 0.0), (7, 0.0), (60, 0.02)):
        graph = graph_of(random_pattern(n, density, rng))
        assert sorted(minimum_degree(*graph)) == list(range(n))


def test_large_graphs_are_dissected_and_small_ones_are_not():
    for shape in ((6, 5, 4), (17, 16, 16)):
        elements, points = box_elements(shape)
        graph = graph_of(BlockPattern.of_elements(elements, len(points)))
        order = minimum_degree if len(points) <= LARGEST_FOR_MINIMUM_DEGREE else nested_dissection
        assert (fill_reducing_order(*graph) == order(*graph)).all()
    assert len(points) > LARGEST_FOR_MINIMUM_DEGREE
