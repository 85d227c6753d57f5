"""The shock sensor at a face, from 0 in smooth flow to 1, see `.reconstruction`.

Theory: ``docs/theory/euler_transonic.rst``.
"""

from __future__ import annotations

from numba import njit

from .gas import GAMMA

__all__ = ["OPEN", "SHUT", "smooth_step", "smooth_step_slope", "stencil_sensor"]

SHUT, OPEN = 0.7, 1.0
"""Squares of the Mach number below which the sensor is zero, since there are no shocks, and above which it is free."""


@njit(cache=True, error_model="numpy", forceinline=True)
def stencil_sensor(
    # states of the first and the last of the four cells, pressures of the two at the face
    first,
    left,
    right,
    last,
    # has_first, has_last: 1.0 if the first and the last cell exist, 0.0 if they stand in for missing ones
    has_first,
    has_last,
    level,  # square of ``n_l^2 + n_r^2`` at which it is a half: the fourth power of the threshold
):
    """Second differences of the pressure, where the flow is fast."""
    # Fast by the mean square of the Mach numbers of the outer cells: a cell next to a shock still sees the flow ahead.
    n_left = has_first * (first[4] - 2.0 * left + right) / (first[4] + 2.0 * left + right)
    n_right = has_last * (left - 2.0 * right + last[4]) / (left + 2.0 * right + last[4])
    q = n_left * n_left + n_right * n_right
    square = q * q
    speed = (0.5 * (_mach_squared(first) + _mach_squared(last)) - SHUT) / (OPEN - SHUT)
    return smooth_step(speed) * (square / (square + level))


@njit(cache=True, error_model="numpy", forceinline=True)
def _mach_squared(w):
    return w[0] * (w[1] * w[1] + w[2] * w[2] + w[3] * w[3]) / (GAMMA * w[4])


@njit(cache=True, error_model="numpy", forceinline=True)
def smooth_step(t):
    """From 0 for ``t`` of 0 or less to 1 for 1 or more, with a continuous slope."""
    if t.real <= 0.0:
        return 0.0 * t
    if t.real >= 1.0:
        return 1.0 + 0.0 * t
    return t * t * (3.0 - 2.0 * t)


@njit(cache=True, error_model="numpy", forceinline=True)
def smooth_step_slope(t):
    """Derivative of `smooth_step`."""
    if t.real <= 0.0 or t.real >= 1.0:
        return 0.0 * t
    return 6.0 * t * (1.0 - t)
