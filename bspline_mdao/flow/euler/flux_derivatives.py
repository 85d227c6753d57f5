"""Derivatives of `face_flux`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .flux import CV, ROUNDING
from .gas import GAMMA


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def face_flux_jvp(w, j, s, shock, d_w, d_j, d_s, d_shock):
    """Change of `face_flux` with ``w``, ``j``, ``s``, ``shock``."""
    (r, u0, u1, u2, p) = w
    (jr, ju0, ju1, ju2, jp) = j
    (s0, s1, s2) = s
    (d_r, d_u0, d_u1, d_u2, d_p) = d_w
    (d_jr, d_ju0, d_ju1, d_ju2, d_jp) = d_j
    (d_s0, d_s1, d_s2) = d_s
    U = u0 * s0 + u1 * s1 + u2 * s2
    d_U = s0 * d_u0 + u0 * d_s0 + s1 * d_u1 + u1 * d_s1 + s2 * d_u2 + u2 * d_s2
    jU = ju0 * s0 + ju1 * s1 + ju2 * s2
    d_jU = s0 * d_ju0 + ju0 * d_s0 + s1 * d_ju1 + ju1 * d_s1 + s2 * d_ju2 + ju2 * d_s2
    uu = u0 * u0 + u1 * u1 + u2 * u2
    d_uu = 2.0 * u0 * d_u0 + 2.0 * u1 * d_u1 + 2.0 * u2 * d_u2
    ss = s0 * s0 + s1 * s1 + s2 * s2
    d_ss = 2.0 * s0 * d_s0 + 2.0 * s1 * d_s1 + 2.0 * s2 * d_s2
    x = 0.25 * shock
    d_x = 0.25 * d_shock
    through = r * U + x * jr * jU
    d_through = U * d_r + r * d_U + jU * (jr * d_x + x * d_jr) + x * jr * d_jU
    part = r * r - x * jr * jr
    d_part = 2.0 * r * d_r - jr * (jr * d_x + x * d_jr) - x * jr * d_jr
    T = (r * p - x * jr * jp) / part
    d_T = (p * d_r + r * d_p - jp * (jr * d_x + x * d_jr) - x * jr * d_jp - T * d_part) / part
    part_2 = ju0 * ju0 + ju1 * ju1 + ju2 * ju2
    d_part_2 = 2.0 * ju0 * d_ju0 + 2.0 * ju1 * d_ju1 + 2.0 * ju2 * d_ju2
    H = GAMMA * CV * T + 0.5 * (uu + x * part_2)
    d_H = GAMMA * CV * d_T + 0.5 * (d_uu + part_2 * d_x + x * d_part_2)
    part_3 = GAMMA * p / r
    d_part_3 = (GAMMA * d_p - part_3 * d_r) / r
    part_4 = part_3 * ss
    d_part_4 = ss * d_part_3 + part_3 * d_ss
    A = np.sqrt(part_4)
    d_A = 0.5 * d_part_4 / A
    part_5 = ROUNDING * A
    d_part_5 = ROUNDING * d_A
    k = part_5**2
    d_k = 2.0 * part_5 * d_part_5
    part_6 = U * U + k
    d_part_6 = 2.0 * U * d_U + d_k
    l0 = np.sqrt(part_6)
    d_l0 = 0.5 * d_part_6 / l0
    part_8 = U + A
    d_part_8 = d_U + d_A
    part_9 = part_8**2 + k
    d_part_9 = 2.0 * part_8 * d_part_8 + d_k
    lp = np.sqrt(part_9)
    d_lp = 0.5 * d_part_9 / lp
    part_11 = U - A
    d_part_11 = d_U - d_A
    part_12 = part_11**2 + k
    d_part_12 = 2.0 * part_11 * d_part_11 + d_k
    lm = np.sqrt(part_12)
    d_lm = 0.5 * d_part_12 / lm
    sigma = 0.5 * (lp + lm) - l0
    d_sigma = 0.5 * (d_lp + d_lm) - d_l0
    delta = 0.5 * (lp - lm)
    d_delta = 0.5 * (d_lp - d_lm)
    part_7 = GAMMA * p
    d_part_7 = GAMMA * d_p
    m2 = uu * r / part_7
    d_m2 = (r * d_uu + uu * d_r - m2 * d_part_7) / part_7
    part_10 = 1.0 + m2 * m2
    d_part_10 = 2.0 * m2 * d_m2
    part_13 = np.sqrt(part_10)
    d_part_13 = 0.5 * d_part_10 / part_13
    low = m2 / part_13
    d_low = (d_m2 - low * d_part_13) / part_13
    g = sigma * r * (low + shock * (1.0 - low))
    d_g = (low + shock * (1.0 - low)) * (r * d_sigma + sigma * d_r) + sigma * r * (
        d_low + (1.0 - low) * d_shock - shock * d_low
    )
    part_14 = g * jU / ss
    d_part_14 = (jU * d_g + g * d_jU - part_14 * d_ss) / ss
    part_15 = delta * jp / A
    d_part_15 = (jp * d_delta + delta * d_jp - part_15 * d_A) / A
    P = part_14 + part_15
    d_P = d_part_14 + d_part_15
    part_16 = GAMMA * p
    d_part_16 = GAMMA * d_p
    part_17 = sigma * jp / part_16
    d_part_17 = (jp * d_sigma + sigma * d_jp - part_17 * d_part_16) / part_16
    part_18 = delta * jU / A
    d_part_18 = (jU * d_delta + delta * d_jU - part_18 * d_A) / A
    Q = part_17 + part_18
    d_Q = d_part_17 + d_part_18
    m = through - 0.5 * (l0 * jr + r * Q)
    d_m = d_through - 0.5 * (jr * d_l0 + l0 * d_jr + Q * d_r + r * d_Q)
    push = p - 0.5 * P
    d_push = d_p - 0.5 * d_P
    drag = 0.5 * l0 * r
    d_drag = r * 0.5 * d_l0 + 0.5 * l0 * d_r
    part_19 = u0 * ju0 + u1 * ju1 + u2 * ju2
    d_part_19 = ju0 * d_u0 + u0 * d_ju0 + ju1 * d_u1 + u1 * d_ju1 + ju2 * d_u2 + u2 * d_ju2
    loss = jp * CV + 0.5 * uu * jr + r * part_19
    d_loss = CV * d_jp + jr * 0.5 * d_uu + 0.5 * uu * d_jr + part_19 * d_r + r * d_part_19
    d_energy = (
        (through - 0.5 * r * Q) * d_H
        + H * (d_through - Q * 0.5 * d_r - 0.5 * r * d_Q)
        - 0.5 * (loss * d_l0 + l0 * d_loss + U * d_P + P * d_U)
    )
    d_out1 = u0 * d_m + m * d_u0 + s0 * d_push + push * d_s0 - ju0 * d_drag - drag * d_ju0
    d_out2 = u1 * d_m + m * d_u1 + s1 * d_push + push * d_s1 - ju1 * d_drag - drag * d_ju1
    d_out3 = u2 * d_m + m * d_u2 + s2 * d_push + push * d_s2 - ju2 * d_drag - drag * d_ju2
    return (d_m, d_out1, d_out2, d_out3, d_energy)


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def face_flux_vjp(w, j, s, shock, bar):
    """Transpose of `face_flux_jvp`: derivatives with respect to ``w``, ``j``, ``s``, ``shock``."""
    (r, u0, u1, u2, p) = w
    (jr, ju0, ju1, ju2, jp) = j
    (s0, s1, s2) = s
    (bar0, bar1, bar2, bar3, bar4) = bar
    U = u0 * s0 + u1 * s1 + u2 * s2
    jU = ju0 * s0 + ju1 * s1 + ju2 * s2
    uu = u0 * u0 + u1 * u1 + u2 * u2
    ss = s0 * s0 + s1 * s1 + s2 * s2
    x = 0.25 * shock
    through = r * U + x * jr * jU
    part = r * r - x * jr * jr
    T = (r * p - x * jr * jp) / part
    part_2 = ju0 * ju0 + ju1 * ju1 + ju2 * ju2
    H = GAMMA * CV * T + 0.5 * (uu + x * part_2)
    part_3 = GAMMA * p / r
    part_4 = part_3 * ss
    A = np.sqrt(part_4)
    part_5 = ROUNDING * A
    k = part_5**2
    part_6 = U * U + k
    l0 = np.sqrt(part_6)
    part_8 = U + A
    part_9 = part_8**2 + k
    lp = np.sqrt(part_9)
    part_11 = U - A
    part_12 = part_11**2 + k
    lm = np.sqrt(part_12)
    sigma = 0.5 * (lp + lm) - l0
    delta = 0.5 * (lp - lm)
    part_7 = GAMMA * p
    m2 = uu * r / part_7
    part_10 = 1.0 + m2 * m2
    part_13 = np.sqrt(part_10)
    low = m2 / part_13
    g = sigma * r * (low + shock * (1.0 - low))
    part_14 = g * jU / ss
    part_15 = delta * jp / A
    P = part_14 + part_15
    part_16 = GAMMA * p
    part_17 = sigma * jp / part_16
    part_18 = delta * jU / A
    Q = part_17 + part_18
    m = through - 0.5 * (l0 * jr + r * Q)
    push = p - 0.5 * P
    drag = 0.5 * l0 * r
    part_19 = u0 * ju0 + u1 * ju1 + u2 * ju2
    loss = jp * CV + 0.5 * uu * jr + r * part_19
    out3_bar = bar3
    out2_bar = bar2
    out1_bar = bar1
    energy_bar = bar4
    loss_bar = -energy_bar * 0.5 * l0
    part_19_bar = loss_bar * r
    drag_bar = -out3_bar * ju2 - out2_bar * ju1 - out1_bar * ju0
    push_bar = out3_bar * s2 + out2_bar * s1 + out1_bar * s0
    m_bar = bar0 + out3_bar * u2 + out2_bar * u1 + out1_bar * u0
    Q_bar = -energy_bar * H * 0.5 * r - m_bar * 0.5 * r
    part_18_bar = Q_bar
    part_17_bar = Q_bar
    part_16_bar = -(part_17_bar / part_16 * part_17)
    P_bar = -energy_bar * 0.5 * U - push_bar * 0.5
    part_15_bar = P_bar
    part_14_bar = P_bar
    g_bar = part_14_bar / ss * jU
    low_bar = g_bar * sigma * r - g_bar * sigma * r * shock
    part_13_bar = -(low_bar / part_13 * low)
    part_10_bar = part_13_bar / part_13 * 0.5
    m2_bar = low_bar / part_13 + part_10_bar * 2.0 * m2
    part_7_bar = -(m2_bar / part_7 * m2)
    delta_bar = part_18_bar / A * jU + part_15_bar / A * jp
    sigma_bar = part_17_bar / part_16 * jp + g_bar * (low + shock * (1.0 - low)) * r
    lm_bar = sigma_bar * 0.5 - delta_bar * 0.5
    part_12_bar = lm_bar / lm * 0.5
    part_11_bar = part_12_bar * 2.0 * part_11
    lp_bar = delta_bar * 0.5 + sigma_bar * 0.5
    part_9_bar = lp_bar / lp * 0.5
    part_8_bar = part_9_bar * 2.0 * part_8
    l0_bar = drag_bar * r * 0.5 - energy_bar * 0.5 * loss - m_bar * 0.5 * jr - sigma_bar
    part_6_bar = l0_bar / l0 * 0.5
    k_bar = part_12_bar + part_9_bar + part_6_bar
    part_5_bar = k_bar * 2.0 * part_5
    A_bar = part_8_bar + part_5_bar * ROUNDING - part_18_bar / A * part_18 - part_15_bar / A * part_15 - part_11_bar
    part_4_bar = A_bar / A * 0.5
    part_3_bar = part_4_bar * ss
    H_bar = energy_bar * (through - 0.5 * r * Q)
    part_2_bar = H_bar * 0.5 * x
    T_bar = H_bar * GAMMA * CV
    part_bar = -(T_bar / part * T)
    through_bar = energy_bar * H + m_bar
    x_bar = H_bar * 0.5 * part_2 + through_bar * jU * jr - T_bar / part * jp * jr - part_bar * jr * jr
    ss_bar = part_4_bar * part_3 - part_14_bar / ss * part_14
    uu_bar = loss_bar * jr * 0.5 + m2_bar / part_7 * r + H_bar * 0.5
    jU_bar = part_18_bar / A * delta + part_14_bar / ss * g + through_bar * x * jr
    U_bar = part_11_bar + part_8_bar + part_6_bar * 2.0 * U + through_bar * r - energy_bar * 0.5 * P
    r_bar = (
        loss_bar * part_19
        + drag_bar * 0.5 * l0
        + g_bar * (low + shock * (1.0 - low)) * sigma
        + m2_bar / part_7 * uu
        + T_bar / part * p
        + part_bar * 2.0 * r
        + through_bar * U
        - energy_bar * H * Q * 0.5
        - m_bar * 0.5 * Q
        - part_3_bar / r * part_3
    )
    u0_bar = out1_bar * m + part_19_bar * ju0 + uu_bar * 2.0 * u0 + U_bar * s0
    u1_bar = out2_bar * m + part_19_bar * ju1 + uu_bar * 2.0 * u1 + U_bar * s1
    u2_bar = out3_bar * m + part_19_bar * ju2 + uu_bar * 2.0 * u2 + U_bar * s2
    p_bar = push_bar + part_16_bar * GAMMA + part_7_bar * GAMMA + part_3_bar / r * GAMMA + T_bar / part * r
    jr_bar = (
        loss_bar * 0.5 * uu
        + through_bar * jU * x
        - m_bar * 0.5 * l0
        - T_bar / part * jp * x
        - part_bar * jr * x
        - part_bar * x * jr
    )
    ju0_bar = part_19_bar * u0 + part_2_bar * 2.0 * ju0 + jU_bar * s0 - out1_bar * drag
    ju1_bar = part_19_bar * u1 + part_2_bar * 2.0 * ju1 + jU_bar * s1 - out2_bar * drag
    ju2_bar = part_19_bar * u2 + part_2_bar * 2.0 * ju2 + jU_bar * s2 - out3_bar * drag
    jp_bar = loss_bar * CV + part_17_bar / part_16 * sigma + part_15_bar / A * delta - T_bar / part * x * jr
    s0_bar = out1_bar * push + ss_bar * 2.0 * s0 + jU_bar * ju0 + U_bar * u0
    s1_bar = out2_bar * push + ss_bar * 2.0 * s1 + jU_bar * ju1 + U_bar * u1
    s2_bar = out3_bar * push + ss_bar * 2.0 * s2 + jU_bar * ju2 + U_bar * u2
    shock_bar = g_bar * sigma * r * (1.0 - low) + x_bar * 0.25
    return (
        (r_bar, u0_bar, u1_bar, u2_bar, p_bar),
        (jr_bar, ju0_bar, ju1_bar, ju2_bar, jp_bar),
        (s0_bar, s1_bar, s2_bar),
        shock_bar,
    )
