"""Cells of blocks that points lie in."""

import numpy as np

from bspline_mdao.grids.topology.donors import Donors, find_donors, places_in_cells


def skewed(shape, seed: int) -> np.ndarray:
    """Nodes of a block that grows, is bent, and whose nodes are shifted at random."""
    rng = np.random.default_rng(seed)
    x, y, z = np.meshgrid(*[np.linspace(0.0, 1.0, n) ** 2 for n in shape], indexing="ij")
    nodes = np.stack([x + 0.3 * y * y, y + 0.2 * z, z + 0.1 * x * x], axis=-1)
    return nodes + 0.002 * rng.uniform(-1.0, 1.0, nodes.shape)


def points_in(nodes: np.ndarray, cells: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Points at trilinear coordinates of cells."""
    found = np.zeros((len(cells), 3))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, places, 1.0 - places), axis=1)
        found += weight[:, None] * nodes[tuple((cells + corner).T)]
    return found


def test_points_are_found_in_the_cells_that_they_were_put_in():
    nodes, rng = skewed((9, 7, 8), 0), np.random.default_rng(1)
    cells = np.stack([rng.integers(0, n - 1, 300) for n in nodes.shape[:3]], axis=1)
    places = rng.uniform(0.05, 0.95, (300, 3))
    found = find_donors([nodes[::2, ::2, ::2] + 5.0, nodes], points_in(nodes, cells, places))
    assert (found.block == 1).all()
    np.testing.assert_array_equal(found.cell, cells)
    np.testing.assert_allclose(found.place, places, atol=1e-9)


def test_of_two_blocks_the_smaller_cell_is_the_donor_and_points_in_none_have_none():
    nodes = skewed((6, 6, 6), 2)
    inside = nodes[2:4, 2:4, 2:4].reshape(-1, 3).mean(axis=0)
    fine = np.stack(np.meshgrid(*[np.linspace(x - 1e-3, x + 1e-3, 3) for x in inside], indexing="ij"), axis=-1)
    found = find_donors([nodes, fine], np.array([inside, [0.0, 2.0, 0.0], nodes.min(axis=(0, 1, 2)) + [0.0, 1.0, 0.0]]))
    assert found.block[0] == 1
    assert (found.block[1:] == -1).all()


def test_places_in_cells_stay_under_an_affine_move_and_follow_another_by_as_much():
    nodes, rng = skewed((5, 6, 7), 3), np.random.default_rng(4)
    cells = np.stack([rng.integers(0, n - 1, 50) for n in nodes.shape[:3]], axis=1)
    donors = Donors(np.zeros(50, dtype=int), cells, rng.uniform(0.0, 1.0, (50, 3)))
    points, turn = points_in(nodes, cells, donors.place), rng.normal(size=(3, 3))
    np.testing.assert_allclose(places_in_cells([nodes @ turn], donors, points @ turn), donors.place, atol=1e-9)
    to = donors.place + rng.uniform(-0.2, 0.2, (50, 3))
    np.testing.assert_allclose(places_in_cells([nodes], donors, points_in(nodes, cells, to)), to, atol=1e-9)
