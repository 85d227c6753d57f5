"""Centre and area vector of a face of four corners.

The centre is the centre of area of both its pairs of triangles; the area vector is the same for either pair.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, dot, less

FLAT = 1e-8
"""Area of a triangle, by the squares of its face's diagonals, above which it counts: roots are not smooth at 0."""


@njit(cache=True, error_model="numpy")
def face_centre(a, b, c, d):
    """Centre of area and area vector of a face whose diagonals are not both zero, see `has_diagonal`."""
    ab, ac, ad, bc, bd = less(b, a), less(c, a), less(d, a), less(c, b), less(d, b)
    square = dot(ac, ac) + dot(bd, bd)
    flat = FLAT**2 * square * square
    first, second, third, fourth = _normal(ab, ac), _normal(ac, ad), _normal(ab, ad), _normal(bc, bd)
    area = add(first, second)
    p, q = np.sqrt(dot(first, first) + flat), np.sqrt(dot(second, second) + flat)
    r, s = np.sqrt(dot(third, third) + flat), np.sqrt(dot(fourth, fourth) + flat)
    abc, acd, abd, bcd = _sum(a, b, c), _sum(a, c, d), _sum(a, b, d), _sum(b, c, d)
    total = 3.0 * (p + q + r + s)
    centre = (
        (p * abc[0] + q * acd[0] + r * abd[0] + s * bcd[0]) / total,
        (p * abc[1] + q * acd[1] + r * abd[1] + s * bcd[1]) / total,
        (p * abc[2] + q * acd[2] + r * abd[2] + s * bcd[2]) / total,
    )
    return centre, area


@njit(cache=True, error_model="numpy")
def has_diagonal(a, b, c, d):
    """Whether a face has a diagonal of non-zero length; otherwise it has no area, however its corners move."""
    ac, bd = less(c, a), less(d, b)
    square = (dot(ac, ac) + dot(bd, bd)).real
    return FLAT**2 * square * square > 0.0


@njit(cache=True, error_model="numpy")
def _sum(u, v, w):
    return u[0] + v[0] + w[0], u[1] + v[1] + w[1], u[2] + v[2] + w[2]


@njit(cache=True, error_model="numpy")
def _normal(u, v):
    """Half the cross product."""
    return (
        0.5 * (u[1] * v[2] - u[2] * v[1]),
        0.5 * (u[2] * v[0] - u[0] * v[2]),
        0.5 * (u[0] * v[1] - u[1] * v[0]),
    )
