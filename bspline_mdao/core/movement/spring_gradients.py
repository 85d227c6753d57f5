"""The numbers Q that the springs of a hexahedron resist: their gradients g, and the change of g along a field.

See `bspline_mdao.core.movement.springs` for the definition of Q. Theory: ``docs/theory/springs.rst``. Corners and
gradients are arrays, shapes (8, 3) and (4, 3).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import row
from .spring_pulls import angular_pull, lineal_pull, solid_pull
from .spring_pulls_derivatives import angular_pull_jvp, lineal_pull_jvp, solid_pull_jvp

__all__ = ["COUNTS", "N_LINEAL", "N_SPRINGS", "POINTS", "gradient", "gradient_change"]

N_LINEAL = 28
"""Pairs of corners."""

N_SPRINGS = N_LINEAL + 8 * 4
"""All springs of an element: at every corner three angles and the triple product."""


def _points() -> np.ndarray:
    """Corners of every spring, shape (N_SPRINGS, 4): two ends, or a vertex and two or three ends, then padding."""
    pairs = [(p, q, p, p) for p in range(8) for q in range(p + 1, 8)]
    corners = []
    for c in range(8):
        a, b, d = c ^ 1, c ^ 2, c ^ 4
        corners += [(c, a, b, c), (c, b, d, c), (c, d, a, c), (c, a, b, d)]
    return np.array(pairs + corners)


POINTS = _points()
"""Corners of every spring."""

COUNTS = np.array([2] * N_LINEAL + [3, 3, 3, 4] * 8)
"""Number of corners of every spring: the rest of `POINTS` is padding."""

_WEIGHTS = np.array([(0.5, np.sqrt(0.5), 1.0)[bin(p ^ q).count("1") - 1] for p, q in POINTS[:N_LINEAL, :2]])


_PARITY = np.array([(-1.0) ** bin(c).count("1") for c in range(8)])


@njit(cache=True)
def gradient(x, n, sign, torsion, g):
    """Gradient g of spring n with respect to its corners; for torsional springs it has a factor."""
    points = POINTS[n]
    a, b, c, d = row(x, points[0]), row(x, points[1]), row(x, points[2]), row(x, points[3])
    if n < N_LINEAL:
        _put(g, lineal_pull(a, b, _WEIGHTS[n]))
    elif n % 4 < 3:
        _put(g, angular_pull(a, b, c, torsion))
    else:
        _put(g, solid_pull(a, b, c, d, torsion, sign * _PARITY[points[0]]))


@njit(cache=True)
def gradient_change(x, dx, n, sign, torsion, dg):
    """Change dg of `gradient` for a change dx of the corners x."""
    points = POINTS[n]
    a, b, c, d = row(x, points[0]), row(x, points[1]), row(x, points[2]), row(x, points[3])
    d_a, d_b, d_c, d_d = row(dx, points[0]), row(dx, points[1]), row(dx, points[2]), row(dx, points[3])
    if n < N_LINEAL:
        _put(dg, lineal_pull_jvp(a, b, _WEIGHTS[n], d_a, d_b))
    elif n % 4 < 3:
        _put(dg, angular_pull_jvp(a, b, c, torsion, d_a, d_b, d_c))
    else:
        _put(dg, solid_pull_jvp(a, b, c, d, torsion, sign * _PARITY[points[0]], d_a, d_b, d_c, d_d))


@njit(cache=True, inline="always")
def _put(g, vectors):
    for c in range(len(vectors)):
        g[c, 0], g[c, 1], g[c, 2] = vectors[c]
