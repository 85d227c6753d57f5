"""Derivatives of `face_centre`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .face_centre import FLAT


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def face_centre_jvp(a, b, c, d, d_a, d_b, d_c, d_d):
    """Change of `face_centre` with ``a``, ``b``, ``c``, ``d``."""
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    (c0, c1, c2) = c
    (d0, d1, d2) = d
    (d_a0, d_a1, d_a2) = d_a
    (d_b0, d_b1, d_b2) = d_b
    (d_c0, d_c1, d_c2) = d_c
    (d_d0, d_d1, d_d2) = d_d
    ab0 = b0 - a0
    d_ab0 = d_b0 - d_a0
    ab1 = b1 - a1
    d_ab1 = d_b1 - d_a1
    ab2 = b2 - a2
    d_ab2 = d_b2 - d_a2
    ac0 = c0 - a0
    d_ac0 = d_c0 - d_a0
    ac1 = c1 - a1
    d_ac1 = d_c1 - d_a1
    ac2 = c2 - a2
    d_ac2 = d_c2 - d_a2
    ad0 = d0 - a0
    d_ad0 = d_d0 - d_a0
    ad1 = d1 - a1
    d_ad1 = d_d1 - d_a1
    ad2 = d2 - a2
    d_ad2 = d_d2 - d_a2
    bc0 = c0 - b0
    d_bc0 = d_c0 - d_b0
    bc1 = c1 - b1
    d_bc1 = d_c1 - d_b1
    bc2 = c2 - b2
    d_bc2 = d_c2 - d_b2
    bd0 = d0 - b0
    d_bd0 = d_d0 - d_b0
    bd1 = d1 - b1
    d_bd1 = d_d1 - d_b1
    bd2 = d2 - b2
    d_bd2 = d_d2 - d_b2
    part = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    d_part = 2.0 * ac0 * d_ac0 + 2.0 * ac1 * d_ac1 + 2.0 * ac2 * d_ac2
    part_2 = bd0 * bd0 + bd1 * bd1 + bd2 * bd2
    d_part_2 = 2.0 * bd0 * d_bd0 + 2.0 * bd1 * d_bd1 + 2.0 * bd2 * d_bd2
    square = part + part_2
    d_square = d_part + d_part_2
    flat = FLAT**2 * square * square
    d_flat = square * FLAT**2 * d_square + FLAT**2 * square * d_square
    first0 = 0.5 * (ab1 * ac2 - ab2 * ac1)
    d_first0 = 0.5 * (ac2 * d_ab1 + ab1 * d_ac2 - ac1 * d_ab2 - ab2 * d_ac1)
    first1 = 0.5 * (ab2 * ac0 - ab0 * ac2)
    d_first1 = 0.5 * (ac0 * d_ab2 + ab2 * d_ac0 - ac2 * d_ab0 - ab0 * d_ac2)
    first2 = 0.5 * (ab0 * ac1 - ab1 * ac0)
    d_first2 = 0.5 * (ac1 * d_ab0 + ab0 * d_ac1 - ac0 * d_ab1 - ab1 * d_ac0)
    second0 = 0.5 * (ac1 * ad2 - ac2 * ad1)
    d_second0 = 0.5 * (ad2 * d_ac1 + ac1 * d_ad2 - ad1 * d_ac2 - ac2 * d_ad1)
    second1 = 0.5 * (ac2 * ad0 - ac0 * ad2)
    d_second1 = 0.5 * (ad0 * d_ac2 + ac2 * d_ad0 - ad2 * d_ac0 - ac0 * d_ad2)
    second2 = 0.5 * (ac0 * ad1 - ac1 * ad0)
    d_second2 = 0.5 * (ad1 * d_ac0 + ac0 * d_ad1 - ad0 * d_ac1 - ac1 * d_ad0)
    third0 = 0.5 * (ab1 * ad2 - ab2 * ad1)
    d_third0 = 0.5 * (ad2 * d_ab1 + ab1 * d_ad2 - ad1 * d_ab2 - ab2 * d_ad1)
    third1 = 0.5 * (ab2 * ad0 - ab0 * ad2)
    d_third1 = 0.5 * (ad0 * d_ab2 + ab2 * d_ad0 - ad2 * d_ab0 - ab0 * d_ad2)
    third2 = 0.5 * (ab0 * ad1 - ab1 * ad0)
    d_third2 = 0.5 * (ad1 * d_ab0 + ab0 * d_ad1 - ad0 * d_ab1 - ab1 * d_ad0)
    fourth0 = 0.5 * (bc1 * bd2 - bc2 * bd1)
    d_fourth0 = 0.5 * (bd2 * d_bc1 + bc1 * d_bd2 - bd1 * d_bc2 - bc2 * d_bd1)
    fourth1 = 0.5 * (bc2 * bd0 - bc0 * bd2)
    d_fourth1 = 0.5 * (bd0 * d_bc2 + bc2 * d_bd0 - bd2 * d_bc0 - bc0 * d_bd2)
    fourth2 = 0.5 * (bc0 * bd1 - bc1 * bd0)
    d_fourth2 = 0.5 * (bd1 * d_bc0 + bc0 * d_bd1 - bd0 * d_bc1 - bc1 * d_bd0)
    d_area0 = d_first0 + d_second0
    d_area1 = d_first1 + d_second1
    d_area2 = d_first2 + d_second2
    part_3 = first0 * first0 + first1 * first1 + first2 * first2
    d_part_3 = 2.0 * first0 * d_first0 + 2.0 * first1 * d_first1 + 2.0 * first2 * d_first2
    part_4 = part_3 + flat
    d_part_4 = d_part_3 + d_flat
    p = np.sqrt(part_4)
    d_p = 0.5 * d_part_4 / p
    part_6 = second0 * second0 + second1 * second1 + second2 * second2
    d_part_6 = 2.0 * second0 * d_second0 + 2.0 * second1 * d_second1 + 2.0 * second2 * d_second2
    part_7 = part_6 + flat
    d_part_7 = d_part_6 + d_flat
    q = np.sqrt(part_7)
    d_q = 0.5 * d_part_7 / q
    part_5 = third0 * third0 + third1 * third1 + third2 * third2
    d_part_5 = 2.0 * third0 * d_third0 + 2.0 * third1 * d_third1 + 2.0 * third2 * d_third2
    part_8 = part_5 + flat
    d_part_8 = d_part_5 + d_flat
    r = np.sqrt(part_8)
    d_r = 0.5 * d_part_8 / r
    part_10 = fourth0 * fourth0 + fourth1 * fourth1 + fourth2 * fourth2
    d_part_10 = 2.0 * fourth0 * d_fourth0 + 2.0 * fourth1 * d_fourth1 + 2.0 * fourth2 * d_fourth2
    part_11 = part_10 + flat
    d_part_11 = d_part_10 + d_flat
    s = np.sqrt(part_11)
    d_s = 0.5 * d_part_11 / s
    abc0 = a0 + b0 + c0
    d_abc0 = d_a0 + d_b0 + d_c0
    abc1 = a1 + b1 + c1
    d_abc1 = d_a1 + d_b1 + d_c1
    abc2 = a2 + b2 + c2
    d_abc2 = d_a2 + d_b2 + d_c2
    acd0 = a0 + c0 + d0
    d_acd0 = d_a0 + d_c0 + d_d0
    acd1 = a1 + c1 + d1
    d_acd1 = d_a1 + d_c1 + d_d1
    acd2 = a2 + c2 + d2
    d_acd2 = d_a2 + d_c2 + d_d2
    abd0 = a0 + b0 + d0
    d_abd0 = d_a0 + d_b0 + d_d0
    abd1 = a1 + b1 + d1
    d_abd1 = d_a1 + d_b1 + d_d1
    abd2 = a2 + b2 + d2
    d_abd2 = d_a2 + d_b2 + d_d2
    bcd0 = b0 + c0 + d0
    d_bcd0 = d_b0 + d_c0 + d_d0
    bcd1 = b1 + c1 + d1
    d_bcd1 = d_b1 + d_c1 + d_d1
    bcd2 = b2 + c2 + d2
    d_bcd2 = d_b2 + d_c2 + d_d2
    total = 3.0 * (p + q + r + s)
    d_total = 3.0 * (d_p + d_q + d_r + d_s)
    centre0 = (p * abc0 + q * acd0 + r * abd0 + s * bcd0) / total
    d_centre0 = (
        abc0 * d_p
        + p * d_abc0
        + acd0 * d_q
        + q * d_acd0
        + abd0 * d_r
        + r * d_abd0
        + bcd0 * d_s
        + s * d_bcd0
        - centre0 * d_total
    ) / total
    centre1 = (p * abc1 + q * acd1 + r * abd1 + s * bcd1) / total
    d_centre1 = (
        abc1 * d_p
        + p * d_abc1
        + acd1 * d_q
        + q * d_acd1
        + abd1 * d_r
        + r * d_abd1
        + bcd1 * d_s
        + s * d_bcd1
        - centre1 * d_total
    ) / total
    centre2 = (p * abc2 + q * acd2 + r * abd2 + s * bcd2) / total
    d_centre2 = (
        abc2 * d_p
        + p * d_abc2
        + acd2 * d_q
        + q * d_acd2
        + abd2 * d_r
        + r * d_abd2
        + bcd2 * d_s
        + s * d_bcd2
        - centre2 * d_total
    ) / total
    return ((d_centre0, d_centre1, d_centre2), (d_area0, d_area1, d_area2))


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def face_centre_vjp(a, b, c, d, bar):
    """Transpose of `face_centre_jvp`: derivatives with respect to ``a``, ``b``, ``c``, ``d``."""
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    (c0, c1, c2) = c
    (d0, d1, d2) = d
    ((bar0, bar1, bar2), (bar3, bar4, bar5)) = bar
    ab0 = b0 - a0
    ab1 = b1 - a1
    ab2 = b2 - a2
    ac0 = c0 - a0
    ac1 = c1 - a1
    ac2 = c2 - a2
    ad0 = d0 - a0
    ad1 = d1 - a1
    ad2 = d2 - a2
    bc0 = c0 - b0
    bc1 = c1 - b1
    bc2 = c2 - b2
    bd0 = d0 - b0
    bd1 = d1 - b1
    bd2 = d2 - b2
    part = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    part_2 = bd0 * bd0 + bd1 * bd1 + bd2 * bd2
    square = part + part_2
    flat = FLAT**2 * square * square
    first0 = 0.5 * (ab1 * ac2 - ab2 * ac1)
    first1 = 0.5 * (ab2 * ac0 - ab0 * ac2)
    first2 = 0.5 * (ab0 * ac1 - ab1 * ac0)
    second0 = 0.5 * (ac1 * ad2 - ac2 * ad1)
    second1 = 0.5 * (ac2 * ad0 - ac0 * ad2)
    second2 = 0.5 * (ac0 * ad1 - ac1 * ad0)
    third0 = 0.5 * (ab1 * ad2 - ab2 * ad1)
    third1 = 0.5 * (ab2 * ad0 - ab0 * ad2)
    third2 = 0.5 * (ab0 * ad1 - ab1 * ad0)
    fourth0 = 0.5 * (bc1 * bd2 - bc2 * bd1)
    fourth1 = 0.5 * (bc2 * bd0 - bc0 * bd2)
    fourth2 = 0.5 * (bc0 * bd1 - bc1 * bd0)
    part_3 = first0 * first0 + first1 * first1 + first2 * first2
    part_4 = part_3 + flat
    p = np.sqrt(part_4)
    part_6 = second0 * second0 + second1 * second1 + second2 * second2
    part_7 = part_6 + flat
    q = np.sqrt(part_7)
    part_5 = third0 * third0 + third1 * third1 + third2 * third2
    part_8 = part_5 + flat
    r = np.sqrt(part_8)
    part_10 = fourth0 * fourth0 + fourth1 * fourth1 + fourth2 * fourth2
    part_11 = part_10 + flat
    s = np.sqrt(part_11)
    abc0 = a0 + b0 + c0
    abc1 = a1 + b1 + c1
    abc2 = a2 + b2 + c2
    acd0 = a0 + c0 + d0
    acd1 = a1 + c1 + d1
    acd2 = a2 + c2 + d2
    abd0 = a0 + b0 + d0
    abd1 = a1 + b1 + d1
    abd2 = a2 + b2 + d2
    bcd0 = b0 + c0 + d0
    bcd1 = b1 + c1 + d1
    bcd2 = b2 + c2 + d2
    total = 3.0 * (p + q + r + s)
    centre0 = (p * abc0 + q * acd0 + r * abd0 + s * bcd0) / total
    centre1 = (p * abc1 + q * acd1 + r * abd1 + s * bcd1) / total
    centre2 = (p * abc2 + q * acd2 + r * abd2 + s * bcd2) / total
    centre2_bar = bar2
    centre1_bar = bar1
    centre0_bar = bar0
    total_bar = -(centre2_bar / total * centre2) - centre1_bar / total * centre1 - centre0_bar / total * centre0
    bcd2_bar = centre2_bar / total * s
    bcd1_bar = centre1_bar / total * s
    bcd0_bar = centre0_bar / total * s
    abd2_bar = centre2_bar / total * r
    abd1_bar = centre1_bar / total * r
    abd0_bar = centre0_bar / total * r
    acd2_bar = centre2_bar / total * q
    acd1_bar = centre1_bar / total * q
    acd0_bar = centre0_bar / total * q
    abc2_bar = centre2_bar / total * p
    abc1_bar = centre1_bar / total * p
    abc0_bar = centre0_bar / total * p
    s_bar = centre2_bar / total * bcd2 + centre1_bar / total * bcd1 + centre0_bar / total * bcd0 + total_bar * 3.0
    part_11_bar = s_bar / s * 0.5
    part_10_bar = part_11_bar
    r_bar = centre2_bar / total * abd2 + centre1_bar / total * abd1 + centre0_bar / total * abd0 + total_bar * 3.0
    part_8_bar = r_bar / r * 0.5
    part_5_bar = part_8_bar
    q_bar = centre2_bar / total * acd2 + centre1_bar / total * acd1 + centre0_bar / total * acd0 + total_bar * 3.0
    part_7_bar = q_bar / q * 0.5
    part_6_bar = part_7_bar
    p_bar = centre2_bar / total * abc2 + centre1_bar / total * abc1 + centre0_bar / total * abc0 + total_bar * 3.0
    part_4_bar = p_bar / p * 0.5
    part_3_bar = part_4_bar
    area2_bar = bar5
    area1_bar = bar4
    area0_bar = bar3
    fourth2_bar = part_10_bar * 2.0 * fourth2
    fourth1_bar = part_10_bar * 2.0 * fourth1
    fourth0_bar = part_10_bar * 2.0 * fourth0
    third2_bar = part_5_bar * 2.0 * third2
    third1_bar = part_5_bar * 2.0 * third1
    third0_bar = part_5_bar * 2.0 * third0
    second2_bar = part_6_bar * 2.0 * second2 + area2_bar
    second1_bar = part_6_bar * 2.0 * second1 + area1_bar
    second0_bar = part_6_bar * 2.0 * second0 + area0_bar
    first2_bar = part_3_bar * 2.0 * first2 + area2_bar
    first1_bar = part_3_bar * 2.0 * first1 + area1_bar
    first0_bar = part_3_bar * 2.0 * first0 + area0_bar
    flat_bar = part_11_bar + part_8_bar + part_7_bar + part_4_bar
    square_bar = flat_bar * square * FLAT**2 + flat_bar * FLAT**2 * square
    part_2_bar = square_bar
    part_bar = square_bar
    bd2_bar = fourth0_bar * 0.5 * bc1 + part_2_bar * 2.0 * bd2 - fourth1_bar * 0.5 * bc0
    bd1_bar = fourth2_bar * 0.5 * bc0 + part_2_bar * 2.0 * bd1 - fourth0_bar * 0.5 * bc2
    bd0_bar = fourth1_bar * 0.5 * bc2 + part_2_bar * 2.0 * bd0 - fourth2_bar * 0.5 * bc1
    bc2_bar = fourth1_bar * 0.5 * bd0 - fourth0_bar * 0.5 * bd1
    bc1_bar = fourth0_bar * 0.5 * bd2 - fourth2_bar * 0.5 * bd0
    bc0_bar = fourth2_bar * 0.5 * bd1 - fourth1_bar * 0.5 * bd2
    ad2_bar = third0_bar * 0.5 * ab1 + second0_bar * 0.5 * ac1 - third1_bar * 0.5 * ab0 - second1_bar * 0.5 * ac0
    ad1_bar = third2_bar * 0.5 * ab0 + second2_bar * 0.5 * ac0 - third0_bar * 0.5 * ab2 - second0_bar * 0.5 * ac2
    ad0_bar = third1_bar * 0.5 * ab2 + second1_bar * 0.5 * ac2 - third2_bar * 0.5 * ab1 - second2_bar * 0.5 * ac1
    ac2_bar = (
        second1_bar * 0.5 * ad0
        + first0_bar * 0.5 * ab1
        + part_bar * 2.0 * ac2
        - second0_bar * 0.5 * ad1
        - first1_bar * 0.5 * ab0
    )
    ac1_bar = (
        second0_bar * 0.5 * ad2
        + first2_bar * 0.5 * ab0
        + part_bar * 2.0 * ac1
        - second2_bar * 0.5 * ad0
        - first0_bar * 0.5 * ab2
    )
    ac0_bar = (
        second2_bar * 0.5 * ad1
        + first1_bar * 0.5 * ab2
        + part_bar * 2.0 * ac0
        - second1_bar * 0.5 * ad2
        - first2_bar * 0.5 * ab1
    )
    ab2_bar = third1_bar * 0.5 * ad0 + first1_bar * 0.5 * ac0 - third0_bar * 0.5 * ad1 - first0_bar * 0.5 * ac1
    ab1_bar = third0_bar * 0.5 * ad2 + first0_bar * 0.5 * ac2 - third2_bar * 0.5 * ad0 - first2_bar * 0.5 * ac0
    ab0_bar = third2_bar * 0.5 * ad1 + first2_bar * 0.5 * ac1 - third1_bar * 0.5 * ad2 - first1_bar * 0.5 * ac2
    a0_bar = abd0_bar + acd0_bar + abc0_bar - ad0_bar - ac0_bar - ab0_bar
    a1_bar = abd1_bar + acd1_bar + abc1_bar - ad1_bar - ac1_bar - ab1_bar
    a2_bar = abd2_bar + acd2_bar + abc2_bar - ad2_bar - ac2_bar - ab2_bar
    b0_bar = bcd0_bar + abd0_bar + abc0_bar + ab0_bar - bd0_bar - bc0_bar
    b1_bar = bcd1_bar + abd1_bar + abc1_bar + ab1_bar - bd1_bar - bc1_bar
    b2_bar = bcd2_bar + abd2_bar + abc2_bar + ab2_bar - bd2_bar - bc2_bar
    c0_bar = bcd0_bar + acd0_bar + abc0_bar + bc0_bar + ac0_bar
    c1_bar = bcd1_bar + acd1_bar + abc1_bar + bc1_bar + ac1_bar
    c2_bar = bcd2_bar + acd2_bar + abc2_bar + bc2_bar + ac2_bar
    d0_bar = bcd0_bar + abd0_bar + acd0_bar + bd0_bar + ad0_bar
    d1_bar = bcd1_bar + abd1_bar + acd1_bar + bd1_bar + ad1_bar
    d2_bar = bcd2_bar + abd2_bar + acd2_bar + bd2_bar + ad2_bar
    return ((a0_bar, a1_bar, a2_bar), (b0_bar, b1_bar, b2_bar), (c0_bar, c1_bar, c2_bar), (d0_bar, d1_bar, d2_bar))
