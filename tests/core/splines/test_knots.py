"""Knots as functions of the other two parameters, Eq. (5), and their validation."""

import pickle

import numpy as np
import pytest

from bspline_mdao.core.splines.knots import (
    BilinearKnots,
    ConstantKnots,
    FunctionKnots,
    knots_from_array,
    knots_to_array,
    open_uniform_knots,
)
from bspline_mdao.errors import InputError

CORNERS = np.array([[[0, 0, 0.2, 0.5, 1, 1], [0, 0, 0.3, 0.4, 1, 1]], [[0, 0, 0.1, 0.9, 1, 1], [0, 0, 0.6, 0.7, 1, 1]]])


def quadratic_knot(s, t):
    return (0.5 + 0.3 * s * (1 - t))[:, None]


def quadratic_gradient(s, t):
    return 0.3 * np.stack([1 - t, -s], axis=-1)[:, None]


def test_bilinear_knots_are_equation_5():
    s, t = np.random.default_rng(0).uniform(size=(2, 20))
    blend = [(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t]
    expected = np.einsum("aq,ai->qi", blend, CORNERS.reshape(4, -1))
    np.testing.assert_allclose(BilinearKnots(CORNERS, 2).values(s, t), expected, atol=1e-15)


def test_bilinear_knots_reproduce_the_edges_and_the_ends_exactly():
    knots = BilinearKnots(CORNERS, 2)
    ends = knots.values(np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0]))
    np.testing.assert_array_equal(ends, CORNERS.reshape(4, -1))
    s, t = np.random.default_rng(0).uniform(size=(2, 10000))
    values = knots.values(s, t)
    assert (values[:, :2] == 0).all()
    assert (values[:, -2:] == 1).all()


@pytest.mark.parametrize(
    "knots",
    [ConstantKnots.uniform(6, 3), BilinearKnots(CORNERS, 2), FunctionKnots(3, 4, quadratic_knot, quadratic_gradient)],
)
def test_knot_gradients_agree_with_differences(knots):
    s, t = np.random.default_rng(1).uniform(0.1, 0.9, (2, 15))
    h = 1e-4  # knots here are at most quadratic: central differences have no truncation error
    d_s = (knots.values(s + h, t) - knots.values(s - h, t)) / (2 * h)
    d_t = (knots.values(s, t + h) - knots.values(s, t - h)) / (2 * h)
    np.testing.assert_allclose(knots.gradients(s, t), np.stack([d_s, d_t], axis=-1), atol=1e-11)


def test_bilinear_hessian_is_the_twist():
    s, t = np.random.default_rng(2).uniform(0.1, 0.9, (2, 5))
    knots, h = BilinearKnots(CORNERS, 2), 1e-2
    twist = (knots.gradients(s + h, t) - knots.gradients(s - h, t))[..., 1] / (2 * h)
    hessians = knots.hessians(s, t)
    np.testing.assert_allclose(hessians[..., 1], twist, atol=1e-13)
    assert (hessians[..., [0, 2]] == 0).all()
    assert np.abs(twist).max() > 0.1


def test_open_uniform_knots_space_the_inner_knots_evenly():
    np.testing.assert_allclose(open_uniform_knots(7, 4), [0, 0, 0, 0, 0.25, 0.5, 0.75, 1, 1, 1, 1])
    np.testing.assert_array_equal(open_uniform_knots(1, 1), [0, 1])


@pytest.mark.parametrize("knots", [ConstantKnots([0, 0, 0, 0.4, 0.4, 1, 1, 1], 3), BilinearKnots(CORNERS, 2)])
def test_knots_survive_pickling_and_storage(knots):
    s, t = np.random.default_rng(3).uniform(size=(2, 5))
    for copy in (pickle.loads(pickle.dumps(knots)), knots_from_array(knots_to_array(knots), knots.order)):
        assert type(copy) is type(knots)
        assert (copy.order, copy.n_control) == (knots.order, knots.n_control)
        np.testing.assert_array_equal(copy.values(s, t), knots.values(s, t))


def test_function_knots_cannot_be_stored():
    with pytest.raises(InputError, match="FunctionKnots cannot be saved"):
        knots_to_array(FunctionKnots(3, 4, quadratic_knot, quadratic_gradient))


def test_knots_do_not_follow_later_changes_of_the_array_they_came_from():
    array = open_uniform_knots(5, 3)
    knots = ConstantKnots(array, 3)
    array[3] = 0.9
    assert knots.knots[3] < 0.5


@pytest.mark.parametrize(
    ("knots", "order", "message"),
    [
        ([0, 0, 0.5, 0.2, 1, 1], 2, "knot 4 is below knot 3"),
        ([0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1], 3, "knots 4 to 6 are equal"),
        ([0, 0, 0, 1, 1, 1, 1], 3, "knots 4 to 6 are equal"),
        ([0, 0, 0, 0, 1, 1, 1], 3, "knots 2 to 4 are equal"),
        ([0, 0.1, 0.5, 1, 1], 2, "not open"),
        ([0, 0, 0.5, 1, 2], 2, "not open"),
        ([0, 0, np.nan, 1, 1], 2, "not finite"),
        ([0, 0, 1, 1], 3, "1 control points for order 3"),
        ([0, 1], 0, "order 0"),
        ([[0, 0, 1, 1]], 2, "shape"),
    ],
)
def test_unusable_constant_knots_are_refused(knots, order, message):
    with pytest.raises(InputError, match=message):
        ConstantKnots(knots, order)


def test_unusable_bilinear_knots_are_refused():
    repeated = CORNERS.copy()
    repeated[1, 0, 3] = repeated[1, 0, 2]
    with pytest.raises(InputError, match="knots 3 to 4 are equal"):
        BilinearKnots(repeated, 2)
    with pytest.raises(InputError, match="shape"):
        BilinearKnots(CORNERS[0], 2)


def test_unusable_knot_functions_are_refused():
    with pytest.raises(InputError, match="do not increase"):
        FunctionKnots(3, 4, lambda s, t: 0.5 + s[:, None], quadratic_gradient)
    with pytest.raises(InputError, match="`gradient` gave shape"):
        FunctionKnots(3, 4, quadratic_knot, quadratic_knot)
    knots = FunctionKnots(3, 4, quadratic_knot, quadratic_gradient)
    with pytest.raises(InputError, match="give `hessian`"):
        knots.hessians(np.zeros(1), np.zeros(1))


def test_errors_are_one_line():
    with pytest.raises(InputError) as error:
        ConstantKnots([0, 0, 0.5, 0.2, 1, 1], 2)
    assert "\n" not in str(error.value)
