"""Pulls of the springs of a hexahedron at its corners: gradients of the numbers Q that they resist.

See `bspline_mdao.core.movement.springs` for the definition of Q. Theory: ``docs/theory/springs.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, cross, dot, less, scaled
from .trilinear import FAST, FLAT_CORNER, regularised

__all__ = ["angular_pull", "inverse_regularised", "inverse_regularised_slope", "lineal_pull", "solid_pull"]

TINY = 1e-150
"""Added to squares of lengths: an inverse length is below 1e75, and its fourth power finite."""


@njit(cache=True, error_model="numpy", inline="always")
def inverse_regularised(t, t_0):
    """Inverse of t regularised at t_0."""
    return 1.0 / regularised(t, t_0)[0]


@njit(cache=True, error_model="numpy", inline="always")
def inverse_regularised_slope(t, t_0):
    """Derivative of `inverse_regularised`."""
    number, slope = regularised(t, t_0)
    return -slope / (number * number)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def lineal_pull(a, b, factor):
    """Gradient of the Q of a lineal spring with respect to its ends."""
    direction, inverse = _unit(a, b)
    pull = scaled(factor * inverse, direction)
    return scaled(-1.0, pull), pull


@njit(cache=True, error_model="numpy", fastmath=FAST)
def angular_pull(vertex, a, b, factor):
    """Gradient of the Q of an angle with respect to its vertex and the ends of its legs."""
    u, inverse_u = _unit(vertex, a)
    v, inverse_v = _unit(vertex, b)
    cosine = dot(u, v)
    slope = -factor * inverse_regularised(1.0 - cosine * cosine, FLAT_CORNER * FLAT_CORNER)
    first = _across(slope * inverse_u, cosine, u, v)
    second = _across(slope * inverse_v, cosine, v, u)
    return scaled(-1.0, add(first, second)), first, second


@njit(cache=True, error_model="numpy", fastmath=FAST)
def solid_pull(vertex, a, b, c, factor, sign):
    """Gradient of the Q of a corner with respect to its vertex and the ends of its three edges."""
    u, inverse_u = _unit(vertex, a)
    v, inverse_v = _unit(vertex, b)
    w, inverse_w = _unit(vertex, c)
    vw, wu, uv = cross(v, w), cross(w, u), cross(u, v)
    t = dot(u, vw)
    slope = sign * factor * inverse_regularised(sign * t, FLAT_CORNER)
    first = _across(slope * inverse_u, t, u, vw)
    second = _across(slope * inverse_v, t, v, wu)
    third = _across(slope * inverse_w, t, w, uv)
    return scaled(-1.0, add(first, add(second, third))), first, second, third


@njit(cache=True, error_model="numpy", inline="always")
def _unit(start, end):
    """Unit vector between two corners, and their inverse distance; 0 and a large number if they coincide."""
    edge = less(end, start)
    inverse = 1.0 / np.sqrt(dot(edge, edge) + TINY)
    return scaled(inverse, edge), inverse


@njit(cache=True, error_model="numpy", inline="always")
def _across(factor, t, unit, normal):
    """``factor (normal - t unit)``."""
    return scaled(factor, less(normal, scaled(t, unit)))
