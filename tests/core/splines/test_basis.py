"""Basis functions, Eqs. (2) and (4), their derivatives in the parameter and the knots, and their jets."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from splines_cases import ORDERS, random_bilinear_knots, random_constant_knots, wavy_knots

from bspline_mdao.core.splines.basis import (
    basis,
    basis_derivatives,
    basis_gradients,
    basis_jets,
    basis_values,
    find_span,
)
from bspline_mdao.core.splines.knots import ConstantKnots

STEP = 1e-30


def recursive_basis(T, order, i, s, xi):
    """Eq. (2) as it is printed, on span s; complex-safe and differentiable in T and xi."""
    if order == 1:
        return 1.0 if i == s else 0.0
    left, right = T[i + order - 1] - T[i], T[i + order] - T[i + 1]
    total = 0.0
    if left != 0:
        total += (xi - T[i]) / left * recursive_basis(T, order - 1, i, s, xi)
    if right != 0:
        total += (T[i + order] - xi) / right * recursive_basis(T, order - 1, i + 1, s, xi)
    return total


def recursive_values(T, order, s, xi):
    return np.array([recursive_basis(T, order, i, s, xi) for i in range(s - order + 1, s + 1)])


def points(rng, n=40):
    return rng.uniform(size=(3, n))


def local_jacobians(knots, xi, s, t):
    """Spans, and derivatives of the functions in the parameter and in the 2p - 2 local knots, (n, p, 2p - 1)."""
    p, T = knots.order, knots.values(s, t)
    spans, variables = basis(knots, xi, s, t)[0], np.eye(2 * p - 1)
    out = np.empty((len(xi), p, 2 * p))
    for q, span in enumerate(spans):
        local = T[q, span - p + 2 : span + p]
        basis_derivatives(local, variables[1:], p, p - 2, xi[q], variables[0], out[q])
    np.testing.assert_allclose(out[..., 0], basis(knots, xi, s, t)[1], atol=2e-15)
    return spans, out[..., 1:]


@pytest.mark.parametrize("order", ORDERS)
def test_partition_of_unity_holds(order):
    rng = np.random.default_rng(order)
    for knots in (random_constant_knots(rng, order), random_bilinear_knots(rng, order), wavy_knots(order)):
        _, values = basis(knots, *points(rng, 200))
        np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=2e-15)


@pytest.mark.parametrize("order", ORDERS)
def test_basis_is_not_negative(order):
    rng = np.random.default_rng(order)
    _, values = basis(random_bilinear_knots(rng, order), *points(rng, 500))
    assert values.min() >= 0


@pytest.mark.parametrize("order", ORDERS)
def test_derivatives_of_a_partition_of_unity_vanish(order):
    rng = np.random.default_rng(order)
    _, jets = basis_jets(random_bilinear_knots(rng, order), *points(rng))
    total = jets.sum(axis=1)
    assert np.abs(total[:, 1:]).max() < 1e-13 * np.abs(jets).max()


@pytest.mark.parametrize("order", range(1, 11))
def test_basis_agrees_with_scipy(order):
    rng = np.random.default_rng(order)
    knots = random_constant_knots(rng, order)
    xi = np.concatenate([rng.uniform(size=50), knots.knots])
    spans, values = basis(knots, xi)
    dense = np.zeros((xi.size, knots.n_control))
    np.put_along_axis(dense, spans[:, None] + np.arange(1 - order, 1), values, axis=1)
    expected = BSpline.design_matrix(xi, knots.knots, order - 1).toarray()
    np.testing.assert_allclose(dense, expected, atol=5e-16)


@pytest.mark.parametrize("order", ORDERS)
def test_basis_agrees_with_the_printed_recursion_where_knots_are_repeated(order):
    rng = np.random.default_rng(order)
    repeated = [0.3] * (order - 1) + [0.6] * max(order - 2, 1)
    knots = ConstantKnots(np.concatenate([np.zeros(order), repeated, np.ones(order)]), order)
    xi = rng.uniform(size=30)
    spans, values = basis(knots, xi)
    for q in range(xi.size):
        np.testing.assert_allclose(values[q], recursive_values(knots.knots, order, spans[q], xi[q]), atol=1e-15)


def test_span_is_half_open_and_the_last_one_closed():
    T = np.array([0.0, 0.0, 0.0, 0.25, 0.5, 0.5, 1.0, 1.0, 1.0])
    xi = [0.0, 0.1, 0.25, 0.3, 0.5, 0.7, 1.0]
    assert [find_span(T, 3, 6, x) for x in xi] == [2, 2, 3, 3, 5, 5, 5]


def test_parameters_just_outside_continue_the_nearest_span():
    knots = random_constant_knots(np.random.default_rng(0), 4)
    inside = basis(knots, [0.0, 1.0])
    outside = basis(knots, [-1e-15, 1.0 + 1e-15])
    np.testing.assert_array_equal(outside[0], inside[0])
    np.testing.assert_allclose(outside[1], inside[1], atol=1e-13)


@pytest.mark.parametrize("order", range(1, 8))
def test_jacobian_agrees_with_complex_step_through_the_printed_recursion(order):
    rng = np.random.default_rng(order)
    knots = random_bilinear_knots(rng, order)
    xi, s, t = points(rng, 8)
    T = knots.values(s, t)
    spans, jacobians = local_jacobians(knots, xi, s, t)
    for q in range(xi.size):
        expected = np.empty_like(jacobians[q])
        for column in range(2 * order - 1):
            moved, x = T[q].astype(complex), complex(xi[q])
            if column == 0:
                x += STEP * 1j
            else:
                moved[spans[q] - order + 1 + column] += STEP * 1j
            expected[:, column] = recursive_values(moved, order, spans[q], x).imag / STEP
        np.testing.assert_allclose(jacobians[q], expected, rtol=1e-12, atol=1e-12 * max(np.abs(expected).max(), 1))


@pytest.mark.slow
def test_compiled_kernels_accept_complex_numbers():
    T = np.array([0, 0, 0, 0, 0.2, 0.5, 0.6, 1, 1, 1, 1], dtype=complex)
    values, derivatives, d_T = np.empty(4, dtype=complex), np.empty((4, 2)), np.eye(11)[:, 4:5].copy()
    basis_derivatives(T.real.copy(), d_T, 4, 4, 0.3, (0.0,), derivatives)
    T[4] += STEP * 1j
    basis_values(T, 4, 4, 0.3 + 0j, values)
    np.testing.assert_allclose(values.imag / STEP, derivatives[:, 1], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_basis_depends_on_shifts_and_scalings_of_parameter_and_knots_as_it_must(order):
    """Shifting all changes nothing; scaling all about 0 changes nothing: two Euler identities of the Jacobian."""
    rng = np.random.default_rng(order)
    knots = random_bilinear_knots(rng, order)
    xi, s, t = points(rng)
    spans, jacobians = local_jacobians(knots, xi, s, t)
    local = spans[:, None] + np.arange(2 - order, order)
    arguments = np.column_stack([xi, np.take_along_axis(knots.values(s, t), local, axis=1)])
    scale = np.abs(jacobians).max()
    assert np.abs(jacobians.sum(axis=2)).max() < 1e-13 * scale
    assert np.abs(np.einsum("qic,qc->qi", jacobians, arguments)).max() < 1e-13 * scale


@pytest.mark.parametrize("make_knots", [random_constant_knots, random_bilinear_knots, lambda rng, p: wavy_knots(p)])
@pytest.mark.parametrize("order", range(1, 8))
def test_gradient_is_the_jacobian_times_the_knot_gradient(order, make_knots):
    rng = np.random.default_rng(order)
    knots = make_knots(rng, order)
    xi, s, t = points(rng)
    _, jets = basis_jets(knots, xi, s, t, degree=1)
    spans, jacobians = local_jacobians(knots, xi, s, t)
    local = spans[:, None] + np.arange(2 - order, order)
    knot_gradients = np.take_along_axis(knots.gradients(s, t), local[..., None], axis=1)
    expected = np.concatenate([jacobians[..., :1], jacobians[..., 1:] @ knot_gradients], axis=-1)
    np.testing.assert_allclose(jets[..., 0], basis(knots, xi, s, t)[1], atol=1e-15)
    np.testing.assert_allclose(jets[..., 1:], expected, atol=1e-13 * max(np.abs(expected).max(), 1))
    for direction in range(3):
        parameters = np.roll(np.column_stack([xi, s, t]), direction, axis=1)
        same_spans, gradients = basis_gradients(knots, direction, parameters)
        np.testing.assert_array_equal(same_spans, spans)
        np.testing.assert_allclose(gradients[..., 0], jets[..., 0], atol=1e-14)
        expected = np.roll(jets[..., 1:], direction, axis=-1)
        np.testing.assert_allclose(gradients[..., 1:], expected, atol=1e-13 * max(np.abs(expected).max(), 1))


@pytest.mark.parametrize("make_knots", [random_bilinear_knots, lambda rng, p: wavy_knots(p)])
@pytest.mark.parametrize("order", ORDERS)
def test_jet_hessian_converges_as_differences_of_the_gradient_at_fourth_order(order, make_knots):
    rng = np.random.default_rng(order)
    knots = make_knots(rng, order)
    at = points(rng, 20)
    _, jets = basis_jets(knots, *at)
    hessian = jets[..., [[4, 5, 6], [5, 7, 8], [6, 8, 9]]]
    spans = basis(knots, *at)[0]
    for k in range(3):
        errors = []
        for h in (4e-3, 2e-3):
            offsets, weights = h * np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / (12 * h)
            parts = [basis_jets(knots, *(at + o * np.eye(3)[:, k : k + 1]), degree=1) for o in offsets]
            stays = np.all([p[0] == spans for p in parts], axis=0)
            difference = sum(w * p[1][..., 1:] for w, p in zip(weights, parts))
            errors.append(np.abs(difference - hessian[..., k])[stays].max() / np.abs(hessian).max())
        assert stays.sum() >= 8
        assert errors[1] < max(errors[0] / 10, 1e-10)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_jets_of_lower_degree_are_the_beginning_of_higher_ones(degree):
    rng = np.random.default_rng(3)
    knots, at = random_bilinear_knots(rng, 4), points(rng)
    low, high = basis_jets(knots, *at, degree=degree)[1], basis_jets(knots, *at, degree=2)[1]
    np.testing.assert_array_equal(low, high[..., : low.shape[-1]])
