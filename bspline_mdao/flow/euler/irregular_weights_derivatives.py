"""Derivatives of `free_changes`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

from numba import njit

from .irregular_weights import ROUNDED, WORTH


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def free_changes_jvp(face, weights, has_first, has_last, d_face):
    """Change of `free_changes` with ``face``."""
    (
        (middle0, middle1, middle2),
        (a0, a1, a2),
        (b0, b1, b2),
        (c0, c1, c2),
        (d0, d1, d2),
        ((spread00, spread01, spread02), (spread10, spread11, spread12), (spread20, spread21, spread22)),
    ) = face
    (
        (d_middle0, d_middle1, d_middle2),
        (d_a0, d_a1, d_a2),
        (d_b0, d_b1, d_b2),
        (d_c0, d_c1, d_c2),
        (d_d0, d_d1, d_d2),
        (
            (d_spread00, d_spread01, d_spread02),
            (d_spread10, d_spread11, d_spread12),
            (d_spread20, d_spread21, d_spread22),
        ),
    ) = d_face
    p0 = a0 - middle0
    d_p0 = d_a0 - d_middle0
    p1 = a1 - middle1
    d_p1 = d_a1 - d_middle1
    p2 = a2 - middle2
    d_p2 = d_a2 - d_middle2
    q0 = b0 - middle0
    d_q0 = d_b0 - d_middle0
    q1 = b1 - middle1
    d_q1 = d_b1 - d_middle1
    q2 = b2 - middle2
    d_q2 = d_b2 - d_middle2
    r0 = c0 - middle0
    d_r0 = d_c0 - d_middle0
    r1 = c1 - middle1
    d_r1 = d_c1 - d_middle1
    r2 = c2 - middle2
    d_r2 = d_c2 - d_middle2
    s0 = d0 - middle0
    d_s0 = d_d0 - d_middle0
    s1 = d1 - middle1
    d_s1 = d_d1 - d_middle1
    s2 = d2 - middle2
    d_s2 = d_d2 - d_middle2
    miss0 = weights[0] * p0 + weights[1] * q0 + weights[2] * r0 + weights[3] * s0
    d_miss0 = weights[0] * d_p0 + weights[1] * d_q0 + weights[2] * d_r0 + weights[3] * d_s0
    miss1 = weights[0] * p1 + weights[1] * q1 + weights[2] * r1 + weights[3] * s1
    d_miss1 = weights[0] * d_p1 + weights[1] * d_q1 + weights[2] * d_r1 + weights[3] * d_s1
    miss2 = weights[0] * p2 + weights[1] * q2 + weights[2] * r2 + weights[3] * s2
    d_miss2 = weights[0] * d_p2 + weights[1] * d_q2 + weights[2] * d_r2 + weights[3] * d_s2
    total0 = has_first * p0 + 1.0 * q0 + 1.0 * r0 + has_last * s0
    d_total0 = has_first * d_p0 + 1.0 * d_q0 + 1.0 * d_r0 + has_last * d_s0
    total1 = has_first * p1 + 1.0 * q1 + 1.0 * r1 + has_last * s1
    d_total1 = has_first * d_p1 + 1.0 * d_q1 + 1.0 * d_r1 + has_last * d_s1
    total2 = has_first * p2 + 1.0 * q2 + 1.0 * r2 + has_last * s2
    d_total2 = has_first * d_p2 + 1.0 * d_q2 + 1.0 * d_r2 + has_last * d_s2
    n_cells = 2.0 + has_first + has_last
    mean0 = total0 / n_cells
    d_mean0 = d_total0 / n_cells
    mean1 = total1 / n_cells
    d_mean1 = d_total1 / n_cells
    mean2 = total2 / n_cells
    d_mean2 = d_total2 / n_cells
    e0 = p0 - mean0
    d_e0 = d_p0 - d_mean0
    e1 = p1 - mean1
    d_e1 = d_p1 - d_mean1
    e2 = p2 - mean2
    d_e2 = d_p2 - d_mean2
    f0 = q0 - mean0
    d_f0 = d_q0 - d_mean0
    f1 = q1 - mean1
    d_f1 = d_q1 - d_mean1
    f2 = q2 - mean2
    d_f2 = d_q2 - d_mean2
    g0 = r0 - mean0
    d_g0 = d_r0 - d_mean0
    g1 = r1 - mean1
    d_g1 = d_r1 - d_mean1
    g2 = r2 - mean2
    d_g2 = d_r2 - d_mean2
    h0 = s0 - mean0
    d_h0 = d_s0 - d_mean0
    h1 = s1 - mean1
    d_h1 = d_s1 - d_mean1
    h2 = s2 - mean2
    d_h2 = d_s2 - d_mean2
    xx = has_first * e0 * e0 + f0 * f0 + g0 * g0 + has_last * h0 * h0 + 0.5 / WORTH * spread00
    d_xx = (
        e0 * has_first * d_e0
        + has_first * e0 * d_e0
        + 2.0 * f0 * d_f0
        + 2.0 * g0 * d_g0
        + h0 * has_last * d_h0
        + has_last * h0 * d_h0
        + 0.5 / WORTH * d_spread00
    )
    yy = has_first * e1 * e1 + f1 * f1 + g1 * g1 + has_last * h1 * h1 + 0.5 / WORTH * spread11
    d_yy = (
        e1 * has_first * d_e1
        + has_first * e1 * d_e1
        + 2.0 * f1 * d_f1
        + 2.0 * g1 * d_g1
        + h1 * has_last * d_h1
        + has_last * h1 * d_h1
        + 0.5 / WORTH * d_spread11
    )
    zz = has_first * e2 * e2 + f2 * f2 + g2 * g2 + has_last * h2 * h2 + 0.5 / WORTH * spread22
    d_zz = (
        e2 * has_first * d_e2
        + has_first * e2 * d_e2
        + 2.0 * f2 * d_f2
        + 2.0 * g2 * d_g2
        + h2 * has_last * d_h2
        + has_last * h2 * d_h2
        + 0.5 / WORTH * d_spread22
    )
    xy = has_first * e0 * e1 + f0 * f1 + g0 * g1 + has_last * h0 * h1 + 0.25 / WORTH * (spread01 + spread10)
    d_xy = (
        e1 * has_first * d_e0
        + has_first * e0 * d_e1
        + f1 * d_f0
        + f0 * d_f1
        + g1 * d_g0
        + g0 * d_g1
        + h1 * has_last * d_h0
        + has_last * h0 * d_h1
        + 0.25 / WORTH * (d_spread01 + d_spread10)
    )
    yz = has_first * e1 * e2 + f1 * f2 + g1 * g2 + has_last * h1 * h2 + 0.25 / WORTH * (spread12 + spread21)
    d_yz = (
        e2 * has_first * d_e1
        + has_first * e1 * d_e2
        + f2 * d_f1
        + f1 * d_f2
        + g2 * d_g1
        + g1 * d_g2
        + h2 * has_last * d_h1
        + has_last * h1 * d_h2
        + 0.25 / WORTH * (d_spread12 + d_spread21)
    )
    zx = has_first * e2 * e0 + f2 * f0 + g2 * g0 + has_last * h2 * h0 + 0.25 / WORTH * (spread20 + spread02)
    d_zx = (
        e0 * has_first * d_e2
        + has_first * e2 * d_e0
        + f0 * d_f2
        + f2 * d_f0
        + g0 * d_g2
        + g2 * d_g0
        + h0 * has_last * d_h2
        + has_last * h2 * d_h0
        + 0.25 / WORTH * (d_spread20 + d_spread02)
    )
    rounding = ROUNDED * (xx + yy + zz)
    d_rounding = ROUNDED * (d_xx + d_yy + d_zz)
    x = xx + rounding
    d_x = d_xx + d_rounding
    y = yy + rounding
    d_y = d_yy + d_rounding
    z = zz + rounding
    d_z = d_zz + d_rounding
    first0 = y * z - yz * yz
    d_first0 = z * d_y + y * d_z - 2.0 * yz * d_yz
    first1 = yz * zx - xy * z
    d_first1 = zx * d_yz + yz * d_zx - z * d_xy - xy * d_z
    first2 = xy * yz - y * zx
    d_first2 = yz * d_xy + xy * d_yz - zx * d_y - y * d_zx
    second1 = z * x - zx * zx
    d_second1 = x * d_z + z * d_x - 2.0 * zx * d_zx
    second2 = zx * xy - x * yz
    d_second2 = xy * d_zx + zx * d_xy - yz * d_x - x * d_yz
    third2 = x * y - xy * xy
    d_third2 = y * d_x + x * d_y - 2.0 * xy * d_xy
    determinant = x * first0 + xy * first1 + zx * first2
    d_determinant = first0 * d_x + x * d_first0 + first1 * d_xy + xy * d_first1 + first2 * d_zx + zx * d_first2
    part = first0 * miss0 + first1 * miss1 + first2 * miss2
    d_part = (
        miss0 * d_first0 + first0 * d_miss0 + miss1 * d_first1 + first1 * d_miss1 + miss2 * d_first2 + first2 * d_miss2
    )
    push0 = part / determinant
    d_push0 = (d_part - push0 * d_determinant) / determinant
    part_3 = first1 * miss0 + second1 * miss1 + second2 * miss2
    d_part_3 = (
        miss0 * d_first1
        + first1 * d_miss0
        + miss1 * d_second1
        + second1 * d_miss1
        + miss2 * d_second2
        + second2 * d_miss2
    )
    push1 = part_3 / determinant
    d_push1 = (d_part_3 - push1 * d_determinant) / determinant
    part_5 = first2 * miss0 + second2 * miss1 + third2 * miss2
    d_part_5 = (
        miss0 * d_first2
        + first2 * d_miss0
        + miss1 * d_second2
        + second2 * d_miss1
        + miss2 * d_third2
        + third2 * d_miss2
    )
    push2 = part_5 / determinant
    d_push2 = (d_part_5 - push2 * d_determinant) / determinant
    d_part_2 = push0 * d_e0 + e0 * d_push0 + push1 * d_e1 + e1 * d_push1 + push2 * d_e2 + e2 * d_push2
    d_part_4 = push0 * d_f0 + f0 * d_push0 + push1 * d_f1 + f1 * d_push1 + push2 * d_f2 + f2 * d_push2
    d_part_6 = push0 * d_g0 + g0 * d_push0 + push1 * d_g1 + g1 * d_push1 + push2 * d_g2 + g2 * d_push2
    d_part_7 = push0 * d_h0 + h0 * d_push0 + push1 * d_h1 + h1 * d_push1 + push2 * d_h2 + h2 * d_push2
    d_out00 = -has_first * d_part_2
    d_out01 = -d_part_4
    d_out02 = -d_part_6
    d_out03 = -has_last * d_part_7
    return ((d_out00, d_out01, d_out02, d_out03), d_determinant)


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def free_changes_vjp(face, weights, has_first, has_last, bar):
    """Transpose of `free_changes_jvp`: derivatives with respect to ``face``."""
    (
        (middle0, middle1, middle2),
        (a0, a1, a2),
        (b0, b1, b2),
        (c0, c1, c2),
        (d0, d1, d2),
        ((spread00, spread01, spread02), (spread10, spread11, spread12), (spread20, spread21, spread22)),
    ) = face
    ((bar0, bar1, bar2, bar3), bar4) = bar
    p0 = a0 - middle0
    p1 = a1 - middle1
    p2 = a2 - middle2
    q0 = b0 - middle0
    q1 = b1 - middle1
    q2 = b2 - middle2
    r0 = c0 - middle0
    r1 = c1 - middle1
    r2 = c2 - middle2
    s0 = d0 - middle0
    s1 = d1 - middle1
    s2 = d2 - middle2
    miss0 = weights[0] * p0 + weights[1] * q0 + weights[2] * r0 + weights[3] * s0
    miss1 = weights[0] * p1 + weights[1] * q1 + weights[2] * r1 + weights[3] * s1
    miss2 = weights[0] * p2 + weights[1] * q2 + weights[2] * r2 + weights[3] * s2
    total0 = has_first * p0 + 1.0 * q0 + 1.0 * r0 + has_last * s0
    total1 = has_first * p1 + 1.0 * q1 + 1.0 * r1 + has_last * s1
    total2 = has_first * p2 + 1.0 * q2 + 1.0 * r2 + has_last * s2
    n_cells = 2.0 + has_first + has_last
    mean0 = total0 / n_cells
    mean1 = total1 / n_cells
    mean2 = total2 / n_cells
    e0 = p0 - mean0
    e1 = p1 - mean1
    e2 = p2 - mean2
    f0 = q0 - mean0
    f1 = q1 - mean1
    f2 = q2 - mean2
    g0 = r0 - mean0
    g1 = r1 - mean1
    g2 = r2 - mean2
    h0 = s0 - mean0
    h1 = s1 - mean1
    h2 = s2 - mean2
    xx = has_first * e0 * e0 + f0 * f0 + g0 * g0 + has_last * h0 * h0 + 0.5 / WORTH * spread00
    yy = has_first * e1 * e1 + f1 * f1 + g1 * g1 + has_last * h1 * h1 + 0.5 / WORTH * spread11
    zz = has_first * e2 * e2 + f2 * f2 + g2 * g2 + has_last * h2 * h2 + 0.5 / WORTH * spread22
    xy = has_first * e0 * e1 + f0 * f1 + g0 * g1 + has_last * h0 * h1 + 0.25 / WORTH * (spread01 + spread10)
    yz = has_first * e1 * e2 + f1 * f2 + g1 * g2 + has_last * h1 * h2 + 0.25 / WORTH * (spread12 + spread21)
    zx = has_first * e2 * e0 + f2 * f0 + g2 * g0 + has_last * h2 * h0 + 0.25 / WORTH * (spread20 + spread02)
    rounding = ROUNDED * (xx + yy + zz)
    x = xx + rounding
    y = yy + rounding
    z = zz + rounding
    first0 = y * z - yz * yz
    first1 = yz * zx - xy * z
    first2 = xy * yz - y * zx
    second1 = z * x - zx * zx
    second2 = zx * xy - x * yz
    third2 = x * y - xy * xy
    determinant = x * first0 + xy * first1 + zx * first2
    part = first0 * miss0 + first1 * miss1 + first2 * miss2
    push0 = part / determinant
    part_3 = first1 * miss0 + second1 * miss1 + second2 * miss2
    push1 = part_3 / determinant
    part_5 = first2 * miss0 + second2 * miss1 + third2 * miss2
    push2 = part_5 / determinant
    out03_bar = bar3
    out02_bar = bar2
    out01_bar = bar1
    out00_bar = bar0
    part_7_bar = -out03_bar * has_last
    part_6_bar = -out02_bar
    part_4_bar = -out01_bar
    part_2_bar = -out00_bar * has_first
    push2_bar = part_7_bar * h2 + part_6_bar * g2 + part_4_bar * f2 + part_2_bar * e2
    part_5_bar = push2_bar / determinant
    push1_bar = part_7_bar * h1 + part_6_bar * g1 + part_4_bar * f1 + part_2_bar * e1
    part_3_bar = push1_bar / determinant
    push0_bar = part_7_bar * h0 + part_6_bar * g0 + part_4_bar * f0 + part_2_bar * e0
    part_bar = push0_bar / determinant
    determinant_bar = (
        bar4 - push2_bar / determinant * push2 - push1_bar / determinant * push1 - push0_bar / determinant * push0
    )
    third2_bar = part_5_bar * miss2
    second2_bar = part_5_bar * miss1 + part_3_bar * miss2
    second1_bar = part_3_bar * miss1
    first2_bar = part_5_bar * miss0 + part_bar * miss2 + determinant_bar * zx
    first1_bar = part_3_bar * miss0 + part_bar * miss1 + determinant_bar * xy
    first0_bar = part_bar * miss0 + determinant_bar * x
    z_bar = second1_bar * x + first0_bar * y - first1_bar * xy
    y_bar = third2_bar * x + first0_bar * z - first2_bar * zx
    x_bar = determinant_bar * first0 + third2_bar * y + second1_bar * z - second2_bar * yz
    rounding_bar = z_bar + y_bar + x_bar
    zx_bar = determinant_bar * first2 + second2_bar * xy + first1_bar * yz - second1_bar * 2.0 * zx - first2_bar * y
    yz_bar = first2_bar * xy + first1_bar * zx - second2_bar * x - first0_bar * 2.0 * yz
    xy_bar = determinant_bar * first1 + second2_bar * zx + first2_bar * yz - third2_bar * 2.0 * xy - first1_bar * z
    zz_bar = z_bar + rounding_bar * ROUNDED
    yy_bar = y_bar + rounding_bar * ROUNDED
    xx_bar = x_bar + rounding_bar * ROUNDED
    h2_bar = (
        part_7_bar * push2
        + zx_bar * h0 * has_last
        + yz_bar * has_last * h1
        + zz_bar * h2 * has_last
        + zz_bar * has_last * h2
    )
    h1_bar = (
        part_7_bar * push1
        + yz_bar * h2 * has_last
        + xy_bar * has_last * h0
        + yy_bar * h1 * has_last
        + yy_bar * has_last * h1
    )
    h0_bar = (
        part_7_bar * push0
        + zx_bar * has_last * h2
        + xy_bar * h1 * has_last
        + xx_bar * h0 * has_last
        + xx_bar * has_last * h0
    )
    g2_bar = part_6_bar * push2 + zx_bar * g0 + yz_bar * g1 + zz_bar * 2.0 * g2
    g1_bar = part_6_bar * push1 + yz_bar * g2 + xy_bar * g0 + yy_bar * 2.0 * g1
    g0_bar = part_6_bar * push0 + zx_bar * g2 + xy_bar * g1 + xx_bar * 2.0 * g0
    f2_bar = part_4_bar * push2 + zx_bar * f0 + yz_bar * f1 + zz_bar * 2.0 * f2
    f1_bar = part_4_bar * push1 + yz_bar * f2 + xy_bar * f0 + yy_bar * 2.0 * f1
    f0_bar = part_4_bar * push0 + zx_bar * f2 + xy_bar * f1 + xx_bar * 2.0 * f0
    e2_bar = (
        part_2_bar * push2
        + zx_bar * e0 * has_first
        + yz_bar * has_first * e1
        + zz_bar * e2 * has_first
        + zz_bar * has_first * e2
    )
    e1_bar = (
        part_2_bar * push1
        + yz_bar * e2 * has_first
        + xy_bar * has_first * e0
        + yy_bar * e1 * has_first
        + yy_bar * has_first * e1
    )
    e0_bar = (
        part_2_bar * push0
        + zx_bar * has_first * e2
        + xy_bar * e1 * has_first
        + xx_bar * e0 * has_first
        + xx_bar * has_first * e0
    )
    mean2_bar = -h2_bar - g2_bar - f2_bar - e2_bar
    mean1_bar = -h1_bar - g1_bar - f1_bar - e1_bar
    mean0_bar = -h0_bar - g0_bar - f0_bar - e0_bar
    total2_bar = mean2_bar / n_cells
    total1_bar = mean1_bar / n_cells
    total0_bar = mean0_bar / n_cells
    miss2_bar = part_5_bar * third2 + part_3_bar * second2 + part_bar * first2
    miss1_bar = part_5_bar * second2 + part_3_bar * second1 + part_bar * first1
    miss0_bar = part_5_bar * first2 + part_3_bar * first1 + part_bar * first0
    s2_bar = h2_bar + total2_bar * has_last + miss2_bar * weights[3]
    s1_bar = h1_bar + total1_bar * has_last + miss1_bar * weights[3]
    s0_bar = h0_bar + total0_bar * has_last + miss0_bar * weights[3]
    r2_bar = g2_bar + total2_bar * 1.0 + miss2_bar * weights[2]
    r1_bar = g1_bar + total1_bar * 1.0 + miss1_bar * weights[2]
    r0_bar = g0_bar + total0_bar * 1.0 + miss0_bar * weights[2]
    q2_bar = f2_bar + total2_bar * 1.0 + miss2_bar * weights[1]
    q1_bar = f1_bar + total1_bar * 1.0 + miss1_bar * weights[1]
    q0_bar = f0_bar + total0_bar * 1.0 + miss0_bar * weights[1]
    p2_bar = e2_bar + total2_bar * has_first + miss2_bar * weights[0]
    p1_bar = e1_bar + total1_bar * has_first + miss1_bar * weights[0]
    p0_bar = e0_bar + total0_bar * has_first + miss0_bar * weights[0]
    middle0_bar = -s0_bar - r0_bar - q0_bar - p0_bar
    middle1_bar = -s1_bar - r1_bar - q1_bar - p1_bar
    middle2_bar = -s2_bar - r2_bar - q2_bar - p2_bar
    a0_bar = p0_bar
    a1_bar = p1_bar
    a2_bar = p2_bar
    b0_bar = q0_bar
    b1_bar = q1_bar
    b2_bar = q2_bar
    c0_bar = r0_bar
    c1_bar = r1_bar
    c2_bar = r2_bar
    d0_bar = s0_bar
    d1_bar = s1_bar
    d2_bar = s2_bar
    spread00_bar = xx_bar * 0.5 / WORTH
    spread01_bar = xy_bar * 0.25 / WORTH
    spread02_bar = zx_bar * 0.25 / WORTH
    spread10_bar = xy_bar * 0.25 / WORTH
    spread11_bar = yy_bar * 0.5 / WORTH
    spread12_bar = yz_bar * 0.25 / WORTH
    spread20_bar = zx_bar * 0.25 / WORTH
    spread21_bar = yz_bar * 0.25 / WORTH
    spread22_bar = zz_bar * 0.5 / WORTH
    return (
        (middle0_bar, middle1_bar, middle2_bar),
        (a0_bar, a1_bar, a2_bar),
        (b0_bar, b1_bar, b2_bar),
        (c0_bar, c1_bar, c2_bar),
        (d0_bar, d1_bar, d2_bar),
        (
            (spread00_bar, spread01_bar, spread02_bar),
            (spread10_bar, spread11_bar, spread12_bar),
            (spread20_bar, spread21_bar, spread22_bar),
        ),
    )
