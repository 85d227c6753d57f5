"""Numbers of control points and orders."""

from dataclasses import replace

import numpy as np
import pytest
from fit_cases import bend, bent_block, c_grid, grid_of, lattice, two_blocks

from bspline_mdao import fit_grid
from bspline_mdao.core.fit.control_counts import choose_counts
from bspline_mdao.core.fit.requested_counts import RequestedCounts
from bspline_mdao.core.fit.settings import FITTING
from bspline_mdao.errors import InputError
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.splines import fit_blocks

SMALL = replace(FITTING, largest_choice=2000)
"""Settings with which Gram matrices stay small."""


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


def test_a_single_control_point_for_several_nodes_is_an_error():
    with pytest.raises(InputError, match=r"1 control point in direction i of block 1 .* its 13 nodes"):
        counts_of(grid_of(bend(lattice(13, 9, 9))), (1, 5, 5))


def test_a_block_gets_no_more_control_points_than_it_has_nodes_and_a_word_says_so():
    grid = grid_of(bend(lattice(13, 3, 9)), bend(lattice(8, 9, 1) + [3, 0, 0]))
    counts = counts_of(grid, (9, 6, 5))
    np.testing.assert_array_equal(counts.n_control, [[9, 3, 5], [8, 6, 1]])
    assert (
        counts.warnings[0]
        == "no more control points than nodes where more were asked for (2): block 1 j (3), block 2 i (8)"
    )
    assert not counts_of(grid_of(bend(lattice(13, 6, 9))), (9, 6, 5)).warnings


def test_what_is_asked_of_one_block_is_followed_by_those_joined_to_it_and_the_rest_is_chosen():
    usual, (first, second) = counts_of(two_blocks()), counts_of(two_blocks(), {2: (6, 9, 8)}).n_control
    np.testing.assert_array_equal(second, [6, 9, 8])  # its k is j of the first block, its i is k of the first one
    np.testing.assert_array_equal(first, [usual.n_control[0, 0], 8, 6])
    assert counts_of(two_blocks(), {2: (6, 9, 8)}).orders[0, 0] == usual.orders[0, 0] == 3
    np.testing.assert_array_equal(counts_of(two_blocks(), [None, (6, 9, 8)]).n_control, [first, second])


def test_what_is_asked_of_one_block_goes_before_what_is_asked_of_all():
    counts = counts_of(two_blocks(), {None: (5, 5, 5), 2: (6, 9, 8)})
    np.testing.assert_array_equal(counts.n_control, [[5, 8, 6], [6, 9, 8]])
    np.testing.assert_array_equal(counts_of(two_blocks(), {None: 5}).n_control, np.full((2, 3), 5))


def test_blocks_that_are_asked_for_by_themselves_and_disagree_are_both_named():
    message = r"block 1 has 7 of order 4 in j \(on imax\) and block 2 has 8 of order 4 in k \(on jmax\); give both"
    with pytest.raises(InputError, match=message):
        counts_of(two_blocks(), {1: (5, 7, 6), 2: (6, 9, 8)})


def test_a_cut_block_that_is_asked_for_goes_before_what_is_asked_of_all():
    topology = find_topology(c_grid(n_wake=9, n_body=25))
    named = choose_counts(topology, {None: (5, 5, 4), 1: (19, 6, 4)}).n_control
    np.testing.assert_array_equal(named, choose_counts(topology, (19, 6, 4)).n_control)


def test_blocks_are_asked_for_by_name_too():
    topology = find_topology(two_blocks())
    for key in ("block 2", "2", 2):
        counts = RequestedCounts.of({key: (6, 9, 8)}, topology, ("left", "block 2")).counts
        np.testing.assert_array_equal(counts, [[0, 0, 0], [6, 9, 8]])
    by_name = fit_grid(two_blocks(), n_control={"block 2": (6, 9, 8)})
    assert by_name.mesh.volumes[1].n_control == (6, 9, 8)
    np.testing.assert_array_equal(RequestedCounts.of({"2": 5}, topology, ("2", "1")).counts, [[5, 5, 5], [0, 0, 0]])


@pytest.mark.parametrize(
    ("n_control", "names", "message"),
    [
        ({3: 5}, (), "block 3; give a number from 1 to 2"),
        ({0: 5}, (), "block 0; give a number from 1 to 2"),
        ({"wing": 5}, ("left", "right"), "block wing; give a number from 1 to 2 or a name, such as left"),
        ({"left": 5, 1: 6}, ("left", "right"), "block 1 twice"),
        ({"left": 5}, ("left", "left"), "several blocks are named left"),
        ({1: (5, 5)}, (), "n_control = "),
        ({None: (5, 0, 5)}, (), "n_control = "),
    ],
)
def test_what_is_asked_of_no_block_is_an_error(n_control, names, message):
    with pytest.raises(InputError, match=message):
        RequestedCounts.of(n_control, find_topology(two_blocks()), names)


def test_counts_that_are_asked_for_are_not_lowered_where_others_are():
    counts = counts_of(two_blocks(), {1: (7, 7, 7)}, settings=SMALL)
    np.testing.assert_array_equal(counts.n_control, [[7, 7, 7], [7, 4, 7]])


@pytest.mark.parametrize("n_control", [(5, 5), [(5, 5, 5)] * 3, [None] * 3, (5.5, 5, 5), (0, 5, 5), "many"])
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


def test_choice_keeps_the_least_squares_of_large_blocks_small():
    usual = counts_of(two_blocks())
    counts = counts_of(two_blocks(), settings=SMALL)
    assert (counts.n_control <= usual.n_control).all()
    assert counts.n_control[0, 1] == counts.n_control[1, 2]
    assert all(8 * np.prod(n - 2) ** 2 <= 2000 for n in counts.n_control)
    assert "block 1, 2" in counts.warnings[0]
    given = [(5, 7, 6), (6, 8, 7)]
    np.testing.assert_array_equal(counts_of(two_blocks(), given, settings=SMALL).n_control, given)


def test_fits_take_other_settings():
    grid = two_blocks()
    usual = fit_blocks(grid, corrections=1)
    finer = fit_blocks(grid, corrections=1, settings=replace(FITTING, cells_per_span=2))
    assert finer.mesh.n_control_points > usual.mesh.n_control_points
    uncorrected = fit_blocks(grid, corrections=1, settings=replace(FITTING, correction_steps=0))
    np.testing.assert_array_equal(uncorrected.control_points, fit_blocks(grid).control_points)
    assert (uncorrected.control_points != usual.control_points).any()
