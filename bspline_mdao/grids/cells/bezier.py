"""Lower bounds of the Jacobian of curved hexahedra: Bézier elements, and the Lagrange elements of high-order files.

The coefficients of the derivatives of a hexahedron of degree ``(l, m, n)`` are differences of its Bézier control
points. Products of polynomials in Bernstein form are convolutions of coefficients times binomial numbers, whose terms
have positive weights. So the ``3l x 3m x 3n`` coefficients of the Jacobian are means of triple products of such
differences, and their rounding error is bounded by the error of a single triple product.

Theory: ``docs/theory/validity.rst``.

References
----------
A. Johnen, J.-F. Remacle and C. Geuzaine, Geometrical validity of curvilinear finite elements, *Journal of Computational
Physics* 233, 2013, pp. 359-372.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import comb

import numpy as np
from numba import njit

from ...base.numerics.rows import copy_row
from ...errors import InputError
from .bernstein import MAX_HALVINGS, UNIT, decide, inverse_of

__all__ = ["bezier_bound", "binomials", "lagrange_validity"]


@cache
def binomials(degree: int) -> np.ndarray:
    """Binomial numbers up to a degree, shape (degree + 1, degree + 1), zeros above the diagonal."""
    return np.array([[float(comb(n, k)) for k in range(degree + 1)] for n in range(degree + 1)])


@njit(cache=True, nogil=True, error_model="numpy")
def _scaled_edges(points, direction, binomial, normal, shortest, out, is_long):
    """Write differences of control points in one direction, times binomial numbers; return the largest sum norm."""
    # In a direction with one layer of points, the difference is the normal.
    largest = 0.0
    n_0, n_1, n_2 = out.shape[0], out.shape[1], out.shape[2]
    is_flat = points.shape[direction] == 1
    factor = 1.0 if is_flat else float(out.shape[direction])
    for i in range(n_0):
        for j in range(n_1):
            for k in range(n_2):
                weight = factor * binomial[n_0 - 1, i] * binomial[n_1 - 1, j] * binomial[n_2 - 1, k]
                size = 0.0
                for c in range(3):
                    if is_flat:
                        edge = normal[c]
                    else:
                        at = i + (direction == 0), j + (direction == 1), k + (direction == 2)
                        edge = points[at[0], at[1], at[2], c] - points[i, j, k, c]
                    size += abs(edge)
                    out[i, j, k, c] = weight * edge
                is_long[i, j, k] = 1.0 if size > shortest or is_flat else 0.0
                largest = max(largest, size)
    return factor * largest


@njit(cache=True, nogil=True, error_model="numpy")
def _multiply_long(a, b, out):
    """Convolution of two arrays of numbers."""
    out[:] = 0.0
    for i, j, k in np.ndindex(a.shape):
        for l, m, n in np.ndindex(b.shape):
            out[i + l, j + m, k + n] += a[i, j, k] * b[l, m, n]


@njit(cache=True, nogil=True, error_model="numpy")
def _sizes(shape, first, second):
    """Shape of the product of two derivatives, in the directions ``first`` and ``second``, of points of a shape."""
    n_0 = 2 * shape[0] - 1 - (first == 0 and shape[0] > 1) - (second == 0 and shape[0] > 1)
    n_1 = 2 * shape[1] - 1 - (first == 1 and shape[1] > 1) - (second == 1 and shape[1] > 1)
    n_2 = 2 * shape[2] - 1 - (first == 2 and shape[2] > 1) - (second == 2 and shape[2] > 1)
    return n_0, n_1, n_2


@njit(cache=True, nogil=True, error_model="numpy")
def bezier_bound(
    points,  # (l + 1, m + 1, n + 1, 3), control points (m); a degree may be 0
    sign,  # handedness
    binomial,  # `binomials` up to the degree of the Jacobian, at least ``3 max(l, m, n) - 1``
    normal,  # (3,), derivative in a direction of degree 0
    shortest,  # differences up to this length (m), in the sum norm, count as collapsed
    # bounds of the error of a difference of control points in each direction (m), in the sum norm
    errors,  # tuple of three float
    max_halvings,  # int, see `bspline_mdao.grids.cells.bernstein.decide`
):  # status, bound, see `bspline_mdao.grids.cells.bernstein.decide`
    """Decide whether the Jacobian of a Bézier hexahedron is positive."""
    s_0, s_1, s_2 = points.shape[0], points.shape[1], points.shape[2]
    t_0, t_1, t_2 = max(s_0 - 1, 1), max(s_1 - 1, 1), max(s_2 - 1, 1)
    a, b, c = np.empty((t_0, s_1, s_2, 3)), np.empty((s_0, t_1, s_2, 3)), np.empty((s_0, s_1, t_2, 3))
    long_a, long_b, long_c = np.empty((t_0, s_1, s_2)), np.empty((s_0, t_1, s_2)), np.empty((s_0, s_1, t_2))
    e_a = _scaled_edges(points, 0, binomial, normal, shortest, a, long_a)
    e_b = _scaled_edges(points, 1, binomial, normal, shortest, b, long_b)
    e_c = _scaled_edges(points, 2, binomial, normal, shortest, c, long_c)
    n_0, n_1, n_2 = _sizes((s_0, s_1, s_2), 0, 1)
    areas = np.zeros((n_0, n_1, n_2, 3))
    for i, j, k in np.ndindex((t_0, s_1, s_2)):
        u = a[i, j, k]
        for l in range(s_0):
            for m in range(t_1):
                for n in range(s_2):
                    v, w = b[l, m, n], areas[i + l, j + m, k + n]
                    w[0] += u[1] * v[2] - u[2] * v[1]
                    w[1] += u[2] * v[0] - u[0] * v[2]
                    w[2] += u[0] * v[1] - u[1] * v[0]
    o_0, o_1, o_2 = n_0 + s_0 - 1, n_1 + s_1 - 1, n_2 + t_2 - 1
    out = np.zeros((o_0, o_1, o_2))
    for i, j, k in np.ndindex((n_0, n_1, n_2)):
        u = areas[i, j, k]
        for l in range(s_0):
            for m in range(s_1):
                for n in range(t_2):
                    v = c[l, m, n]
                    out[i + l, j + m, k + n] += u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    for i, j, k in np.ndindex(out.shape):
        out[i, j, k] *= sign / (binomial[o_0 - 1, i] * binomial[o_1 - 1, j] * binomial[o_2 - 1, k])
    n_terms = t_0 * s_1 * s_2 + s_0 * s_1 * t_2  # the longest sums, in sequence
    product = e_a * e_b * e_c
    d_a, d_b, d_c = errors[0] * t_0, errors[1] * t_1, errors[2] * t_2
    margin = (24.0 + n_terms) * UNIT * product + 1e-290
    margin += (1.0 + 1e-9) * (d_a * (e_b + d_b) * (e_c + d_c) + e_a * d_b * (e_c + d_c) + e_a * e_b * d_c)
    has_zeros = long_a.min() + long_b.min() + long_c.min() < 3.0
    counts = np.ones((1, 1, 1))
    if has_zeros:
        long_areas, counts = np.empty((n_0, n_1, n_2)), np.empty(out.shape)  # type: ignore[assignment]
        _multiply_long(long_a, long_b, long_areas)
        _multiply_long(long_areas, long_c, counts)
    return decide(out, counts, margin, has_zeros, max_halvings)


@cache
def _bezier_of_lagrange(degree: int) -> tuple[np.ndarray, float]:
    """Matrix from evenly spaced points of a polynomial to its Bézier control points, and its norm."""
    xs = [Fraction(i, degree) for i in range(degree + 1)]
    rows = [[comb(degree, i) * x**i * (1 - x) ** (degree - i) for i in range(degree + 1)] for x in xs]
    matrix = np.array([[float(x) for x in row] for row in inverse_of(rows)])
    return matrix, float(np.abs(matrix).sum(axis=1).max() * (1.0 + 1e-9))


def lagrange_validity(
    # nodes of elements of degree q, evenly spaced in the parameters (m); q = 1 to 4 as in CGNS and Gmsh
    nodes: np.ndarray,  # (n_e, q + 1, q + 1, q + 1, 3)
    handedness: int = 1,  # +1 or -1
    # edges between control points up to this length (m) count as collapsed; the Jacobian may be zero there
    shortest: float = 0.0,
    max_halvings: int = MAX_HALVINGS,  # see `bspline_mdao.grids.cells.bernstein.decide`
) -> tuple[np.ndarray, np.ndarray]:
    """Decide whether curved hexahedra are valid: whether their Jacobian is positive everywhere inside.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.grids.cells.bezier import lagrange_validity
    >>> axes = np.linspace(0.0, 1.0, 3)
    >>> cube = np.stack(np.meshgrid(axes, axes, axes, indexing="ij"), axis=-1)
    >>> lagrange_validity(cube[None])[0]  # of degree 2: valid
    array([0], dtype=uint8)
    """
    # returns status uint8 (n_e,): `bspline_mdao.grids.cells.bernstein.VALID`, ``UNDECIDED`` or ``INVALID``
    # returns bound (n_e,): lower bound of the Jacobian (m^3) of those that are valid, with parameters from 0 to 1
    nodes = np.ascontiguousarray(nodes, dtype=float)
    if nodes.ndim != 5 or nodes.shape[4] != 3 or len(set(nodes.shape[1:4])) != 1 or nodes.shape[1] < 2:
        raise InputError(f"curved elements: nodes of shape {nodes.shape}; give (n, q + 1, q + 1, q + 1, 3) of degree q")
    degree = nodes.shape[1] - 1
    matrix, norm = _bezier_of_lagrange(degree)
    status, bound = np.empty(len(nodes), dtype=np.uint8), np.empty(len(nodes))
    factor = 0.0 if degree == 1 else 2.0 * (3.0 * (degree + 3)) * UNIT * norm**3
    _decide_lagrange(
        nodes, matrix, factor, float(handedness), binomials(3 * degree), shortest, max_halvings, status, bound
    )
    return status, bound


@njit(cache=True, nogil=True, error_model="numpy")
def _decide_lagrange(nodes, matrix, factor, sign, binomial, shortest, max_halvings, status, bound):
    """Decide about all elements; a difference of control points is known up to ``factor`` times the element's size."""
    size = matrix.shape[0]
    normal = np.zeros(3)
    old, new = np.empty((size, size, size, 3)), np.empty((size, size, size, 3))
    for e in range(nodes.shape[0]):
        extent = 0.0
        for i, j, k in np.ndindex((size, size, size)):
            length = 0.0
            for c in range(3):
                old[i, j, k, c] = nodes[e, i, j, k, c] - nodes[e, 0, 0, 0, c]
                length += abs(old[i, j, k, c])
            extent = max(extent, length)
        if size > 2:
            _apply(matrix, 0, old, new)
            _apply(matrix, 1, new, old)
            _apply(matrix, 2, old, new)
        else:
            for i, j, k in np.ndindex((size, size, size)):
                copy_row(nodes[e, i, j, k], new[i, j, k])
        error = factor * extent
        status[e], bound[e] = bezier_bound(new, sign, binomial, normal, shortest, (error, error, error), max_halvings)


@njit(cache=True, nogil=True, error_model="numpy")
def _apply(matrix, direction, old, new):
    """Multiply by a matrix in one direction."""
    new[:] = 0.0
    for i, j, k in np.ndindex(old.shape[:3]):
        for n in range(matrix.shape[0]):
            row = new[n, j, k] if direction == 0 else new[i, n, k] if direction == 1 else new[i, j, n]
            weight = matrix[n, i if direction == 0 else j if direction == 1 else k]
            for c in range(3):
                row[c] += weight * old[i, j, k, c]
