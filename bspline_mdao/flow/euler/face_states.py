"""Mean state and jump at a face, from the cells along the grid line through it.

The jump is ``sigma`` of the first difference and ``(1 - sigma) dissipation`` of the third. The sensor of shocks is that
of Jameson, smooth: with the relative second differences ``n`` of the pressure at the cells on both sides,
``sigma = n^2 / (n^2 + threshold^2)``, of fourth order in smooth flow.
"""

from __future__ import annotations

from numba import njit

from .stencil import FARFIELD, FIRST, MEAN, THIRD


@njit(cache=True, inline="always")
def _sum(weights, states, cells, n):
    return (
        weights[0] * states[cells[0], n]
        + weights[1] * states[cells[1], n]
        + weights[2] * states[cells[2], n]
        + weights[3] * states[cells[3], n]
    )


@njit(cache=True)
def _combine(weights, states, cells):
    return (
        _sum(weights, states, cells, 0),
        _sum(weights, states, cells, 1),
        _sum(weights, states, cells, 2),
        _sum(weights, states, cells, 3),
        _sum(weights, states, cells, 4),
    )


@njit(cache=True)
def shock_sensor(states, cells, weights, threshold):
    """Share of the first difference at an inner face, and its derivatives in the pressures of the four cells."""
    a, b, c, d = states[cells[0], 4], states[cells[1], 4], states[cells[2], 4], states[cells[3], 4]
    has_a, has_d = (1.0 if cells[0] != cells[1] else 0.0), (1.0 if cells[3] != cells[2] else 0.0)
    sum_l, sum_r = a + 2.0 * b + c, b + 2.0 * c + d
    n_l, n_r = has_a * (a - 2.0 * b + c) / sum_l, has_d * (b - 2.0 * c + d) / sum_r
    square, level = n_l * n_l + n_r * n_r, threshold * threshold
    slope = 2.0 * level / (square + level) ** 2
    l, r = slope * n_l * has_a / sum_l, slope * n_r * has_d / sum_r
    ratio_l, ratio_r = l * n_l, r * n_r
    gradient = (l - ratio_l, r - 2.0 * l - 2.0 * ratio_l - ratio_r, l - 2.0 * r - ratio_l - 2.0 * ratio_r, r - ratio_r)
    return square / (square + level), gradient


@njit(cache=True)
def face_state(states, cells, weights, role, stream, dissipation, sigma):
    """Mean state, jump, and the derivative of the jump in the sensor."""
    mean = _combine(weights[MEAN], states, cells)
    first = _combine(weights[FIRST], states, cells)
    if role == FARFIELD:
        mean = (
            mean[0] + 0.5 * stream[0],
            mean[1] + 0.5 * stream[1],
            mean[2] + 0.5 * stream[2],
            mean[3] + 0.5 * stream[3],
            mean[4] + 0.5 * stream[4],
        )
        jump = (
            first[0] + stream[0],
            first[1] + stream[1],
            first[2] + stream[2],
            first[3] + stream[3],
            first[4] + stream[4],
        )
        return mean, jump, first
    third = _combine(weights[THIRD], states, cells)
    e = dissipation
    slope = (
        first[0] - e * third[0],
        first[1] - e * third[1],
        first[2] - e * third[2],
        first[3] - e * third[3],
        first[4] - e * third[4],
    )
    jump = (
        e * third[0] + sigma * slope[0],
        e * third[1] + sigma * slope[1],
        e * third[2] + sigma * slope[2],
        e * third[3] + sigma * slope[3],
        e * third[4] + sigma * slope[4],
    )
    return mean, jump, slope
