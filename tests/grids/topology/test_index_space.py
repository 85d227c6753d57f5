"""Windows of blocks and the maps between them."""

from itertools import permutations, product

import numpy as np
import pytest

from bspline_mdao.grids.topology.index_space import (
    Interface,
    Orientation,
    Window,
    face_layers,
    section_rows,
    sections_of,
)

ORIENTATIONS = [Orientation(perm, flip) for perm in permutations(range(3)) for flip in product((False, True), repeat=3)]


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
def test_a_window_goes_through_an_interface_and_back_and_holds_the_nodes_that_it_meets(orientation):
    nodes_a = np.arange(7 * 8 * 9).reshape(7, 8, 9)
    nodes_b = orientation.inverse().apply(nodes_a)
    a, b = Window.whole(0, nodes_a.shape), Window.whole(1, nodes_b.shape)
    interface = Interface(a, b, orientation)
    window = Window(0, (1, 2, 4), (3, 2, 8))
    there = interface.map_window(window)
    assert interface.reverse().map_window(there) == window
    assert interface.reverse().reverse() == interface
    assert set(nodes_b[there.slices].ravel()) == set(nodes_a[window.slices].ravel())


@pytest.mark.parametrize("face", range(6))
def test_the_layer_beside_a_face_is_one_step_inside(face):
    indices = np.moveaxis(np.indices((4, 5, 6)), 0, -1)
    window = Window.whole(0, (4, 5, 6)).face(face)
    on_face, inner = face_layers(indices, window)
    d, is_high = divmod(face, 2)
    step = inner - on_face
    assert (step[..., d] == (-1 if is_high else 1)).all()
    assert (np.delete(step, d, axis=-1) == 0).all()
    np.testing.assert_array_equal(on_face, np.take(indices, -is_high, axis=d))


def test_a_block_one_node_deep_has_its_face_on_both_sides():
    values = np.arange(20.0).reshape(4, 1, 5)
    for layer in face_layers(values, Window.whole(0, (4, 1, 5)).face(2)):
        np.testing.assert_array_equal(layer, values[:, 0])


@pytest.mark.parametrize("n_free", range(4))
def test_rows_of_sections_are_those_of_the_whole_block(n_free):
    shape = (4, 5, 6)
    rows = 7 + np.arange(4 * 5 * 6).reshape(shape)
    sections = sections_of(shape, n_free)
    assert len(sections) == (8, 12, 6, 1)[n_free]
    for section in sections:
        there = np.ix_(*(range(n) if end is None else [end] for n, end in zip(shape, section)))
        np.testing.assert_array_equal(section_rows(shape, section, start=7), rows[there])
