"""The mapping of Eq. (3) and its derivatives."""

import itertools

import numpy as np
import pytest
from scipy.interpolate import NdBSpline
from scipy.optimize import linprog
from splines_cases import ORDERS, random_bilinear_knots, random_constant_knots, random_curved_volume, wavy_knots

from bspline_mdao.core.splines.basis import basis
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.volume import Volume, evaluate, evaluate_gradients, evaluate_hessians
from bspline_mdao.errors import InputError

SECOND = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]  # column of each second derivative


def polynomial(x, exponents):
    return np.prod(x ** np.asarray(exponents), axis=-1)


def greville_net(volume):
    """Control points of the identity: knot averages in each direction (constant knots)."""
    averages = [
        [k.knots[i + 1 : i + k.order].mean() if k.order > 1 else 0.0 for i in range(k.n_control)] for k in volume.knots
    ]
    return np.stack(np.meshgrid(*averages, indexing="ij"), axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
def test_mapping_agrees_with_scipy_ndbspline(order):
    rng = np.random.default_rng(order)
    knots = [random_constant_knots(rng, p, n_inner=3 + d) for d, p in enumerate((order, 3, 4))]
    volume = Volume(tuple(knots))
    control_points = rng.standard_normal((*volume.n_control, 2))
    parameters = np.concatenate([rng.uniform(size=(60, 3)), list(itertools.product([0.0, 1.0], repeat=3))])
    oracle = NdBSpline(tuple(k.knots for k in knots), control_points, [k.order - 1 for k in knots])
    np.testing.assert_allclose(evaluate(volume, control_points, parameters), oracle(parameters), atol=1e-14)
    gradients = evaluate_gradients(volume, control_points, parameters)
    hessians = evaluate_hessians(volume, control_points, parameters)
    for a in range(3):
        expected = oracle(parameters, nu=np.eye(3, dtype=int)[a])
        np.testing.assert_allclose(gradients[..., a], expected, atol=1e-13 * np.abs(expected).max())
        for b in range(3):
            expected = oracle(parameters, nu=np.eye(3, dtype=int)[a] + np.eye(3, dtype=int)[b])
            scale = max(np.abs(expected).max(), 1)
            np.testing.assert_allclose(hessians[..., SECOND[a][b]], expected, atol=1e-12 * scale)


def test_mapping_with_curved_knots_is_the_literal_triple_sum():
    volume, control_points = random_curved_volume(np.random.default_rng(0))
    for x in np.random.default_rng(1).uniform(size=(10, 3)):
        functions = []
        for d, knots in enumerate(volume.knots):
            spans, values = basis(knots, x[d], x[(d + 1) % 3], x[(d + 2) % 3])
            functions.append(np.zeros(knots.n_control))
            functions[d][spans[0] - knots.order + 1 : spans[0] + 1] = values[0]
        expected = np.einsum("i,j,k,ijkx->x", *functions, control_points)
        np.testing.assert_allclose(evaluate(volume, control_points, x[None])[0], expected, atol=1e-14)


@pytest.mark.parametrize("orders", [(2, 3, 4), (5, 6, 3), (4, 4, 4)])
def test_derivatives_agree_with_differences_through_curved_knots(orders):
    rng = np.random.default_rng(sum(orders))
    volume, control_points = random_curved_volume(rng, orders)
    parameters, h = rng.uniform(0.01, 0.99, (60, 3)), 1e-3
    gradients = evaluate_gradients(volume, control_points, parameters)
    hessians = evaluate_hessians(volume, control_points, parameters)
    for k in range(3):
        # a knot between the points of the difference formula spoils it (not the derivative), so medians are compared
        difference = central_difference(evaluate, volume, control_points, parameters, k, h)
        assert np.median(np.abs(difference - gradients[..., k])) < 1e-7 * np.abs(gradients).max()
        difference = central_difference(evaluate_gradients, volume, control_points, parameters, k, h)
        assert np.median(np.abs(difference - hessians[..., SECOND[k]])) < 1e-7 * np.abs(hessians).max()


def central_difference(f, volume, control_points, parameters, k, h):
    """Fourth-order difference of ``f`` in parameter ``k``."""
    values = [f(volume, control_points, parameters + step * h * np.eye(3)[k]) for step in (-2, -1, 1, 2)]
    return (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_mapping_is_p_minus_2_times_continuous_across_curved_knots_in_all_directions(order):
    """The paper's claim in II.C: knots in eta that depend on zeta and xi leave the mapping smooth across all three."""
    rng = np.random.default_rng(order)
    volume = Volume((random_constant_knots(rng, order), random_bilinear_knots(rng, order), wavy_knots(order)))
    control_points = rng.standard_normal((*volume.n_control, 2))
    for d in (1, 2):
        on_knots = points_on_knots(volume, d, rng)
        for k in range(3):  # crossing the curved knot along every parameter
            jumps = jumps_across(volume, control_points, on_knots, k)
            assert (jumps[: order - 1] < 1e-5).all(), (d, k)
            if order == 3:
                assert jumps[2] > 1e-2, "the second derivative of a quadratic spline has to jump"


def points_on_knots(volume, d, rng, n=20):
    parameters = rng.uniform(0.05, 0.95, (n, 3))
    T = volume.knots[d].values(parameters[:, (d + 1) % 3].copy(), parameters[:, (d + 2) % 3].copy())
    inner = T[:, volume.orders[d] : volume.n_control[d]]
    parameters[:, d] = inner[np.arange(n), rng.integers(inner.shape[1], size=n)]
    return parameters


def jumps_across(volume, control_points, parameters, k, step=1e-8):
    """Largest jump of the mapping, its gradient and Hessian in a short step along parameter ``k``, scaled."""
    jumps = []
    for f in (evaluate, evaluate_gradients, evaluate_hessians):
        before, after = (f(volume, control_points, parameters + side * step * np.eye(3)[k]) for side in (-1, 1))
        jumps.append(np.abs(after - before).max() / np.abs(before).max())
    return np.array(jumps)


@pytest.mark.parametrize("order", ORDERS)
def test_first_derivative_of_order_2_jumps_and_higher_orders_do_not(order):
    rng = np.random.default_rng(order)
    volume = Volume((random_bilinear_knots(rng, order),) * 3)
    control_points = rng.standard_normal((*volume.n_control, 2))
    jump = jumps_across(volume, control_points, points_on_knots(volume, 0, rng), 0)[1]
    assert jump > 1e-2 if order == 2 else jump < 1e-5


@pytest.mark.parametrize("order", ORDERS)
def test_polynomials_below_the_order_are_reproduced(order):
    """Any polynomial of degree p - 1 is in the space of constant knots, at every point and not only where fitted."""
    rng = np.random.default_rng(order)
    volume = Volume(tuple(random_constant_knots(rng, p, n_inner=2) for p in (order, 2, 3)))
    exponents = (order - 1, 1, 2)
    fitted = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in (15, 9, 11)], indexing="ij"), axis=-1).reshape(-1, 3)
    design = evaluate(volume, np.eye(np.prod(volume.n_control)).reshape(*volume.n_control, -1), fitted)
    coefficients = np.linalg.lstsq(design, polynomial(fitted, exponents), rcond=None)[0]
    elsewhere = rng.uniform(size=(100, 3))
    values = evaluate(volume, coefficients.reshape(*volume.n_control, 1), elsewhere)[:, 0]
    np.testing.assert_allclose(values, polynomial(elsewhere, exponents), rtol=0, atol=1e-13)


@pytest.mark.parametrize("order", ORDERS)
def test_knot_averages_as_control_points_give_the_identity(order):
    rng = np.random.default_rng(order)
    volume = Volume(tuple(random_constant_knots(rng, p, n_inner=4) for p in (order, order + 1, 3)))
    parameters = rng.uniform(size=(50, 3))
    net = greville_net(volume)
    np.testing.assert_allclose(evaluate(volume, net, parameters), parameters, atol=1e-14)
    np.testing.assert_allclose(evaluate_gradients(volume, net, parameters), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(evaluate_hessians(volume, net, parameters), 0.0, atol=1e-10)


def test_affine_maps_of_control_points_are_maps_of_the_volume():
    rng = np.random.default_rng(5)
    volume, control_points = random_curved_volume(rng)
    parameters, matrix, shift = rng.uniform(size=(30, 3)), rng.standard_normal((3, 3)), rng.standard_normal(3)
    moved = evaluate(volume, control_points @ matrix.T + shift, parameters)
    np.testing.assert_allclose(moved, evaluate(volume, control_points, parameters) @ matrix.T + shift, atol=1e-13)


def test_corners_are_control_points_even_with_curved_knots():
    volume, control_points = random_curved_volume(np.random.default_rng(6))
    corners = np.array(list(itertools.product([0, 1], repeat=3)))
    expected = control_points[tuple(-corners.T)]
    np.testing.assert_array_equal(evaluate(volume, control_points, corners.astype(float)), expected)


@pytest.mark.parametrize("order", ORDERS)
def test_points_lie_in_the_convex_hull_of_their_control_points(order):
    rng = np.random.default_rng(order)
    volume = Volume(tuple(random_bilinear_knots(rng, order, n_inner=2 + d) for d in range(3)))
    control_points = rng.standard_normal((*volume.n_control, 3))
    parameters = rng.uniform(size=(5, 3))
    for x, point in zip(parameters, evaluate(volume, control_points, parameters)):
        starts = [basis(k, x[d], x[(d + 1) % 3], x[(d + 2) % 3])[0][0] - order + 1 for d, k in enumerate(volume.knots)]
        local = control_points[tuple(slice(i, i + order) for i in starts)].reshape(-1, 3)
        weights = linprog(np.zeros(len(local)), A_eq=np.vstack([local.T, np.ones(len(local))]), b_eq=[*point, 1.0])
        assert weights.status == 0


def test_surfaces_and_curves_are_volumes_with_degenerate_directions():
    rng = np.random.default_rng(8)
    volume = Volume.of(*(random_constant_knots(rng, p) for p in (4, 3, 2)))
    net = rng.standard_normal((*volume.n_control, 3))
    st = rng.uniform(size=(20, 2))
    on_face = np.column_stack([st, np.zeros(20)])
    surface = Volume.of(*volume.knots[:2])
    assert surface.orders == (4, 3, 1)
    np.testing.assert_allclose(evaluate(surface, net[:, :, :1], on_face), evaluate(volume, net, on_face), atol=1e-14)
    gradients = evaluate_gradients(surface, net[:, :, :1], on_face)
    assert (gradients[..., 2] == 0).all()
    np.testing.assert_allclose(gradients[..., :2], evaluate_gradients(volume, net, on_face)[..., :2], atol=1e-12)


@pytest.mark.parametrize("dimension", [1, 2, 5])
def test_control_points_have_any_dimension(dimension):
    rng = np.random.default_rng(dimension)
    volume, _ = random_curved_volume(rng)
    control_points, parameters = rng.standard_normal((*volume.n_control, dimension)), rng.uniform(size=(7, 3))
    assert evaluate(volume, control_points, parameters).shape == (7, dimension)
    single = evaluate_hessians(volume, control_points[..., -1:], parameters)
    np.testing.assert_array_equal(evaluate_hessians(volume, control_points, parameters)[:, -1:], single)


def test_a_point_does_not_depend_on_its_company():
    """Chunks and neighbours change no bit, so that shared nodes are the same from everywhere."""
    rng = np.random.default_rng(9)
    volume, control_points = random_curved_volume(rng)
    parameters = rng.uniform(size=(5000, 3))
    together = evaluate(volume, control_points, parameters)
    alone = [evaluate(volume, control_points, parameters[q : q + 1])[0] for q in range(0, 5000, 499)]
    np.testing.assert_array_equal(together[::499], alone)


def test_no_points_give_no_points():
    volume, control_points = random_curved_volume(np.random.default_rng(0))
    assert evaluate_gradients(volume, control_points, np.empty((0, 3))).shape == (0, 3, 3)


def test_arrays_that_do_not_fit_are_refused():
    volume, control_points = random_curved_volume(np.random.default_rng(0))
    with pytest.raises(InputError, match="control points of shape"):
        evaluate(volume, control_points[1:], np.zeros((1, 3)))
    with pytest.raises(InputError, match="parameters of shape"):
        evaluate(volume, control_points, np.zeros((1, 2)))
    with pytest.raises(InputError, match="knots of 2 directions"):
        Volume((ConstantKnots.uniform(2, 2),) * 2)
