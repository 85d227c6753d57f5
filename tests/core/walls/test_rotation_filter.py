"""Rotations of the residual, smoothed over its length: what it is, what it keeps, and what it cures."""

import copy
import pickle
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.splines.basis import basis
from bspline_mdao.core.splines.greville import span_breaks
from bspline_mdao.core.walls.residual_lengths import corner_numbers
from bspline_mdao.core.walls.rotation_filter import MOST_WEIGHT, RotationFilter
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import judge_move
from bspline_mdao.movers import LinearElasticity, moving_mesh


def graph(rng, n=31, n_edges=80):
    """Random points with neighbours, as rotations of surroundings have them, and which of them are smoothed."""
    pairs = np.unique(np.sort(rng.integers(n, size=(n_edges, 2)), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort(both.T[::-1])]
    scales = np.empty(len(both))
    of_pair = dict(zip(map(tuple, pairs.tolist()), 10.0 ** rng.uniform(-2, 2, len(pairs))))
    scales[:] = [of_pair[tuple(sorted(pair))] for pair in both.tolist()]
    return np.searchsorted(both[:, 0], np.arange(n + 1)), both[:, 1], scales, rng.random(n) < 0.7


def filter_of(rng, lengths=1.0):
    starts, neighbours, scales, free = graph(rng)
    found = RotationFilter.of(starts, neighbours, scales, lengths * rng.uniform(0.2, 2.0, len(free)), free)
    assert found is not None
    assert len(found.free) > len(found.given) > 3
    return found


def test_smoothed_rotations_minimise_distance_and_jumps():
    rng = np.random.default_rng(1)
    smoothing = filter_of(rng)
    rotations, given = rng.standard_normal((len(smoothing.free), 9)), rng.standard_normal((len(smoothing.given), 9))
    found = smoothing.forward(rotations, given)
    jumps = smoothing.of_free @ found + smoothing.of_given @ given
    slope = found - rotations + smoothing.of_free.T @ (smoothing.weights[:, None] * jumps)
    assert np.abs(slope).max() < 1e-11 * smoothing.weights.max()
    assert np.abs(jumps).max() > 1e-3


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e7])
def test_equal_rotations_stay_equal_however_long_the_residual(length):
    """Weights up to 1e10, with which a sum of weights and one has six digits of the one."""
    rng = np.random.default_rng(2)
    smoothing = filter_of(rng, length)
    assert (smoothing.weights.max() == MOST_WEIGHT) == (length > 1.0)
    same = rng.standard_normal(9)
    found = smoothing.forward(np.tile(same, (len(smoothing.free), 1)), np.tile(same, (len(smoothing.given), 1)))
    np.testing.assert_allclose(found, np.tile(same, (len(found), 1)), rtol=0, atol=4e-16)


@pytest.mark.parametrize("length", [1e3, 1e7])
def test_stiff_edges_cost_no_digits(length):
    """Where nothing is given, all that is joined keeps its mean; the weights have up to ten digits more than one."""
    rng = np.random.default_rng(8)
    starts, neighbours, scales, free = graph(rng, n_edges=200)
    smoothing = RotationFilter.of(starts, neighbours, scales, np.full(len(free), length), np.ones_like(free))
    rotations = rng.standard_normal((len(free), 9))
    found = smoothing.forward(rotations, np.zeros((0, 9)))
    np.testing.assert_allclose(found.mean(axis=0), rotations.mean(axis=0), rtol=0, atol=1e-13)
    assert np.ptp(found, axis=0).max() < 1e-3


@pytest.mark.parametrize("length", [1.0, 1e7])
def test_transpose_is_the_transpose(length):
    rng = np.random.default_rng(3)
    smoothing = filter_of(rng, length)
    rotations, given = rng.standard_normal((len(smoothing.free), 9)), rng.standard_normal((len(smoothing.given), 9))
    bar = rng.standard_normal(rotations.shape)
    terms = bar * smoothing.forward(rotations, given)
    rotations_bar, given_bar = smoothing.transpose(bar)
    found = np.vdot(rotations_bar, rotations) + np.vdot(given_bar, given)
    assert abs(terms.sum() - found) < 1e-13 * np.abs(terms).sum()


def test_nothing_moves_where_all_is_at_rest():
    smoothing = filter_of(np.random.default_rng(4))
    assert not smoothing.forward(np.zeros((len(smoothing.free), 9)), np.zeros((len(smoothing.given), 9))).any()


def test_a_residual_that_is_short_beside_the_spans_is_left_alone():
    rng = np.random.default_rng(5)
    starts, neighbours, scales, free = graph(rng)
    assert RotationFilter.of(starts, neighbours, scales, np.full(len(free), 1e-5), free) is None


def test_what_smoothing_joins_is_all_that_a_rotation_depends_on():
    rng = np.random.default_rng(6)
    smoothing, n = filter_of(rng), 31
    wanted = np.zeros(n, dtype=bool)
    wanted[smoothing.free[4]] = True
    free, given = smoothing.joined(wanted)
    step, step_given = np.zeros((len(smoothing.free), 9)), np.zeros((len(smoothing.given), 9))
    step[~np.isin(smoothing.free, free)] = 1.0
    step_given[~np.isin(smoothing.given, given)] = 1.0
    assert not smoothing.forward(step, step_given)[4].any()
    for rows, joined, which in ((smoothing.free, free, 0), (smoothing.given, given, 1)):
        for number in np.flatnonzero(np.isin(rows, joined)):
            steps = [np.zeros_like(step), np.zeros_like(step_given)]
            steps[which][number] = 1.0
            assert smoothing.forward(*steps)[4].all()


def test_copies_and_pickles_smooth_alike():
    rng = np.random.default_rng(7)
    smoothing = filter_of(rng)
    given = rng.standard_normal((len(smoothing.given), 9)), rng.standard_normal((len(smoothing.free), 9))
    expected = smoothing.forward(given[1], given[0])
    for other in (copy.deepcopy(smoothing), pickle.loads(pickle.dumps(smoothing))):
        np.testing.assert_array_equal(other.forward(given[1], given[0]), expected)


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((13, 21, 11), Spacing(off_wall=1e-5)), n_control=5)


@pytest.mark.slow
def test_lengths_are_those_of_the_longest_residual_around_each_corner(wing):
    numbers = corner_numbers(wing.topology, wing.mesh)[1]
    expected = np.zeros(1 + max(ids.max() for ids in numbers))
    starts = np.cumsum([0, *(np.prod(shape) for shape in wing.topology.shapes)])
    for window, volume, ids, x in zip(wing.topology.segments, wing.mesh.volumes, numbers, wing.parameters):
        start = starts[window.block]
        shape = (*wing.topology.shapes[window.block], 3)
        residual = wing.residual[start : start + np.prod(shape[:3])].reshape(shape)[window.slices].reshape(-1, 3)
        u = x.reshape(-1, 3)
        spans = [
            np.searchsorted(span_breaks(k), basis(k, u[:, d], u[:, (d + 1) % 3], u[:, (d + 2) % 3])[0])
            for d, k in enumerate(volume.knots)
        ]
        for ends in product(range(2), repeat=3):
            np.maximum.at(
                expected, ids[tuple(s + end for s, end in zip(spans, ends))], np.linalg.norm(residual, axis=1)
            )
    np.testing.assert_array_equal(wing.residual_lengths, expected)
    assert wing.residual_lengths.max() == np.linalg.norm(wing.residual, axis=1).max()
    assert replace(wing, residual=None).residual_lengths is None


@pytest.mark.slow
def test_a_residual_much_longer_than_the_cells_folds_few_of_them(wing):
    """A bend of 60 degrees of a viscous wing: 204 inverted cells where its rotations change from span to span."""
    mesh, points, quality = moving_mesh(wing), wing.control_points, GridQuality.of_baseline(wing.regenerate())
    bent = parse_deformation("bend=60deg@0.5", wing, mesh).apply(points[mesh.surface_ids])
    moved, grid_map = LinearElasticity(mesh, n_increments=5).move(points, bent).points, wing.grid_map()
    groups = tuple(replace(group, filter=None) for group in grid_map.rotation_map.groups)
    as_before = replace(grid_map, rotation_map=replace(grid_map.rotation_map, groups=groups))
    smoothed, rough = (judge_move(quality, of.at(moved).nodes) for of in (grid_map, as_before))
    assert rough.n_inverted > 150
    assert smoothed.n_inverted < 0.1 * rough.n_inverted
