"""The point of a mapping closest to a given one: damped Newton in the unit cube, one step at a time.

Levenberg (1944) and Marquardt (1963) for three unknowns with bounds. The columns of the Jacobian are scaled to unit
length first, so that a step does not depend on the aspect ratio of the cell; the damping keeps it finite where columns
vanish or become parallel (collapsed faces, singular lines); parameters that a bound holds back are left out.

Steps that do not come closer are followed for a while before the descent goes back to the closest parameters so far and
damps more: near a singular line Newton's path to the point leads over larger distances (Grippo, Lampariello and Lucidi
1986, a nonmonotone search).

At a point outside, the residual does not vanish and the curvature of the mapping counts: its part of the Hessian is
estimated from the steps by the structured secant update of Dennis, Gay and Welsch (1981), and used while steps reduce
the distance by less than half. Without it, convergence there is linear, and slow beyond the radius of curvature.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["advance", "column_norm", "is_collapsed", "start"]

DAMPING_START = 1e-10
"""Damping of the first step, relative to the unit diagonal of the scaled normal matrix: all but undamped."""

DAMPING_MIN = 1e-14
"""Least damping: keeps the normal matrix of a rank-deficient Jacobian factorable."""

DAMPING_RESTART = 1e-3
"""Damping after the first step that does not come closer; ten times more after each further one."""

DAMPING_MAX = 1e12
"""Damping at which steps are below round-off."""

PATIENCE = 4
"""Steps in a row that need not come closer, until one has halved the distance."""

STATIONARY = 1e-9
"""Cosine of the angle between the residual and every free column below which the point is the closest one."""

DEFINITE = 1e-3
"""Least pivot of the scaled Hessian with curvature; with a smaller one the curvature is left out of the step."""

COLLAPSED = 1e-12
"""Norm of a column, relative to the longest one, below which the position does not depend on its parameter."""


@njit(cache=True)
def start(progress):
    """Set the progress of a descent (see `advance`) to its beginning."""
    progress[0], progress[1], progress[2] = np.inf, DAMPING_START, 0.0


@njit(cache=True, error_model="numpy")
def advance(xi, residual, jacobian, kept, progress, target):
    """Judge the parameters that a descent has come to, and take the next step from there or from the closest ones.

    Parameters
    ----------
    xi : ndarray, shape (3,)
        Parameters reached; overwritten with the next ones to evaluate, or with the closest ones at the end.
    residual, jacobian : ndarray, shapes (3,) and (3, 3)
        ``mapping(xi) - point`` and its derivatives in the parameters (columns).
    kept : ndarray, shape (8, 3)
        Scratch of the descent: parameters, residual and Jacobian where it was closest, and the curvature there.
    progress : ndarray, shape (3,)
        Least distance so far, damping, and steps without success.
    target : float
        Distance that is close enough.

    Returns
    -------
    bool
        Whether the descent has ended.
    """
    _judge(xi, residual, jacobian, kept, progress)
    is_back = progress[2] > PATIENCE
    is_at_best = is_back or progress[2] == 0.0
    if is_back:
        xi[:], residual[:], jacobian[:] = kept[0], kept[1], kept[2:5]
    cosine = _trial_step(xi, residual, jacobian, kept[5:], progress[1])
    is_done = progress[0] <= target or progress[1] > DAMPING_MAX or (is_at_best and cosine <= STATIONARY)
    if is_done:
        xi[:] = kept[0]
    return is_done


@njit(cache=True)
def _judge(xi, residual, jacobian, kept, progress):
    """Keep the closest parameters; count the steps that are not closer, and damp when there are too many."""
    distance = np.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
    if distance < progress[0]:
        if distance < 0.5 * progress[0] or progress[2] <= PATIENCE:
            progress[2] = 0.0
        if distance > 0.5 * progress[0]:
            _update_curvature(xi, residual, jacobian, kept)
        else:
            kept[5:] = 0.0
        progress[0], progress[1] = distance, max(0.05 * progress[1], DAMPING_MIN)
        kept[0], kept[1], kept[2:5] = xi, residual, jacobian
        return
    progress[2] += 1.0
    if progress[2] > PATIENCE:
        progress[1] = max(10.0 * progress[1], DAMPING_RESTART)


@njit(cache=True, error_model="numpy")
def _update_curvature(xi, residual, jacobian, kept):
    """Update the estimate of ``sum_x residual_x Hessian_x`` by the step from the kept parameters to ``xi``."""
    step = xi - kept[0]
    change = np.empty(3)  # of the gradient of half the squared distance
    excess = np.empty(3)  # part of it that is due to curvature
    for d in range(3):
        gradient, moved = 0.0, 0.0
        for x in range(3):
            gradient += jacobian[x, d] * residual[x]
            moved += kept[2 + x, d] * residual[x]
        change[d], excess[d] = gradient, gradient - moved
        for x in range(3):
            change[d] -= kept[2 + x, d] * kept[1, x]
    _secant_update(kept[5:], step, change, excess)


@njit(cache=True, error_model="numpy")
def _secant_update(curvature, step, change, excess):
    """Update the matrix, after sizing, so that it maps ``step`` to ``excess`` (Dennis, Gay and Welsch, section 4)."""
    slope, sized, wanted = 0.0, 0.0, 0.0
    for d in range(3):
        slope += change[d] * step[d]
        wanted += excess[d] * step[d]
        for e in range(3):
            sized += step[d] * curvature[d, e] * step[e]
    if slope <= 0.0:
        return
    if sized != 0.0:
        curvature *= min(1.0, abs(wanted / sized))
    missing = excess.copy()
    for d in range(3):
        for e in range(3):
            missing[d] -= curvature[d, e] * step[e]
    along = (missing[0] * step[0] + missing[1] * step[1] + missing[2] * step[2]) / slope
    for d in range(3):
        for e in range(3):
            curvature[d, e] += (missing[d] * change[e] + change[d] * missing[e] - along * change[d] * change[e]) / slope


@njit(cache=True, error_model="numpy")
def _trial_step(xi, residual, jacobian, curvature, damping):
    """Move ``xi`` by one step; return the largest cosine between residual and free columns, 0 at the closest point."""
    norms, slopes = _free_columns(xi, residual, jacobian)
    step, is_definite = _solve(_scaled_products(jacobian, curvature, norms), slopes, damping)
    if not is_definite:
        step, _ = _solve(_scaled_products(jacobian, 0.0 * curvature, norms), slopes, damping)
    for d in range(3):
        if norms[d] > 0.0:
            xi[d] = min(max(xi[d] + step[d] / norms[d], 0.0), 1.0)
    length = np.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
    return max(abs(slopes[0]), abs(slopes[1]), abs(slopes[2])) / max(length, 1e-300)


@njit(cache=True, inline="always")
def _column_product(jacobian, d, e):
    return jacobian[0, d] * jacobian[0, e] + jacobian[1, d] * jacobian[1, e] + jacobian[2, d] * jacobian[2, e]


@njit(cache=True)
def column_norm(jacobian, d):
    """Length of column ``d``."""
    return np.sqrt(_column_product(jacobian, d, d))


@njit(cache=True)
def is_collapsed(jacobian, d):
    """Whether the position does not depend on parameter ``d``, as on a collapsed face, up to round-off."""
    longest = max(column_norm(jacobian, 0), column_norm(jacobian, 1), column_norm(jacobian, 2))
    return column_norm(jacobian, d) <= COLLAPSED * longest


@njit(cache=True)
def _free_column(xi, residual, jacobian, d):
    """Norm of a column and slope of the distance along it; both 0 where it vanishes or a bound holds the parameter."""
    slope = jacobian[0, d] * residual[0] + jacobian[1, d] * residual[1] + jacobian[2, d] * residual[2]
    if is_collapsed(jacobian, d) or (xi[d] <= 0.0 and slope >= 0.0) or (xi[d] >= 1.0 and slope <= 0.0):
        return 0.0, 0.0
    norm = column_norm(jacobian, d)
    return norm, slope / norm


@njit(cache=True)
def _free_columns(xi, residual, jacobian):
    n0, s0 = _free_column(xi, residual, jacobian, 0)
    n1, s1 = _free_column(xi, residual, jacobian, 1)
    n2, s2 = _free_column(xi, residual, jacobian, 2)
    return (n0, n1, n2), (s0, s1, s2)


@njit(cache=True)
def _scaled_product(jacobian, curvature, norms, d, e):
    """Entry of the Hessian in scaled parameters; that of the unit matrix with a column left out."""
    if norms[d] == 0.0 or norms[e] == 0.0:
        return 1.0 if d == e else 0.0
    return (_column_product(jacobian, d, e) + curvature[d, e]) / (norms[d] * norms[e])


@njit(cache=True)
def _scaled_products(jacobian, curvature, norms):
    """Entries (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2) of the Hessian in scaled parameters."""
    return (
        _scaled_product(jacobian, curvature, norms, 0, 0),
        _scaled_product(jacobian, curvature, norms, 1, 1),
        _scaled_product(jacobian, curvature, norms, 2, 2),
        _scaled_product(jacobian, curvature, norms, 0, 1),
        _scaled_product(jacobian, curvature, norms, 0, 2),
        _scaled_product(jacobian, curvature, norms, 1, 2),
    )


@njit(cache=True, error_model="numpy")
def _solve(products, slopes, damping):
    """Solve ``(H + damping I) step = -slopes`` by L D L^T; return whether its pivots are safely positive too."""
    h00, h11, h22, h01, h02, h12 = products
    d0 = h00 + damping
    l10, l20 = h01 / d0, h02 / d0
    d1 = max(h11 + damping - h01 * l10, damping)
    l21 = (h12 - h02 * l10) / d1
    d2 = max(h22 + damping - h02 * l20 - d1 * l21 * l21, damping)
    y0 = -slopes[0]
    y1 = -slopes[1] - l10 * y0
    y2 = -slopes[2] - l20 * y0 - l21 * y1
    step2 = y2 / d2
    step1 = y1 / d1 - l21 * step2
    step0 = y0 / d0 - l10 * step1 - l20 * step2
    return (step0, step1, step2), min(d0, d1, d2) > DEFINITE
