"""Knot insertion and order elevation keep the geometry."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from splines_cases import ORDERS, random_bilinear_knots, random_constant_knots

from bspline_mdao.core.splines.curve import Curve
from bspline_mdao.core.splines.knot_insertion import elevate_order, elevation_matrix, insert_knots, insertion_matrix
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.errors import InputError


def sample(rng, order, direction):
    """A volume with constant knots in one direction, one repeated if the order allows, and curved ones elsewhere."""
    knots = [random_bilinear_knots(rng, p, n_inner=n) for p, n in zip((4, 3, 2), (2, 3, 4))]
    inner = np.array([0.2, 0.45, 0.45, 0.8]) if order > 2 else np.array([0.2, 0.45, 0.5, 0.8])
    knots[direction] = ConstantKnots(np.concatenate([np.zeros(order), inner, np.ones(order)]), order)
    volume = Volume(tuple(knots))
    return volume, rng.standard_normal((*volume.n_control, 3)), rng.uniform(size=(200, 3))


@pytest.mark.parametrize("direction", [0, 1, 2])
@pytest.mark.parametrize("order", ORDERS)
def test_knot_insertion_keeps_the_geometry(order, direction):
    rng = np.random.default_rng(order)
    volume, net, parameters = sample(rng, order, direction)
    new_knots = [0.9, 0.1, 0.33] + [0.2] * (order - 2)
    finer, finer_net = insert_knots(volume, net, direction, new_knots)
    assert finer.n_control[direction] == volume.n_control[direction] + len(new_knots)
    expected = evaluate(volume, net, parameters)
    np.testing.assert_allclose(evaluate(finer, finer_net, parameters), expected, atol=1e-14)


@pytest.mark.parametrize("direction", [0, 1, 2])
@pytest.mark.parametrize("order", ORDERS)
def test_order_elevation_keeps_the_geometry(order, direction):
    volume, net, parameters = sample(np.random.default_rng(order), order, direction)
    expected = evaluate(volume, net, parameters)
    for _ in range(2):
        volume, net = elevate_order(volume, net, direction)
    assert volume.orders[direction] == order + 2
    np.testing.assert_allclose(evaluate(volume, net, parameters), expected, atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_knot_insertion_agrees_with_scipy(order):
    rng = np.random.default_rng(order)
    old = random_constant_knots(rng, order)
    spline = BSpline(old.knots, rng.standard_normal((old.n_control, 2)), order - 1)
    finer = spline.insert_knot(0.37).insert_knot(0.81)
    matrix = insertion_matrix(old, ConstantKnots(finer.t, order))
    np.testing.assert_allclose(matrix @ spline.c, finer.c[: len(matrix)], atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_new_control_points_are_averages_of_old_ones(order):
    old = random_constant_knots(np.random.default_rng(order), order)
    finer = ConstantKnots(np.sort(np.append(old.knots, [0.123, 0.5, 0.51, 0.94])), order)
    elevated = ConstantKnots(np.sort(np.append(old.knots, np.unique(old.knots))), order + 1)
    for matrix in (insertion_matrix(old, finer), elevation_matrix(old, elevated)):
        assert matrix.min() > -1e-16
        np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-15)


def test_control_points_converge_to_the_curve_at_second_order_under_knot_insertion():
    """Section II.B: as knots are inserted the control points approach the geometry, with the square of the interval."""
    curve = Curve.uniform(np.random.default_rng(1).standard_normal((7, 2)))
    distances = []
    for n in (32, 64, 128):
        inner = np.setdiff1d(np.arange(1, n) / n, curve.knots.knots)
        volume, net = insert_knots(Volume.of(curve.knots), curve.control_points[:, None, None], 0, inner)
        T = volume.knots[0].knots
        averages = np.array([T[i + 1 : i + 4].mean() for i in range(len(net))])
        distances.append(np.abs(net[:, 0, 0] - curve(averages)).max())
    rates = np.log2(np.divide(distances[:-1], distances[1:]))
    assert (rates > 1.8).all()


def test_full_multiplicity_splits_a_curve_into_bezier_pieces():
    curve = Curve.uniform(np.random.default_rng(2).standard_normal((5, 2)))
    _, net = insert_knots(Volume.of(curve.knots), curve.control_points[:, None, None], 0, [0.5, 0.5])
    np.testing.assert_allclose(net[3, 0, 0], curve([0.5])[0], atol=1e-15)


def test_a_degenerate_direction_can_be_elevated():
    surface = Volume.of(ConstantKnots.uniform(5, 3), ConstantKnots.uniform(4, 2))
    volume, net = elevate_order(surface, np.random.default_rng(3).standard_normal((5, 4, 1, 3)), 2)
    assert volume.n_control == (5, 4, 2)
    np.testing.assert_array_equal(net[:, :, 0], net[:, :, 1])


@pytest.mark.parametrize("direction", [0, 1, 2])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_a_knot_goes_into_curved_knots_that_an_affine_map_moves_around_it(order, direction):
    rng = np.random.default_rng(order)
    knots = [random_bilinear_knots(rng, p, n_inner=n) for p, n in zip((4, 3, 2), (2, 3, 4))]
    starts, widths = 0.2 + 0.2 * rng.random((2, 2, 1)), 0.2 + 0.2 * rng.random((2, 2, 1))
    parts = np.sort(rng.random(2 * order - 2))
    moved = starts + widths * parts  # the 2 p - 2 knots around the new one
    others = np.concatenate([np.full((2, 2, 1), 0.1), moved, 0.85 + 0.1 * rng.random((2, 2, 1))], axis=2)
    ends = np.zeros((2, 2, order)), np.ones((2, 2, order))
    knots[direction] = BilinearKnots(np.concatenate([ends[0], others, ends[1]], axis=2), order)
    volume = Volume(tuple(knots))
    net, parameters = rng.standard_normal((*volume.n_control, 3)), rng.random((200, 3))
    middle = 0.4 * parts[order - 2] + 0.6 * parts[order - 1]
    finer, finer_net = insert_knots(volume, net, direction, starts + widths * middle)
    assert finer.n_control[direction] == volume.n_control[direction] + 1
    assert np.ptp(finer.knots[direction].corners, axis=(0, 1)).max() > 0.05
    np.testing.assert_allclose(evaluate(finer, finer_net, parameters), evaluate(volume, net, parameters), atol=1e-13)
    share = rng.uniform(0.2, 0.8, (2, 2, 1))
    uneven = (1.0 - share) * moved[..., order - 2 : order - 1] + share * moved[..., order - 1 : order]
    with pytest.raises(InputError, match=f"direction {direction + 1} are curved, and the weights of the new knot"):
        insert_knots(volume, net, direction, uneven)
    with pytest.raises(InputError, match=r"new knots of shape \(2, 2\); give shape \(m,\) or \(2, 2, m\)"):
        insert_knots(volume, net, direction, np.zeros((2, 2)))


def test_what_cannot_be_refined_is_refused():
    volume, net, _ = sample(np.random.default_rng(4), 3, 0)
    with pytest.raises(InputError, match="direction 2 are curved"):
        insert_knots(volume, net, 1, [0.5])
    with pytest.raises(InputError, match="direction 3 are curved"):
        elevate_order(volume, net, 2)
    with pytest.raises(InputError, match="not open"):
        insert_knots(volume, net, 0, [1.5])
    with pytest.raises(InputError, match="equal"):
        insert_knots(volume, net, 0, [0.45])
