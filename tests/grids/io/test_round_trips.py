"""What goes there and back, on inputs that hypothesis searches for: index spaces, topology, knots, numbers in files."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from topology_cases import ORIENTATIONS, box, grid_of, split

from bspline_mdao.core.splines.knot_insertion import elevate_order, insert_knots
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots, knots_from_array, knots_to_array
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.grids.io import fortran as fortran_records
from bspline_mdao.grids.io.fortran import join_records, parse_numbers, split_records
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.sharing import node_sharing

searched = settings(max_examples=60)

orientations = st.sampled_from(ORIENTATIONS)


@pytest.mark.slow
@searched
@given(st.tuples(*3 * [st.integers(1, 5)]), orientations, orientations)
def test_an_orientation_and_its_inverse_carry_index_spaces_there_and_back(shape, first, second):
    numbers = np.arange(np.prod(shape)).reshape(shape)
    np.testing.assert_array_equal(first.inverse().apply(first.apply(numbers)), numbers)
    assert first.inverse().inverse() == first
    there = second.apply(first.apply(numbers))
    np.testing.assert_array_equal(first.inverse().apply(second.inverse().apply(there)), numbers)


def cuts(n):
    """Indices inside a direction of n nodes at which blocks are cut."""
    return st.lists(st.integers(1, n - 2), max_size=2, unique=True).map(sorted)


@pytest.mark.slow
@searched
@given(st.data(), st.tuples(*3 * [st.integers(3, 6)]))
def test_a_box_cut_anywhere_and_turned_at_random_is_joined_again(data, shape):
    """Its interfaces are the cuts, its links join the nodes that were one, and each is reported in its orientation."""
    lines = [np.linspace(0.0, 1.0, n) ** power for n, power in zip(shape, (1.0, 1.3, 0.8))]
    at = [data.draw(cuts(n)) for n in shape]
    blocks = split(box(*lines), *at)
    grid = grid_of(*(data.draw(orientations).apply(nodes) for nodes in blocks))
    topology = find_topology(grid)
    pieces = [len(cut) + 1 for cut in at]
    n_cuts = sum((pieces[d] - 1) * np.prod(pieces, dtype=int) // pieces[d] for d in range(3))
    assert len(topology.interfaces) == n_cuts
    for interface in topology.interfaces:
        a, b = (grid.blocks[side.block].nodes[side.slices] for side in (interface.a, interface.b))
        np.testing.assert_array_equal(a, interface.orientation.apply(b))
    copies, originals = node_sharing(topology).copies.T
    nodes = grid.to_vector().reshape(-1, 3)
    np.testing.assert_array_equal(nodes[copies], nodes[originals])
    assert len(nodes) - len(copies) == np.prod(shape)


@st.composite
def open_knots(draw, order):
    """Knots of an order with up to four inner ones, some of them repeated as often as their order allows."""
    places = draw(st.lists(st.integers(1, 31), max_size=4, unique=True).map(sorted))
    inner = [place / 32 for place in places for _ in range(draw(st.integers(1, order - 1)))]
    return ConstantKnots(np.array([0.0] * order + inner + [1.0] * order), order)


def room(knots):
    """Places at which one more knot may be put in, in 32nds."""
    counts = np.bincount(np.rint(32 * knots.knots[knots.order : knots.n_control]).astype(int), minlength=33)
    return [place / 32 for place in range(1, 32) if counts[place] < knots.order - 1]


@pytest.mark.slow
@searched
@given(st.data(), st.integers(2, 6))
def test_knots_put_in_and_orders_raised_in_any_sequence_keep_every_point(data, order):
    volume, rng = Volume.of(data.draw(open_knots(order))), np.random.default_rng(0)
    net = rng.standard_normal((*volume.n_control, 3))
    at = np.zeros((65, 3))
    at[:, 0] = np.linspace(0.0, 1.0, 65)
    expected, finer, finer_net = evaluate(volume, net, at), volume, net
    for step in data.draw(st.lists(st.sampled_from(["insert", "elevate"]), min_size=1, max_size=4)):
        places = room(finer.knots[0])
        if step == "insert" and places:
            finer, finer_net = insert_knots(finer, finer_net, 0, [data.draw(st.sampled_from(places))])
        elif step == "elevate" and finer.orders[0] < 7:
            finer, finer_net = elevate_order(finer, finer_net, 0)
    np.testing.assert_allclose(evaluate(finer, finer_net, at), expected, atol=1e-12)
    assert finer_net.min() >= net.min() - 1e-12  # new control points are averages of old ones
    assert finer_net.max() <= net.max() + 1e-12


@pytest.mark.slow
@searched
@given(st.data(), st.integers(2, 5))
def test_knots_come_back_from_the_array_that_a_file_holds(data, order):
    constant = data.draw(open_knots(order))
    again = knots_from_array(knots_to_array(constant), order)
    assert type(again) is ConstantKnots
    np.testing.assert_array_equal(again.knots, constant.knots)
    inner = sorted(data.draw(st.sets(st.integers(1, 63), max_size=5)))
    shift = np.array(data.draw(st.lists(st.floats(-0.4, 0.4), min_size=4, max_size=4))).reshape(2, 2, 1)
    corners = np.concatenate(
        [np.zeros((2, 2, order)), (np.array(inner) + shift * np.ones(len(inner))) / 64, np.ones((2, 2, order))], axis=-1
    )
    again = knots_from_array(knots_to_array(BilinearKnots(corners, order)), order)
    assert type(again) is BilinearKnots
    np.testing.assert_array_equal(again.corners, corners)


@searched
@given(
    st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=5),
    st.sampled_from("<>"),
    st.sampled_from([4, 8]),
    st.integers(1, 50),
)
@example([b"abcdefg"], "<", 4, 3)
def test_records_come_back_from_a_file_however_they_are_cut(payloads, byte_order, marker_bytes, longest):
    limit, fortran_records.MAX_SUBRECORD = fortran_records.MAX_SUBRECORD, longest
    try:
        data = b"".join(bytes(piece) for piece in join_records(payloads, byte_order, marker_bytes))
    finally:
        fortran_records.MAX_SUBRECORD = limit
    numbers, lengths = split_records(data, byte_order, marker_bytes)
    assert (bytes(numbers), lengths) == (b"".join(payloads), [len(payload) for payload in payloads])
    assert split_records(data[:-1], byte_order, marker_bytes) is None


STYLES = {
    "plain": lambda x: repr(x),
    "double": lambda x: f"{x:.17E}".replace("E", "D"),
    "quadruple": lambda x: f"{x:.17e}".replace("e", "q"),
    "letter lost": lambda x: f"{x:.17e}".replace("e+", "+").replace("e-", "-"),
}
"""How Fortran programs write a number."""

numbers = st.tuples(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(STYLES)), st.integers(1, 4)
)


@searched
@given(st.lists(st.tuples(numbers, st.sampled_from([" ", "\n", ", ", " ; ", "\t"])), min_size=1, max_size=12))
def test_numbers_of_text_come_back_in_every_style_of_fortran_to_the_last_bit(items):
    words = [(f"{n}*" if n > 1 else "") + STYLES[style](value) + separator for (value, style, n), separator in items]
    expected = np.concatenate([np.full(n, value) for (value, _, n), _ in items])
    np.testing.assert_array_equal(parse_numbers("".join(words).encode(), "text"), expected)
