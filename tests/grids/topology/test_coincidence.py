from types import SimpleNamespace

import numpy as np
import pytest
from topology_cases import box, o_grid, smooth_box, split

from bspline_mdao.grids.topology.coincidence import data_round_off, find_coincidence
from bspline_mdao.grids.topology.shell import Shell


def coincidence_of(blocks):
    """Coincidence of blocks, with values in arrays of the shapes of these."""
    found = find_coincidence([Shell.of(nodes) for nodes in blocks])
    dense = {name: [on.dense() for on in getattr(found, name)] for name in ("ids", "near_ids", "spacing")}
    return SimpleNamespace(**dense)


def data_round_off_of(blocks):
    return data_round_off([Shell.of(nodes) for nodes in blocks])


def wall_line(first, n, ratio=1.4):
    return np.concatenate(([0.0], np.cumsum(first * ratio ** np.arange(n - 1))))


def test_nodes_on_one_point_get_one_number_and_inner_nodes_none():
    left, right = split(smooth_box(7, 5, 6), [3], [], [])
    found = coincidence_of([left, right])
    np.testing.assert_array_equal(found.ids[0][-1], found.ids[1][0])
    assert (found.ids[0][1:-1, 1:-1, 1:-1] == -1).all()
    n_face_nodes, n_shared = 4 * 5 * 6 - 2 * 3 * 4, 5 * 6
    assert len(np.unique(np.concatenate([ids[ids >= 0] for ids in found.ids]))) == 2 * n_face_nodes - n_shared


def test_spacing_is_that_of_the_shortest_edge():
    found = coincidence_of([box([0.0, 1.0, 3.0], [0.0, 0.5, 2.0], [0.0, 4.0, 8.0])])
    assert found.spacing[0][0, 0, 0] == 0.5
    assert found.spacing[0][2, 2, 2] == 1.5
    assert np.isinf(found.spacing[0][1, 1, 1])


def test_independent_round_off_of_four_byte_reals_is_bridged():
    rng = np.random.default_rng(1)
    nodes = 100.0 + smooth_box(9, 5, 6)
    left, right = split(nodes, [4], [], [])
    ulp = np.spacing(np.float32(101.0))
    noisy = [(block + rng.uniform(-0.5, 0.5, block.shape) * ulp).astype(np.float32) for block in (left, right)]
    assert np.abs(noisy[0][-1] - noisy[1][0]).max() > 0
    found = coincidence_of([block.astype(float) for block in noisy])
    np.testing.assert_array_equal(found.ids[0][-1], found.ids[1][0])


@pytest.mark.parametrize("offset", [0.0, 1.0, 100.0])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_ends_of_a_viscous_cell_never_become_one(kind, offset):
    nodes = box(offset + np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4), wall_line(1e-6, 30))
    nodes = nodes.astype(kind).astype(float)
    found = coincidence_of([nodes, nodes])
    for ids in (*found.ids, *found.near_ids):
        for axis in range(3):
            a, b = np.moveaxis(ids, axis, 0)[1:], np.moveaxis(ids, axis, 0)[:-1]
            assert ((a != b) | (a < 0)).all()
    np.testing.assert_array_equal(found.ids[0], found.ids[1])


def test_a_chain_of_merges_never_spans_a_cell():
    # Numbers of eight digits; round-off is 18 units here, a quarter of the thin cell 15.
    places = np.round(900.0 + 1e-5 * np.cumsum([0, 14, 13, 12, 11, 10]), 5)
    thin = box([*places[[0, -1]], 902.0], [0.0, 1.0], [0.0, 1.0])
    chain = [box([890.0 - n, x], [0.0, 1.0], [0.0, 1.0]) for n, x in enumerate(places[1:-1])]
    assert data_round_off_of([thin, *chain]) == 1e-7
    found = coincidence_of([*chain, thin])
    assert found.ids[-1][0, 0, 0] != found.ids[-1][1, 0, 0]
    assert found.near_ids[-1][0, 0, 0] != found.near_ids[-1][1, 0, 0]


def test_gaps_within_a_hundredth_of_the_spacing_are_near():
    left, right = split(smooth_box(7, 5, 6), [3], [], [])
    spacing = coincidence_of([left]).spacing[0].min()
    for gap, is_one, is_near in ((1e-6, True, True), (5e-3, False, True), (2e-2, False, False)):
        found = coincidence_of([left, right + [0.0, 0.0, gap * spacing]])
        assert (found.ids[0][-1] == found.ids[1][0]).all() == is_one
        assert (found.near_ids[0][-1] == found.near_ids[1][0]).all() == is_near


def test_an_axis_with_round_off_is_one_line_of_points():
    nodes = o_grid(radius=0.0)
    nodes[:, 0, :, :2] += 1e-16 * np.random.default_rng(2).normal(size=nodes[:, 0, :, :2].shape)
    ids = coincidence_of([nodes]).ids[0]
    assert (ids[:, 0] == ids[0, 0]).all()
    assert len(np.unique(ids[0, 0])) == nodes.shape[2]
    assert (ids[1:, 1, 0] != ids[:-1, 1, 0]).all()


def test_a_slender_wedge_is_not_taken_for_a_pole():
    angle = np.deg2rad([-0.5, 0.5])[:, None, None]
    radius, along = np.linspace(0.0, 1.0, 400)[None, :, None] ** 3, np.linspace(0.0, 10.0, 5)[None, None, :]
    nodes = np.stack(np.broadcast_arrays(along, radius * np.cos(angle), radius * np.sin(angle)), axis=-1)
    ids = coincidence_of([nodes.astype(np.float32).astype(float)]).ids[0]
    assert (ids[0, 0] == ids[1, 0]).all()
    assert (ids[0, 1:] != ids[1, 1:]).all()


def test_round_off_is_that_of_the_data():
    nodes = smooth_box(5, 6, 4)
    assert data_round_off_of([nodes]) == np.finfo(float).eps
    assert data_round_off_of([nodes.astype(np.float32).astype(float)]) == np.finfo(np.float32).eps
    for digits in (8, 10):
        text = [float(f"{value:.{digits - 1}e}") for value in nodes.ravel()]
        assert data_round_off_of([np.reshape(text, nodes.shape)]) == 10.0 ** (1 - digits)
