"""Systems of a step: stabilised biconjugate gradients, preconditioned by symmetric block Gauss-Seidel sweeps.

H. A. van der Vorst, *Bi-CGSTAB: a fast and smoothly converging variant of Bi-CG for the solution of nonsymmetric linear
systems*, SIAM Journal on Scientific and Statistical Computing 13 (1992) 631-644.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def solve(starts, nodes, diagonal, blocks, right, x, tolerance, most):
    """Solve from the guess x, shape (n, 3), in place; return the iterations and the relative residual."""
    # ``diagonal`` (n, 9) and ``blocks`` (n_neighbours, 9) are 3 x 3 blocks, rows first
    inverse = _inverses(diagonal)
    r, y, v, z, t = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x)
    _product(starts, nodes, diagonal, blocks, x, v)
    r[:] = right - v
    shadow, p = r.copy(), r.copy()
    rho, norm = _dot(shadow, r), np.sqrt(_dot(right, right))
    iteration = 0
    while iteration < most and np.sqrt(_dot(r, r)) > tolerance * norm:
        iteration += 1
        _precondition(starts, nodes, diagonal, inverse, blocks, p, y)
        _product(starts, nodes, diagonal, blocks, y, v)
        alpha = rho / _dot(shadow, v)
        r -= alpha * v
        _precondition(starts, nodes, diagonal, inverse, blocks, r, z)
        _product(starts, nodes, diagonal, blocks, z, t)
        omega = _dot(t, r) / _dot(t, t)
        x += alpha * y + omega * z
        r -= omega * t
        new = _dot(shadow, r)
        p[:] = r + new / rho * alpha / omega * (p - omega * v)
        rho = new
    return iteration, np.sqrt(_dot(r, r)) / norm


@njit(cache=True, error_model="numpy")
def _inverses(diagonal):
    """Inverses of blocks, shape (n, 9)."""
    inverse = np.empty_like(diagonal)
    for i in range(len(diagonal)):
        a, b, c = diagonal[i, 0], diagonal[i, 1], diagonal[i, 2]
        d, e, f = diagonal[i, 3], diagonal[i, 4], diagonal[i, 5]
        g, h, k = diagonal[i, 6], diagonal[i, 7], diagonal[i, 8]
        p, q, r = e * k - f * h, f * g - d * k, d * h - e * g
        s = 1.0 / (a * p + b * q + c * r)
        inverse[i, 0], inverse[i, 1], inverse[i, 2] = p * s, (c * h - b * k) * s, (b * f - c * e) * s
        inverse[i, 3], inverse[i, 4], inverse[i, 5] = q * s, (a * k - c * g) * s, (c * d - a * f) * s
        inverse[i, 6], inverse[i, 7], inverse[i, 8] = r * s, (b * g - a * h) * s, (a * e - b * d) * s
    return inverse


@njit(cache=True, fastmath={"contract", "reassoc"})
def _product(starts, nodes, diagonal, blocks, x, y):
    """Y = A x."""
    for i in range(len(x)):
        u, v, w = x[i, 0], x[i, 1], x[i, 2]
        a = diagonal[i, 0] * u + diagonal[i, 1] * v + diagonal[i, 2] * w
        b = diagonal[i, 3] * u + diagonal[i, 4] * v + diagonal[i, 5] * w
        c = diagonal[i, 6] * u + diagonal[i, 7] * v + diagonal[i, 8] * w
        for k in range(starts[i], starts[i + 1]):
            j = nodes[k]
            u, v, w = x[j, 0], x[j, 1], x[j, 2]
            a += blocks[k, 0] * u + blocks[k, 1] * v + blocks[k, 2] * w
            b += blocks[k, 3] * u + blocks[k, 4] * v + blocks[k, 5] * w
            c += blocks[k, 6] * u + blocks[k, 7] * v + blocks[k, 8] * w
        y[i, 0], y[i, 1], y[i, 2] = a, b, c


@njit(cache=True, fastmath={"contract", "reassoc"})
def _precondition(starts, nodes, diagonal, inverse, blocks, right, y):
    """Solve (D + L) D^-1 (D + U) y = right: one sweep forwards, one backwards."""
    n = len(y)
    for i in range(n):
        a, b, c = right[i, 0], right[i, 1], right[i, 2]
        for k in range(starts[i], starts[i + 1]):
            j = nodes[k]
            if j < i:
                u, v, w = y[j, 0], y[j, 1], y[j, 2]
                a -= blocks[k, 0] * u + blocks[k, 1] * v + blocks[k, 2] * w
                b -= blocks[k, 3] * u + blocks[k, 4] * v + blocks[k, 5] * w
                c -= blocks[k, 6] * u + blocks[k, 7] * v + blocks[k, 8] * w
        y[i, 0] = inverse[i, 0] * a + inverse[i, 1] * b + inverse[i, 2] * c
        y[i, 1] = inverse[i, 3] * a + inverse[i, 4] * b + inverse[i, 5] * c
        y[i, 2] = inverse[i, 6] * a + inverse[i, 7] * b + inverse[i, 8] * c
    for i in range(n - 1, -1, -1):
        a = b = c = 0.0
        for k in range(starts[i], starts[i + 1]):
            j = nodes[k]
            if j > i:
                u, v, w = y[j, 0], y[j, 1], y[j, 2]
                a += blocks[k, 0] * u + blocks[k, 1] * v + blocks[k, 2] * w
                b += blocks[k, 3] * u + blocks[k, 4] * v + blocks[k, 5] * w
                c += blocks[k, 6] * u + blocks[k, 7] * v + blocks[k, 8] * w
        y[i, 0] -= inverse[i, 0] * a + inverse[i, 1] * b + inverse[i, 2] * c
        y[i, 1] -= inverse[i, 3] * a + inverse[i, 4] * b + inverse[i, 5] * c
        y[i, 2] -= inverse[i, 6] * a + inverse[i, 7] * b + inverse[i, 8] * c


@njit(cache=True, fastmath={"contract", "reassoc"})
def _dot(a, b):
    total = 0.0
    for i in range(len(a)):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total
