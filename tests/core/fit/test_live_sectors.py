"""Live fits and grids of passages: both sides have the same control points but for the motion, and move alike."""

import numpy as np
import pytest
from periodic_cases import cut_passage, passage

from bspline_mdao import fit_grid
from bspline_mdao.core.fit.live_fit import live_fit, live_grid
from bspline_mdao.grids.topology.periodic_ties import control_ties, row_ties
from bspline_mdao.testing import central_difference


def layered_passage(motion):
    """A passage whose cells at the hub are so low that nodes follow it."""
    grid = passage(7, 8, 7, motion=motion)
    nodes = grid.blocks[0].nodes
    off = np.linspace(0.0, 1.0, 7)
    hub, lid = nodes[:, :, :1].copy(), nodes[:, :, -1:].copy()
    nodes[:] = hub + (np.expm1(7.0 * off) / np.expm1(7.0))[:, None] * (lid - hub)
    return grid


def case(motion, keep_residual=True, method="valid", layered=False):
    """Model of a passage, and another baseline, whose sides are no copies of each other."""
    grid = layered_passage(motion) if layered else cut_passage(motion, seed=3)
    model = fit_grid(grid, method=method, keep_residual=keep_residual)
    nodes = grid.to_vector().reshape(-1, 3)
    sharing = row_ties(model.topology)
    rng = np.random.default_rng(0)
    other = nodes + 2e-3 * np.sin(nodes @ rng.uniform(-3.0, 3.0, (3, 3)))
    assert np.linalg.norm((other - nodes)[sharing.copies] - (other - nodes)[sharing.originals], axis=1).max() > 1e-4
    return model, nodes, other


def smooth(nodes, rng):
    """A change of a grid that sides do not have alike: one that is random at nodes is too sharp for differences."""
    return np.sin(nodes @ rng.uniform(-3.0, 3.0, (3, 3)) + rng.uniform(0.0, 3.0, 3))


@pytest.mark.parametrize("method", ["valid", "least_squares", "quasi_interpolant"])
@pytest.mark.parametrize("motion", ["translation", "rotation"])
def test_control_points_of_both_sides_follow_the_first_with_exact_derivatives(motion, method):
    model, nodes, other = case(motion, method=method)
    ties, rng = control_ties(model.topology, model.mesh.control_ids), np.random.default_rng(1)
    np.testing.assert_allclose(live_fit(model, nodes).control_points, model.control_points, atol=1e-12)
    fit = live_fit(model, other)
    np.testing.assert_array_equal(ties.lay(fit.control_points.copy()), fit.control_points)
    change, bar = smooth(nodes, rng), rng.normal(size=fit.control_points.shape)
    forward = fit.jvp(change)
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(fit.vjp(bar), change), rel=1e-11)
    difference = central_difference(lambda t: live_fit(model, other + t * change).control_points, 1e-4, levels=4)
    np.testing.assert_allclose(forward, difference, atol=1e-8 * np.abs(forward).max())


@pytest.mark.parametrize("motion", ["translation", "rotation"])
@pytest.mark.parametrize(("keep_residual", "layered"), [(True, False), (False, False), (True, True), (False, True)])
def test_nodes_of_both_sides_move_alike_from_any_baseline_with_exact_derivatives(motion, keep_residual, layered):
    model, nodes, other = case(motion, keep_residual, layered=layered)
    assert (model.grid_map().following is not None and model.grid_map().following.layer.n_followers > 112) == layered
    rng = np.random.default_rng(2)
    moved = model.control_points + 0.02 * np.sin(model.control_points @ rng.uniform(-2.0, 2.0, (3, 3)))
    expected = model.grid_map().at(moved).nodes
    grid = live_grid(model, nodes)
    assert grid.inputs == ("grid_initial", "control_points_initial", "control_points")
    np.testing.assert_allclose(grid.at(moved, model.control_points).nodes, expected, atol=1e-12)
    changes = {
        "grid_initial": 0.1 * smooth(nodes, rng),
        "control_points_initial": 0.1 * rng.normal(size=moved.shape),
        "control_points": 0.1 * rng.normal(size=moved.shape),
    }

    def at(t):
        of = {name: t * change for name, change in changes.items()}
        initial = model.control_points + of["control_points_initial"]
        return live_grid(model, other + of["grid_initial"]).at(moved + of["control_points"], initial)

    state, bar, ties = at(0.0), rng.normal(size=nodes.shape), row_ties(model.topology)
    start = other if keep_residual else live_grid(model, other).mapping.evaluate(model.control_points)
    went = state.nodes - start
    turned = np.einsum("nij,nj->ni", ties.turns, went[ties.originals])
    np.testing.assert_allclose(turned, went[ties.copies], atol=1e-14)
    forward, back = state.jvp(**changes), state.vjp(bar)
    there = sum(np.vdot(back[name], change) for name, change in changes.items())
    assert np.vdot(bar, forward) == pytest.approx(there, rel=1e-11)
    difference = central_difference(lambda t: at(t).nodes, 1e-4, levels=4)
    np.testing.assert_allclose(forward, difference, atol=1e-8 * np.abs(forward).max())
