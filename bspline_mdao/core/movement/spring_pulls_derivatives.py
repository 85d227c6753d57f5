"""Derivatives of `lineal_pull` and `angular_pull` and `solid_pull`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .spring_pulls import TINY, inverse_regularised, inverse_regularised_slope
from .trilinear import FLAT_CORNER


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def lineal_pull_jvp(a, b, factor, d_a, d_b):
    """Change of `lineal_pull` with ``a``, ``b``."""
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    (d_a0, d_a1, d_a2) = d_a
    (d_b0, d_b1, d_b2) = d_b
    edge0 = b0 - a0
    d_edge0 = d_b0 - d_a0
    edge1 = b1 - a1
    d_edge1 = d_b1 - d_a1
    edge2 = b2 - a2
    d_edge2 = d_b2 - d_a2
    part = edge0 * edge0 + edge1 * edge1 + edge2 * edge2
    d_part = 2.0 * edge0 * d_edge0 + 2.0 * edge1 * d_edge1 + 2.0 * edge2 * d_edge2
    part_2 = part + TINY
    d_part_2 = d_part
    part_3 = np.sqrt(part_2)
    d_part_3 = 0.5 * d_part_2 / part_3
    inverse = 1.0 / part_3
    d_inverse = -inverse * d_part_3 / part_3
    direction0 = inverse * edge0
    d_direction0 = edge0 * d_inverse + inverse * d_edge0
    direction1 = inverse * edge1
    d_direction1 = edge1 * d_inverse + inverse * d_edge1
    direction2 = inverse * edge2
    d_direction2 = edge2 * d_inverse + inverse * d_edge2
    factor_2 = factor * inverse
    d_factor_2 = factor * d_inverse
    d_pull0 = direction0 * d_factor_2 + factor_2 * d_direction0
    d_pull1 = direction1 * d_factor_2 + factor_2 * d_direction1
    d_pull2 = direction2 * d_factor_2 + factor_2 * d_direction2
    factor_3 = -1.0
    d_out00 = factor_3 * d_pull0
    d_out01 = factor_3 * d_pull1
    d_out02 = factor_3 * d_pull2
    return ((d_out00, d_out01, d_out02), (d_pull0, d_pull1, d_pull2))


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def angular_pull_jvp(vertex, a, b, factor, d_vertex, d_a, d_b):
    """Change of `angular_pull` with ``vertex``, ``a``, ``b``."""
    (vertex0, vertex1, vertex2) = vertex
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    (d_vertex0, d_vertex1, d_vertex2) = d_vertex
    (d_a0, d_a1, d_a2) = d_a
    (d_b0, d_b1, d_b2) = d_b
    edge0 = a0 - vertex0
    d_edge0 = d_a0 - d_vertex0
    edge1 = a1 - vertex1
    d_edge1 = d_a1 - d_vertex1
    edge2 = a2 - vertex2
    d_edge2 = d_a2 - d_vertex2
    part = edge0 * edge0 + edge1 * edge1 + edge2 * edge2
    d_part = 2.0 * edge0 * d_edge0 + 2.0 * edge1 * d_edge1 + 2.0 * edge2 * d_edge2
    part_2 = part + TINY
    d_part_2 = d_part
    part_3 = np.sqrt(part_2)
    d_part_3 = 0.5 * d_part_2 / part_3
    inverse = 1.0 / part_3
    d_inverse = -inverse * d_part_3 / part_3
    u0 = inverse * edge0
    d_u0 = edge0 * d_inverse + inverse * d_edge0
    u1 = inverse * edge1
    d_u1 = edge1 * d_inverse + inverse * d_edge1
    u2 = inverse * edge2
    d_u2 = edge2 * d_inverse + inverse * d_edge2
    edge0_2 = b0 - vertex0
    d_edge0_2 = d_b0 - d_vertex0
    edge1_2 = b1 - vertex1
    d_edge1_2 = d_b1 - d_vertex1
    edge2_2 = b2 - vertex2
    d_edge2_2 = d_b2 - d_vertex2
    part_4 = edge0_2 * edge0_2 + edge1_2 * edge1_2 + edge2_2 * edge2_2
    d_part_4 = 2.0 * edge0_2 * d_edge0_2 + 2.0 * edge1_2 * d_edge1_2 + 2.0 * edge2_2 * d_edge2_2
    part_5 = part_4 + TINY
    d_part_5 = d_part_4
    part_6 = np.sqrt(part_5)
    d_part_6 = 0.5 * d_part_5 / part_6
    inverse_v = 1.0 / part_6
    d_inverse_v = -inverse_v * d_part_6 / part_6
    v0 = inverse_v * edge0_2
    d_v0 = edge0_2 * d_inverse_v + inverse_v * d_edge0_2
    v1 = inverse_v * edge1_2
    d_v1 = edge1_2 * d_inverse_v + inverse_v * d_edge1_2
    v2 = inverse_v * edge2_2
    d_v2 = edge2_2 * d_inverse_v + inverse_v * d_edge2_2
    cosine = u0 * v0 + u1 * v1 + u2 * v2
    d_cosine = v0 * d_u0 + u0 * d_v0 + v1 * d_u1 + u1 * d_v1 + v2 * d_u2 + u2 * d_v2
    part_7 = 1.0 - cosine * cosine
    d_part_7 = -2.0 * cosine * d_cosine
    part_8 = inverse_regularised(part_7, FLAT_CORNER * FLAT_CORNER)
    d_part_8 = inverse_regularised_slope(part_7, FLAT_CORNER * FLAT_CORNER) * d_part_7
    slope = -factor * part_8
    d_slope = -factor * d_part_8
    factor_2 = slope * inverse
    d_factor_2 = inverse * d_slope + slope * d_inverse
    v0_2 = cosine * u0
    d_v0_2 = u0 * d_cosine + cosine * d_u0
    v1_2 = cosine * u1
    d_v1_2 = u1 * d_cosine + cosine * d_u1
    v2_2 = cosine * u2
    d_v2_2 = u2 * d_cosine + cosine * d_u2
    u0_2 = v0 - v0_2
    d_u0_2 = d_v0 - d_v0_2
    u1_2 = v1 - v1_2
    d_u1_2 = d_v1 - d_v1_2
    u2_2 = v2 - v2_2
    d_u2_2 = d_v2 - d_v2_2
    d_first0 = u0_2 * d_factor_2 + factor_2 * d_u0_2
    d_first1 = u1_2 * d_factor_2 + factor_2 * d_u1_2
    d_first2 = u2_2 * d_factor_2 + factor_2 * d_u2_2
    factor_3 = slope * inverse_v
    d_factor_3 = inverse_v * d_slope + slope * d_inverse_v
    v0_3 = cosine * v0
    d_v0_3 = v0 * d_cosine + cosine * d_v0
    v1_3 = cosine * v1
    d_v1_3 = v1 * d_cosine + cosine * d_v1
    v2_3 = cosine * v2
    d_v2_3 = v2 * d_cosine + cosine * d_v2
    u0_3 = u0 - v0_3
    d_u0_3 = d_u0 - d_v0_3
    u1_3 = u1 - v1_3
    d_u1_3 = d_u1 - d_v1_3
    u2_3 = u2 - v2_3
    d_u2_3 = d_u2 - d_v2_3
    d_second0 = u0_3 * d_factor_3 + factor_3 * d_u0_3
    d_second1 = u1_3 * d_factor_3 + factor_3 * d_u1_3
    d_second2 = u2_3 * d_factor_3 + factor_3 * d_u2_3
    factor_4 = -1.0
    d_u0_4 = d_first0 + d_second0
    d_u1_4 = d_first1 + d_second1
    d_u2_4 = d_first2 + d_second2
    d_out00 = factor_4 * d_u0_4
    d_out01 = factor_4 * d_u1_4
    d_out02 = factor_4 * d_u2_4
    return ((d_out00, d_out01, d_out02), (d_first0, d_first1, d_first2), (d_second0, d_second1, d_second2))


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def solid_pull_jvp(vertex, a, b, c, factor, sign, d_vertex, d_a, d_b, d_c):
    """Change of `solid_pull` with ``vertex``, ``a``, ``b``, ``c``."""
    (vertex0, vertex1, vertex2) = vertex
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    (c0, c1, c2) = c
    (d_vertex0, d_vertex1, d_vertex2) = d_vertex
    (d_a0, d_a1, d_a2) = d_a
    (d_b0, d_b1, d_b2) = d_b
    (d_c0, d_c1, d_c2) = d_c
    edge0 = a0 - vertex0
    d_edge0 = d_a0 - d_vertex0
    edge1 = a1 - vertex1
    d_edge1 = d_a1 - d_vertex1
    edge2 = a2 - vertex2
    d_edge2 = d_a2 - d_vertex2
    part = edge0 * edge0 + edge1 * edge1 + edge2 * edge2
    d_part = 2.0 * edge0 * d_edge0 + 2.0 * edge1 * d_edge1 + 2.0 * edge2 * d_edge2
    part_2 = part + TINY
    d_part_2 = d_part
    part_3 = np.sqrt(part_2)
    d_part_3 = 0.5 * d_part_2 / part_3
    inverse = 1.0 / part_3
    d_inverse = -inverse * d_part_3 / part_3
    u0 = inverse * edge0
    d_u0 = edge0 * d_inverse + inverse * d_edge0
    u1 = inverse * edge1
    d_u1 = edge1 * d_inverse + inverse * d_edge1
    u2 = inverse * edge2
    d_u2 = edge2 * d_inverse + inverse * d_edge2
    edge0_2 = b0 - vertex0
    d_edge0_2 = d_b0 - d_vertex0
    edge1_2 = b1 - vertex1
    d_edge1_2 = d_b1 - d_vertex1
    edge2_2 = b2 - vertex2
    d_edge2_2 = d_b2 - d_vertex2
    part_4 = edge0_2 * edge0_2 + edge1_2 * edge1_2 + edge2_2 * edge2_2
    d_part_4 = 2.0 * edge0_2 * d_edge0_2 + 2.0 * edge1_2 * d_edge1_2 + 2.0 * edge2_2 * d_edge2_2
    part_5 = part_4 + TINY
    d_part_5 = d_part_4
    part_6 = np.sqrt(part_5)
    d_part_6 = 0.5 * d_part_5 / part_6
    inverse_v = 1.0 / part_6
    d_inverse_v = -inverse_v * d_part_6 / part_6
    v0 = inverse_v * edge0_2
    d_v0 = edge0_2 * d_inverse_v + inverse_v * d_edge0_2
    v1 = inverse_v * edge1_2
    d_v1 = edge1_2 * d_inverse_v + inverse_v * d_edge1_2
    v2 = inverse_v * edge2_2
    d_v2 = edge2_2 * d_inverse_v + inverse_v * d_edge2_2
    edge0_3 = c0 - vertex0
    d_edge0_3 = d_c0 - d_vertex0
    edge1_3 = c1 - vertex1
    d_edge1_3 = d_c1 - d_vertex1
    edge2_3 = c2 - vertex2
    d_edge2_3 = d_c2 - d_vertex2
    part_7 = edge0_3 * edge0_3 + edge1_3 * edge1_3 + edge2_3 * edge2_3
    d_part_7 = 2.0 * edge0_3 * d_edge0_3 + 2.0 * edge1_3 * d_edge1_3 + 2.0 * edge2_3 * d_edge2_3
    part_8 = part_7 + TINY
    d_part_8 = d_part_7
    part_9 = np.sqrt(part_8)
    d_part_9 = 0.5 * d_part_8 / part_9
    inverse_w = 1.0 / part_9
    d_inverse_w = -inverse_w * d_part_9 / part_9
    w0 = inverse_w * edge0_3
    d_w0 = edge0_3 * d_inverse_w + inverse_w * d_edge0_3
    w1 = inverse_w * edge1_3
    d_w1 = edge1_3 * d_inverse_w + inverse_w * d_edge1_3
    w2 = inverse_w * edge2_3
    d_w2 = edge2_3 * d_inverse_w + inverse_w * d_edge2_3
    vw0 = v1 * w2 - v2 * w1
    d_vw0 = w2 * d_v1 + v1 * d_w2 - w1 * d_v2 - v2 * d_w1
    vw1 = v2 * w0 - v0 * w2
    d_vw1 = w0 * d_v2 + v2 * d_w0 - w2 * d_v0 - v0 * d_w2
    vw2 = v0 * w1 - v1 * w0
    d_vw2 = w1 * d_v0 + v0 * d_w1 - w0 * d_v1 - v1 * d_w0
    wu0 = w1 * u2 - w2 * u1
    d_wu0 = u2 * d_w1 + w1 * d_u2 - u1 * d_w2 - w2 * d_u1
    wu1 = w2 * u0 - w0 * u2
    d_wu1 = u0 * d_w2 + w2 * d_u0 - u2 * d_w0 - w0 * d_u2
    wu2 = w0 * u1 - w1 * u0
    d_wu2 = u1 * d_w0 + w0 * d_u1 - u0 * d_w1 - w1 * d_u0
    uv0 = u1 * v2 - u2 * v1
    d_uv0 = v2 * d_u1 + u1 * d_v2 - v1 * d_u2 - u2 * d_v1
    uv1 = u2 * v0 - u0 * v2
    d_uv1 = v0 * d_u2 + u2 * d_v0 - v2 * d_u0 - u0 * d_v2
    uv2 = u0 * v1 - u1 * v0
    d_uv2 = v1 * d_u0 + u0 * d_v1 - v0 * d_u1 - u1 * d_v0
    t = u0 * vw0 + u1 * vw1 + u2 * vw2
    d_t = vw0 * d_u0 + u0 * d_vw0 + vw1 * d_u1 + u1 * d_vw1 + vw2 * d_u2 + u2 * d_vw2
    part_10 = sign * t
    d_part_10 = sign * d_t
    part_11 = inverse_regularised(part_10, FLAT_CORNER)
    d_part_11 = inverse_regularised_slope(part_10, FLAT_CORNER) * d_part_10
    slope = sign * factor * part_11
    d_slope = sign * factor * d_part_11
    factor_2 = slope * inverse
    d_factor_2 = inverse * d_slope + slope * d_inverse
    v0_2 = t * u0
    d_v0_2 = u0 * d_t + t * d_u0
    v1_2 = t * u1
    d_v1_2 = u1 * d_t + t * d_u1
    v2_2 = t * u2
    d_v2_2 = u2 * d_t + t * d_u2
    u0_2 = vw0 - v0_2
    d_u0_2 = d_vw0 - d_v0_2
    u1_2 = vw1 - v1_2
    d_u1_2 = d_vw1 - d_v1_2
    u2_2 = vw2 - v2_2
    d_u2_2 = d_vw2 - d_v2_2
    d_first0 = u0_2 * d_factor_2 + factor_2 * d_u0_2
    d_first1 = u1_2 * d_factor_2 + factor_2 * d_u1_2
    d_first2 = u2_2 * d_factor_2 + factor_2 * d_u2_2
    factor_3 = slope * inverse_v
    d_factor_3 = inverse_v * d_slope + slope * d_inverse_v
    v0_3 = t * v0
    d_v0_3 = v0 * d_t + t * d_v0
    v1_3 = t * v1
    d_v1_3 = v1 * d_t + t * d_v1
    v2_3 = t * v2
    d_v2_3 = v2 * d_t + t * d_v2
    u0_3 = wu0 - v0_3
    d_u0_3 = d_wu0 - d_v0_3
    u1_3 = wu1 - v1_3
    d_u1_3 = d_wu1 - d_v1_3
    u2_3 = wu2 - v2_3
    d_u2_3 = d_wu2 - d_v2_3
    d_second0 = u0_3 * d_factor_3 + factor_3 * d_u0_3
    d_second1 = u1_3 * d_factor_3 + factor_3 * d_u1_3
    d_second2 = u2_3 * d_factor_3 + factor_3 * d_u2_3
    factor_4 = slope * inverse_w
    d_factor_4 = inverse_w * d_slope + slope * d_inverse_w
    v0_4 = t * w0
    d_v0_4 = w0 * d_t + t * d_w0
    v1_4 = t * w1
    d_v1_4 = w1 * d_t + t * d_w1
    v2_4 = t * w2
    d_v2_4 = w2 * d_t + t * d_w2
    u0_4 = uv0 - v0_4
    d_u0_4 = d_uv0 - d_v0_4
    u1_4 = uv1 - v1_4
    d_u1_4 = d_uv1 - d_v1_4
    u2_4 = uv2 - v2_4
    d_u2_4 = d_uv2 - d_v2_4
    d_third0 = u0_4 * d_factor_4 + factor_4 * d_u0_4
    d_third1 = u1_4 * d_factor_4 + factor_4 * d_u1_4
    d_third2 = u2_4 * d_factor_4 + factor_4 * d_u2_4
    d_v0_5 = d_second0 + d_third0
    d_v1_5 = d_second1 + d_third1
    d_v2_5 = d_second2 + d_third2
    factor_5 = -1.0
    d_u0_5 = d_first0 + d_v0_5
    d_u1_5 = d_first1 + d_v1_5
    d_u2_5 = d_first2 + d_v2_5
    d_out00 = factor_5 * d_u0_5
    d_out01 = factor_5 * d_u1_5
    d_out02 = factor_5 * d_u2_5
    return (
        (d_out00, d_out01, d_out02),
        (d_first0, d_first1, d_first2),
        (d_second0, d_second1, d_second2),
        (d_third0, d_third1, d_third2),
    )
