"""Entries of blocks of unequal shapes are numbered through, split, joined and found again."""

import pickle

import numpy as np
import pytest

from bspline_mdao.grids.topology.block_layout import BlockLayout

LAYOUTS = {
    "unequal blocks": [(3, 4, 2), (5, 2, 7), (2, 3, 4)],
    "a block one node deep": [(3, 4, 2), (5, 1, 2), (1, 6, 3)],
    "blocks without entries": [(0, 3, 2), (2, 3, 4), (4, 0, 5), (2, 2, 2), (3, 2, 0)],
    "faces": [(3, 4), (1, 5), (6, 2)],
    "one block": [(2, 3, 5)],
    "no block": [],
}


@pytest.fixture(params=LAYOUTS)
def layout(request):
    return BlockLayout.of(np.array(shape) for shape in LAYOUTS[request.param])


def test_split_gives_views_in_the_shapes_of_the_blocks_and_join_takes_them_back(layout):
    values = np.random.default_rng(1).normal(size=(layout.size, 3))
    parts = layout.split(values)
    assert [part.shape for part in parts] == [(*shape, 3) for shape in layout.shapes]
    assert all(np.shares_memory(part, values) for part in parts if part.size)
    if parts:
        np.testing.assert_array_equal(layout.join(parts), values)
        np.testing.assert_array_equal(np.concatenate([part.reshape(-1, 3) for part in parts]), values)
    for part in parts:
        part[...] = 7.0
    assert np.all(values == 7.0)


def test_every_number_is_found_in_its_block_at_its_index(layout):
    numbers = np.random.default_rng(2).permutation(layout.size)
    block, index = layout.unravel(numbers)
    expected = [(b, *i) for b, shape in enumerate(layout.shapes) for i in np.ndindex(shape)]
    found = np.column_stack([block, index])
    np.testing.assert_array_equal(found, np.reshape(expected, (-1, found.shape[1]))[numbers])
    np.testing.assert_array_equal(layout.owner(numbers), block)
    np.testing.assert_array_equal(layout.ravel(block, index), numbers)
    for b, own in enumerate(layout.numbers):
        assert own.shape == layout.shapes[b]
        np.testing.assert_array_equal(layout.ravel(b, np.argwhere(own >= 0)), own.ravel())


def test_cells_are_those_between_nodes_and_a_plane_has_a_layer_of_them():
    layout = BlockLayout.of([(3, 4, 2), (5, 1, 2), (1, 6, 1), (1, 1, 1), (2, 2, 2)])
    assert layout.cells.shapes == ((2, 3, 1), (4, 1, 1), (0, 0, 0), (0, 0, 0), (1, 1, 1))
    assert layout.cells.starts.tolist() == [0, 6, 10, 10, 10, 11]


def test_shapes_of_a_damaged_file_have_a_size():
    assert BlockLayout.of([(2**31 - 1,) * 3, (2, 2, 2)]).size == (2**31 - 1) ** 3 + 8


def test_what_is_made_of_the_shapes_is_not_pickled(layout):
    before = pickle.dumps(layout)
    layout.unravel(np.arange(layout.cells.size))
    assert pickle.dumps(layout) == before
    again = pickle.loads(before)
    assert again == layout
    np.testing.assert_array_equal(again.starts, layout.starts)


def test_blocks_of_other_shapes_are_not_joined():
    layout = BlockLayout.of([(3, 4, 2), (2, 2, 2)])
    with pytest.raises(ValueError):
        layout.join([np.zeros((3, 4, 3)), np.zeros((2, 2, 2))])
    with pytest.raises(ValueError):
        layout.join([np.zeros((3, 4, 2))])
