"""Coarse nets: what they can do, finer ones can, to round-off, on curved knots; knots are chosen by the gradient."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.design.surface_strips import Face, Strip, SurfaceStrips, _labels
from bspline_mdao.design import CoarseNet, Local, OnPatch
from bspline_mdao.generators import ball_grid, brick_grid, onera_m6_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.splines import BilinearKnots, ConstantKnots


@cache
def wing():
    """A wing whose knots are curved, its mesh, and heights of the control points off its edges."""
    model = fit_grid(onera_m6_grid((9, 9, 9)), n_control=(8, 5, 7))
    upper, lower = (OnPatch(model, f"wing_{side}") for side in ("upper", "lower"))
    mesh = moving_mesh(model)
    return model, mesh, Local("heights", (upper & ~lower) | (lower & ~upper), "y")


def net_of(n=4):
    return CoarseNet.of(*wing(), n=n)


def full(net):
    return net.refine([(s, k) for s, mask in enumerate(net.kept) for k in range(len(mask))])


def moved(net, values):
    mesh = net.mesh
    return Parametrization(mesh, [net]).apply(mesh.points[mesh.surface_ids], {net.name: values})


def test_knots_of_the_wing_are_curved():
    knots = [k.corners for volume in wing()[0].mesh.volumes for k in volume.knots if isinstance(k, BilinearKnots)]
    assert max(np.ptp(corners, axis=(0, 1)).max() for corners in knots) > 0.01


@pytest.mark.parametrize("seed", range(3))
def test_refinement_keeps_the_shape_to_round_off_on_curved_knots(seed):
    random, coarse = np.random.default_rng(seed), net_of()
    missing = coarse.missing()
    some = [missing[i] for i in random.permutation(len(missing))[:3]]
    for finer in (coarse.refine(some), coarse.refine(coarse.halves()), full(coarse)):
        values = 0.02 * random.normal(size=coarse.n_values)
        there = moved(finer, coarse.to(finer).values(values))
        assert np.abs(moved(coarse, values) - coarse.mesh.points[coarse.mesh.surface_ids]).max() > 0.005
        np.testing.assert_allclose(there, moved(coarse, values), rtol=0.0, atol=1e-15)
        assert finer.n_values > coarse.n_values
    middle = coarse.refine(coarse.halves())
    both = middle.to(full(coarse)).matrix @ coarse.to(middle).matrix
    assert abs(both - coarse.to(full(coarse)).matrix).max() < 1e-15


def test_a_net_of_all_knots_is_the_variable_itself():
    _model, mesh, heights = wing()
    net = full(net_of())
    np.testing.assert_allclose(
        net.weights.toarray(), np.eye(Parametrization(mesh, [heights]).initial["heights"].size), atol=1e-15
    )
    assert net.halves() == []
    assert net.where_to_refine(np.ones(net.n_values), 3) == []


@pytest.mark.parametrize("grid", [brick_grid((6, 5, 7, 4)), ball_grid((6, 7, 5, 6))], ids=["brick", "ball"])
def test_faces_of_a_closed_surface_agree_along_their_edges(grid):
    model = fit_grid(grid)
    mesh = moving_mesh(model)
    coarse = CoarseNet.of(model, mesh, Local("bump", direction="xyz"), n=4)
    finer = coarse.refine(coarse.halves())
    for net in (coarse, finer, full(coarse)):
        np.testing.assert_allclose(net.weights @ np.ones(net.n_values), 1.0, atol=1e-14)  # moves as a whole
    values = np.random.default_rng(0).normal(size=coarse.n_values)
    same = coarse.to(finer).values(values)
    np.testing.assert_allclose(moved(finer, same), moved(coarse, values), rtol=0.0, atol=1e-14)


def test_knots_of_a_folded_face_come_in_pairs_and_its_halves_agree():
    rows = np.arange(9 * 5).reshape(9, 5)
    rows[:, 0] = [0, 5, 10, 15, 20, 15, 10, 5, 0]  # the halves of an edge are one
    _, numbers = np.unique(rows, return_inverse=True)
    rows = numbers.reshape(rows.shape)
    labels = _labels([rows])
    assert labels[0, 0, 0] == labels[0, 0, 1]
    assert labels[0, 1, 0] != labels[0, 1, 1]
    inner = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    folded = Strip(ConstantKnots(np.concatenate([np.zeros(4), inner, np.ones(4)]), 4), np.eye(3)[0], True)
    plain = Strip(ConstantKnots.uniform(5, 4), np.eye(3)[1], False)
    surface = SurfaceStrips((Face(rows, (0, 1), (False, False)),), (folded, plain), rows.max() + 1)
    mesh = SimpleNamespace(surface_ids=np.arange(rows.max() + 1), once=lambda rows: rows)
    coarse = CoarseNet(Local("bump", direction="y"), surface, mesh, (np.zeros(5, bool), np.zeros(1, bool)))
    assert coarse.missing() == [(0, 0), (0, 1), (0, 2), (1, 0)]
    for net in (coarse, coarse.refine([(0, 0)]), coarse.refine(coarse.missing())):
        assert (net.kept[0] == net.kept[0][::-1]).all()
        np.testing.assert_allclose(net.weights @ np.ones(net.n_values), 1.0, atol=1e-14)
        values = np.random.default_rng(1).normal(size=coarse.n_values)
        np.testing.assert_allclose(net.weights @ coarse.to(net).values(values), coarse.weights @ values, atol=1e-14)


def test_bounds_contain_every_shape_within_the_coarse_ones():
    random, coarse = np.random.default_rng(3), net_of()
    finer = coarse.refine(coarse.halves())
    lower = -random.uniform(0.1, 1.0, coarse.n_values)
    upper = random.uniform(0.05, 2.0, coarse.n_values)
    lower[3], upper[5] = 0.02, -0.01  # bounds that leave zero out
    upper[7] = np.inf
    low, high = coarse.to(finer).bounds(lower, upper)
    for _ in range(200):
        corners = random.random(coarse.n_values) < 0.5
        values = coarse.to(finer).values(np.where(corners, lower, np.minimum(upper, 50.0)))
        assert (values >= low - 1e-15).all()
        assert (values <= high + 1e-15).all()
    assert np.isinf(high).any()
    assert np.isfinite(low).all()
    low, high = coarse.to(finer).bounds(-0.5, 0.5)
    np.testing.assert_allclose([low, high], [-0.5 * np.ones(finer.n_values), 0.5 * np.ones(finer.n_values)], rtol=1e-14)


@pytest.mark.slow
def test_the_knot_that_a_planted_gradient_misses_is_chosen_first():
    random, coarse = np.random.default_rng(5), net_of()
    for planted in [(0, 1), (0, 3), (1, 0)]:
        assert planted in coarse.missing()
        finer = coarse.refine([planted])
        mode = finer.mass() @ random.normal(size=finer.n_values)
        area = np.diag(coarse._areas)
        gradient = area @ finer.weights @ np.linalg.solve(finer.mass(), mode)
        assert coarse.part_used(gradient) < 0.999
        assert abs(finer.part_used(gradient) - 1.0) < 1e-12
        assert coarse.where_to_refine(gradient, 5) == [planted]


def test_a_net_follows_all_of_a_gradient_of_its_own():
    coarse = net_of()
    gradient = np.diag(coarse._areas) @ coarse.weights @ np.random.default_rng(1).normal(size=coarse.n_values)
    assert abs(coarse.part_used(gradient) - 1.0) < 1e-12
    assert coarse.where_to_refine(gradient, 2) == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda net: net_of(3), "3 points along strip 1; give 4 at least"),
        (lambda net: net_of([4, 4, 4, 4]), "give one number, or one for each of 2 strips"),
        (lambda net: net.refine([(0, 99)]), "no inner knot 99 of strip 0; there are 4 of strip 0, 3 of strip 1"),
        (lambda net: net.refine([(0, 1)]).to(net), "was not made of this one"),
        (lambda net: net.where_to_refine(np.ones(3)), r"a gradient of shape \(3,\)"),
        (lambda net: net.to(net).bounds(1.0, 0.0), "a lower bound is above the upper one"),
        (lambda net: net.part_used(np.ones(72), np.eye(2)), r"a metric of shape \(2, 2\)"),
    ],
)
def test_wrong_inputs_are_named(wrong, message):
    with pytest.raises(InputError, match=message):
        wrong(net_of())
