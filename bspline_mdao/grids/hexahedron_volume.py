"""Volumes of a run of trilinear cells, and their derivatives in the edges."""

from __future__ import annotations

from numba import njit

from .hexahedron_layout import EDGE, RUN, VOLUME, cross, dot, vector


@njit(cache=True, inline="always")
def _sum(p, q, r, s):
    return p[0] + q[0] + r[0] + s[0], p[1] + q[1] + r[1] + s[1], p[2] + q[2] + r[2] + s[2]


@njit(cache=True, inline="always")
def _change(p, q, r, s):
    """From the edges p, q on one side of the cell to r, s on the other."""
    return r[0] + s[0] - p[0] - q[0], r[1] + s[1] - p[1] - q[1], r[2] + s[2] - p[2] - q[2]


@njit(cache=True, inline="always")
def _shape_vectors(work, k):
    """Four times the mean edges a, b, c of a cell and twice the coefficients d, e, f of xi eta, eta zeta, zeta xi."""
    i0, i1 = vector(work, k), vector(work, EDGE + k)
    i2, i3 = vector(work, 2 * EDGE + k), vector(work, 3 * EDGE + k)
    j0, j1 = vector(work, 4 * EDGE + k), vector(work, 5 * EDGE + k)
    j2, j3 = vector(work, 6 * EDGE + k), vector(work, 7 * EDGE + k)
    k0, k1 = vector(work, 8 * EDGE + k), vector(work, 9 * EDGE + k)
    k2, k3 = vector(work, 10 * EDGE + k), vector(work, 11 * EDGE + k)
    a, b, c = _sum(i0, i1, i2, i3), _sum(j0, j1, j2, j3), _sum(k0, k1, k2, k3)
    return a, b, c, _change(i0, i2, i1, i3), _change(j0, j1, j2, j3), _change(i0, i1, i2, i3)


@njit(cache=True, fastmath={"contract"})
def volumes(work, sign, n):
    """Volume of trilinear cells: the Jacobian integrated term by term, see docs/theory/quality.rst."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        product = dot(cross(a, b), c)
        products = dot(cross(a, d), f) + dot(cross(d, b), e) + dot(cross(f, e), c)
        work[VOLUME + k] = sign * (product + products / 3.0) / 64.0


@njit(cache=True, inline="always")
def _combine(p, scale, q):
    return p[0] + scale * q[0], p[1] + scale * q[1], p[2] + scale * q[2]


@njit(cache=True, inline="always")
def _volume_gradient(a, b, c, d, e, f):
    """Gradient of 64 volumes in the six vectors of `_shape_vectors`."""
    third = 1.0 / 3.0
    g_a = _combine(cross(b, c), third, cross(d, f))
    g_b = _combine(cross(c, a), third, cross(e, d))
    g_c = _combine(cross(a, b), third, cross(f, e))
    g_d = _combine(cross(f, a), 1.0, cross(b, e))
    g_e = _combine(cross(d, b), 1.0, cross(c, f))
    g_f = _combine(cross(a, d), 1.0, cross(e, c))
    return g_a, g_b, g_c, g_d, g_e, g_f


@njit(cache=True, fastmath={"contract"})
def volumes_jvp(work, sign, n):
    """Change of the volumes."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(a, b, c, d, e, f)
        d_a, d_b, d_c, d_d, d_e, d_f = _shape_vectors(work, 4 * RUN + k)
        straight = dot(g_a, d_a) + dot(g_b, d_b) + dot(g_c, d_c)
        twisted = dot(g_d, d_d) + dot(g_e, d_e) + dot(g_f, d_f)
        work[VOLUME + k] = sign * (straight + twisted / 3.0) / 64.0


@njit(cache=True, inline="always")
def _put(work, m, k, mean, s, p, t, q):
    """Set the adjoint of edge m to ``mean + s p + t q``."""
    at = m * EDGE + 4 * RUN + k
    work[at] = mean[0] + s * p[0] + t * q[0]
    work[at + RUN] = mean[1] + s * p[1] + t * q[1]
    work[at + 2 * RUN] = mean[2] + s * p[2] + t * q[2]


@njit(cache=True, inline="always")
def _scaled(factor, p):
    return factor * p[0], factor * p[1], factor * p[2]


@njit(cache=True, fastmath={"contract"})
def volumes_vjp(work, sign, n):
    """Set the adjoints of the edges to what the volumes' adjoints give."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(a, b, c, d, e, f)
        bar = sign * work[VOLUME + k] / 64.0
        g_a, g_b, g_c = _scaled(bar, g_a), _scaled(bar, g_b), _scaled(bar, g_c)
        g_d, g_e, g_f = _scaled(bar / 3.0, g_d), _scaled(bar / 3.0, g_e), _scaled(bar / 3.0, g_f)
        _put(work, 0, k, g_a, -1.0, g_d, -1.0, g_f)
        _put(work, 1, k, g_a, 1.0, g_d, -1.0, g_f)
        _put(work, 2, k, g_a, -1.0, g_d, 1.0, g_f)
        _put(work, 3, k, g_a, 1.0, g_d, 1.0, g_f)
        _put(work, 4, k, g_b, -1.0, g_e, 0.0, g_e)
        _put(work, 5, k, g_b, -1.0, g_e, 0.0, g_e)
        _put(work, 6, k, g_b, 1.0, g_e, 0.0, g_e)
        _put(work, 7, k, g_b, 1.0, g_e, 0.0, g_e)
        _put(work, 8, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 9, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 10, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 11, k, g_c, 0.0, g_e, 0.0, g_e)
