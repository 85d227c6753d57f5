"""Pieces are exchanged between processes until there are few faces between these."""

from functools import cache
from itertools import chain, combinations

import numpy as np
import pytest
from topology_cases import grid_of, smooth_box, split, twelve_block_plate

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.edge_cut import SLACK, faces_between, with_short_cuts
from bspline_mdao.grids.topology.partition import Partition, Subdomain

GRIDS = {
    "plate": twelve_block_plate,
    "unequal": lambda: grid_of(*split(smooth_box(18, 9, 11), [3, 9], [4], [5])),
    "one block": lambda: grid_of(smooth_box(13, 8, 9)),
    "wing": lambda: onera_m6_grid((7, 6, 5)),
}


@cache
def grid_and_topology(name):
    grid = GRIDS[name]()
    return grid, find_topology(grid)


def dealt_at_random(topology, n_ranks, seed):
    """Pieces of a partition, dealt out at random."""
    pieces = [piece for subdomain in Partition.of(topology, 3 * n_ranks).pieces for piece in subdomain]
    ranks = np.random.default_rng(seed).integers(0, n_ranks, len(pieces))
    return [[piece for piece, rank in zip(pieces, ranks) if rank == k] for k in range(n_ranks)]


def cut(topology, dealt):
    """Faces between processes."""
    faces = faces_between(topology, [piece for subdomain in dealt for piece in subdomain])
    ranks = np.repeat(np.arange(len(dealt)), [len(subdomain) for subdomain in dealt])
    return faces[ranks[:, None] != ranks].sum() / 2


def loads(dealt):
    return np.array([sum(np.prod(piece.shape) for piece in subdomain) for subdomain in dealt])


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("n_ranks", [2, 3, 5])
def test_faces_between_pieces_are_those_that_the_list_of_all_faces_has(name, n_ranks):
    grid, topology = grid_and_topology(name)
    pieces = [piece for subdomain in dealt_at_random(topology, n_ranks, 0) for piece in subdomain]
    faces = CellFaces.of(topology, grid.to_vector().reshape(-1, 3))
    piece_of = np.full(faces.n_cells, -1)
    for number, piece in enumerate(pieces):
        piece_of[Subdomain.of_windows(topology.shapes, [piece]).cells] = number
    expected = np.zeros(2 * (len(pieces),))
    np.add.at(expected, (piece_of[faces.left[: faces.n_inner]], piece_of[faces.right]), 1)
    expected += expected.T
    np.fill_diagonal(expected, 0.0)
    np.testing.assert_array_equal(faces_between(topology, pieces), expected)


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("n_ranks", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", [1, 2])
def test_cuts_get_shorter_and_the_largest_load_no_larger(name, n_ranks, seed):
    _, topology = grid_and_topology(name)
    dealt = dealt_at_random(topology, n_ranks, seed)
    after = with_short_cuts(topology, dealt)
    assert sorted(map(str, chain(*after))) == sorted(map(str, chain(*dealt)))
    assert loads(after).max() <= max(loads(dealt).max(), (1.0 + SLACK) * loads(dealt).mean())
    assert cut(topology, after) <= cut(topology, dealt)


def test_twelve_blocks_are_cut_into_two_halves_at_the_fewest_faces():
    topology = find_topology(twelve_block_plate())
    pieces = [piece for subdomain in Partition.of(topology, 1).pieces for piece in subdomain]
    halves = [
        [[pieces[n] for n in one], [p for m, p in enumerate(pieces) if m not in one]]
        for one in combinations(range(12), 6)
    ]
    ours = Partition.of(topology, 2).pieces
    most = loads(ours).max()
    assert cut(topology, ours) == min(cut(topology, half) for half in halves if loads(half).max() <= most)
    assert cut(topology, ours) < cut(topology, [pieces[::2], pieces[1::2]])


def test_blocks_in_a_row_are_cut_once():
    topology = find_topology(grid_of(*split(smooth_box(17, 9, 9), [4, 8, 12], [], [])))
    (pieces,) = Partition.of(topology, 1).pieces
    after = with_short_cuts(topology, [[pieces[0], pieces[2]], [pieces[1], pieces[3]]])
    assert cut(topology, after) == 64.0
