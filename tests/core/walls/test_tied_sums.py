"""Points of periodic sides see what their copies see: rotations are those of the whole wheel, or of all repetitions."""

import numpy as np
import pytest
from periodic_cases import passage
from topology_cases import box, grid_of

from bspline_mdao.core.walls.rotations import LocalRotations
from bspline_mdao.core.walls.tied_sums import TiedSums
from bspline_mdao.grids.topology.boundary_surface import quads_in_turn
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.periodic_pair import Motion
from bspline_mdao.grids.topology.periodic_ties import Ties, row_ties
from bspline_mdao.testing import central_difference


@pytest.mark.parametrize("hub", [0.0, 2.0])
def test_sums_over_copies_are_their_own_transpose_and_alike(hub):
    ties, rng = row_ties(find_topology(passage(5, 6, 4, hub=hub))), np.random.default_rng(0)
    one, other = rng.normal(size=(2, 5 * 6 * 4, 3, 3))
    sums = TiedSums(ties).of(one)
    assert np.vdot(sums, other) == pytest.approx(np.vdot(one, TiedSums(ties).of(other)), rel=1e-12)
    turned = np.einsum("nij,njk,nlk->nil", ties.turns, sums[ties.originals], ties.turns)
    np.testing.assert_allclose(turned, sums[ties.copies], atol=1e-14)
    on_axis = sums[np.unique(ties.on_axis)]
    turn = Motion(axis=(1.0, 0.0, 0.0), angle=0.7).turn(np.eye(3)).T
    np.testing.assert_allclose(turn @ on_axis @ turn.T, on_axis, atol=1e-14)
    assert len(on_axis) == (5 if hub == 0.0 else 0)


def test_a_cell_that_repeats_itself_in_two_directions_turns_as_all_of_the_repetitions():
    rng, n = np.random.default_rng(1), np.array([4, 5])
    shifts = np.array([[1.0, 0.2, 0.1], [-0.1, 1.5, 0.3]])

    def sheet(repetitions, wave):
        """Points of so many cells by so many, in which a wave repeats itself, and their numbers."""
        counts = repetitions * n
        i, j = np.meshgrid(*(np.arange(count + 1) for count in counts), indexing="ij")
        bumps = wave[i % n[0], j % n[1]]
        places = (i / n[0])[..., None] * shifts[0] + (j / n[1])[..., None] * shifts[1]
        return (places + bumps).reshape(-1, 3), np.arange(i.size).reshape(i.shape)

    rest, moved = rng.uniform(-0.03, 0.03, (2, *n, 3))
    (one, ids), (after, _) = (sheet(np.array([1, 1]), wave) for wave in (rest, rest + moved))
    ties = Ties.of(
        [(ids[0], ids[-1], Motion(shift=tuple(shifts[0]))), (ids[:, 0], ids[:, -1], Motion(shift=tuple(shifts[1])))]
    )
    found = LocalRotations.of(one, quads=quads_in_turn(ids), ties=ties).at(one, after).matrices
    (many, all_ids), (all_after, _) = (sheet(np.array([3, 3]), wave) for wave in (rest, rest + moved))
    expected = LocalRotations.of(many, quads=quads_in_turn(all_ids)).at(many, all_after).matrices
    middle = all_ids[n[0] : 2 * n[0] + 1, n[1] : 2 * n[1] + 1].ravel()
    np.testing.assert_allclose(found, expected[middle], atol=1e-13)
    assert np.abs(found - np.eye(3)).max() > 0.02


def test_edges_of_a_side_and_points_that_see_one_direction_count_as_in_a_longer_row():
    nodes = box(np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 4), np.zeros(1)).reshape(4, 4, 3)
    ids = np.arange(16).reshape(4, 4)
    edges = np.concatenate([np.stack([ids[:-1].ravel(), ids[1:].ravel()], axis=1), ids[:, [0, 1]]])
    ties = Ties.of([(ids[0], ids[-1], Motion(shift=(1.0, 0.0, 0.0)))])
    rotations = LocalRotations.of(nodes.reshape(-1, 3), edges, ties=ties)
    assert rotations.mix is not None
    rng, points = np.random.default_rng(2), nodes.reshape(-1, 3)
    change, bar = rng.normal(size=(16, 3)), rng.normal(size=(16, 3, 3))
    after = points + 0.05 * rng.normal(size=(16, 3))
    state = rotations.at(points, after)
    forward, back = state.jvp(change, 0.5 * change), state.vjp(bar)
    there = np.vdot(back["initial"], change) + np.vdot(back["moved"], 0.5 * change)
    assert np.vdot(bar, forward) == pytest.approx(there, rel=1e-12)
    difference = central_difference(
        lambda t: rotations.at(points + t * change, after + 0.5 * t * change).matrices, 1e-3, levels=4
    )
    np.testing.assert_allclose(forward, difference, atol=1e-9 * np.abs(forward).max())


def test_a_grid_without_periodic_sides_has_no_sums():
    grid = grid_of(box(np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 3)))
    assert row_ties(find_topology(grid)) is None
