"""Orthogonality Q of a hexahedral cell, Eq. (9), with its Jacobians and its volume: formulas and derivatives.

Corners are numbered ``c = a + 2 b + 4 d`` with a, b, d = 0, 1 along i, j, k. The three edges that meet at a corner are
taken in the direction of rising index, whichever end the corner is on::

        6-------7
       /|      /|        k
      4-------5 |        | j
      | 2-----|-3        |/
      |/      |/         0--- i
      0-------1

Eq. (9) is the product of the corner triple products of unit edges, ``Q = prod_c (u_c x v_c) . w_c``. The triple product
of the edges themselves is the Jacobian of the corner. Every formula is written here once, as straight-line code on the
twelve edges of one cell, given as three tuples of four, along i, j and k, each edge a tuple of its components.
`.cell_loops` calls it for all cells of a block or a list. Each value has its change (``_jvp``) and its transpose
(``_vjp``).

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.lanes import inverse_root

__all__ = [
    "FAST",
    "TINY",
    "at_corners",
    "between",
    "cell_volume",
    "cell_volume_jvp",
    "cell_volume_vjp",
    "corner_jvp",
    "corner_measures",
    "corner_vjp",
    "edges_vjp",
    "inverse_length",
    "inverse_lengths",
    "orthogonality",
    "orthogonality_jvp",
    "orthogonality_vjp",
]

FAST = {"cache": True, "nogil": True, "error_model": "numpy", "forceinline": True, "fastmath": {"contract"}}
"""Options for straight-line code: compiled into its caller, whose loop over cells then becomes SIMD instructions;
products and sums may be fused, which round once instead of twice."""

TINY = 1e-190
"""Added to a squared length before its root is inverted, so that an edge of no length has a triple product of 0. It
must not be smaller: a corner takes the product of three such inverses, 1e95 each."""


def orthogonality(
    triples: np.ndarray,  # corner triple products, the corners along ``axis``; 1 at degenerate corners
    axis: int = -1,  # axis of the corners
) -> np.ndarray:
    """Q of Eq. (9), the product of the corner triple products."""
    return np.prod(triples, axis=axis)


def orthogonality_jvp(triples: np.ndarray, d_triples: np.ndarray, axis: int = -1) -> np.ndarray:
    """Change of Q with the corner triple products, arrays as for `orthogonality`."""
    return np.sum(_products_of_others(triples, axis) * d_triples, axis=axis)


def orthogonality_vjp(triples: np.ndarray, q_bar: np.ndarray, axis: int = -1) -> np.ndarray:
    """Adjoint of the corner triple products from the adjoint of Q, arrays as for `orthogonality`."""
    return _products_of_others(triples, axis) * np.expand_dims(q_bar, axis)


def _products_of_others(triples: np.ndarray, axis: int) -> np.ndarray:
    """Products of all corners but one: Q divided by one triple product, which may itself be zero."""
    corners = np.moveaxis(triples, axis, 0)
    others = np.ones_like(corners)
    for corner in range(1, len(corners)):  # row by row, which NumPy's cumprod does not support
        np.multiply(others[corner - 1], corners[corner - 1], out=others[corner])
    following = np.ones_like(corners[0])
    for corner in range(len(corners) - 2, -1, -1):
        following *= corners[corner + 1]
        others[corner] *= following
    return np.moveaxis(others, 0, axis)


@njit(**FAST)
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(**FAST)
def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(**FAST)
def at_corners(xi, eta, zeta):
    """Gather values of the twelve edges into triples for the eight corners."""
    return (
        (xi[0], eta[0], zeta[0]),
        (xi[0], eta[1], zeta[1]),
        (xi[1], eta[0], zeta[2]),
        (xi[1], eta[1], zeta[3]),
        (xi[2], eta[2], zeta[0]),
        (xi[2], eta[3], zeta[1]),
        (xi[3], eta[2], zeta[2]),
        (xi[3], eta[3], zeta[3]),
    )


@njit(**FAST)
def between(p, q):
    """Vector from one point to another."""
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@njit(**FAST)
def inverse_length(e):
    """Inverse length of an edge."""
    return inverse_root(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + TINY)


@njit(**FAST)
def inverse_lengths(edges):
    """Inverse lengths of four edges."""
    return inverse_length(edges[0]), inverse_length(edges[1]), inverse_length(edges[2]), inverse_length(edges[3])


@njit(**FAST)
def corner_measures(sign, edges, inverses):
    """Triple product of unit edges, a factor of Eq. (9), and Jacobian of a corner: ``t = J / (|a| |b| |c|)``."""
    jacobian = sign * _dot(_cross(edges[0], edges[1]), edges[2])
    return jacobian * (inverses[0] * inverses[1] * inverses[2]), jacobian


@njit(**FAST)
def corner_jvp(sign, edges, inverses, changes):
    """Change of `corner_measures`."""
    # ``dJ = (b x c) . da + (c x a) . db + (a x b) . dc`` and ``dt = dJ / (|a| |b| |c|) - t sum_e (e . de) / |e|^2``.
    (a, b, c), (i_a, i_b, i_c), (d_a, d_b, d_c) = edges, inverses, changes
    ab = _cross(a, b)
    change = sign * (_dot(_cross(b, c), d_a) + _dot(_cross(c, a), d_b) + _dot(ab, d_c))
    stretch = i_a * i_a * _dot(a, d_a) + i_b * i_b * _dot(b, d_b) + i_c * i_c * _dot(c, d_c)
    return (i_a * i_b * i_c) * (change - sign * _dot(ab, c) * stretch), change


@njit(**FAST)
def corner_vjp(sign, edges, inverses, triple_bar, jacobian_bar):
    """Transpose of `corner_jvp`: adjoints of the three edges of a corner without their stretch, and of the stretch."""
    (a, b, c), (i_a, i_b, i_c) = edges, inverses
    ab, scaled = _cross(a, b), sign * triple_bar * (i_a * i_b * i_c)
    factor = sign * jacobian_bar + scaled
    return _times(factor, _cross(b, c)), _times(factor, _cross(c, a)), _times(factor, ab), scaled * _dot(ab, c)


@njit(**FAST)
def _times(factor, p):
    return factor * p[0], factor * p[1], factor * p[2]


@njit(**FAST)
def _edge_bar(edge, inverse, p, q, shrink, r):
    """Adjoint of an edge from its two corners and their stretch, and from the volume."""
    s = shrink * (inverse * inverse)
    return p[0] + q[0] - s * edge[0] + r[0], p[1] + q[1] - s * edge[1] + r[1], p[2] + q[2] - s * edge[2] + r[2]


@njit(**FAST)
def edges_vjp(edges, inverses, corner_bars, volume_bars):
    """Transpose of `at_corners`: adjoints of the twelve edges, from the corners and from the volume."""
    b0, b1, b2, b3, b4, b5, b6, b7 = corner_bars
    (e, f, g), (i, j, k), (a, b, c) = edges, inverses, volume_bars
    return (
        (
            _edge_bar(e[0], i[0], b0[0], b1[0], b0[3] + b1[3], a[0]),
            _edge_bar(e[1], i[1], b2[0], b3[0], b2[3] + b3[3], a[1]),
            _edge_bar(e[2], i[2], b4[0], b5[0], b4[3] + b5[3], a[2]),
            _edge_bar(e[3], i[3], b6[0], b7[0], b6[3] + b7[3], a[3]),
        ),
        (
            _edge_bar(f[0], j[0], b0[1], b2[1], b0[3] + b2[3], b[0]),
            _edge_bar(f[1], j[1], b1[1], b3[1], b1[3] + b3[3], b[1]),
            _edge_bar(f[2], j[2], b4[1], b6[1], b4[3] + b6[3], b[2]),
            _edge_bar(f[3], j[3], b5[1], b7[1], b5[3] + b7[3], b[3]),
        ),
        (
            _edge_bar(g[0], k[0], b0[2], b4[2], b0[3] + b4[3], c[0]),
            _edge_bar(g[1], k[1], b1[2], b5[2], b1[3] + b5[3], c[1]),
            _edge_bar(g[2], k[2], b2[2], b6[2], b2[3] + b6[3], c[2]),
            _edge_bar(g[3], k[3], b3[2], b7[2], b3[3] + b7[3], c[3]),
        ),
    )


@njit(**FAST)
def _sum(p, q, r, s):
    return p[0] + q[0] + r[0] + s[0], p[1] + q[1] + r[1] + s[1], p[2] + q[2] + r[2] + s[2]


@njit(**FAST)
def _change_across(p, q, r, s):
    """From the edges p, q on one side of the cell to r, s on the other."""
    return r[0] + s[0] - p[0] - q[0], r[1] + s[1] - p[1] - q[1], r[2] + s[2] - p[2] - q[2]


@njit(**FAST)
def _shape_vectors(i, j, k):
    """Four times the mean edges a, b, c of a cell and twice the coefficients d, e, f of xi eta, eta zeta, zeta xi."""
    return (
        _sum(i[0], i[1], i[2], i[3]),
        _sum(j[0], j[1], j[2], j[3]),
        _sum(k[0], k[1], k[2], k[3]),
        _change_across(i[0], i[2], i[1], i[3]),
        _change_across(j[0], j[1], j[2], j[3]),
        _change_across(i[0], i[1], i[2], i[3]),
    )


@njit(**FAST)
def cell_volume(i, j, k):
    """Volume of a trilinear cell: its Jacobian integrated term by term."""
    # ``V = [a, b, c] + ([a, d, f] + [d, b, e] + [f, e, c]) / 12`` with the mean edges a, b, c and the coefficients d,
    # e, f of xi eta, eta zeta, zeta xi of the trilinear mapping; the multiples that `_shape_vectors` returns are
    # divided out.
    a, b, c, d, e, f = _shape_vectors(i, j, k)
    product = _dot(_cross(a, b), c)
    products = _dot(_cross(a, d), f) + _dot(_cross(d, b), e) + _dot(_cross(f, e), c)
    return (product + products * (1.0 / 3.0)) * (1.0 / 64.0)


@njit(**FAST)
def _combine(p, scale, q):
    return p[0] + scale * q[0], p[1] + scale * q[1], p[2] + scale * q[2]


@njit(**FAST)
def _volume_gradient(vectors):
    """Gradient of 64 volumes with respect to the six vectors of `_shape_vectors`; of the last three, three times it."""
    a, b, c, d, e, f = vectors
    third = 1.0 / 3.0
    return (
        _combine(_cross(b, c), third, _cross(d, f)),
        _combine(_cross(c, a), third, _cross(e, d)),
        _combine(_cross(a, b), third, _cross(f, e)),
        _combine(_cross(f, a), 1.0, _cross(b, e)),
        _combine(_cross(d, b), 1.0, _cross(c, f)),
        _combine(_cross(a, d), 1.0, _cross(e, c)),
    )


@njit(**FAST)
def cell_volume_jvp(edges, changes):
    """Change of the volume with the edges."""
    g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(_shape_vectors(edges[0], edges[1], edges[2]))
    d_a, d_b, d_c, d_d, d_e, d_f = _shape_vectors(changes[0], changes[1], changes[2])
    straight = _dot(g_a, d_a) + _dot(g_b, d_b) + _dot(g_c, d_c)
    twisted = _dot(g_d, d_d) + _dot(g_e, d_e) + _dot(g_f, d_f)
    return (straight + twisted * (1.0 / 3.0)) * (1.0 / 64.0)


@njit(**FAST)
def _weighted(mean, s, p, t, q, scale):
    """``scale (mean + (s p + t q) / 3)``."""
    s, t = s / 3.0, t / 3.0
    return (
        scale * (mean[0] + s * p[0] + t * q[0]),
        scale * (mean[1] + s * p[1] + t * q[1]),
        scale * (mean[2] + s * p[2] + t * q[2]),
    )


@njit(**FAST)
def cell_volume_vjp(edges, bar):
    """Adjoints of the edges from the adjoint of the volume."""
    g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(_shape_vectors(edges[0], edges[1], edges[2]))
    bar = bar * (1.0 / 64.0)
    low, high = _weighted(g_b, -1.0, g_e, 0.0, g_e, bar), _weighted(g_b, 1.0, g_e, 0.0, g_e, bar)
    straight = _weighted(g_c, 0.0, g_e, 0.0, g_e, bar)
    return (
        (
            _weighted(g_a, -1.0, g_d, -1.0, g_f, bar),
            _weighted(g_a, 1.0, g_d, -1.0, g_f, bar),
            _weighted(g_a, -1.0, g_d, 1.0, g_f, bar),
            _weighted(g_a, 1.0, g_d, 1.0, g_f, bar),
        ),
        (low, low, high, high),
        (straight, straight, straight, straight),
    )
