import numpy as np

from bspline_mdao.grids.cells.marked_faces import faces_at, faces_on


def test_faces_on_and_beside_marked_nodes_are_those_of_their_definition():
    rng = np.random.default_rng(3)
    faces, is_marked = rng.integers(0, 50, (5000, 4)), rng.random(50) < 0.6
    corners = is_marked[faces]
    np.testing.assert_array_equal(faces_on(faces, is_marked), np.flatnonzero(corners.all(axis=1)))
    np.testing.assert_array_equal(faces_at(faces, is_marked), np.flatnonzero(corners.any(1) & ~corners.all(1)))
    assert len(faces_on(faces[:0], is_marked)) == 0
