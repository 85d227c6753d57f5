"""Basis functions of one direction with their gradients in all three parameters, through curved knots, Eq. (4).

The triangle of `bspline_mdao.splines.basis` with three tangents, for many points at a time and without the interpreter
lock. A *gradient jet* is ``(f, f_xi, f_eta, f_zeta)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..splines.basis import find_span
from ..splines.knots import BilinearKnots, ConstantKnots, Knots, bilinear_knots, bilinear_slopes


def gradient_jets(knots: Knots, direction: int, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the functions that differ from zero at points.

    Parameters
    ----------
    knots : Knots
        Knots of the direction.
    direction : int
        0, 1 or 2.
    parameters : ndarray, shape (n, 3)
        Parameters of the points.

    Returns
    -------
    firsts : ndarray of int, shape (n,)
        First control point that each point depends on.
    jets : ndarray, shape (n, p, 4)
        Gradient jets of the functions.
    """
    firsts, jets = np.empty(len(parameters), dtype=np.int64), np.empty((len(parameters), knots.order, 4))
    if isinstance(knots, BilinearKnots):
        _bilinear_jets(knots.corners, knots.order, direction, parameters, firsts, jets)
    elif isinstance(knots, ConstantKnots):
        none = np.zeros((1, knots.knots.size, 2))
        _jets(knots.knots[None], none, knots.order, direction, parameters, firsts, jets)
    else:
        s, t = (parameters[:, (direction + offset) % 3].copy() for offset in (1, 2))
        _jets(knots.values(s, t), knots.gradients(s, t), knots.order, direction, parameters, firsts, jets)
    return firsts, jets


@njit(cache=True, nogil=True, error_model="numpy")
def _bilinear_jets(corners, order, direction, parameters, firsts, jets):
    T, slopes = np.empty(corners.shape[2]), np.empty((corners.shape[2], 2))
    for q in range(parameters.shape[0]):
        s, t = parameters[q, (direction + 1) % 3], parameters[q, (direction + 2) % 3]
        bilinear_knots(corners, s, t, T)
        bilinear_slopes(corners, s, t, 0, T.size, slopes)
        firsts[q] = _write_jets(T, slopes, order, direction, parameters[q, direction], jets[q])


@njit(cache=True, nogil=True, error_model="numpy")
def _jets(knots, slopes, order, direction, parameters, firsts, jets):
    """Knots of shape (n, N + p) and their slopes of shape (n, N + p, 2), or one of each for all points."""
    for q in range(parameters.shape[0]):
        at = min(q, knots.shape[0] - 1)
        firsts[q] = _write_jets(knots[at], slopes[at], order, direction, parameters[q, direction], jets[q])


@njit(cache=True, nogil=True, error_model="numpy")
def _write_jets(T, slopes, order, direction, xi, out):
    """Write the jets at one point to ``out``, shape (p, 4); return the first control point."""
    s = find_span(T, order, T.size - order, xi)
    gradient_jets_at(T, slopes, order, s, direction, xi, out)
    return s - order + 1


@njit(cache=True, nogil=True, error_model="numpy")
def gradient_jets_at(T, slopes, order, s, direction, xi, out):
    """Write the gradient jets of the ``p`` functions on span ``s`` to ``out``, for use inside numba kernels.

    Parameters
    ----------
    T, slopes : ndarray, shapes (N + p,) and (N + p, 2)
        Knots, and their derivatives in the next two parameters in cyclic order.
    order, s, direction : int
        Order p, span, and the direction of the knots.
    xi : float
        Parameter of this direction.
    out : ndarray, shape (>= p, 4)
        Receives the jets.
    """
    own, second, third = 1 + direction, 1 + (direction + 1) % 3, 1 + (direction + 2) % 3
    out[0, 0] = 1.0
    out[0, 1:] = 0.0
    for r in range(1, order):
        saved = saved_own = saved_second = saved_third = 0.0
        for m in range(r):
            low, high = s + 1 - r + m, s + 1 + m
            left, right = xi - T[low], T[high] - xi
            reciprocal = 1.0 / (T[high] - T[low])
            ratio = out[m, 0] * reciprocal
            ratio_own = out[m, own] * reciprocal
            ratio_second = (out[m, second] - ratio * (slopes[high, 0] - slopes[low, 0])) * reciprocal
            ratio_third = (out[m, third] - ratio * (slopes[high, 1] - slopes[low, 1])) * reciprocal
            out[m, 0] = saved + right * ratio
            out[m, own] = saved_own + right * ratio_own - ratio
            out[m, second] = saved_second + right * ratio_second + slopes[high, 0] * ratio
            out[m, third] = saved_third + right * ratio_third + slopes[high, 1] * ratio
            saved = left * ratio
            saved_own = left * ratio_own + ratio
            saved_second = left * ratio_second - slopes[low, 0] * ratio
            saved_third = left * ratio_third - slopes[low, 1] * ratio
        out[r, 0], out[r, own], out[r, second], out[r, third] = saved, saved_own, saved_second, saved_third
