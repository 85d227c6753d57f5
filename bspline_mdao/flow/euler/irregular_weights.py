"""Changes of the weights of one face where grid lines turn or their spacing jumps, see `.irregular_faces`.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import dot, less

WORTH = 100.0
"""Weight of the square of a distance in cells, mu: a tenth of a cell counts like a change of the weights of one."""

LARGEST = 0.5
"""Upper bound of changes of a weight."""

OUTER = 0.25
"""Largest total weight of the two outer cells. Above it, the mean of an alternating field along the line has the wrong
sign, cos(x) (1 - 4 OUTER sin(x)^2) < 0 at some phase x from a face to the next cells, and such waves run backwards."""

ROUNDED = 1e-12
"""Addition to the diagonal of the matrix of a face, relative to its trace, that makes it invertible."""


@njit(cache=True, error_model="numpy")
def free_changes(
    # centre of the face, centres of the four cells (m), and the sum of the squares of the edges of the middle two
    # (m^2), as rows
    face: tuple,
    weights: tuple,  # weights of smooth lines
    # has_first, has_last: 1.0 if the first and the last cell exist, 0.0 if they stand in for missing ones
    has_first: float,
    has_last: float,
) -> tuple:
    """Changes of the four weights without bounds, and the determinant of the matrix of the face."""
    # They exist if the determinant is positive.
    middle, a, b, c, d, spread = face
    p, q, r, s = less(a, middle), less(b, middle), less(c, middle), less(d, middle)
    miss = _sum(p, q, r, s, weights[0], weights[1], weights[2], weights[3])
    total, n_cells = _sum(p, q, r, s, has_first, 1.0, 1.0, has_last), 2.0 + has_first + has_last
    mean = total[0] / n_cells, total[1] / n_cells, total[2] / n_cells
    e, f, g, h = less(p, mean), less(q, mean), less(r, mean), less(s, mean)
    xx = has_first * e[0] * e[0] + f[0] * f[0] + g[0] * g[0] + has_last * h[0] * h[0] + 0.5 / WORTH * spread[0][0]
    yy = has_first * e[1] * e[1] + f[1] * f[1] + g[1] * g[1] + has_last * h[1] * h[1] + 0.5 / WORTH * spread[1][1]
    zz = has_first * e[2] * e[2] + f[2] * f[2] + g[2] * g[2] + has_last * h[2] * h[2] + 0.5 / WORTH * spread[2][2]
    xy = (
        has_first * e[0] * e[1]
        + f[0] * f[1]
        + g[0] * g[1]
        + has_last * h[0] * h[1]
        + 0.25 / WORTH * (spread[0][1] + spread[1][0])
    )
    yz = (
        has_first * e[1] * e[2]
        + f[1] * f[2]
        + g[1] * g[2]
        + has_last * h[1] * h[2]
        + 0.25 / WORTH * (spread[1][2] + spread[2][1])
    )
    zx = (
        has_first * e[2] * e[0]
        + f[2] * f[0]
        + g[2] * g[0]
        + has_last * h[2] * h[0]
        + 0.25 / WORTH * (spread[2][0] + spread[0][2])
    )
    rounding = ROUNDED * (xx + yy + zz)
    x, y, z = xx + rounding, yy + rounding, zz + rounding
    first = (y * z - yz * yz, yz * zx - xy * z, xy * yz - y * zx)
    second = (first[1], z * x - zx * zx, zx * xy - x * yz)
    third = (first[2], second[2], x * y - xy * xy)
    determinant = x * first[0] + xy * first[1] + zx * first[2]
    push = dot(first, miss) / determinant, dot(second, miss) / determinant, dot(third, miss) / determinant
    return (-has_first * dot(e, push), -dot(f, push), -dot(g, push), -has_last * dot(h, push)), determinant


@njit(cache=True, error_model="numpy")
def bounded_changes(free, weights, is_more):
    """Changes of the weights within their bounds; ``is_more`` is 1.0 if the outer two gain, else 0.0."""
    # Their factor ``(1 + sum_k (free_k / LARGEST)^8 + (outer / room)^8)^(-1/8)`` is smooth, and 1 within 0.05 % up to
    # half of both bounds.
    beyond = is_more * _eighth((free[0] + free[3]) / (OUTER - weights[0] - weights[3]))
    inner = _eighth(free[0] / LARGEST) + _eighth(free[1] / LARGEST) + _eighth(free[2] / LARGEST)
    total = 1.0 + inner + _eighth(free[3] / LARGEST) + beyond
    factor = 1.0 / np.sqrt(np.sqrt(np.sqrt(total)))
    return factor * free[0], factor * free[1], factor * free[2], factor * free[3]


@njit(cache=True, error_model="numpy")
def _sum(p, q, r, s, a, b, c, d):
    return (
        a * p[0] + b * q[0] + c * r[0] + d * s[0],
        a * p[1] + b * q[1] + c * r[1] + d * s[1],
        a * p[2] + b * q[2] + c * r[2] + d * s[2],
    )


@njit(cache=True, error_model="numpy")
def _eighth(x):
    """Eighth power; for a complex number it keeps a small imaginary part, which ``**`` loses."""
    square = x * x
    fourth = square * square
    return fourth * fourth
