"""Volume of a trilinear cell, and its derivatives in the edges.

Edges come as three tuples of four, along xi, eta and zeta, each edge a tuple of its components.
"""

from __future__ import annotations

from numba import njit

FAST = {"cache": True, "nogil": True, "error_model": "numpy", "forceinline": True, "fastmath": {"contract"}}
"""How straight-line code is compiled: products and sums may become fused ones."""


@njit(**FAST)
def cross(u, v):
    """``u x v``."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(**FAST)
def dot(u, v):
    """``u . v``."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(**FAST)
def _sum(p, q, r, s):
    return p[0] + q[0] + r[0] + s[0], p[1] + q[1] + r[1] + s[1], p[2] + q[2] + r[2] + s[2]


@njit(**FAST)
def _change(p, q, r, s):
    """From the edges p, q on one side of the cell to r, s on the other."""
    return r[0] + s[0] - p[0] - q[0], r[1] + s[1] - p[1] - q[1], r[2] + s[2] - p[2] - q[2]


@njit(**FAST)
def _shape_vectors(i, j, k):
    """Four times the mean edges a, b, c of a cell and twice the coefficients d, e, f of xi eta, eta zeta, zeta xi."""
    return (
        _sum(i[0], i[1], i[2], i[3]),
        _sum(j[0], j[1], j[2], j[3]),
        _sum(k[0], k[1], k[2], k[3]),
        _change(i[0], i[2], i[1], i[3]),
        _change(j[0], j[1], j[2], j[3]),
        _change(i[0], i[1], i[2], i[3]),
    )


@njit(**FAST)
def volume_of(i, j, k):
    """Volume of a trilinear cell: the Jacobian integrated term by term, see docs/theory/quality.rst."""
    a, b, c, d, e, f = _shape_vectors(i, j, k)
    product = dot(cross(a, b), c)
    products = dot(cross(a, d), f) + dot(cross(d, b), e) + dot(cross(f, e), c)
    return (product + products / 3.0) / 64.0


@njit(**FAST)
def _combine(p, scale, q):
    return p[0] + scale * q[0], p[1] + scale * q[1], p[2] + scale * q[2]


@njit(**FAST)
def _volume_gradient(vectors):
    """Gradient of 64 volumes in the six vectors of `_shape_vectors`."""
    a, b, c, d, e, f = vectors
    third = 1.0 / 3.0
    return (
        _combine(cross(b, c), third, cross(d, f)),
        _combine(cross(c, a), third, cross(e, d)),
        _combine(cross(a, b), third, cross(f, e)),
        _combine(cross(f, a), 1.0, cross(b, e)),
        _combine(cross(d, b), 1.0, cross(c, f)),
        _combine(cross(a, d), 1.0, cross(e, c)),
    )


@njit(**FAST)
def volume_of_jvp(edges, changes):
    """Change of the volume."""
    g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(_shape_vectors(edges[0], edges[1], edges[2]))
    d_a, d_b, d_c, d_d, d_e, d_f = _shape_vectors(changes[0], changes[1], changes[2])
    straight = dot(g_a, d_a) + dot(g_b, d_b) + dot(g_c, d_c)
    twisted = dot(g_d, d_d) + dot(g_e, d_e) + dot(g_f, d_f)
    return (straight + twisted / 3.0) / 64.0


@njit(**FAST)
def _turned(mean, s, p, t, q, scale):
    """``scale (mean + (s p + t q) / 3)``."""
    s, t = s / 3.0, t / 3.0
    return (
        scale * (mean[0] + s * p[0] + t * q[0]),
        scale * (mean[1] + s * p[1] + t * q[1]),
        scale * (mean[2] + s * p[2] + t * q[2]),
    )


@njit(**FAST)
def volume_of_vjp(edges, bar):
    """Adjoints of the edges from that of the volume."""
    g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(_shape_vectors(edges[0], edges[1], edges[2]))
    bar = bar / 64.0
    low, high = _turned(g_b, -1.0, g_e, 0.0, g_e, bar), _turned(g_b, 1.0, g_e, 0.0, g_e, bar)
    straight = _turned(g_c, 0.0, g_e, 0.0, g_e, bar)
    return (
        (
            _turned(g_a, -1.0, g_d, -1.0, g_f, bar),
            _turned(g_a, 1.0, g_d, -1.0, g_f, bar),
            _turned(g_a, -1.0, g_d, 1.0, g_f, bar),
            _turned(g_a, 1.0, g_d, 1.0, g_f, bar),
        ),
        (low, low, high, high),
        (straight, straight, straight, straight),
    )
