"""Lower bounds of the Jacobian of trilinear cells: its 27 Bernstein coefficients, with derivatives.

The Jacobian of a trilinear cell is a polynomial of degree (2, 2, 2). Its Bernstein coefficients are means of triple
products of one edge of each direction: of one product at the eight corners, where they are the corner Jacobians, of two
on the twelve edges, of four on the six faces and of eight inside. Edges are numbered as in `.orthogonality`.

`block_bounds` takes the smallest coefficient and the smallest corner of all cells of a block, many at a time, and
decides nearly all cells. `decide_cells` passes the others to `.bernstein`.

Theory: ``docs/theory/validity.rst``.

References
----------
A. Johnen, J.-C. Weill and J.-F. Remacle, Robust and efficient validation of the linear hexahedral element, *Procedia
Engineering* 203, 2017, pp. 271-283.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.rows import copy_row
from .bernstein import INVALID, UNIT, VALID, decide
from .orthogonality import FAST

__all__ = [
    "N_COEFFICIENTS",
    "block_bounds",
    "block_coefficients",
    "coefficients_jvp",
    "coefficients_of",
    "coefficients_vjp",
    "decide_cells",
    "edges_of",
    "triple",
]

N_COEFFICIENTS = 27

ROUNDING = 16.0 * UNIT
"""Error of a coefficient relative to the product of the longest edges of three directions, in the sum norm: one
rounding of each edge, two of a cross product, one of a sum of two, three of a scalar product, two of a sum of four, and
a margin."""

SMALLEST = 1e-290
"""Added to that, since products below it may have lost digits."""


def _terms() -> tuple[np.ndarray, np.ndarray]:
    """Coefficient ``i + 3 j + 9 k``, edges along xi, eta and zeta, and weight of each of the 64 triple products."""
    terms, weights = [], []
    for a_1, a_2, b_1, b_2, c_1, c_2 in np.ndindex(2, 2, 2, 2, 2, 2):
        i, j, k = a_1 + a_2, b_1 + b_2, c_1 + c_2
        terms.append((i + 3 * j + 9 * k, b_1 + 2 * c_1, a_1 + 2 * c_2, a_2 + 2 * b_2))
        weights.append(1.0 / ((1 + (i == 1)) * (1 + (j == 1)) * (1 + (k == 1))))
    return np.array(terms), np.array(weights)


TERMS, WEIGHTS = _terms()

ENDS = np.array([[[0, 1], [2, 3], [4, 5], [6, 7]], [[0, 2], [1, 3], [4, 6], [5, 7]], [[0, 4], [1, 5], [2, 6], [3, 7]]])
"""Corners joined by the four edges of each direction."""


@njit(**FAST)
def _vector(p, q):
    return q.x - p.x, q.y - p.y, q.z - p.z


@njit(**FAST)
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(**FAST)
def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(**FAST)
def _plus(u, v):
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@njit(**FAST)
def _less(a, b):
    return a if a < b else b


@njit(**FAST)
def _more(a, b):
    return a if a > b else b


@njit(**FAST)
def _size(e):
    return abs(e[0]) + abs(e[1]) + abs(e[2])


@njit(**FAST)
def _longest(e):
    return _more(_more(_size(e[0]), _size(e[1])), _more(_size(e[2]), _size(e[3])))


@njit(**FAST)
def _layer(sign, weight, so_far, y, c):
    """Smallest of the nine coefficients of one k, and of the four corners, including the smallest so far."""
    # ``y[a + 2 b]`` is the cross product of the edges along xi at b and along eta at a, ``c[a + 2 b]`` the edge along
    # zeta.
    c_00, c_20 = sign * _dot(y[0], c[0]), sign * _dot(y[1], c[1])
    c_02, c_22 = sign * _dot(y[2], c[2]), sign * _dot(y[3], c[3])
    half = 0.5 * sign
    c_10 = half * (_dot(y[0], c[1]) + _dot(y[1], c[0]))
    c_01 = half * (_dot(y[0], c[2]) + _dot(y[2], c[0]))
    c_12 = half * (_dot(y[2], c[3]) + _dot(y[3], c[2]))
    c_21 = half * (_dot(y[1], c[3]) + _dot(y[3], c[1]))
    c_11 = 0.5 * half * (_dot(y[0], c[3]) + _dot(y[3], c[0]) + _dot(y[1], c[2]) + _dot(y[2], c[1]))
    corner = _less(_less(c_00, c_20), _less(c_02, c_22))
    inner = _less(_less(_less(c_10, c_01), _less(c_12, c_21)), c_11)
    return _less(so_far, weight * _less(corner, inner)), weight * corner


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def block_bounds(
    x,  # (ni, nj, nk), nodes
    degenerate,  # uint8 (ni-1, nj-1, nk-1), only its shape is used: degenerate corners count here
    sign,  # handedness
    # results, cells in C order (m^3)
    bound,  # (n_cells,)
    corner,  # (n_cells,)
    margin,  # (n_cells,)
):
    """Smallest Bernstein coefficient and corner Jacobian of the cells of a block, and bounds of their errors."""
    n = degenerate.shape[2]
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            p, q, r, s = x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1]
            e, f, g, h = p[1:], q[1:], r[1:], s[1:]
            first = (i * degenerate.shape[1] + j) * n
            row_bound, row_corner, row_margin = (
                bound[first : first + n],
                corner[first : first + n],
                margin[first : first + n],
            )
            for k in range(n):
                p0, p1, p2, p3, p4, p5, p6, p7 = p[k], q[k], r[k], s[k], e[k], f[k], g[k], h[k]
                a = _vector(p0, p1), _vector(p2, p3), _vector(p4, p5), _vector(p6, p7)
                b = _vector(p0, p2), _vector(p1, p3), _vector(p4, p6), _vector(p5, p7)
                c = _vector(p0, p4), _vector(p1, p5), _vector(p2, p6), _vector(p3, p7)
                low = _cross(a[0], b[0]), _cross(a[0], b[1]), _cross(a[1], b[0]), _cross(a[1], b[1])
                high = _cross(a[2], b[2]), _cross(a[2], b[3]), _cross(a[3], b[2]), _cross(a[3], b[3])
                middle = (
                    _plus(_cross(a[0], b[2]), _cross(a[2], b[0])),
                    _plus(_cross(a[0], b[3]), _cross(a[2], b[1])),
                    _plus(_cross(a[1], b[2]), _cross(a[3], b[0])),
                    _plus(_cross(a[1], b[3]), _cross(a[3], b[1])),
                )
                least, lowest = _layer(sign, 1.0, np.inf, low, c)
                least, highest = _layer(sign, 1.0, least, high, c)
                least, _ = _layer(sign, 0.5, least, middle, c)
                row_bound[k], row_corner[k] = least, _less(lowest, highest)
                row_margin[k] = ROUNDING * (_longest(a) * _longest(b) * _longest(c)) + SMALLEST


@njit(cache=True, nogil=True, error_model="numpy")
def _corners_of(x, i, j, k, corners):
    """Write the corners of a cell, shape (8, 3)."""
    for c in range(8):
        point = x[i + (c & 1), j + ((c >> 1) & 1), k + (c >> 2)]
        corners[c, 0], corners[c, 1], corners[c, 2] = point.x, point.y, point.z


@njit(cache=True, nogil=True, error_model="numpy")
def edges_of(corners, edges):
    """Write the edges of a cell, shape (3, 4, 3), from its corners, shape (8, 3)."""
    for d in range(3):
        for e in range(4):
            for c in range(3):
                edges[d, e, c] = corners[ENDS[d, e, 1], c] - corners[ENDS[d, e, 0], c]


@njit(cache=True, nogil=True, error_model="numpy")
def triple(a, b, c):
    """Triple product of three vectors."""
    return (a[1] * b[2] - a[2] * b[1]) * c[0] + (a[2] * b[0] - a[0] * b[2]) * c[1] + (a[0] * b[1] - a[1] * b[0]) * c[2]


@njit(cache=True, nogil=True, error_model="numpy")
def coefficients_of(edges, sign, out):
    """Write the 27 coefficients of a cell."""
    out[:] = 0.0
    for t in range(64):
        n, a, b, c = TERMS[t]
        out[n] += sign * WEIGHTS[t] * triple(edges[0, a], edges[1, b], edges[2, c])


@njit(cache=True, nogil=True, error_model="numpy")
def _counting(corners, bits, shortest, counts):
    """Mark with 1 the coefficients that are not zero by construction, which have a term without a collapsed edge."""
    # If the baseline has collapsed corners, ``bits``, their edges that are shorter than ``shortest`` have collapsed.
    counts[:] = 1.0
    if bits == 0:
        return False
    is_short = np.zeros((3, 4), dtype=np.bool_)
    for d in range(3):
        for e in range(4):
            p, q = ENDS[d, e]
            square = 0.0
            for c in range(3):
                square += (corners[q, c] - corners[p, c]) ** 2
            both = (bits >> np.uint8(p)) & (bits >> np.uint8(q)) & np.uint8(1)
            is_short[d, e] = both == 1 and square < shortest * shortest
    counts[:] = 0.0
    for t in range(64):
        n, a, b, c = TERMS[t]
        if not (is_short[0, a] or is_short[1, b] or is_short[2, c]):
            counts[n] = 1.0
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def decide_cells(
    # see `block_bounds`; bit c of ``degenerate`` is set if corner c is degenerate
    x,
    degenerate,
    sign,
    shortest,  # length (m) below which an edge at degenerate corners has collapsed
    # from `block_bounds`; ``bound`` receives the lower bound that was found, also for undecided cells
    bound,  # (n_cells,)
    corner,  # (n_cells,)
    margin,  # (n_cells,)
    max_halvings,  # int, see `bspline_mdao.grids.cells.bernstein.decide`
    status,  # uint8 (n_cells,), receives the status of each cell
):  # int, cells that the first bound left undecided
    """Decide about all cells of a block from the results of `block_bounds`, halving if they do not suffice."""
    corners, edges, counts, n_open = np.empty((8, 3)), np.empty((3, 4, 3)), np.empty(27), 0
    coefficients = np.empty(27)
    _, n_j, n_k = degenerate.shape
    bits_of = degenerate.ravel()
    for cell in range(status.size):
        bits = bits_of[cell]
        if bits == 0:
            if bound[cell] > margin[cell]:
                status[cell] = VALID
                bound[cell] -= margin[cell]
                continue
            if corner[cell] + margin[cell] <= 0.0:
                status[cell] = INVALID
                bound[cell] = corner[cell]
                continue
        n_open += 1
        i, j, k = cell // (n_j * n_k), cell // n_k % n_j, cell % n_k
        _corners_of(x, i, j, k, corners)
        edges_of(corners, edges)
        coefficients_of(edges, sign, coefficients)
        has_zeros = _counting(corners, bits, shortest, counts)
        shape = (3, 3, 3)  # of (k, j, i)
        status[cell], bound[cell] = decide(
            coefficients.reshape(shape), counts.reshape(shape), margin[cell], has_zeros, max_halvings
        )
    return n_open


@njit(cache=True, nogil=True, error_model="numpy")
def block_coefficients(x, degenerate, sign, shortest, out):
    """Write the Bernstein coefficients of a block's cells, shape (27, n_cells); infinity if one does not count."""
    # Parameters as for `decide_cells`; coefficient (i, j, k) is in row ``i + 3 j + 9 k``.
    corners, edges, counts, found = np.empty((8, 3)), np.empty((3, 4, 3)), np.empty(27), np.empty(27)
    for cell, (i, j, k) in enumerate(np.ndindex(degenerate.shape)):
        _corners_of(x, i, j, k, corners)
        edges_of(corners, edges)
        coefficients_of(edges, sign, found)
        has_zeros = _counting(corners, degenerate[i, j, k], shortest, counts)
        for n in range(27):
            out[n, cell] = np.inf if has_zeros and counts[n] == 0.0 else found[n]


@njit(cache=True, nogil=True, error_model="numpy")
def coefficients_jvp(x, d_x, degenerate, sign, d_out):
    """Write the change of the coefficients with the nodes, shape (27, n_cells)."""
    corners, edges, d_edges, change = np.empty((8, 3)), np.empty((3, 4, 3)), np.empty((3, 4, 3)), np.empty(27)
    for cell, (i, j, k) in enumerate(np.ndindex(degenerate.shape)):
        _corners_of(x, i, j, k, corners)
        edges_of(corners, edges)
        _corners_of(d_x, i, j, k, corners)
        edges_of(corners, d_edges)
        change[:] = 0.0
        for t in range(64):
            n, a, b, c = TERMS[t]
            u, v, w = edges[0, a], edges[1, b], edges[2, c]
            d = triple(d_edges[0, a], v, w) + triple(u, d_edges[1, b], w) + triple(u, v, d_edges[2, c])
            change[n] += sign * WEIGHTS[t] * d
        copy_row(change, d_out[:, cell])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add_cross(factor, u, v, out):
    out[0] += factor * (u[1] * v[2] - u[2] * v[1])
    out[1] += factor * (u[2] * v[0] - u[0] * v[2])
    out[2] += factor * (u[0] * v[1] - u[1] * v[0])


@njit(cache=True, nogil=True, error_model="numpy")
def coefficients_vjp(x, degenerate, sign, bar, x_bar):
    """Add the adjoint of the nodes, from that of the coefficients, to ``x_bar``; zeros of ``bar`` are skipped."""
    corners, edges, edges_bar = np.empty((8, 3)), np.empty((3, 4, 3)), np.empty((3, 4, 3))
    for cell, (i, j, k) in enumerate(np.ndindex(degenerate.shape)):
        if np.any(bar[:, cell] != 0.0):
            _corners_of(x, i, j, k, corners)
            edges_of(corners, edges)
            edges_bar[:] = 0.0
            for t in range(64):
                n, a, b, c = TERMS[t]
                factor = sign * WEIGHTS[t] * bar[n, cell]
                u, v, w = edges[0, a], edges[1, b], edges[2, c]
                _add_cross(factor, v, w, edges_bar[0, a])
                _add_cross(factor, w, u, edges_bar[1, b])
                _add_cross(factor, u, v, edges_bar[2, c])
            for d in range(3):
                for e in range(4):
                    for end in range(2):
                        c, side = ENDS[d, e, end], 2.0 * end - 1.0
                        point = x_bar[i + (c & 1), j + ((c >> 1) & 1), k + (c >> 2)]
                        point.x += side * edges_bar[d, e, 0]
                        point.y += side * edges_bar[d, e, 1]
                        point.z += side * edges_bar[d, e, 2]
