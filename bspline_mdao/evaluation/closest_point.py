"""The point of a mapping closest to a given one: damped Newton in the unit cube, one step at a time.

Levenberg (1944) and Marquardt (1963) for three unknowns with bounds. The columns of the Jacobian are scaled to unit
length first, so that a step does not depend on the aspect ratio of the cell; the damping keeps it finite where columns
vanish or become parallel (collapsed faces, singular lines); parameters that a bound holds back are left out.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["DAMPING_MAX", "DAMPING_START", "STATIONARY", "next_damping", "trial_step"]

DAMPING_START = 1e-10
"""Damping of the first step, relative to the unit diagonal of the scaled normal matrix: all but undamped."""

DAMPING_MIN = 1e-14
"""Least damping: keeps the normal matrix of a rank-deficient Jacobian factorable."""

DAMPING_RESTART = 1e-3
"""Damping after the first step that does not come closer; ten times more after each further one."""

DAMPING_MAX = 1e12
"""Damping at which steps are below round-off."""

STATIONARY = 1e-9
"""Cosine of the angle between the residual and every free column below which the point is the closest one."""


@njit(cache=True)
def next_damping(damping, is_closer):
    """Damping of the next step, after one that came closer or did not."""
    if is_closer:
        return max(0.05 * damping, DAMPING_MIN)
    return max(10.0 * damping, DAMPING_RESTART)


@njit(cache=True)
def trial_step(xi, residual, jacobian, damping, trial):
    """Step from ``xi`` towards the point whose residual is ``mapping(xi) - point``.

    Parameters
    ----------
    xi : ndarray, shape (3,)
        Parameters in [0, 1].
    residual : ndarray, shape (3,)
        Position minus the given point.
    jacobian : ndarray, shape (3, 3)
        Derivatives of the position; column d belongs to parameter d.
    damping : float
        Levenberg-Marquardt damping.
    trial : ndarray, shape (3,)
        Overwritten with the parameters to try, in [0, 1].

    Returns
    -------
    cosine : float
        Largest cosine of the angle between the residual and a free column; 0 at the closest point.
    """
    norms, slopes = _free_columns(xi, residual, jacobian)
    matrix = _scaled_products(jacobian, norms)
    step = _solve(matrix, slopes, damping)
    for d in range(3):
        trial[d] = xi[d] if norms[d] == 0.0 else min(max(xi[d] + step[d] / norms[d], 0.0), 1.0)
    length = np.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
    return max(abs(slopes[0]), abs(slopes[1]), abs(slopes[2])) / max(length, 1e-300)


@njit(cache=True, inline="always")
def _column_product(jacobian, d, e):
    return jacobian[0, d] * jacobian[0, e] + jacobian[1, d] * jacobian[1, e] + jacobian[2, d] * jacobian[2, e]


@njit(cache=True)
def _free_column(xi, residual, jacobian, d):
    """Norm of a column and slope of the distance along it; both 0 where it vanishes or a bound holds the parameter."""
    norm = np.sqrt(_column_product(jacobian, d, d))
    slope = jacobian[0, d] * residual[0] + jacobian[1, d] * residual[1] + jacobian[2, d] * residual[2]
    if norm < 1e-150 or (xi[d] <= 0.0 and slope >= 0.0) or (xi[d] >= 1.0 and slope <= 0.0):
        return 0.0, 0.0
    return norm, slope / norm


@njit(cache=True)
def _free_columns(xi, residual, jacobian):
    n0, s0 = _free_column(xi, residual, jacobian, 0)
    n1, s1 = _free_column(xi, residual, jacobian, 1)
    n2, s2 = _free_column(xi, residual, jacobian, 2)
    return (n0, n1, n2), (s0, s1, s2)


@njit(cache=True)
def _scaled_products(jacobian, norms):
    """Products (0, 1), (0, 2), (1, 2) of the unit columns; 0 with a column left out."""
    n01, n02, n12 = norms[0] * norms[1], norms[0] * norms[2], norms[1] * norms[2]
    return (
        _column_product(jacobian, 0, 1) / n01 if n01 > 0.0 else 0.0,
        _column_product(jacobian, 0, 2) / n02 if n02 > 0.0 else 0.0,
        _column_product(jacobian, 1, 2) / n12 if n12 > 0.0 else 0.0,
    )


@njit(cache=True)
def _solve(products, slopes, damping):
    """Solve ``(C^T C + damping I) step = -slopes`` by L D L^T; the diagonal of ``C^T C`` is 1."""
    d0 = 1.0 + damping
    l10, l20 = products[0] / d0, products[1] / d0
    d1 = max(d0 - products[0] * l10, damping)
    l21 = (products[2] - products[1] * l10) / d1
    d2 = max(d0 - products[1] * l20 - d1 * l21 * l21, damping)
    y0 = -slopes[0]
    y1 = -slopes[1] - l10 * y0
    y2 = -slopes[2] - l20 * y0 - l21 * y1
    step2 = y2 / d2
    step1 = y1 / d1 - l21 * step2
    return y0 / d0 - l10 * step1 - l20 * step2, step1, step2
