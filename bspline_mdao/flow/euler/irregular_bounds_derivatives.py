"""Derivatives of `bounded_changes`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .irregular_weights import LARGEST, OUTER


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def bounded_changes_jvp(free, weights, is_more, d_free):
    """Change of `bounded_changes` with ``free``."""
    (free0, free1, free2, free3) = free
    (d_free0, d_free1, d_free2, d_free3) = d_free
    x = (free0 + free3) / (OUTER - weights[0] - weights[3])
    d_x = (d_free0 + d_free3) / (OUTER - weights[0] - weights[3])
    square = x * x
    d_square = 2.0 * x * d_x
    fourth = square * square
    d_fourth = 2.0 * square * d_square
    part = fourth * fourth
    d_part = 2.0 * fourth * d_fourth
    beyond = is_more * part
    d_beyond = is_more * d_part
    x_2 = free0 / LARGEST
    d_x_2 = d_free0 / LARGEST
    square_2 = x_2 * x_2
    d_square_2 = 2.0 * x_2 * d_x_2
    fourth_2 = square_2 * square_2
    d_fourth_2 = 2.0 * square_2 * d_square_2
    part_2 = fourth_2 * fourth_2
    d_part_2 = 2.0 * fourth_2 * d_fourth_2
    x_3 = free1 / LARGEST
    d_x_3 = d_free1 / LARGEST
    square_3 = x_3 * x_3
    d_square_3 = 2.0 * x_3 * d_x_3
    fourth_3 = square_3 * square_3
    d_fourth_3 = 2.0 * square_3 * d_square_3
    part_3 = fourth_3 * fourth_3
    d_part_3 = 2.0 * fourth_3 * d_fourth_3
    x_4 = free2 / LARGEST
    d_x_4 = d_free2 / LARGEST
    square_4 = x_4 * x_4
    d_square_4 = 2.0 * x_4 * d_x_4
    fourth_4 = square_4 * square_4
    d_fourth_4 = 2.0 * square_4 * d_square_4
    part_4 = fourth_4 * fourth_4
    d_part_4 = 2.0 * fourth_4 * d_fourth_4
    inner = part_2 + part_3 + part_4
    d_inner = d_part_2 + d_part_3 + d_part_4
    x_5 = free3 / LARGEST
    d_x_5 = d_free3 / LARGEST
    square_5 = x_5 * x_5
    d_square_5 = 2.0 * x_5 * d_x_5
    fourth_5 = square_5 * square_5
    d_fourth_5 = 2.0 * square_5 * d_square_5
    part_5 = fourth_5 * fourth_5
    d_part_5 = 2.0 * fourth_5 * d_fourth_5
    total = 1.0 + inner + part_5 + beyond
    d_total = d_inner + d_part_5 + d_beyond
    part_6 = np.sqrt(total)
    d_part_6 = 0.5 * d_total / part_6
    part_7 = np.sqrt(part_6)
    d_part_7 = 0.5 * d_part_6 / part_7
    part_8 = np.sqrt(part_7)
    d_part_8 = 0.5 * d_part_7 / part_8
    factor = 1.0 / part_8
    d_factor = -factor * d_part_8 / part_8
    d_out0 = free0 * d_factor + factor * d_free0
    d_out1 = free1 * d_factor + factor * d_free1
    d_out2 = free2 * d_factor + factor * d_free2
    d_out3 = free3 * d_factor + factor * d_free3
    return (d_out0, d_out1, d_out2, d_out3)


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def bounded_changes_vjp(free, weights, is_more, bar):
    """Transpose of `bounded_changes_jvp`: derivatives with respect to ``free``."""
    (free0, free1, free2, free3) = free
    (bar0, bar1, bar2, bar3) = bar
    x = (free0 + free3) / (OUTER - weights[0] - weights[3])
    square = x * x
    fourth = square * square
    part = fourth * fourth
    beyond = is_more * part
    x_2 = free0 / LARGEST
    square_2 = x_2 * x_2
    fourth_2 = square_2 * square_2
    part_2 = fourth_2 * fourth_2
    x_3 = free1 / LARGEST
    square_3 = x_3 * x_3
    fourth_3 = square_3 * square_3
    part_3 = fourth_3 * fourth_3
    x_4 = free2 / LARGEST
    square_4 = x_4 * x_4
    fourth_4 = square_4 * square_4
    part_4 = fourth_4 * fourth_4
    inner = part_2 + part_3 + part_4
    x_5 = free3 / LARGEST
    square_5 = x_5 * x_5
    fourth_5 = square_5 * square_5
    part_5 = fourth_5 * fourth_5
    total = 1.0 + inner + part_5 + beyond
    part_6 = np.sqrt(total)
    part_7 = np.sqrt(part_6)
    part_8 = np.sqrt(part_7)
    factor = 1.0 / part_8
    out3_bar = bar3
    out2_bar = bar2
    out1_bar = bar1
    out0_bar = bar0
    factor_bar = out3_bar * free3 + out2_bar * free2 + out1_bar * free1 + out0_bar * free0
    part_8_bar = -(factor_bar / part_8 * factor)
    part_7_bar = part_8_bar / part_8 * 0.5
    part_6_bar = part_7_bar / part_7 * 0.5
    total_bar = part_6_bar / part_6 * 0.5
    part_5_bar = total_bar
    fourth_5_bar = part_5_bar * 2.0 * fourth_5
    square_5_bar = fourth_5_bar * 2.0 * square_5
    x_5_bar = square_5_bar * 2.0 * x_5
    inner_bar = total_bar
    part_4_bar = inner_bar
    fourth_4_bar = part_4_bar * 2.0 * fourth_4
    square_4_bar = fourth_4_bar * 2.0 * square_4
    x_4_bar = square_4_bar * 2.0 * x_4
    part_3_bar = inner_bar
    fourth_3_bar = part_3_bar * 2.0 * fourth_3
    square_3_bar = fourth_3_bar * 2.0 * square_3
    x_3_bar = square_3_bar * 2.0 * x_3
    part_2_bar = inner_bar
    fourth_2_bar = part_2_bar * 2.0 * fourth_2
    square_2_bar = fourth_2_bar * 2.0 * square_2
    x_2_bar = square_2_bar * 2.0 * x_2
    beyond_bar = total_bar
    part_bar = beyond_bar * is_more
    fourth_bar = part_bar * 2.0 * fourth
    square_bar = fourth_bar * 2.0 * square
    x_bar = square_bar * 2.0 * x
    free0_bar = out0_bar * factor + x_2_bar / LARGEST + x_bar / (OUTER - weights[0] - weights[3])
    free1_bar = out1_bar * factor + x_3_bar / LARGEST
    free2_bar = out2_bar * factor + x_4_bar / LARGEST
    free3_bar = out3_bar * factor + x_5_bar / LARGEST + x_bar / (OUTER - weights[0] - weights[3])
    return (free0_bar, free1_bar, free2_bar, free3_bar)
