"""Derivatives of `stencil_sensor`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

from numba import njit

from .gas import GAMMA
from .sensor import OPEN, SHUT, smooth_step, smooth_step_slope


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def stencil_sensor_jvp(first, left, right, last, has_first, has_last, level, d_first, d_left, d_right, d_last):
    """Change of `stencil_sensor` with ``first``, ``left``, ``right``, ``last``."""
    (first0, first1, first2, first3, first4) = first
    (last0, last1, last2, last3, last4) = last
    (d_first0, d_first1, d_first2, d_first3, d_first4) = d_first
    (d_last0, d_last1, d_last2, d_last3, d_last4) = d_last
    part = first4 + 2.0 * left + right
    d_part = d_first4 + 2.0 * d_left + d_right
    n_left = has_first * (first4 - 2.0 * left + right) / part
    d_n_left = (has_first * (d_first4 + d_right - 2.0 * d_left) - n_left * d_part) / part
    part_2 = left + 2.0 * right + last4
    d_part_2 = d_left + 2.0 * d_right + d_last4
    n_right = has_last * (left - 2.0 * right + last4) / part_2
    d_n_right = (has_last * (d_left + d_last4 - 2.0 * d_right) - n_right * d_part_2) / part_2
    q = n_left * n_left + n_right * n_right
    d_q = 2.0 * n_left * d_n_left + 2.0 * n_right * d_n_right
    square = q * q
    d_square = 2.0 * q * d_q
    part_3 = GAMMA * first4
    d_part_3 = GAMMA * d_first4
    part_4 = first0 * (first1 * first1 + first2 * first2 + first3 * first3) / part_3
    d_part_4 = (
        (first1 * first1 + first2 * first2 + first3 * first3) * d_first0
        + first0 * (2.0 * first1 * d_first1 + 2.0 * first2 * d_first2 + 2.0 * first3 * d_first3)
        - part_4 * d_part_3
    ) / part_3
    part_5 = GAMMA * last4
    d_part_5 = GAMMA * d_last4
    part_6 = last0 * (last1 * last1 + last2 * last2 + last3 * last3) / part_5
    d_part_6 = (
        (last1 * last1 + last2 * last2 + last3 * last3) * d_last0
        + last0 * (2.0 * last1 * d_last1 + 2.0 * last2 * d_last2 + 2.0 * last3 * d_last3)
        - part_6 * d_part_5
    ) / part_5
    speed = (0.5 * (part_4 + part_6) - SHUT) / (OPEN - SHUT)
    d_speed = 0.5 * (d_part_4 + d_part_6) / (OPEN - SHUT)
    part_7 = smooth_step(speed)
    d_part_7 = smooth_step_slope(speed) * d_speed
    part_8 = square + level
    d_part_8 = d_square
    part_9 = square / part_8
    d_part_9 = (d_square - part_9 * d_part_8) / part_8
    d_out = part_9 * d_part_7 + part_7 * d_part_9
    return d_out


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def stencil_sensor_vjp(first, left, right, last, has_first, has_last, level, bar):
    """Transpose of `stencil_sensor_jvp`: derivatives with respect to ``first``, ``left``, ``right``, ``last``."""
    (first0, first1, first2, first3, first4) = first
    (last0, last1, last2, last3, last4) = last
    bar0 = bar
    part = first4 + 2.0 * left + right
    n_left = has_first * (first4 - 2.0 * left + right) / part
    part_2 = left + 2.0 * right + last4
    n_right = has_last * (left - 2.0 * right + last4) / part_2
    q = n_left * n_left + n_right * n_right
    square = q * q
    part_3 = GAMMA * first4
    part_4 = first0 * (first1 * first1 + first2 * first2 + first3 * first3) / part_3
    part_5 = GAMMA * last4
    part_6 = last0 * (last1 * last1 + last2 * last2 + last3 * last3) / part_5
    speed = (0.5 * (part_4 + part_6) - SHUT) / (OPEN - SHUT)
    part_7 = smooth_step(speed)
    part_8 = square + level
    part_9 = square / part_8
    out_bar = bar0
    part_9_bar = out_bar * part_7
    part_8_bar = -(part_9_bar / part_8 * part_9)
    part_7_bar = out_bar * part_9
    speed_bar = part_7_bar * smooth_step_slope(speed)
    part_6_bar = speed_bar / (OPEN - SHUT) * 0.5
    part_5_bar = -(part_6_bar / part_5 * part_6)
    part_4_bar = speed_bar / (OPEN - SHUT) * 0.5
    part_3_bar = -(part_4_bar / part_3 * part_4)
    square_bar = part_9_bar / part_8 + part_8_bar
    q_bar = square_bar * 2.0 * q
    n_right_bar = q_bar * 2.0 * n_right
    part_2_bar = -(n_right_bar / part_2 * n_right)
    n_left_bar = q_bar * 2.0 * n_left
    part_bar = -(n_left_bar / part * n_left)
    first0_bar = part_4_bar / part_3 * (first1 * first1 + first2 * first2 + first3 * first3)
    first1_bar = part_4_bar / part_3 * first0 * 2.0 * first1
    first2_bar = part_4_bar / part_3 * first0 * 2.0 * first2
    first3_bar = part_4_bar / part_3 * first0 * 2.0 * first3
    first4_bar = part_3_bar * GAMMA + n_left_bar / part * has_first + part_bar
    left_bar = n_right_bar / part_2 * has_last + part_2_bar + part_bar * 2.0 - n_left_bar / part * has_first * 2.0
    right_bar = part_2_bar * 2.0 + n_left_bar / part * has_first + part_bar - n_right_bar / part_2 * has_last * 2.0
    last0_bar = part_6_bar / part_5 * (last1 * last1 + last2 * last2 + last3 * last3)
    last1_bar = part_6_bar / part_5 * last0 * 2.0 * last1
    last2_bar = part_6_bar / part_5 * last0 * 2.0 * last2
    last3_bar = part_6_bar / part_5 * last0 * 2.0 * last3
    last4_bar = part_5_bar * GAMMA + n_right_bar / part_2 * has_last + part_2_bar
    return (
        (first0_bar, first1_bar, first2_bar, first3_bar, first4_bar),
        left_bar,
        right_bar,
        (last0_bar, last1_bar, last2_bar, last3_bar, last4_bar),
    )
