"""Stiffness of elastic hexahedra, added to the blocks of a sparse matrix.

See `bspline_mdao.movement.element` for the element. With S_cd the integral of dN_a/dx_c dN_b/dx_d, the block between
corners a and b is lambda S + mu S^T + mu tr(S) I. The products S of all corners are sums over the Gauss points of
products of two vectors of 24, whose vector lanes are corners.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .element_corners import add_element
from .gauss_points import FAST, SLOPES, adjugate, at_point, divisor_of, slopes_of

__all__ = ["add_stiffness"]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _shape_gradients(f_s, sign, weight, gradients, weighted):
    """Gradients of the corners' shape functions times J at all Gauss points g.

    Component d of corner c is in ``gradients[g, 8 d + c]``, and times the weight by J in ``weighted[8 d + c, g]``.
    """
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        factor = weight / divisor
        for d in range(3):
            for c in range(8):
                value = a[0][d] * SLOPES[g, 0, c] + a[1][d] * SLOPES[g, 1, c] + a[2][d] * SLOPES[g, 2, c]
                gradients[g, 8 * d + c] = value
                weighted[8 * d + c, g] = factor * value


@njit(cache=True, error_model="numpy", fastmath=FAST)
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


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _pair_block(products, a, b, lame, block):
    """Stiffness between corners a and b, from their products S."""
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
        Place of every pair of corners, see `bspline_mdao.sparse.blocks.slots`.
    data : ndarray, shape (n_blocks, 3, 3)
        Blocks of the lower triangle, added to.
    """
    x, stiffness = np.empty((3, 3, 8), points.dtype), np.empty((8, 8, 3, 3), points.dtype)
    gradients, weighted = np.empty((8, 24), points.dtype), np.empty((24, 8), points.dtype)
    products = np.empty((24, 24), points.dtype)
    for e in range(len(elements)):
        slopes_of(points, elements[e], x)
        _shape_gradients(x, float(signs[e]), 0.125 * modulus[e], gradients, weighted)
        _element_products(gradients, weighted, products)
        for a in range(8):
            for b in range(a + 1):
                _pair_block(products, a, b, lame, stiffness[a, b])
        add_element(stiffness, rows[e], slots[e], data)
