"""Curves, Eq. (1), and one-dimensional meshes, section II.B."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from splines_cases import ORDERS, random_constant_knots

from bspline_mdao.core.splines.curve import Curve, uniform_parameters
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.errors import InputError


def sign_changes(values):
    signs = np.sign(values[np.abs(values) > 1e-12])
    return np.count_nonzero(np.diff(signs))


@pytest.mark.parametrize("order", ORDERS)
def test_curve_agrees_with_scipy(order):
    rng = np.random.default_rng(order)
    knots = random_constant_knots(rng, order)
    control_points, xi = rng.standard_normal((knots.n_control, 3)), rng.uniform(size=50)
    oracle = BSpline(knots.knots, control_points, order - 1)
    curve = Curve(control_points, knots)
    np.testing.assert_allclose(curve(xi), oracle(xi), atol=1e-14)
    np.testing.assert_allclose(curve.derivative(xi), oracle(xi, 1), atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_curve_passes_through_its_end_control_points(order):
    control_points = np.random.default_rng(order).standard_normal((order + 4, 2))
    np.testing.assert_array_equal(Curve.uniform(control_points, order)([0.0, 1.0]), control_points[[0, -1]])


@pytest.mark.parametrize("order", ORDERS)
def test_curve_crosses_no_line_more_often_than_its_control_polygon(order):
    rng = np.random.default_rng(order)
    xi = np.linspace(0, 1, 4001)
    for _ in range(50):
        knots = random_constant_knots(rng, order, n_inner=6)
        curve = Curve(rng.standard_normal((knots.n_control, 2)), knots)
        normal, offset = rng.standard_normal(2), 0.3 * rng.standard_normal()
        crossings = sign_changes(curve(xi) @ normal - offset)
        assert crossings <= sign_changes(curve.control_points @ normal - offset)


@pytest.mark.parametrize("order", ORDERS)
def test_uniform_control_points_knots_and_parameters_give_a_mesh_that_is_not_uniform(order):
    """Figure 2 (a): the spacing at the ends is p - 1 times that in the middle, where the basis is symmetric."""
    curve = Curve.uniform(np.linspace(0, 1, 3 * order - 4)[:, None], order)
    slope = curve.derivative([0.0, 0.5, 1.0])[:, 0]
    np.testing.assert_allclose(slope / slope[1], [order - 1, 1, order - 1], rtol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 17, 400])
@pytest.mark.parametrize("order", ORDERS)
def test_changed_parameters_give_a_uniform_mesh(order, n):
    rng = np.random.default_rng(order)
    knots = random_constant_knots(rng, order)
    for direction in (1, -1):
        curve = Curve(direction * np.cumsum(rng.uniform(0.05, 1.0, (knots.n_control, 1)), axis=0), knots)
        xi = uniform_parameters(curve, n)
        mesh = curve(xi)[:, 0]
        np.testing.assert_allclose(mesh, np.linspace(mesh[0], mesh[-1], n), atol=4e-15 * np.abs(mesh).max())
        assert (xi[0], xi[-1]) == (0.0, 1.0)
        assert (np.diff(xi) > 0).all()


def test_strong_clustering_still_gives_a_uniform_mesh():
    curve = Curve.uniform(np.geomspace(1e-6, 1.0, 15)[:, None])
    mesh = curve(uniform_parameters(curve, 101))[:, 0]
    np.testing.assert_allclose(np.diff(mesh), (1.0 - 1e-6) / 100, rtol=1e-11)


def test_curves_that_are_no_one_dimensional_mesh_are_refused():
    with pytest.raises(InputError, match="not monotone"):
        uniform_parameters(Curve.uniform([[0.0], [2.0], [1.0], [3.0]]), 5)
    with pytest.raises(InputError, match="not monotone"):
        uniform_parameters(Curve.uniform(np.arange(8.0).reshape(4, 2)), 5)
    with pytest.raises(InputError, match="1 mesh points"):
        uniform_parameters(Curve.uniform(np.arange(4.0)[:, None]), 1)
    with pytest.raises(InputError, match="control points of shape"):
        Curve([[0.0], [1.0]], ConstantKnots.uniform(4, 4))
