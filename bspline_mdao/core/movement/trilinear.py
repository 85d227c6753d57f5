"""The trilinear hexahedron that the elements of `bspline_mdao.core.movement` share.

Coordinates at its Gauss points, a positive replacement for a Jacobian that may vanish, and sums over corners.
Theory: ``docs/theory/elasticity.rst``.

Corner a + 2 b + 4 d is at (a, b, d). With the slopes f_i = dx/dxi_i at a Gauss point, the rows of the adjugate are
a_0 = f_1 x f_2, a_1 = f_2 x f_0 and a_2 = f_0 x f_1, and the Jacobian is J = f_0 . a_0. Edges may have no length: only
the Gauss points matter. Slopes at all Gauss points of an element are computed at once, with the Gauss points as SIMD
lanes. All kernels take real or complex points.

Regularisation
--------------
Measures of elements that are flat or folded in real meshes are kept positive. Regularised at t_0, a number t stays
unchanged from t_0 up, and levels off at t_0 / 2 below, with two continuous derivatives::

    t                                           t >= t_0
    t_0 / 2 (1 + 1 / (1 + z + z^2))             t <  t_0,   z = 2 (1 - t / t_0)
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, cross, dot, less, scaled

__all__ = [
    "FAST",
    "FLAT_CORNER",
    "FLAT_ELEMENT",
    "SLOPES",
    "add_at_corners",
    "add_element",
    "add_exactly",
    "add_slopes_transposed",
    "add_slopes_transposed_to_sum",
    "adjugate",
    "adjugate_jvp",
    "adjugate_vjp",
    "at_point",
    "divisor_gradient",
    "divisor_of",
    "gradient",
    "put_at_point",
    "regularised",
    "regularised_array",
    "slopes_of",
    "slopes_of_sum",
    "sum_of",
    "work_of",
]

FLAT_CORNER = 0.01
"""Number t_0 for the triple product of unit edges at a corner: 0.6 degrees from flat."""

FLAT_ELEMENT = 0.05
"""The same for Jacobian over lengths of slopes, and volume over lengths of edges: 3 degrees from flat."""


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def regularised(t, t_0):
    """Regularise t at t_0: the number and its derivative; t may be complex."""
    z = 2.0 * (1.0 - t / t_0)
    g = 1.0 / (1.0 + z + z * z)
    is_above = t.real >= t_0
    return (t if is_above else 0.5 * t_0 * (1.0 + g)), (1.0 + 0.0 * t if is_above else (1.0 + 2.0 * z) * g * g)


@njit(cache=True, error_model="numpy")
def regularised_array(values, t_0):
    """Regularise an array: numbers and their derivatives, both with its shape."""
    numbers, slopes = np.empty_like(values), np.empty_like(values)
    for index in np.ndindex(values.shape):
        numbers[index], slopes[index] = regularised(values[index], t_0)
    return numbers, slopes


_AT = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
_GAUSS = np.array([(_AT[a], _AT[b], _AT[d]) for d in (0, 1) for b in (0, 1) for a in (0, 1)])

_EDGES = np.array(
    [[(0, 1), (2, 3), (4, 5), (6, 7)], [(0, 2), (1, 3), (4, 6), (5, 7)], [(0, 4), (1, 5), (2, 6), (3, 7)]]
)
"""Corners at the ends of the four edges along each direction."""


def _edge_weights() -> np.ndarray:
    """Weights of the four edges in the slope along each direction at each Gauss point, shape (3, 4, 8)."""
    ends = np.stack([1.0 - _GAUSS, _GAUSS])
    weights = np.empty((3, 4, 8))
    for d, (low, high) in enumerate(((1, 2), (0, 2), (0, 1))):
        weights[d] = [ends[a, :, low] * ends[b, :, high] for b in (0, 1) for a in (0, 1)]
    return weights


def _corner_slopes() -> np.ndarray:
    """Slopes of the shape functions at each Gauss point, shape (8 Gauss points, 3, 8 corners)."""
    slopes = np.zeros((8, 3, 8))
    for direction, edge in np.ndindex(3, 4):
        low, high = _EDGES[direction, edge]
        slopes[:, direction, low] -= _WEIGHTS[direction, edge]
        slopes[:, direction, high] += _WEIGHTS[direction, edge]
    return slopes


_WEIGHTS = _edge_weights()
SLOPES = _corner_slopes()

_TINY = 1e-290
"""Added to squares of lengths: an edge without length has a slope of 0 and a finite inverse."""

FAST = {"contract", "nsz", "reassoc"}
"""Flags of the element kernels: sums in any order, to vectorise; infinities and NaN are preserved."""


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def at_point(slopes, g):
    """Three slopes at a Gauss point."""
    return (
        (slopes[0, 0, g], slopes[0, 1, g], slopes[0, 2, g]),
        (slopes[1, 0, g], slopes[1, 1, g], slopes[1, 2, g]),
        (slopes[2, 0, g], slopes[2, 1, g], slopes[2, 2, g]),
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def put_at_point(vectors, g, slopes):
    """Store three vectors of a Gauss point."""
    for i in range(3):
        for d in range(3):
            slopes[i, d, g] = vectors[i][d]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def adjugate(f):
    """Rows of the adjugate of the matrix with columns f."""
    return cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def adjugate_jvp(f, df):
    """Change of the adjugate."""
    return (
        add(cross(df[1], f[2]), cross(f[1], df[2])),
        add(cross(df[2], f[0]), cross(f[2], df[0])),
        add(cross(df[0], f[1]), cross(f[0], df[1])),
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def adjugate_vjp(f, bar):
    """Transpose of `adjugate_jvp`."""
    return (
        less(cross(f[1], bar[2]), cross(f[2], bar[1])),
        less(cross(f[2], bar[0]), cross(f[0], bar[2])),
        less(cross(f[0], bar[1]), cross(f[1], bar[0])),
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def divisor_of(f, a, sign):
    """Positive divisor, equal to |J| in valid elements, and its derivatives with respect to J and the logs of f_i^2."""
    # It is the product of the lengths of the f_i times the regularised triple product of the unit slopes.
    jacobian = sign * dot(f[0], a[0])
    lengths = np.sqrt(dot(f[0], f[0]) * dot(f[1], f[1]) * dot(f[2], f[2]) + _TINY)
    flatness = jacobian / lengths
    height, slope = regularised(flatness, FLAT_ELEMENT)
    return lengths * height, sign * slope, lengths * (height - flatness * slope)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def divisor_gradient(f, a, jacobian_slope, length_slope):
    """Derivatives of the divisor with respect to the slopes f_i."""
    return (
        add(scaled(jacobian_slope, a[0]), scaled(length_slope / (dot(f[0], f[0]) + _TINY), f[0])),
        add(scaled(jacobian_slope, a[1]), scaled(length_slope / (dot(f[1], f[1]) + _TINY), f[1])),
        add(scaled(jacobian_slope, a[2]), scaled(length_slope / (dot(f[2], f[2]) + _TINY), f[2])),
    )


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def gradient(z, a):
    """Rows of H(z) = sum of z_i a_i^T."""
    return (
        add(add(scaled(z[0][0], a[0]), scaled(z[1][0], a[1])), scaled(z[2][0], a[2])),
        add(add(scaled(z[0][1], a[0]), scaled(z[1][1], a[1])), scaled(z[2][1], a[2])),
        add(add(scaled(z[0][2], a[0]), scaled(z[1][2], a[1])), scaled(z[2][2], a[2])),
    )


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def sum_of(p, q):
    """Sum of two triples of vectors, such as slopes."""
    return add(p[0], q[0]), add(p[1], q[1]), add(p[2], q[2])


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def work_of(p, q):
    """Sum of the products of two triples of vectors."""
    return dot(p[0], q[0]) + dot(p[1], q[1]) + dot(p[2], q[2])


@njit(cache=True, error_model="numpy", fastmath=FAST)
def slopes_of(values, element, slopes):
    """Slopes of the corner values at all Gauss points, shape (3 directions, 3 components, 8)."""
    for i in range(3):
        for d in range(3):
            along, edges = slopes[i, d], _edges(values, element, i, d)
            for g in range(8):
                along[g] = _slope(edges, i, g)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def slopes_of_sum(parts, element, slopes):
    """Slopes of the sum of fields, shape (n_parts, n_points, 3), as exact as the differences of the parts."""
    slopes_of(parts[0], element, slopes)
    for part in range(1, len(parts)):
        for i in range(3):
            for d in range(3):
                along, edges = slopes[i, d], _edges(parts[part], element, i, d)
                for g in range(8):
                    along[g] += _slope(edges, i, g)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _edges(values, element, i, d):
    """Component of the four edges along a direction."""
    ends = _EDGES[i]
    return (
        values[element[ends[0, 1]], d] - values[element[ends[0, 0]], d],
        values[element[ends[1, 1]], d] - values[element[ends[1, 0]], d],
        values[element[ends[2, 1]], d] - values[element[ends[2, 0]], d],
        values[element[ends[3, 1]], d] - values[element[ends[3, 0]], d],
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _slope(edges, i, g):
    """Slope along a direction at a Gauss point, from the edges."""
    return (
        _WEIGHTS[i, 0, g] * edges[0]
        + _WEIGHTS[i, 1, g] * edges[1]
        + _WEIGHTS[i, 2, g] * edges[2]
        + _WEIGHTS[i, 3, g] * edges[3]
    )


@njit(cache=True, error_model="numpy", fastmath=FAST)
def add_slopes_transposed(slopes, element, values):
    """Transpose of `slopes_of`, added to the corner values."""
    for i in range(3):
        for edge in range(4):
            low, high = element[_EDGES[i, edge, 0]], element[_EDGES[i, edge, 1]]
            for d in range(3):
                total = _pull(slopes, i, edge, d)
                values[high, d] += total
                values[low, d] -= total


@njit(cache=True)
def add_slopes_transposed_to_sum(slopes, element, parts):
    """Transpose of `slopes_of`, added to a sum of parts, shape (n_parts, n_points, 3)."""
    # It is added to two parts without rounding: the pulls of an edge on its ends cancel however large they are.
    if len(parts) == 1:
        add_slopes_transposed(slopes, element, parts[0])
        return
    for i in range(3):
        for edge in range(4):
            low, high = element[_EDGES[i, edge, 0]], element[_EDGES[i, edge, 1]]
            for d in range(3):
                total = _pull(slopes, i, edge, d)
                add_exactly(parts, high, d, total)
                add_exactly(parts, low, d, -total)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _pull(slopes, i, edge, d):
    """Component of the transposed slopes at the far end of an edge along direction i."""
    total = slopes[i, d, 0] * _WEIGHTS[i, edge, 0]
    for g in range(1, 8):
        total += slopes[i, d, g] * _WEIGHTS[i, edge, g]
    return total


@njit(cache=True)
def add_at_corners(elements, values, n_points):
    """Sum values at corners, shape (n_elements, 8, 3), over the corners of every point: shape (n_points, 3)."""
    total = np.zeros((n_points, 3), values.dtype)
    for element in range(len(elements)):
        for corner in range(8):
            point = elements[element, corner]
            for d in range(3):
                total[point, d] += values[element, corner, d]
    return total


@njit(cache=True)
def add_exactly(parts, point, d, value):
    """Add a number to a component of a point, a sum of two parts: the second takes the rounding error of the first."""
    # Parts have shape (2, n_points, 3). Compiled without permission to reorder sums.
    before = parts[0, point, d]
    total = before + value
    of_value = total - before
    parts[0, point, d] = total
    parts[1, point, d] += (before - (total - of_value)) + (value - of_value)


@njit(cache=True)
def add_element(
    stiffness: np.ndarray,  # (8, 8, 3, 3), blocks (a, b) of corners b <= a
    rows: np.ndarray,  # (8,) of int, block row of every corner, -1 for none
    slots: np.ndarray,  # (36,) of int, place of every pair of corners, see `bspline_mdao.base.sparse.blocks.slots`
    data: np.ndarray,  # (n_blocks, 3, 3), blocks of the lower triangle, added to
) -> None:
    """Add the stiffness of an element to the blocks of a symmetric matrix."""
    for a in range(8):
        for b in range(a + 1):
            place = slots[a * (a + 1) // 2 + b]
            if place < 0:
                continue
            if rows[a] >= rows[b]:  # below the diagonal or on it
                for c in range(3):
                    for d in range(3):
                        data[place, c, d] += stiffness[a, b, c, d]
            if rows[a] < rows[b] or (rows[a] == rows[b] and a > b):  # above the diagonal, or two corners coincide
                for c in range(3):
                    for d in range(3):
                        data[place, c, d] += stiffness[a, b, d, c]
