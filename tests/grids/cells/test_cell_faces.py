"""Cells and faces of all blocks in one list."""

import numpy as np
import pytest
from euler_cases import GRIDS, cell_centres, faces_of
from topology_cases import (
    ORIENTATIONS,
    box,
    c_grid,
    grid_of,
    o_grid,
    patch,
    smooth_box,
    split,
    turned_and_shuffled,
    twelve_block_plate,
    two_block_plate,
)

from bspline_mdao.errors import InputError
from bspline_mdao.flow.euler.flow_grid import area_vectors
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window

UNCOLLAPSED = [name for name in GRIDS if name != "collapsed strip"]
"""Grids whose collapsed faces, if any, stay so: a strip one cell wide is not linked by the topology."""


def sums_over_cells(faces, values):
    """Values of faces summed over the faces of every cell, outwards."""
    total = np.zeros((faces.n_cells, values.shape[1]))
    np.add.at(total, faces.left, values)
    np.subtract.at(total, faces.right, values[: faces.n_inner])
    return total


def centres_of(grid):
    return np.concatenate([cell_centres(block.nodes) for block in grid.blocks])


def turned(name, seed=0):
    """A grid with its blocks turned at random, in random order."""
    return turned_and_shuffled(GRIDS[name](), np.random.default_rng(seed))[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_area_vectors_of_every_cell_sum_to_zero(name):
    for grid in (GRIDS[name](), turned(name)):
        faces = faces_of(grid)
        areas = area_vectors(grid.to_vector().reshape(-1, 3), faces.corners)
        assert np.abs(sums_over_cells(faces, areas)).max() < 2e-15 * np.abs(areas).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", UNCOLLAPSED)
def test_area_vectors_sum_to_zero_wherever_the_nodes_go(name):
    for grid in (GRIDS[name](), turned(name)):
        areas = area_vectors(np.random.default_rng(3).uniform(-1.0, 1.0, (grid.n_nodes, 3)), faces_of(grid).corners)
        assert np.abs(sums_over_cells(faces_of(grid), areas)).max() < 4e-15


@pytest.mark.parametrize("name", GRIDS)
def test_every_side_of_every_cell_is_one_face_or_collapsed(name):
    grid = turned(name)
    topology = find_topology(grid)
    faces = CellFaces.of(topology, grid.to_vector().reshape(-1, 3))
    n_cells = sum(len(cell_centres(block.nodes)) for block in grid.blocks)
    n_collapsed = sum(
        np.prod([n - 1 for n in window.shape if n > 1]) for window in topology.collapsed if window.shape.count(1) == 1
    )
    assert faces.n_cells == n_cells
    assert 2 * faces.n_inner + len(faces.third) + n_collapsed == 6 * n_cells
    assert (faces.left[: faces.n_inner] != faces.right).all()
    assert np.bincount(np.append(faces.left, faces.right), minlength=n_cells).max() <= 6


@pytest.mark.parametrize("name", UNCOLLAPSED)
def test_area_vectors_point_from_left_to_right(name):
    grid = turned(name)
    faces, nodes, centres = faces_of(grid), grid.to_vector().reshape(-1, 3), centres_of(grid)
    areas, middles = area_vectors(nodes, faces.corners), nodes[faces.corners].mean(axis=1)
    assert (np.sum(areas * (middles - centres[faces.left]), axis=1) > 0.0).all()
    inner = slice(0, faces.n_inner)
    assert (np.sum(areas[inner] * (centres[faces.right] - middles[inner]), axis=1) > 0.0).all()


def test_cells_along_the_lines_of_one_block_are_those_of_its_index_space():
    faces, cells, inner, edge = faces_of(grid_of(smooth_box(4, 6, 7))), np.arange(3 * 5 * 6).reshape(3, 5, 6), [], []
    for axis in range(3):
        lines = np.pad(
            np.moveaxis(cells, axis, -1).reshape(-1, cells.shape[axis]), ((0, 0), (2, 2)), constant_values=-1
        )
        inner += [lines[:, n : n + 4] for n in range(1, cells.shape[axis])]
        edge += [lines[:, 2:5], lines[:, -3:-6:-1]]
    lines = np.stack([faces.beyond_left, faces.left], axis=1)
    n_inner = faces.n_inner
    found = np.column_stack([lines[:n_inner], faces.right, faces.beyond_right])
    assert set(map(tuple, found.tolist())) == set(map(tuple, np.concatenate(inner).tolist()))
    found = np.column_stack([faces.left[n_inner:], faces.beyond_left[n_inner:], faces.third])
    assert sorted(found.tolist()) == sorted(np.concatenate(edge).tolist())


def lines_through_faces(grid):
    """Cells along the line through each face by their places, the face's area vector from the lower to the higher."""
    faces, nodes = faces_of(grid), grid.to_vector().reshape(-1, 3)
    places = np.unique(np.round(centres_of(grid), 9) + 0.0, axis=0, return_inverse=True)[1].ravel()
    places = np.append(places, -1)
    none = np.full(len(faces.third), -1)
    cells = [faces.beyond_left, faces.left, np.append(faces.right, none), np.append(faces.beyond_right, faces.third)]
    lines, areas = places[np.stack(cells, axis=1)], area_vectors(nodes, faces.corners)
    is_turned = (lines[:, 2] >= 0) & (lines[:, 1] > lines[:, 2])
    lines[is_turned], areas[is_turned] = lines[is_turned, ::-1], -areas[is_turned]
    order = np.lexsort(np.round(np.column_stack([areas, lines]), 9).T)
    return lines[order], areas[order]


def assert_same_lines(grid, other):
    (lines, areas), (other_lines, other_areas) = lines_through_faces(grid), lines_through_faces(other)
    np.testing.assert_array_equal(lines, other_lines)
    np.testing.assert_allclose(areas, other_areas, atol=1e-12)


WHOLE_AND_CUT = {
    "box": (lambda: grid_of(smooth_box(9, 7, 8)), lambda: GRIDS["boxes"]()),
    "box of thin blocks": (
        lambda: grid_of(smooth_box(7, 5, 4)),
        lambda: grid_of(*split(smooth_box(7, 5, 4), [1, 2, 4, 5], [1, 3], [1])),
    ),
    "O-grid": (lambda: grid_of(o_grid()), lambda: grid_of(*split(o_grid(), [5, 11], [2], [1]))),
    "O-grid about an axis": (
        lambda: GRIDS["cylinder about an axis"](),
        lambda: grid_of(*split(o_grid(radius=0.0), [8], [], [])),
    ),
    "C-grid": (lambda: grid_of(c_grid()), lambda: grid_of(*split(c_grid(), [5, 21], [], [3]))),
    "plate": (two_block_plate, twelve_block_plate),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WHOLE_AND_CUT)
def test_cells_along_grid_lines_are_the_same_however_a_grid_is_cut_into_blocks(name):
    whole, cut = (make() for make in WHOLE_AND_CUT[name])
    assert_same_lines(whole, cut)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in WHOLE_AND_CUT if name != "plate"])
def test_cells_along_grid_lines_are_the_same_however_blocks_are_turned(name):
    cut = WHOLE_AND_CUT[name][1]()
    for seed in range(3):
        assert_same_lines(cut, turned_and_shuffled(cut, np.random.default_rng(seed))[0])


@pytest.mark.parametrize("turn", ORIENTATIONS)
def test_grid_lines_run_on_into_a_block_turned_in_any_way(turn):
    left, right = split(smooth_box(7, 4, 5), [3], [], [])
    assert_same_lines(grid_of(smooth_box(7, 4, 5)), grid_of(left, turn.apply(right)))


def test_cells_and_faces_of_one_row_are_numbered_as_documented():
    faces = faces_of(grid_of(box(np.arange(4.0), [0.0, 2.0], [0.0, 3.0])))
    assert faces.layout.shapes == ((3, 1, 1),)
    assert (faces.n_cells, faces.n_inner, faces.n_faces) == (3, 2, 2 + 14)
    np.testing.assert_array_equal(faces.left[:2], [0, 1])
    np.testing.assert_array_equal(faces.right, [1, 2])
    np.testing.assert_array_equal(faces.beyond_left[:2], [-1, 0])
    np.testing.assert_array_equal(faces.beyond_right, [2, -1])
    ends = np.flatnonzero(faces.third >= 0)
    assert set(zip(faces.left[2:][ends], faces.beyond_left[2:][ends], faces.third[ends])) == {(0, 1, 2), (2, 1, 0)}
    sides = np.setdiff1d(np.arange(14), ends)
    assert (faces.beyond_left[2:][sides] == -1).all()


def test_patches_are_ranges_of_faces_and_what_none_claims_is_unassigned():
    nodes = smooth_box(4, 5, 6)
    face = Window.whole(0, nodes.shape[:3]).face
    patches = [patch("wall", face(0), face(3), name="body"), patch("wall", face(4), name="floor")]
    faces = faces_of(grid_of(nodes, patches=patches))
    assert [(p.name, p.kind, p.stop - p.start) for p in faces.boundary] == [
        ("body", "wall", 4 * 5 + 3 * 5),
        ("floor", "wall", 3 * 4),
        ("unassigned", None, 4 * 5 + 3 * 5 + 3 * 4),
    ]
    assert [p.start for p in faces.boundary] == [faces.n_inner, *(p.stop for p in faces.boundary[:-1])]
    assert faces.boundary[-1].stop == faces.n_faces
    np.testing.assert_array_equal(faces.faces_of("wall"), np.arange(faces.boundary[0].start, faces.boundary[1].stop))
    assert len(faces.faces_of("farfield")) == 0


def test_a_cell_is_named_by_block_and_indices_from_one():
    faces = faces_of(grid_of(smooth_box(4, 5, 6), smooth_box(3, 4, 5) + 10.0))
    assert faces.place(0) == "block 1, cell (1, 1, 1)"
    assert faces.place(3 * 4 * 5 - 1) == "block 1, cell (3, 4, 5)"
    assert faces.place(3 * 4 * 5 + 3 * 4) == "block 2, cell (2, 1, 1)"
    with pytest.raises(IndexError):
        faces.place(faces.n_cells)


def test_blocks_without_cells_or_volume_are_refused_in_one_line():
    with pytest.raises(InputError, match="block 2 is a surface; give blocks with cells"):
        faces_of(grid_of(smooth_box(4, 5, 6), smooth_box(4, 1, 6) + 10.0))
    flat = smooth_box(4, 5, 6)
    flat[..., 2] = 1.0
    with pytest.raises(InputError, match="block 1 has no volume; leave it out"):
        faces_of(grid_of(flat))
