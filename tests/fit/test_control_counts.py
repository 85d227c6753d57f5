"""Numbers of control points and orders."""

import numpy as np
import pytest
from fit_cases import bend, bent_block, c_grid, grid_of, lattice, two_blocks

from bspline_mdao.errors import InputError
from bspline_mdao.fit import control_counts
from bspline_mdao.fit.control_counts import choose_counts
from bspline_mdao.topology.detection import find_topology


def counts_of(grid, *arguments, **options):
    return choose_counts(find_topology(grid), *arguments, **options)


def test_choice_is_near_a_quarter_of_the_nodes():
    counts = counts_of(grid_of(lattice(45, 65, 33)))
    np.testing.assert_array_equal(counts.n_control, [[13, 18, 10]])
    np.testing.assert_array_equal(counts.orders, [[4, 4, 4]])


def test_few_planes_are_all_kept_and_lower_the_order():
    counts = counts_of(grid_of(lattice(2, 21, 5)), order=4)
    np.testing.assert_array_equal(counts.n_control[0, [0, 2]], [2, 5])
    np.testing.assert_array_equal(counts.orders, [[2, 4, 4]])
    assert "block 1 i (order 2)" in counts.warnings[0]


def test_short_directions_choose_a_lower_order_and_fewer_control_points_than_nodes():
    counts = [counts_of(grid_of(lattice(n, 12, 13))) for n in (2, 3, 4, 5, 6, 7)]
    np.testing.assert_array_equal([c.n_control[0] for c in counts], [[n, 5, 5] for n in (2, 3, 3, 3, 4, 5)])
    np.testing.assert_array_equal([c.orders[0] for c in counts], [[2, 3, 4], *[[3, 3, 4]] * 5])
    assert not any(c.warnings for c in counts)
    np.testing.assert_array_equal(counts_of(grid_of(lattice(5, 12, 13)), (2, 12, 5)).orders, [[2, 4, 4]])


def test_choice_agrees_across_permuted_interfaces():
    counts = counts_of(two_blocks())
    (first, second) = counts.n_control
    assert first[1] == second[2]
    assert first[2] == second[0]


def test_a_count_for_each_block_is_taken_as_it_is():
    counts = counts_of(two_blocks(), [(5, 7, 6), (6, 8, 7)], order=[(4, 3, 2), (2, 4, 3)])
    np.testing.assert_array_equal(counts.n_control, [[5, 7, 6], [6, 8, 7]])
    np.testing.assert_array_equal(counts.orders, [[4, 3, 2], [2, 4, 3]])


def test_disagreeing_neighbours_are_named_with_faces_and_counts():
    message = r"block 1 has 7 of order 4 in j \(on imax\) and block 2 has 6 of order 4 in k \(on jmax\)"
    with pytest.raises(InputError, match=message) as error:
        counts_of(two_blocks(), [(5, 7, 6), (6, 8, 6)])
    assert "\n" not in str(error.value)


def test_disagreeing_orders_are_an_error():
    with pytest.raises(InputError, match="disagree along interfaces"):
        counts_of(two_blocks(), [(5, 7, 6), (6, 8, 7)], order=(4, 3, 2))


def test_disagreeing_orders_are_an_error_where_the_counts_are_chosen():
    with pytest.raises(InputError, match=r"order 4 in j .* order 3 in k"):
        choose_counts(find_topology(two_blocks()), None, [(4, 4, 4), (4, 4, 3)])


@pytest.mark.parametrize("n_control", [(14, 5, 5), (1, 5, 5)])
def test_more_control_points_than_nodes_or_a_single_one_are_an_error(n_control):
    with pytest.raises(InputError, match=r"(14|1) control points in direction i of block 1 .* its 13 nodes"):
        counts_of(grid_of(bend(lattice(13, 9, 9))), n_control)


@pytest.mark.parametrize("n_control", [(5, 5), [(5, 5, 5)] * 3, (5.5, 5, 5), (0, 5, 5), "many"])
def test_malformed_counts_are_an_error(n_control):
    with pytest.raises(InputError, match="n_control = "):
        counts_of(two_blocks(), n_control)


def test_segments_share_the_count_of_a_cut_block():
    grid = c_grid(n_wake=9, n_body=25)
    topology = find_topology(grid)
    assert len(topology.segments) == 3
    counts = choose_counts(topology, (19, 5, 4))
    lengths = [segment.shape[0] for segment in topology.segments]
    assert counts.n_control[0, 0] == counts.n_control[2, 0] < counts.n_control[1, 0]
    assert (counts.n_control[:, 0] >= 4).all()
    assert (counts.n_control[:, 0] <= lengths).all()


@pytest.mark.parametrize("order", [1, 17, 1000])
def test_orders_beyond_what_8_byte_reals_carry_are_an_error(order):
    with pytest.raises(InputError, match=f"order {order} of block 1; give 2 to 16"):
        counts_of(bent_block(), order=order)


def test_a_direction_of_one_node_may_have_order_1():
    counts = counts_of(grid_of(bend(lattice(9, 8, 1))), order=(4, 3, 1))
    np.testing.assert_array_equal(counts.orders, [[4, 3, 1]])


def test_choice_keeps_the_least_squares_of_large_blocks_small(monkeypatch):
    usual = counts_of(two_blocks())
    monkeypatch.setattr(control_counts, "LARGEST_CHOICE", 2000)
    counts = counts_of(two_blocks())
    assert (counts.n_control <= usual.n_control).all()
    assert counts.n_control[0, 1] == counts.n_control[1, 2]
    assert all(8 * np.prod(n - 2) ** 2 <= 2000 for n in counts.n_control)
    assert "block 1, 2" in counts.warnings[0]
    given = [(5, 7, 6), (6, 8, 7)]
    np.testing.assert_array_equal(counts_of(two_blocks(), given).n_control, given)
