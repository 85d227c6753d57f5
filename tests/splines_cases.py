"""Knots and volumes that the tests of splines share."""

import numpy as np

from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots, FunctionKnots
from bspline_mdao.core.splines.volume import Volume

ORDERS = (2, 3, 4, 5, 6)


def random_inner_knots(rng, n, shape=()):
    gaps = rng.uniform(0.3, 1.0, (*shape, n + 1))
    return np.cumsum(gaps, axis=-1)[..., :-1] / gaps.sum(axis=-1, keepdims=True)


def random_constant_knots(rng, order, n_inner=5):
    inner = random_inner_knots(rng, n_inner)
    return ConstantKnots(np.concatenate([np.zeros(order), inner, np.ones(order)]), order)


def random_bilinear_knots(rng, order, n_inner=5):
    inner = random_inner_knots(rng, n_inner, (2, 2))
    return BilinearKnots(np.concatenate([np.zeros((2, 2, order)), inner, np.ones((2, 2, order))], axis=-1), order)


def wavy_knots(order):
    """Two inner knots that are not polynomials of the other parameters."""
    at, scale = np.array([0.35, 0.7]), 0.1

    def value(s, t):
        return at + scale * np.sin(3 * s + 2 * t)[:, None] * [1.0, 0.5]

    def gradient(s, t):
        c = scale * np.cos(3 * s + 2 * t)[:, None, None]
        return c * [[[3.0, 2.0], [1.5, 1.0]]]

    def hessian(s, t):
        c = -scale * np.sin(3 * s + 2 * t)[:, None, None]
        return c * [[[9.0, 6.0, 4.0], [4.5, 3.0, 2.0]]]

    return FunctionKnots(order, order + 2, value, gradient, hessian)


def random_curved_volume(rng, orders=(4, 3, 5)):
    """Curved knots of every kind, unequal sizes (9, 5, 11) for the default orders, and its control points in 3-D."""
    volume = Volume(
        (random_bilinear_knots(rng, orders[0]), wavy_knots(orders[1]), random_bilinear_knots(rng, orders[2], n_inner=6))
    )
    return volume, rng.standard_normal((*volume.n_control, 3))
