"""Mean state and jump at a face, from the cells along the grid line through it.

In smooth flow the mean is of fourth order and the jump the third difference times ``dissipation``; at shocks both are
those of the two cells at the face. The sensor ``sigma`` of shocks blends one into the other. With the relative second
differences ``n`` of the pressure at the cells on both sides, after Jameson, Schmidt and Turkel (AIAA 81-1259), and
``q = n_l^2 + n_r^2``, it is ``q^2 / (q^2 + threshold^4)``: smooth, and of eighth order in smooth flow.
"""

from __future__ import annotations

from numba import njit

from .gas import GAMMA
from .stencil import FARFIELD, FIRST, INNER, MEAN, THIRD

COMPACT_MEAN = (0.0, 0.5, 0.5, 0.0)
"""Weights of the four cells in the mean state at shocks."""

SHUT, OPEN = 0.7, 1.0
"""Squares of the Mach number below which there are no shocks, and above which the sensor is free."""

OUTER_MEAN = (0.5, 0.0, 0.0, 0.5)
"""Weights of the four cells in the state whose Mach number that is: a cell next to a shock still sees what is ahead."""


@njit(cache=True, error_model="numpy", inline="always")
def _sum(weights, states, cells, n):
    return (
        weights[0] * states[cells[0], n]
        + weights[1] * states[cells[1], n]
        + weights[2] * states[cells[2], n]
        + weights[3] * states[cells[3], n]
    )


@njit(cache=True, error_model="numpy")
def _combine(weights, states, cells):
    return (
        _sum(weights, states, cells, 0),
        _sum(weights, states, cells, 1),
        _sum(weights, states, cells, 2),
        _sum(weights, states, cells, 3),
        _sum(weights, states, cells, 4),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _blend(smooth, shock, sigma):
    """Mix what holds in smooth flow and at shocks; and the derivative in the sensor."""
    slope = (
        shock[0] - smooth[0],
        shock[1] - smooth[1],
        shock[2] - smooth[2],
        shock[3] - smooth[3],
        shock[4] - smooth[4],
    )
    return _add(smooth, sigma, slope), slope


@njit(cache=True, error_model="numpy", inline="always")
def _scale(factor, a):
    return factor * a[0], factor * a[1], factor * a[2], factor * a[3], factor * a[4]


@njit(cache=True, error_model="numpy", inline="always")
def _add(a, factor, b):
    return (
        a[0] + factor * b[0],
        a[1] + factor * b[1],
        a[2] + factor * b[2],
        a[3] + factor * b[3],
        a[4] + factor * b[4],
    )


@njit(cache=True, error_model="numpy")
def shock_sensor(states, cells, threshold):
    """Share of what holds at shocks at an inner face.

    And its derivatives in the pressures of the four cells, and in the mean state of the first and the last.
    """
    share, by_pressure = _kink(states, cells, threshold)
    gate, by_mean = _gate(_combine(OUTER_MEAN, states, cells))
    return gate * share, _scale(gate, by_pressure), _scale(share, by_mean)


@njit(cache=True, error_model="numpy")
def _kink(states, cells, threshold):
    """Sense the second differences, and differentiate in the four pressures."""
    a, b, c, d = states[cells[0], 4], states[cells[1], 4], states[cells[2], 4], states[cells[3], 4]
    has_a, has_d = (1.0 if cells[0] != cells[1] else 0.0), (1.0 if cells[3] != cells[2] else 0.0)
    sum_l, sum_r = a + 2.0 * b + c, b + 2.0 * c + d
    n_l, n_r = has_a * (a - 2.0 * b + c) / sum_l, has_d * (b - 2.0 * c + d) / sum_r
    q, level = n_l * n_l + n_r * n_r, threshold**4
    slope = 4.0 * q * level / (q * q + level) ** 2
    l, r = slope * n_l * has_a / sum_l, slope * n_r * has_d / sum_r
    ratio_l, ratio_r = l * n_l, r * n_r
    gradient = (l - ratio_l, r - 2.0 * l - 2.0 * ratio_l - ratio_r, l - 2.0 * r - ratio_l - 2.0 * ratio_r, r - ratio_r)
    return q * q / (q * q + level), (*gradient, 0.0 * q)


@njit(cache=True, error_model="numpy")
def _gate(w):
    """Open at the speed of sound, shut in slow flow; and its derivatives in the state."""
    r, u, v, w, p = w
    by_square = 1.0 / (GAMMA * p)
    square = (u * u + v * v + w * w) * r * by_square
    t = (square - SHUT) / (OPEN - SHUT)
    if t.real <= 0.0 or t.real >= 1.0:
        return (0.0 if t.real <= 0.0 else 1.0) + 0.0 * t, (0.0 * t, 0.0 * t, 0.0 * t, 0.0 * t, 0.0 * t)
    slope = 6.0 * t * (1.0 - t) / (OPEN - SHUT)
    by_speed = 2.0 * slope * r * by_square
    gradient = (slope * square / r, by_speed * u, by_speed * v, by_speed * w, -slope * square / p)
    return t * t * (3.0 - 2.0 * t), gradient


@njit(cache=True, error_model="numpy")
def face_state(states, cells, weights, role, stream, dissipation, sigma):
    """Mean state and jump, and the derivatives of both in the sensor."""
    mean = _combine(weights[MEAN], states, cells)
    first = _combine(weights[FIRST], states, cells)
    if role != INNER:
        outside = 1.0 if role == FARFIELD else 0.0
        return _add(mean, 0.5 * outside, stream), _add(first, outside, stream), first, first
    mean, mean_slope = _blend(mean, _combine(COMPACT_MEAN, states, cells), sigma)
    third = _scale(dissipation, _combine(weights[THIRD], states, cells))
    jump, jump_slope = _blend(third, first, sigma)
    return mean, jump, mean_slope, jump_slope


@njit(cache=True, error_model="numpy", nogil=True)
def face_weights(weights, role, dissipation, sigma, out):
    """Weights of the four cells in mean state and jump, shape (2, 4), with the sensor as it is."""
    for k in range(4):
        out[0, k], out[1, k] = weights[MEAN, k], weights[FIRST, k]
        if role == INNER:
            third = dissipation * weights[THIRD, k]
            out[0, k] += sigma * (COMPACT_MEAN[k] - out[0, k])
            out[1, k] = third + sigma * (out[1, k] - third)
