"""The trilinear hexahedron of small-strain isotropic elasticity, with E = 1 per element times a given modulus.

With the slopes f_i = dx/dxi_i of the coordinates at a Gauss point, the rows a_0 = f_1 x f_2, a_1 = f_2 x f_0,
a_2 = f_0 x f_1 of the adjugate, and the Jacobian J = f_0 . a_0, a field u of slopes u_i has the gradient H(u) / J,

    H(u) = u_0 a_0^T + u_1 a_1^T + u_2 a_2^T,

so that the work of the stresses of u on the strains of v is a sum over 2 x 2 x 2 Gauss points of

    w = E / (8 J) (lambda tr H(u) tr H(v) + mu (H(u) + H(u)^T) : H(v)).

Everything here is a derivative of this one expression: the stiffness, the force on v, and the derivatives of the force
with respect to the coordinates. J is needed only as a divisor; where an element is nearly flat or folded it is replaced
by a positive number (`_divisor`), so that the stiffness stays positive definite. Edges may have no length.

Slopes at all Gauss points of an element are computed at once, the Gauss points being the vector lanes. All kernels take
real or complex points.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .element_corners import add_element
from .floors import FLAT, floored
from .vectors import add, cross, dot, less, scaled

__all__ = ["add_stiffness", "force", "force_jvp", "force_vjp", "lame_constants"]

_AT = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
_GAUSS = np.array([(_AT[a], _AT[b], _AT[d]) for d in (0, 1) for b in (0, 1) for a in (0, 1)])

_EDGES = np.array(
    [[(0, 1), (2, 3), (4, 5), (6, 7)], [(0, 2), (1, 3), (4, 6), (5, 7)], [(0, 4), (1, 5), (2, 6), (3, 7)]]
)
"""Corners at the ends of the four edges along each direction."""


def _edge_weights():
    """Weights of the four edges in the slope along each direction at each Gauss point, shape (3, 4, 8)."""
    ends = np.stack([1.0 - _GAUSS, _GAUSS])
    weights = np.empty((3, 4, 8))
    for d, (low, high) in enumerate(((1, 2), (0, 2), (0, 1))):
        weights[d] = [ends[a, :, low] * ends[b, :, high] for b in (0, 1) for a in (0, 1)]
    return weights


def _corner_slopes():
    """Slopes of the shape functions at each Gauss point, shape (8 Gauss points, 3, 8 corners)."""
    slopes = np.zeros((8, 3, 8))
    for direction, edge in np.ndindex(3, 4):
        low, high = _EDGES[direction, edge]
        slopes[:, direction, low] -= _WEIGHTS[direction, edge]
        slopes[:, direction, high] += _WEIGHTS[direction, edge]
    return slopes


_WEIGHTS = _edge_weights()
_SLOPES = _corner_slopes()
_TINY = 1e-290
_FAST = {"contract", "nsz", "reassoc"}


def lame_constants(poisson_ratio: float) -> tuple[float, float]:
    """Lame's constants lambda and mu for a Young's modulus of 1."""
    nu = poisson_ratio
    return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu)


@njit(cache=True, inline="always")
def _at(slopes, g):
    """Three slopes at a Gauss point."""
    return (
        (slopes[0, 0, g], slopes[0, 1, g], slopes[0, 2, g]),
        (slopes[1, 0, g], slopes[1, 1, g], slopes[1, 2, g]),
        (slopes[2, 0, g], slopes[2, 1, g], slopes[2, 2, g]),
    )


@njit(cache=True, inline="always")
def _put(vectors, g, slopes):
    """Store three vectors of a Gauss point."""
    for i in range(3):
        for d in range(3):
            slopes[i, d, g] = vectors[i][d]


@njit(cache=True, inline="always")
def _adjugate(f):
    """Rows of the adjugate of the matrix with columns f."""
    return cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])


@njit(cache=True, inline="always")
def _adjugate_jvp(f, df):
    """Change of the adjugate."""
    return (
        add(cross(df[1], f[2]), cross(f[1], df[2])),
        add(cross(df[2], f[0]), cross(f[2], df[0])),
        add(cross(df[0], f[1]), cross(f[0], df[1])),
    )


@njit(cache=True, inline="always")
def _adjugate_vjp(f, bar):
    """Transpose of `_adjugate_jvp`."""
    return (
        less(cross(f[1], bar[2]), cross(f[2], bar[1])),
        less(cross(f[2], bar[0]), cross(f[0], bar[2])),
        less(cross(f[0], bar[1]), cross(f[1], bar[0])),
    )


@njit(cache=True, inline="always")
def _divisor(f, a, sign):
    """Positive divisor that is |J| in valid elements, and its derivatives by J and by the logarithms of the |f_i|^2.

    |f_0| |f_1| |f_2| times the floored triple product of the unit slopes.
    """
    jacobian = sign * dot(f[0], a[0])
    lengths = np.sqrt(dot(f[0], f[0]) * dot(f[1], f[1]) * dot(f[2], f[2]) + _TINY)
    flatness = jacobian / lengths
    height, slope = floored(flatness, FLAT)
    return lengths * height, sign * slope, lengths * (height - flatness * slope)


@njit(cache=True, inline="always")
def _divisor_gradient(f, a, by_jacobian, by_lengths):
    """Derivatives of the divisor with respect to the slopes f_i."""
    return (
        add(scaled(by_jacobian, a[0]), scaled(by_lengths / (dot(f[0], f[0]) + _TINY), f[0])),
        add(scaled(by_jacobian, a[1]), scaled(by_lengths / (dot(f[1], f[1]) + _TINY), f[1])),
        add(scaled(by_jacobian, a[2]), scaled(by_lengths / (dot(f[2], f[2]) + _TINY), f[2])),
    )


@njit(cache=True, inline="always")
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


@njit(cache=True, inline="always")
def _traction(stress, v):
    """Stress times a vector."""
    xx, yy, zz, yz, zx, xy = stress
    return (
        xx * v[0] + xy * v[1] + zx * v[2],
        xy * v[0] + yy * v[1] + yz * v[2],
        zx * v[0] + yz * v[1] + zz * v[2],
    )


@njit(cache=True, inline="always")
def _fluxes(stress, a, factor):
    """Derivatives by the slopes v_i of the work on v."""
    return (
        scaled(factor, _traction(stress, a[0])),
        scaled(factor, _traction(stress, a[1])),
        scaled(factor, _traction(stress, a[2])),
    )


@njit(cache=True, inline="always")
def _sum(p, q):
    """Sum of two triples of vectors."""
    return add(p[0], q[0]), add(p[1], q[1]), add(p[2], q[2])


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _slopes(values, element, slopes):
    """Slopes of the corner values at all Gauss points, shape (3 directions, 3 components, 8)."""
    for i in range(3):
        for d in range(3):
            along = slopes[i, d]
            edges = _EDGES[i]
            e_0 = values[element[edges[0, 1]], d] - values[element[edges[0, 0]], d]
            e_1 = values[element[edges[1, 1]], d] - values[element[edges[1, 0]], d]
            e_2 = values[element[edges[2, 1]], d] - values[element[edges[2, 0]], d]
            e_3 = values[element[edges[3, 1]], d] - values[element[edges[3, 0]], d]
            for g in range(8):
                along[g] = (
                    _WEIGHTS[i, 0, g] * e_0
                    + _WEIGHTS[i, 1, g] * e_1
                    + _WEIGHTS[i, 2, g] * e_2
                    + _WEIGHTS[i, 3, g] * e_3
                )


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _add_slopes_transposed(slopes, element, values):
    """Transpose of `_slopes`, added to the corner values."""
    for i in range(3):
        for edge in range(4):
            low, high = element[_EDGES[i, edge, 0]], element[_EDGES[i, edge, 1]]
            for d in range(3):
                total = slopes[i, d, 0] * _WEIGHTS[i, edge, 0]
                for g in range(1, 8):
                    total += slopes[i, d, g] * _WEIGHTS[i, edge, g]
                values[high, d] += total
                values[low, d] -= total


@njit(cache=True, inline="always")
def _work(u_fluxes, v):
    """Work of fluxes on slopes."""
    return dot(u_fluxes[0], v[0]) + dot(u_fluxes[1], v[1]) + dot(u_fluxes[2], v[2])


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _element_force(f_s, u_s, sign, weight, lame, out):
    """Fluxes of u at the Gauss points: their transposed slopes are the force."""
    for g in range(8):
        f = _at(f_s, g)
        a = _adjugate(f)
        divisor, _, _ = _divisor(f, a, sign)
        _put(_fluxes(_stress(_at(u_s, g), a, lame), a, weight / divisor), g, out)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _element_force_jvp(f_s, u_s, df_s, du_s, sign, weight, d_weight, lame, out):
    """Change of the fluxes of u."""
    for g in range(8):
        f, u, df = _at(f_s, g), _at(u_s, g), _at(df_s, g)
        a, da = _adjugate(f), _adjugate_jvp(f, df)
        divisor, by_jacobian, by_lengths = _divisor(f, a, sign)
        d_divisor = _work(_divisor_gradient(f, a, by_jacobian, by_lengths), df)
        factor, stress = weight / divisor, _stress(u, a, lame)
        changes = (
            _fluxes(stress, a, (d_weight - factor * d_divisor) / divisor),
            _fluxes(_stress(_at(du_s, g), a, lame), a, factor),
            _fluxes(_stress(u, da, lame), a, factor),
            _fluxes(stress, da, factor),
        )
        for i in range(3):
            for d in range(3):
                out[i, d, g] = changes[0][i][d] + changes[1][i][d] + changes[2][i][d] + changes[3][i][d]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _element_force_vjp(f_s, u_s, v_s, sign, weight, lame, f_bar, u_bar):
    """Derivatives of the work of the stresses of u on the strains of v by the slopes of x and u; the work by weight."""
    total = 0.0 * weight
    for g in range(8):
        f, u, v = _at(f_s, g), _at(u_s, g), _at(v_s, g)
        a = _adjugate(f)
        divisor, by_jacobian, by_lengths = _divisor(f, a, sign)
        stress_u, stress_v, factor = _stress(u, a, lame), _stress(v, a, lame), weight / divisor
        fluxes = _fluxes(stress_v, a, factor)
        work = _work(fluxes, u)
        a_bar = _sum(_fluxes(stress_u, v, factor), _fluxes(stress_v, u, factor))
        by_divisor = -work / divisor
        divisor_bar = _divisor_gradient(f, a, by_divisor * by_jacobian, by_divisor * by_lengths)
        _put(_sum(_adjugate_vjp(f, a_bar), divisor_bar), g, f_bar)
        _put(fluxes, g, u_bar)
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
        Points at the corners, see `bspline_mdao.movement.mesh.MovingMesh.elements`.
    signs : ndarray of int8, shape (n_elements,)
        Handedness.
    modulus : ndarray, shape (n_elements,)
        Young's modulus, positive.
    lame : tuple of float
        From `lame_constants`.
    displacement : ndarray, shape (n_points, 3)
        The field u (m).

    Returns
    -------
    ndarray, shape (n_points, 3)
    """
    total = np.zeros_like(points)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    for e in range(len(elements)):
        corners = elements[e]
        _slopes(points, corners, x)
        _slopes(displacement, corners, u)
        _element_force(x, u, float(signs[e]), 0.125 * modulus[e], lame, fluxes)
        _add_slopes_transposed(fluxes, corners, total)
    return total


@njit(cache=True)
def force_jvp(points, elements, signs, modulus, lame, displacement, d_points, d_modulus, d_displacement):
    """Change of `force` for changes of the points, the modulus and the displacement, each of its shape."""
    total = np.zeros_like(points)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    dx, du = np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype)
    for e in range(len(elements)):
        corners = elements[e]
        _slopes(points, corners, x)
        _slopes(displacement, corners, u)
        _slopes(d_points, corners, dx)
        _slopes(d_displacement, corners, du)
        weight, d_weight = 0.125 * modulus[e], 0.125 * d_modulus[e]
        _element_force_jvp(x, u, dx, du, float(signs[e]), weight, d_weight, lame, fluxes)
        _add_slopes_transposed(fluxes, corners, total)
    return total


@njit(cache=True)
def force_vjp(points, elements, signs, modulus, lame, displacement, bar):
    """Transpose of `force_jvp`.

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
        _slopes(points, corners, x)
        _slopes(displacement, corners, u)
        _slopes(bar, corners, v)
        modulus_bar[e] = 0.125 * _element_force_vjp(x, u, v, float(signs[e]), 0.125 * modulus[e], lame, x_bar, u_bar)
        _add_slopes_transposed(x_bar, corners, points_bar)
        _add_slopes_transposed(u_bar, corners, displacement_bar)
    return points_bar, modulus_bar, displacement_bar


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _shape_gradients(f_s, sign, weight, gradients, weighted):
    """Gradients of the corners' shape functions times J at all Gauss points g.

    Component d of corner c is in ``gradients[g, 8 d + c]``, and times the weight by J in ``weighted[8 d + c, g]``.
    """
    for g in range(8):
        f = _at(f_s, g)
        a = _adjugate(f)
        divisor, _, _ = _divisor(f, a, sign)
        factor = weight / divisor
        for d in range(3):
            for c in range(8):
                value = a[0][d] * _SLOPES[g, 0, c] + a[1][d] * _SLOPES[g, 1, c] + a[2][d] * _SLOPES[g, 2, c]
                gradients[g, 8 * d + c] = value
                weighted[8 * d + c, g] = factor * value


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _element_products(gradients, weighted, products):
    """Integrals of dN_a/dx_c dN_b/dx_d in ``products[8 c + a, 8 d + b]`` for c >= d: sums over the Gauss points."""
    for row in range(24):
        w_0, w_1, w_2, w_3 = weighted[row, 0], weighted[row, 1], weighted[row, 2], weighted[row, 3]
        w_4, w_5, w_6, w_7 = weighted[row, 4], weighted[row, 5], weighted[row, 6], weighted[row, 7]
        for column in range(8 * (row // 8 + 1)):
            products[row, column] = (
                (w_0 * gradients[0, column] + w_1 * gradients[1, column])
                + (w_2 * gradients[2, column] + w_3 * gradients[3, column])
                + (w_4 * gradients[4, column] + w_5 * gradients[5, column])
                + (w_6 * gradients[6, column] + w_7 * gradients[7, column])
            )


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _pair_block(products, a, b, lame, block):
    """Stiffness between corners a and b: lambda S + mu S^T + mu tr(S) I with S_cd an integral of `_element_products`."""
    diagonal = lame[1] * (products[a, b] + products[8 + a, 8 + b] + products[16 + a, 16 + b])
    for c in range(3):
        block[c, c] = (lame[0] + lame[1]) * products[8 * c + a, 8 * c + b] + diagonal
        for d in range(c):
            below, above = products[8 * c + a, 8 * d + b], products[8 * c + b, 8 * d + a]
            block[c, d] = lame[0] * below + lame[1] * above
            block[d, c] = lame[0] * above + lame[1] * below


@njit(cache=True)
def add_stiffness(points, elements, signs, modulus, lame, rows, slots, data):
    """Add the stiffness of all elements to the blocks of a symmetric matrix.

    Parameters
    ----------
    points, elements, signs, modulus, lame
        As for `force`.
    rows : ndarray of int32, shape (n_elements, 8)
        Block row of every corner, -1 where it has none.
    slots : ndarray of int32, shape (n_elements, 36)
        Place of every pair of corners, see `bspline_mdao.sparse.element_pattern.slots`.
    data : ndarray, shape (n_blocks, 3, 3)
        Blocks of the lower triangle, added to.
    """
    x, stiffness = np.empty((3, 3, 8), points.dtype), np.empty((8, 8, 3, 3), points.dtype)
    gradients, weighted = np.empty((8, 24), points.dtype), np.empty((24, 8), points.dtype)
    products = np.empty((24, 24), points.dtype)
    for e in range(len(elements)):
        _slopes(points, elements[e], x)
        _shape_gradients(x, float(signs[e]), 0.125 * modulus[e], gradients, weighted)
        _element_products(gradients, weighted, products)
        for a in range(8):
            for b in range(a + 1):
                _pair_block(products, a, b, lame, stiffness[a, b])
        add_element(stiffness, rows[e], slots[e], data)
