"""The mismatch of a wall, correction over the volume."""

from dataclasses import replace

import numpy as np
import pytest
from mover_cases import channel_grid, rotation
from topology_cases import (
    box,
    c_grid,
    grid_of,
    o_grid,
    patch,
    sphere_octants,
    split,
    turned_and_shuffled,
    twelve_block_plate,
    two_block_plate,
)

from bspline_mdao import find_topology, read_grid
from bspline_mdao.base.numerics.vectors import nearest_plane
from bspline_mdao.core.walls.wall_correction import PIECE, WallCorrection, _cuts, _pieces
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.sharing import node_sharing


def cylinder():
    """O-grid that is joined to itself."""
    return grid_of(o_grid(), patches=[patch("wall", Window(0, (0, 0, 0), (16, 0, 3)))])


def folded():
    """C-grid: the wake is a face that meets itself, and the wall ends inside the face."""
    return grid_of(c_grid(span=2), patches=[patch("wall", Window(0, (5, 0, 0), (21, 2, 0)))])


def sphere():
    """Eight octants with poles in the wall."""
    blocks = sphere_octants()
    walls = [Window.whole(n, nodes.shape[:3]).face(0) for n, nodes in enumerate(blocks)]
    return grid_of(*blocks, patches=[patch("wall", *walls)])


CASES = {
    "channel": channel_grid,
    "oblique channel": lambda: channel_grid(rotation()),
    "cylinder": cylinder,
    "c grid": folded,
    "sphere": sphere,
    "octant of a ball": lambda: ball_grid((5, 6, 7, 4), octant=True),
    "plate": twelve_block_plate,
    "window": two_block_plate,
    "M6": lambda: onera_m6_grid((13, 19, 11)),
}

EACH = [pytest.param(name, marks=pytest.mark.slow if name == "M6" else ()) for name in CASES]


def faces(topology, kind):
    """Rows of every face of a kind."""
    blocks = topology.layout.numbers
    return [blocks[f.window.block][f.window.slices].ravel() for f in topology.boundary if f.kind == kind]


def spread_of(grid):
    """Spread, nodes and planes of a grid with all its walls."""
    topology = find_topology(grid)
    nodes = grid.to_vector().reshape(-1, 3)
    rows = np.unique(node_sharing(topology).source_rows()[np.concatenate(faces(topology, "wall"))])
    planes = [(members, nearest_plane(nodes[members])[0]) for members in faces(topology, "symmetry")]
    return topology, nodes, planes, WallCorrection.of(topology, nodes, rows)


def in_planes(correction, planes, mismatch):
    """Take out of a mismatch what would leave planes of symmetry."""
    for members, normal in planes:
        is_member = np.isin(correction.rows, members)
        mismatch[is_member] -= (mismatch[is_member] @ normal)[:, None] * normal
    return mismatch


@pytest.mark.parametrize("name", EACH)
def test_wall_nodes_get_their_miss_and_shared_nodes_the_same_bits(name):
    topology, _, _, correction = spread_of(CASES[name]())
    mismatch = np.random.default_rng(0).normal(size=(len(correction.rows), 3))
    values, source = correction.forward(mismatch), node_sharing(topology).source_rows()
    np.testing.assert_array_equal(values[correction.rows], mismatch)
    np.testing.assert_array_equal(values, values[source])
    assert np.count_nonzero(values.any(axis=1)) > 1.5 * len(mismatch)
    assert np.abs(values).max() < 3.0 * np.abs(mismatch).max()


@pytest.mark.parametrize("name", EACH)
def test_the_reverse_is_the_transpose(name):
    rng = np.random.default_rng(1)
    _, nodes, _, correction = spread_of(CASES[name]())
    mismatch, bar = rng.normal(size=(len(correction.rows), 3)), rng.normal(size=nodes.shape)
    forward, reverse = correction.forward(mismatch), correction.adjoint(bar)
    assert abs(np.vdot(forward, bar) - np.vdot(mismatch, reverse)) < 1e-14 * np.linalg.norm(forward) * np.linalg.norm(
        bar
    )


@pytest.mark.parametrize("name", ["channel", "oblique channel", "octant of a ball", EACH[-1]])
def test_nodes_stay_in_planes_of_symmetry_and_on_the_far_field(name):
    topology, _, planes, correction = spread_of(CASES[name]())
    mismatch = np.random.default_rng(2).normal(size=(len(correction.rows), 3))
    values, source = correction.forward(in_planes(correction, planes, mismatch)), node_sharing(topology).source_rows()
    assert planes
    for members, normal in planes:
        least = 0.0 if np.abs(normal).max() == 1.0 else 1e-14
        assert np.abs(values[members] @ normal).max() <= least
    for members in faces(topology, "farfield"):
        corners = ~np.isin(source[members], source[np.concatenate(faces(topology, "wall"))])
        if corners.all():  # no wall ends on it
            assert not values[members].any()


@pytest.mark.slow
def test_the_map_does_not_depend_on_how_blocks_lie():
    grid, rng = onera_m6_grid((13, 19, 11)), np.random.default_rng(3)
    _, nodes, _, correction = spread_of(grid)
    names = {tuple(x): n for n, x in enumerate(np.round(nodes[correction.rows], 9))}
    turned, old_rows = turned_and_shuffled(replace(grid, patches=()), rng)
    undeclared = [face.window for face in find_topology(turned).boundary]
    turned = replace(turned, patches=guess_patches(turned, undeclared))
    _, moved_nodes, _, other = spread_of(turned)
    assert len(other.rows) == len(correction.rows)
    mismatch = rng.normal(size=(len(correction.rows), 3))
    permuted = mismatch[[names[tuple(x)] for x in np.round(moved_nodes[other.rows], 9)]]
    np.testing.assert_allclose(other.forward(permuted), correction.forward(mismatch)[old_rows], atol=1e-13)


def test_a_miss_larger_than_a_thin_block_goes_on_beyond_it():
    x = np.linspace(0.0, 1.0, 4 * PIECE + 1)
    thin, thick = (box(x, x, z) for z in (0.01 * np.linspace(0.0, 1.0, 5), np.linspace(0.01, 1.0, 9)))
    grid = grid_of(thin, thick, patches=[patch("wall", Window.whole(0, thin.shape[:3]).face(4))])
    _, nodes, _, correction = spread_of(grid)
    at = nodes[correction.rows]
    mismatch = np.outer(0.02 * np.sin(np.pi * at[:, 0]) * np.sin(np.pi * at[:, 1]), [0.3, 0.2, 1.0])
    quality = GridQuality.of_baseline(grid)
    assert all(cells.is_valid.all() for cells in quality.cells(nodes + correction.forward(mismatch)))


@pytest.mark.slow
def test_cells_of_a_boundary_layer_bear_a_miss_of_a_thousand_heights(real_grids):
    """A smooth mismatch of 0.5 per cent of the wing's size, whose first cells are 1e-5 of it high."""
    grid = read_grid(real_grids / "pyhyp_m6_9blocks.xyz")
    undeclared = [face.window for face in find_topology(grid).boundary]
    grid = replace(grid, patches=guess_patches(grid, undeclared))
    _, nodes, planes, correction = spread_of(grid)
    (normal,) = {tuple(np.abs(n)) for _, n in planes}
    at, rng = nodes[correction.rows], np.random.default_rng(4)
    size = np.linalg.norm(np.ptp(at, axis=0))
    waves = np.sin(at @ rng.normal(size=(3, 3)) * 12.0 / size + rng.uniform(0.0, 6.0, 3))
    waves[:, np.argmax(normal)] *= np.minimum(1.0, 5.0 * np.abs(at[:, np.argmax(normal)]) / size)
    mismatch = in_planes(correction, planes, 0.005 * size * waves)
    quality = GridQuality.of_baseline(grid)
    assert all(cells.is_valid.all() for cells in quality.cells(nodes + correction.forward(mismatch)))


def test_only_directions_along_walls_that_leave_none_are_cut_alike_on_both_sides_of_an_interface():
    """Walls below two blocks in a row and at the end of the first."""
    sizes, first = (4 * PIECE + 1, 2 * PIECE + 1, PIECE + 3), 2 * PIECE
    blocks = split(box(*(np.linspace(0.0, 1.0, n) for n in sizes)), [first], [], [])
    wholes = [Window.whole(n, nodes.shape[:3]) for n, nodes in enumerate(blocks)]
    topology = find_topology(grid_of(*blocks, patches=[patch("wall", *(w.face(4) for w in wholes), wholes[0].face(0))]))
    source, is_wall = node_sharing(topology).source_rows(), np.zeros(topology.n_nodes, dtype=bool)
    is_wall[source[np.concatenate(faces(topology, "wall"))]] = True
    found = list(_pieces(topology, source, is_wall))
    for number, n_cells in ((0, first), (1, PIECE)):  # the first direction of the second block leaves no wall
        of_block = [piece for piece in found if piece.block == number]
        extents = {tuple(np.subtract(piece.hi, piece.lo).tolist()) for piece in of_block}
        assert extents == {(n_cells, PIECE, PIECE + 2)}
        assert len(of_block) == 2 * first // n_cells


@pytest.mark.parametrize("n_cells", range(1, 60))
def test_cuts_are_the_same_from_both_ends(n_cells):
    cuts = _cuts(n_cells)
    np.testing.assert_array_equal(n_cells - cuts[::-1], cuts)
    assert cuts[0] == 0
    assert 0 < np.diff(cuts).min() <= np.diff(cuts).max() <= PIECE + 1


@pytest.mark.parametrize("name", EACH)
def test_a_wall_is_met_exactly_on_all_sides_of_shared_nodes(name):
    topology, nodes, _, correction = spread_of(CASES[name]())
    source = node_sharing(topology).source_rows()
    before, moved = nodes[source], nodes[source]
    wall = before[correction.rows] + 0.01 * np.random.default_rng(5).normal(size=(len(correction.rows), 3))
    mismatch = correction.meet(moved, wall)
    np.testing.assert_array_equal(mismatch, wall - before[correction.rows])
    np.testing.assert_array_equal(moved[correction.rows], wall)
    np.testing.assert_array_equal(moved, moved[source])
    np.testing.assert_allclose(moved, before + correction.forward(mismatch), atol=1e-14)
