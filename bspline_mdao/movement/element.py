"""The trilinear hexahedron of small-strain isotropic elasticity: forces and their derivatives.

With the slopes f_i and adjugate rows a_i of `.gauss_points`, a field u of slopes u_i has the gradient H(u) / J,

    H(u) = u_0 a_0^T + u_1 a_1^T + u_2 a_2^T,

so that the work of the stresses of u on the strains of v is a sum over 2 x 2 x 2 Gauss points of

    w = E / (8 J) (lambda tr H(u) tr H(v) + mu (H(u) + H(u)^T) : H(v)),

lambda and mu being those of a Young's modulus of 1. Everything here is a derivative of this one expression: the force
on v, and the derivatives of the force with respect to the coordinates. J is needed only as a divisor; where an element
is nearly flat or folded, a positive number takes its place, so that the stiffness stays positive definite.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.vectors import add, dot, scaled
from .gauss_points import (
    FAST,
    add_slopes_transposed,
    add_slopes_transposed_to_sum,
    adjugate,
    adjugate_jvp,
    adjugate_vjp,
    at_point,
    divisor_gradient,
    divisor_of,
    put_at_point,
    slopes_of,
    slopes_of_sum,
)

__all__ = ["force", "force_jvp", "force_vjp", "lame_constants"]


def lame_constants(poisson_ratio: float) -> tuple[float, float]:
    """Lame's constants lambda and mu for a Young's modulus of 1."""
    nu = poisson_ratio
    return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _stress(u, a, lame):
    """Stress of H(u) = sum of u_i a_i^T: xx, yy, zz, yz, zx, xy."""
    xx = u[0][0] * a[0][0] + u[1][0] * a[1][0] + u[2][0] * a[2][0]
    yy = u[0][1] * a[0][1] + u[1][1] * a[1][1] + u[2][1] * a[2][1]
    zz = u[0][2] * a[0][2] + u[1][2] * a[1][2] + u[2][2] * a[2][2]
    yz = u[0][1] * a[0][2] + u[1][1] * a[1][2] + u[2][1] * a[2][2]
    zy = u[0][2] * a[0][1] + u[1][2] * a[1][1] + u[2][2] * a[2][1]
    zx = u[0][2] * a[0][0] + u[1][2] * a[1][0] + u[2][2] * a[2][0]
    xz = u[0][0] * a[0][2] + u[1][0] * a[1][2] + u[2][0] * a[2][2]
    xy = u[0][0] * a[0][1] + u[1][0] * a[1][1] + u[2][0] * a[2][1]
    yx = u[0][1] * a[0][0] + u[1][1] * a[1][0] + u[2][1] * a[2][0]
    pressure, twice = lame[0] * (xx + yy + zz), 2.0 * lame[1]
    shear = lame[1] * (yz + zy), lame[1] * (zx + xz), lame[1] * (xy + yx)
    return pressure + twice * xx, pressure + twice * yy, pressure + twice * zz, shear[0], shear[1], shear[2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _traction(stress, v):
    """Stress times a vector."""
    xx, yy, zz, yz, zx, xy = stress
    return (
        xx * v[0] + xy * v[1] + zx * v[2],
        xy * v[0] + yy * v[1] + yz * v[2],
        zx * v[0] + yz * v[1] + zz * v[2],
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _fluxes(stress, a, factor):
    """Derivatives by the slopes v_i of the work on v."""
    return (
        scaled(factor, _traction(stress, a[0])),
        scaled(factor, _traction(stress, a[1])),
        scaled(factor, _traction(stress, a[2])),
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _sum(p, q):
    """Sum of two triples of vectors."""
    return add(p[0], q[0]), add(p[1], q[1]), add(p[2], q[2])


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _work(u_fluxes, v):
    """Work of fluxes on slopes."""
    return dot(u_fluxes[0], v[0]) + dot(u_fluxes[1], v[1]) + dot(u_fluxes[2], v[2])


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force(f_s, u_s, sign, weight, lame, out):
    """Fluxes of u at the Gauss points: their transposed slopes are the force."""
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        put_at_point(_fluxes(_stress(at_point(u_s, g), a, lame), a, weight / divisor), g, out)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_jvp(f_s, u_s, df_s, sign, weight, d_weight, lame, out):
    """Change of the fluxes of a given u."""
    for g in range(8):
        f, u, df = at_point(f_s, g), at_point(u_s, g), at_point(df_s, g)
        a, da = adjugate(f), adjugate_jvp(f, df)
        divisor, by_jacobian, by_lengths = divisor_of(f, a, sign)
        d_divisor = _work(divisor_gradient(f, a, by_jacobian, by_lengths), df)
        factor, stress = weight / divisor, _stress(u, a, lame)
        changes = (
            _fluxes(stress, a, (d_weight - factor * d_divisor) / divisor),
            _fluxes(_stress(u, da, lame), a, factor),
            _fluxes(stress, da, factor),
        )
        for i in range(3):
            for d in range(3):
                out[i, d, g] = changes[0][i][d] + changes[1][i][d] + changes[2][i][d]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_vjp(f_s, u_s, v_s, sign, weight, lame, f_bar, u_bar):
    """Derivatives of the work of the stresses of u on the strains of v by the slopes of x and u; the work by weight."""
    total = 0.0 * weight
    for g in range(8):
        f, u, v = at_point(f_s, g), at_point(u_s, g), at_point(v_s, g)
        a = adjugate(f)
        divisor, by_jacobian, by_lengths = divisor_of(f, a, sign)
        stress_u, stress_v, factor = _stress(u, a, lame), _stress(v, a, lame), weight / divisor
        fluxes = _fluxes(stress_v, a, factor)
        work = _work(fluxes, u)
        a_bar = _sum(_fluxes(stress_u, v, factor), _fluxes(stress_v, u, factor))
        by_divisor = -work / divisor
        divisor_bar = divisor_gradient(f, a, by_divisor * by_jacobian, by_divisor * by_lengths)
        put_at_point(_sum(adjugate_vjp(f, a_bar), divisor_bar), g, f_bar)
        put_at_point(fluxes, g, u_bar)
        total += work
    return total / weight


@njit(cache=True)
def force(points, elements, signs, modulus, lame, displacement):
    """Compute the force K u on every point, matrix-free.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Coordinates (m).
    elements : ndarray of int32, shape (n_elements, 8)
        Points at the corners, see `bspline_mdao.mesh.moving_mesh.MovingMesh.elements`.
    signs : ndarray of int8, shape (n_elements,)
        Handedness.
    modulus : ndarray, shape (n_elements,)
        Young's modulus, positive.
    lame : tuple of float
        From `lame_constants`.
    displacement : ndarray, shape (n_parts, n_points, 3)
        The field u as a sum of parts (m). Two are what an element needs whose corners lie closer together than the
        digits of one can tell: the second holds what rounding left of the first.

    Returns
    -------
    ndarray, shape (n_parts, n_points, 3)
        As a sum of as many parts.
    """
    total = np.zeros_like(displacement)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        _element_force(x, u, float(signs[e]), 0.125 * modulus[e], lame, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def force_jvp(points, elements, signs, modulus, lame, displacement, d_points, d_modulus):
    """Change of `force` for changes of the points and the modulus; in the displacement, `force` is linear.

    It is a sum of as many parts as the displacement.
    """
    total = np.zeros_like(displacement)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    dx = np.empty((3, 3, 8), points.dtype)
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        slopes_of(d_points, corners, dx)
        weight, d_weight = 0.125 * modulus[e], 0.125 * d_modulus[e]
        _element_force_jvp(x, u, dx, float(signs[e]), weight, d_weight, lame, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def force_vjp(points, elements, signs, modulus, lame, displacement, bar):
    """Transpose of `force_jvp` and of `force`.

    Parameters
    ----------
    points, elements, signs, modulus, lame, displacement
        As for `force`.
    bar : ndarray, shape (n_parts, n_points, 3)
        Derivative of a scalar by the force, as a sum of parts.

    Returns
    -------
    points_bar : ndarray, shape (n_points, 3)
        By the points.
    modulus_bar : ndarray, shape (n_elements,)
        By the modulus.
    displacement_bar : ndarray, shape (n_points, 3)
        By the displacement: the force of ``bar``.
    """
    points_bar, modulus_bar, displacement_bar = np.zeros_like(points), np.empty_like(modulus), np.zeros_like(points)
    x, u, v = np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype)
    x_bar, u_bar = np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype)
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        slopes_of_sum(bar, corners, v)
        modulus_bar[e] = 0.125 * _element_force_vjp(x, u, v, float(signs[e]), 0.125 * modulus[e], lame, x_bar, u_bar)
        add_slopes_transposed(x_bar, corners, points_bar)
        add_slopes_transposed(u_bar, corners, displacement_bar)
    return points_bar, modulus_bar, displacement_bar
