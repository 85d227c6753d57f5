"""One point of a volume with its derivatives, Eqs. (3) to (5), for kernels that follow single points.

`bspline_mdao.splines.volume` takes many points at once and any knots. Here the knots are bilinear or constant, given as
the array of `bilinear_corners`, and the triple sum is contracted one direction at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..splines.basis import find_span
from ..splines.knots import BilinearKnots, ConstantKnots, Knots, bilinear_knots, bilinear_slopes
from .basis_gradients import gradient_jets_at

__all__ = ["bilinear_corners", "map_point", "map_point_scratch"]


def bilinear_corners(knots: Knots) -> np.ndarray | None:
    """Knots on the four edges of the other two parameters, Eq. (5), or None where they are not of this form.

    Returns
    -------
    ndarray, shape (2, 2, N + p), or None
    """
    if isinstance(knots, BilinearKnots):
        return knots.corners
    if isinstance(knots, ConstantKnots):
        return np.ascontiguousarray(np.broadcast_to(knots.knots, (2, 2, knots.knots.size)))
    return None


@njit(cache=True, error_model="numpy")
def map_point_scratch(corners, control_points):
    """Scratch arrays of `map_point`: knots, their derivatives, and basis jets of the three directions."""
    n_knots = max(corners[0].shape[2], corners[1].shape[2], corners[2].shape[2])
    order = max(n_knots - min(control_points.shape[:3]), 1)
    return np.empty(n_knots), np.empty((n_knots, 2)), np.empty((3, order, 4))


@njit(cache=True, error_model="numpy")
def map_point(corners, control_points, xi, scratch, position, jacobian):
    """Write one point of the volume and its derivatives in (xi, eta, zeta) to ``position`` and ``jacobian``.

    Parameters
    ----------
    corners : tuple of three ndarrays, shape (2, 2, N_d + p_d)
        Knots of each direction, see `bilinear_corners`.
    control_points : ndarray, shape (N0, N1, N2, 3)
        Control points.
    xi : ndarray, shape (3,)
        Parameters.
    scratch : tuple
        From `map_point_scratch`.
    position, jacobian : ndarray, shapes (3,) and (3, 3)
        Overwritten; column d of the Jacobian belongs to parameter d. It is 0 in a degenerate direction, whose parameter
        is not free to change, even where the knots of others depend on it.
    """
    knots, slopes, bases = scratch
    i = _direction_jets(corners[0], control_points.shape[0], xi[0], xi[1], xi[2], knots, slopes, bases[0])
    j = _direction_jets(corners[1], control_points.shape[1], xi[1], xi[2], xi[0], knots, slopes, bases[1])
    k = _direction_jets(corners[2], control_points.shape[2], xi[2], xi[0], xi[1], knots, slopes, bases[2])
    orders = (
        corners[0].shape[2] - control_points.shape[0],
        corners[1].shape[2] - control_points.shape[1],
        corners[2].shape[2] - control_points.shape[2],
    )
    _contract(control_points, (i, j, k), orders, bases, position, jacobian)
    for d in range(3):
        if control_points.shape[d] == 1:
            jacobian[:, d] = 0.0


@njit(cache=True, error_model="numpy")
def _direction_jets(corners, n_control, x, s, t, knots, slopes, jets):
    """First control point and jets in (x, s, t) of the basis functions of one direction."""
    order = corners.shape[2] - n_control
    bilinear_knots(corners, s, t, knots)
    span = find_span(knots, order, n_control, x)
    bilinear_slopes(corners, s, t, span - order + 2, span + order, slopes)
    gradient_jets_at(knots, slopes, order, span, 0, x, jets)
    return span - order + 1


@njit(cache=True, error_model="numpy")
def _contract(B, first, orders, bases, position, jacobian):
    """Contract the triple sum of Eq. (3): over zeta, then eta, then xi.

    The jet of direction d is in (d, d + 1, d + 2) modulo 3; entry 1 + (q - d) % 3 is its derivative in parameter q.
    """
    position[:] = 0.0
    jacobian[:] = 0.0
    for x in range(3):
        for a in range(orders[0]):
            p0, p1, p2, p3 = 0.0, 0.0, 0.0, 0.0
            for b in range(orders[1]):
                l0, l1, l2, l3 = 0.0, 0.0, 0.0, 0.0
                for c in range(orders[2]):
                    point = B[first[0] + a, first[1] + b, first[2] + c, x]
                    l0 += bases[2, c, 0] * point
                    l1 += bases[2, c, 2] * point
                    l2 += bases[2, c, 3] * point
                    l3 += bases[2, c, 1] * point
                m = bases[1, b]
                p0 += m[0] * l0
                p1 += m[0] * l1 + m[3] * l0
                p2 += m[0] * l2 + m[1] * l0
                p3 += m[0] * l3 + m[2] * l0
            n = bases[0, a]
            position[x] += n[0] * p0
            jacobian[x, 0] += n[0] * p1 + n[1] * p0
            jacobian[x, 1] += n[0] * p2 + n[2] * p0
            jacobian[x, 2] += n[0] * p3 + n[3] * p0
