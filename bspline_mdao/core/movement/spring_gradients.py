"""The numbers Q that the springs of a hexahedron resist: their gradients g, and the change of g along a field.

See `bspline_mdao.core.movement.springs` for what Q is. Theory: ``docs/theory/springs.rst``. Corners and gradients are
arrays, shapes (8, 3) and (4, 3).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, cross, dot, less, row, scaled
from .trilinear import FAST, FLAT_CORNER, regularised

__all__ = ["COUNTS", "N_LINEAL", "N_SPRINGS", "POINTS", "gradient", "gradient_change"]

N_LINEAL = 28
"""Pairs of corners."""

N_SPRINGS = N_LINEAL + 8 * 4
"""All springs of an element: at every corner three angles and the triple product."""


def _points():
    """Corners of every spring, shape (N_SPRINGS, 4): two ends, or a vertex and two or three ends, and then any."""
    pairs = [(p, q, p, p) for p in range(8) for q in range(p + 1, 8)]
    corners = []
    for c in range(8):
        a, b, d = c ^ 1, c ^ 2, c ^ 4
        corners += [(c, a, b, c), (c, b, d, c), (c, d, a, c), (c, a, b, d)]
    return np.array(pairs + corners)


POINTS = _points()
"""Corners of every spring."""

COUNTS = np.array([2] * N_LINEAL + [3, 3, 3, 4] * 8)
"""Number of corners of every spring: what follows in `POINTS` does not count."""

_WEIGHTS = np.array([(0.5, np.sqrt(0.5), 1.0)[bin(p ^ q).count("1") - 1] for p, q in POINTS[:N_LINEAL, :2]])


_PARITY = np.array([(-1.0) ** bin(c).count("1") for c in range(8)])


_TINY = 1e-150
"""Added to squares of lengths: an inverse length is below 1e75, and its fourth power finite."""


@njit(cache=True, error_model="numpy", inline="always")
def _inverse_regularised(t, t_0):
    """Inverse of t regularised at t_0, and its derivative."""
    number, slope = regularised(t, t_0)
    inverse = 1.0 / number
    return inverse, -slope * inverse * inverse


@njit(cache=True, error_model="numpy", inline="always")
def _unit(x, start, end):
    """Unit vector between two corners, and the inverse of their distance; 0, and a large number, between twins."""
    edge = less(row(x, end), row(x, start))
    inverse = 1.0 / np.sqrt(dot(edge, edge) + _TINY)
    return scaled(inverse, edge), inverse


@njit(cache=True, inline="always")
def _unit_change(dx, start, end, unit, inverse):
    """Change of `_unit`."""
    d_edge = less(row(dx, end), row(dx, start))
    along = dot(unit, d_edge)
    return scaled(inverse, less(d_edge, scaled(along, unit))), -inverse * inverse * along


@njit(cache=True, inline="always")
def _across(t, unit, normal):
    """``normal - t unit``."""
    return less(normal, scaled(t, unit))


@njit(cache=True, inline="always")
def _across_change(t, d_t, unit, d_unit, d_normal):
    """Change of `_across`."""
    return less(d_normal, add(scaled(d_t, unit), scaled(t, d_unit)))


@njit(cache=True, inline="always")
def _product_change(a, d_a, b, d_b, vector, d_vector):
    """Change of ``a b vector``."""
    return add(scaled(d_a * b + a * d_b, vector), scaled(a * b, d_vector))


@njit(cache=True, inline="always")
def _put(g, n, vector):
    g[n, 0], g[n, 1], g[n, 2] = vector


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _lineal(x, points, factor, power, g):
    """Gradient of the Q of a lineal spring by its ends."""
    direction, inverse = _unit(x, points[0], points[1])
    pull = scaled(factor * inverse ** (0.5 * power), direction)
    _put(g, 0, scaled(-1.0, pull))
    _put(g, 1, pull)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _lineal_change(x, dx, points, factor, power, dg):
    """Change of `_lineal`."""
    direction, inverse = _unit(x, points[0], points[1])
    d_edge = less(row(dx, points[1]), row(dx, points[0]))
    along = (1.0 + 0.5 * power) * dot(direction, d_edge)
    pull = scaled(factor * inverse ** (1.0 + 0.5 * power), _across(along, direction, d_edge))
    _put(dg, 0, scaled(-1.0, pull))
    _put(dg, 1, pull)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _angular(x, points, factor, g):
    """Gradient of the Q of an angle by its vertex and the ends of its legs."""
    a, inverse_a = _unit(x, points[0], points[1])
    b, inverse_b = _unit(x, points[0], points[2])
    cosine = dot(a, b)
    slope = -factor * _inverse_regularised(1.0 - cosine * cosine, FLAT_CORNER * FLAT_CORNER)[0]
    first = scaled(slope * inverse_a, _across(cosine, a, b))
    second = scaled(slope * inverse_b, _across(cosine, b, a))
    _put(g, 0, scaled(-1.0, add(first, second)))
    _put(g, 1, first)
    _put(g, 2, second)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _angular_change(x, dx, points, factor, dg):
    """Change of `_angular`."""
    a, inverse_a = _unit(x, points[0], points[1])
    b, inverse_b = _unit(x, points[0], points[2])
    d_a, d_inverse_a = _unit_change(dx, points[0], points[1], a, inverse_a)
    d_b, d_inverse_b = _unit_change(dx, points[0], points[2], b, inverse_b)
    cosine, d_cosine = dot(a, b), dot(d_a, b) + dot(a, d_b)
    inverse, square_slope = _inverse_regularised(1.0 - cosine * cosine, FLAT_CORNER * FLAT_CORNER)
    slope, d_slope = -factor * inverse, 2.0 * factor * square_slope * cosine * d_cosine
    d_first = _across_change(cosine, d_cosine, a, d_a, d_b)
    d_second = _across_change(cosine, d_cosine, b, d_b, d_a)
    first = _product_change(slope, d_slope, inverse_a, d_inverse_a, _across(cosine, a, b), d_first)
    second = _product_change(slope, d_slope, inverse_b, d_inverse_b, _across(cosine, b, a), d_second)
    _put(dg, 0, scaled(-1.0, add(first, second)))
    _put(dg, 1, first)
    _put(dg, 2, second)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _solid(x, points, factor, sign, g):
    """Gradient of the Q of a corner by its vertex and the ends of its three edges."""
    a, inverse_a = _unit(x, points[0], points[1])
    b, inverse_b = _unit(x, points[0], points[2])
    c, inverse_c = _unit(x, points[0], points[3])
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    t = dot(a, bc)
    slope = sign * factor * _inverse_regularised(sign * t, FLAT_CORNER)[0]
    first = scaled(slope * inverse_a, _across(t, a, bc))
    second = scaled(slope * inverse_b, _across(t, b, ca))
    third = scaled(slope * inverse_c, _across(t, c, ab))
    _put(g, 0, scaled(-1.0, add(first, add(second, third))))
    _put(g, 1, first)
    _put(g, 2, second)
    _put(g, 3, third)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _solid_change(x, dx, points, factor, sign, dg):
    """Change of `_solid`."""
    a, inverse_a = _unit(x, points[0], points[1])
    b, inverse_b = _unit(x, points[0], points[2])
    c, inverse_c = _unit(x, points[0], points[3])
    d_a, d_inverse_a = _unit_change(dx, points[0], points[1], a, inverse_a)
    d_b, d_inverse_b = _unit_change(dx, points[0], points[2], b, inverse_b)
    d_c, d_inverse_c = _unit_change(dx, points[0], points[3], c, inverse_c)
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    t, d_t = dot(a, bc), dot(d_a, bc) + dot(d_b, ca) + dot(d_c, ab)
    inverse, triple_slope = _inverse_regularised(sign * t, FLAT_CORNER)
    slope, d_slope = sign * factor * inverse, factor * triple_slope * d_t
    d_first = _across_change(t, d_t, a, d_a, add(cross(d_b, c), cross(b, d_c)))
    d_second = _across_change(t, d_t, b, d_b, add(cross(d_c, a), cross(c, d_a)))
    d_third = _across_change(t, d_t, c, d_c, add(cross(d_a, b), cross(a, d_b)))
    first = _product_change(slope, d_slope, inverse_a, d_inverse_a, _across(t, a, bc), d_first)
    second = _product_change(slope, d_slope, inverse_b, d_inverse_b, _across(t, b, ca), d_second)
    third = _product_change(slope, d_slope, inverse_c, d_inverse_c, _across(t, c, ab), d_third)
    _put(dg, 0, scaled(-1.0, add(first, add(second, third))))
    _put(dg, 1, first)
    _put(dg, 2, second)
    _put(dg, 3, third)


@njit(cache=True)
def gradient(x, n, sign, settings, g):
    """Gradient g of spring n by its corners; settings are the power and the weight of torsion."""
    power, torsion = settings
    points = POINTS[n]
    if n < N_LINEAL:
        _lineal(x, points, _WEIGHTS[n], power, g)
    elif n % 4 < 3:
        _angular(x, points, torsion, g)
    else:
        _solid(x, points, torsion, sign * _PARITY[points[0]], g)


@njit(cache=True)
def gradient_change(x, dx, n, sign, settings, dg):
    """Change dg of `gradient` as the corners x go along dx."""
    power, torsion = settings
    points = POINTS[n]
    if n < N_LINEAL:
        _lineal_change(x, dx, points, _WEIGHTS[n], power, dg)
    elif n % 4 < 3:
        _angular_change(x, dx, points, torsion, dg)
    else:
        _solid_change(x, dx, points, torsion, sign * _PARITY[points[0]], dg)
