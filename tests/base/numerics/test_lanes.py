"""Several numbers in one register, as values in kernels."""

import numpy as np
from numba import njit

from bspline_mdao.base.numerics import lanes
from bspline_mdao.grids.cells.cell_loops import as_points


@njit(error_model="numpy")
def roots(x, out):
    """Take inverse roots one by one, and of lanes."""
    for k in range(x.size):
        out[0, k] = lanes.inverse_root(x[k])
    flat = out.reshape(-1)
    for k in range(0, x.size, lanes.LANES):
        n = min(lanes.LANES, x.size - k)
        lanes.store(flat, x.size + k, n, lanes.inverse_root(lanes.load(x, k, n) + 0.0))


def test_inverse_roots_are_rounded_once():
    x = np.exp(np.random.default_rng(0).uniform(-430.0, 430.0, 1003))
    x[:4] = 1.0, 4.0, 2.0**-40, 1e-190
    out = np.full((3, 1003), -1.0)
    roots(x, out[:2])
    exact = 1.0 / np.sqrt(x.astype(np.longdouble))
    np.testing.assert_array_equal(out[0], out[1])
    np.testing.assert_allclose(out[0], exact.astype(float), rtol=3e-16)
    assert out[0, :4].tolist() == [1.0, 0.5, 2.0**20, 1e95]
    assert (out[2] == -1.0).all()  # nothing beyond the last is written


@njit(error_model="numpy")
def exponentials(x, out):
    """Take exponentials."""
    for k in range(0, x.size, lanes.LANES):
        n = min(lanes.LANES, x.size - k)
        lanes.store(out, k, n, lanes.exponential(lanes.load(x, k, n)))


def test_exponentials_are_off_by_less_than_the_last_place():
    rng = np.random.default_rng(3)
    x = np.concatenate([[0.0, -0.0, 700.0, -700.0], rng.uniform(-700.0, 700.0, 20000), rng.uniform(-1.0, 1.0, 20001)])
    out = np.empty(x.size)
    exponentials(x, out)
    exact = np.exp(x.astype(np.longdouble))
    assert np.abs(out / exact - 1.0).max() < np.finfo(float).eps
    assert out[:2].tolist() == [1.0, 1.0]
    exponentials(x[:9] * np.nan, out)
    assert np.isnan(out[:9]).all()


@njit(error_model="numpy")
def limited(x, factors, out, found):
    """Keep what is below a limit; scale."""
    for k in range(0, x.size, lanes.LANES):
        n = min(lanes.LANES, x.size - k)
        numbers = lanes.within(n, lanes.load(x, k, n), np.inf)
        lanes.store(out[0], k, n, lanes.below(0.5, numbers, numbers + 1.0))
        lanes.store(out[1], k, n, lanes.scaled(numbers, lanes.load(factors, k, n), 7.0))
        found[k // lanes.LANES] = lanes.any_below(0.5, numbers)


def test_limits_look_at_every_lane_and_let_what_is_no_number_through():
    x = np.random.default_rng(4).uniform(0.6, 1.0, 4 * lanes.LANES + 3)
    x[lanes.LANES + 3], x[3 * lanes.LANES - 1] = 0.4, np.nan
    factors = np.where(np.arange(x.size) % 3, 2.0, 0.0)
    out, found = np.empty((2, x.size)), np.empty(5, dtype=bool)
    limited(x, factors, out, found)
    np.testing.assert_array_equal(out[0], np.where(~(x >= 0.5), x + 1.0, 0.0))
    np.testing.assert_array_equal(out[1], np.where(factors == 0.0, 7.0, factors * x))
    assert found.tolist() == [False, True, True, False, False]


@njit(error_model="numpy")
def arithmetic(a, b, bits, out):
    """Combine lanes with one another and with numbers."""
    for k in range(0, a.size, lanes.LANES):
        n = min(lanes.LANES, a.size - k)
        x, y = lanes.load(a, k, n), lanes.load(b, k, n)
        least = lanes.smaller(x, y) * 2.0 - (1.0 - x) * y
        lanes.store(out, k, n, lanes.with_bits(lanes.load_bits(bits, k, n), np.uint8(4), least + 3.0, 7.0))


def test_formulas_of_numbers_are_those_of_lanes():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 21))
    bits, out = rng.integers(0, 8, 21).astype(np.uint8), np.zeros(21)
    arithmetic(a, b, bits, out)
    expected = np.where(bits & 4, 7.0, np.minimum(a, b) * 2.0 - (1.0 - a) * b + 3.0)
    np.testing.assert_allclose(out, expected, rtol=1e-14, atol=1e-15)
    a[3] = np.nan
    arithmetic(a, b, 0 * bits, out)
    assert np.isnan(out[3])
    assert np.isfinite(np.delete(out, 3)).all()


@njit(error_model="numpy")
def shifted(points, out):
    """Add twice every point to the one behind it."""
    for k in range(0, points.size - 1, lanes.LANES):
        n = min(lanes.LANES, points.size - 1 - k)
        x, y, z = lanes.load_points(points, k, n)
        lanes.add_points(out, k + 1, n, (2.0 * x, 2.0 * y, 2.0 * z))


def test_points_come_and_go_from_any_place():
    for n in (2, 9, 30):
        points, out = np.random.default_rng(n).standard_normal((2, n, 3))
        expected = out + 2.0 * np.concatenate([np.zeros((1, 3)), points[:-1]])
        shifted(as_points(points), as_points(out))
        np.testing.assert_allclose(out, expected, rtol=1e-15)
