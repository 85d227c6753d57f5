"""Corner triple products, corner Jacobians and volumes of runs of cells, and their derivatives.

Corners and signs are those of `.hexahedron`. All three measures are functions of the twelve edges of a cell, and so are
their derivatives: a run of up to `RUN` cells is taken edge by edge and corner by corner, in loops whose vector lanes
are cells. The numbers of a run live in one flat array with rows at fixed distances, since that is what lets the
compiler see that the rows do not overlap::

    edge m:  x, y, z, 1 / length, and three rows for the change of the edge or for its adjoint;  m = 0..11
    corners: triple products 0..7, Jacobians 0..7;   volume;   corner 0..7 of the points' adjoint, x, y, z each

Points come and go as eight rows, one per corner.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = [
    "POINT",
    "RUN",
    "as_points",
    "block_jvp",
    "block_measures",
    "block_vjp",
    "list_jvp",
    "list_measures",
    "list_vjp",
]

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, whose fixed stride lets loops over points vectorise."""

RUN = 32
"""Cells of a run: its numbers fit the first-level cache."""

TINY = 1e-190
"""Added to a squared length before it is inverted, so that an edge of no length has a triple product of 0."""

_EDGE = 7 * RUN
_TRIPLE = 12 * _EDGE
_JACOBIAN = _TRIPLE + 8 * RUN
_VOLUME = _JACOBIAN + 8 * RUN
_POINT = _VOLUME + RUN
_SIZE = _POINT + 24 * RUN


def as_points(nodes: np.ndarray) -> np.ndarray:
    """View coordinates ``(..., 3)`` as records of type `POINT`; copied where they are not contiguous.

    Parameters
    ----------
    nodes : ndarray, shape (..., 3)
        Coordinates (m).

    Returns
    -------
    ndarray of POINT, shape (...)
    """
    return np.ascontiguousarray(nodes, dtype=np.float64).view(POINT)[..., 0]


@njit(cache=True, inline="always")
def _vector(work, at):
    return work[at], work[at + RUN], work[at + 2 * RUN]


@njit(cache=True, inline="always")
def _set(work, at, x, y, z):
    work[at], work[at + RUN], work[at + 2 * RUN] = x, y, z


@njit(cache=True, inline="always")
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(cache=True, inline="always")
def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(inline="always")
def _edge(work, edge, start, end, n):
    """Edges between two corners with their inverse lengths."""
    for k in range(n):
        p, q = _vector(work, start + k), _vector(work, end + k)
        x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        _set(work, edge + k, x, y, z)
        work[edge + 3 * RUN + k] = 1.0 / np.sqrt(x * x + y * y + z * z + TINY)


@njit(inline="always")
def _edge_change(work, edge, start, end, n):
    """Change of the edges with the corners."""
    for k in range(n):
        p, q = _vector(work, start + k), _vector(work, end + k)
        _set(work, edge + 4 * RUN + k, q[0] - p[0], q[1] - p[1], q[2] - p[2])


@njit(inline="always")
def _corner(work, u, v, w, corner, sign, n):
    """Triple products of unit edges and Jacobians at one corner."""
    for k in range(n):
        jacobian = sign * _dot(_cross(_vector(work, u + k), _vector(work, v + k)), _vector(work, w + k))
        inverse = work[u + 3 * RUN + k] * work[v + 3 * RUN + k] * work[w + 3 * RUN + k]
        work[_TRIPLE + corner * RUN + k] = jacobian * inverse
        work[_JACOBIAN + corner * RUN + k] = jacobian


@njit(inline="always")
def _corner_jvp(work, u, v, w, corner, sign, n):
    """Change of the triple products and Jacobians at one corner."""
    for k in range(n):
        a, b, c = _vector(work, u + k), _vector(work, v + k), _vector(work, w + k)
        i_a, i_b, i_c = work[u + 3 * RUN + k], work[v + 3 * RUN + k], work[w + 3 * RUN + k]
        d_a, d_b, d_c = _vector(work, u + 4 * RUN + k), _vector(work, v + 4 * RUN + k), _vector(work, w + 4 * RUN + k)
        ab = _cross(a, b)
        change = sign * (_dot(_cross(b, c), d_a) + _dot(_cross(c, a), d_b) + _dot(ab, d_c))
        stretch = i_a * i_a * _dot(a, d_a) + i_b * i_b * _dot(b, d_b) + i_c * i_c * _dot(c, d_c)
        work[_TRIPLE + corner * RUN + k] = (i_a * i_b * i_c) * (change - sign * _dot(ab, c) * stretch)
        work[_JACOBIAN + corner * RUN + k] = change


@njit(cache=True, inline="always")
def _add(work, at, factor, cross, shrink, edge):
    """Add ``factor cross - shrink edge`` to the adjoint of an edge."""
    work[at] += factor * cross[0] - shrink * edge[0]
    work[at + RUN] += factor * cross[1] - shrink * edge[1]
    work[at + 2 * RUN] += factor * cross[2] - shrink * edge[2]


@njit(inline="always")
def _corner_vjp(work, u, v, w, corner, sign, n):
    """Add what one corner's adjoints give to the adjoints of its edges."""
    for k in range(n):
        a, b, c = _vector(work, u + k), _vector(work, v + k), _vector(work, w + k)
        i_a, i_b, i_c = work[u + 3 * RUN + k], work[v + 3 * RUN + k], work[w + 3 * RUN + k]
        ab, scaled = _cross(a, b), sign * work[_TRIPLE + corner * RUN + k] * (i_a * i_b * i_c)
        factor, shrink = sign * work[_JACOBIAN + corner * RUN + k] + scaled, scaled * _dot(ab, c)
        _add(work, u + 4 * RUN + k, factor, _cross(b, c), shrink * i_a * i_a, a)
        _add(work, v + 4 * RUN + k, factor, _cross(c, a), shrink * i_b * i_b, b)
        _add(work, w + 4 * RUN + k, factor, ab, shrink * i_c * i_c, c)


@njit(inline="always")
def _point_adjoint(work, u, v, w, corner, sign, n):
    """Adjoint of a corner from those of its three edges, each of which it starts or ends."""
    s, t, r = 2.0 * (corner & 1) - 1.0, 2.0 * ((corner >> 1) & 1) - 1.0, 2.0 * (corner >> 2) - 1.0
    for k in range(n):
        a, b, c = _vector(work, u + 4 * RUN + k), _vector(work, v + 4 * RUN + k), _vector(work, w + 4 * RUN + k)
        x, y, z = s * a[0] + t * b[0] + r * c[0], s * a[1] + t * b[1] + r * c[1], s * a[2] + t * b[2] + r * c[2]
        _set(work, _POINT + 3 * RUN * corner + k, x, y, z)


def _at_each_edge(task):
    """Kernel that runs a task for every edge, told where the edge and the corners at its ends are in the workspace.

    The places are constants, so that the compiler knows how far apart the rows are.
    """

    @njit(error_model="numpy", fastmath={"contract"})
    def run(work, n):
        task(work, 0, _POINT, _POINT + 3 * RUN, n)
        task(work, _EDGE, _POINT + 6 * RUN, _POINT + 9 * RUN, n)
        task(work, 2 * _EDGE, _POINT + 12 * RUN, _POINT + 15 * RUN, n)
        task(work, 3 * _EDGE, _POINT + 18 * RUN, _POINT + 21 * RUN, n)
        task(work, 4 * _EDGE, _POINT, _POINT + 6 * RUN, n)
        task(work, 5 * _EDGE, _POINT + 3 * RUN, _POINT + 9 * RUN, n)
        task(work, 6 * _EDGE, _POINT + 12 * RUN, _POINT + 18 * RUN, n)
        task(work, 7 * _EDGE, _POINT + 15 * RUN, _POINT + 21 * RUN, n)
        task(work, 8 * _EDGE, _POINT, _POINT + 12 * RUN, n)
        task(work, 9 * _EDGE, _POINT + 3 * RUN, _POINT + 15 * RUN, n)
        task(work, 10 * _EDGE, _POINT + 6 * RUN, _POINT + 18 * RUN, n)
        task(work, 11 * _EDGE, _POINT + 9 * RUN, _POINT + 21 * RUN, n)

    return run


def _at_each_corner(task):
    """Kernel that runs a task for every corner, told where its three edges are in the workspace."""

    @njit(error_model="numpy", fastmath={"contract"})
    def run(work, sign, n):
        task(work, 0, 4 * _EDGE, 8 * _EDGE, 0, sign, n)
        task(work, 0, 5 * _EDGE, 9 * _EDGE, 1, sign, n)
        task(work, _EDGE, 4 * _EDGE, 10 * _EDGE, 2, sign, n)
        task(work, _EDGE, 5 * _EDGE, 11 * _EDGE, 3, sign, n)
        task(work, 2 * _EDGE, 6 * _EDGE, 8 * _EDGE, 4, sign, n)
        task(work, 2 * _EDGE, 7 * _EDGE, 9 * _EDGE, 5, sign, n)
        task(work, 3 * _EDGE, 6 * _EDGE, 10 * _EDGE, 6, sign, n)
        task(work, 3 * _EDGE, 7 * _EDGE, 11 * _EDGE, 7, sign, n)

    return run


_edges, _edge_changes = _at_each_edge(_edge), _at_each_edge(_edge_change)
_corners, _corners_jvp, _corners_vjp = (
    _at_each_corner(_corner),
    _at_each_corner(_corner_jvp),
    _at_each_corner(_corner_vjp),
)
_point_adjoints = _at_each_corner(_point_adjoint)


@njit(cache=True, inline="always")
def _sum(p, q, r, s):
    return p[0] + q[0] + r[0] + s[0], p[1] + q[1] + r[1] + s[1], p[2] + q[2] + r[2] + s[2]


@njit(cache=True, inline="always")
def _change(p, q, r, s):
    """From the edges p, q on one side of the cell to r, s on the other."""
    return r[0] + s[0] - p[0] - q[0], r[1] + s[1] - p[1] - q[1], r[2] + s[2] - p[2] - q[2]


@njit(cache=True, inline="always")
def _shape_vectors(work, k):
    """Four times the mean edges a, b, c of a cell and twice the coefficients d, e, f of xi eta, eta zeta, zeta xi."""
    i0, i1 = _vector(work, k), _vector(work, _EDGE + k)
    i2, i3 = _vector(work, 2 * _EDGE + k), _vector(work, 3 * _EDGE + k)
    j0, j1 = _vector(work, 4 * _EDGE + k), _vector(work, 5 * _EDGE + k)
    j2, j3 = _vector(work, 6 * _EDGE + k), _vector(work, 7 * _EDGE + k)
    k0, k1 = _vector(work, 8 * _EDGE + k), _vector(work, 9 * _EDGE + k)
    k2, k3 = _vector(work, 10 * _EDGE + k), _vector(work, 11 * _EDGE + k)
    a, b, c = _sum(i0, i1, i2, i3), _sum(j0, j1, j2, j3), _sum(k0, k1, k2, k3)
    return a, b, c, _change(i0, i2, i1, i3), _change(j0, j1, j2, j3), _change(i0, i1, i2, i3)


@njit(cache=True, fastmath={"contract"})
def _volume(work, sign, n):
    """Volume of trilinear cells: the Jacobian integrated term by term, see docs/theory/quality.rst."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        product = _dot(_cross(a, b), c)
        products = _dot(_cross(a, d), f) + _dot(_cross(d, b), e) + _dot(_cross(f, e), c)
        work[_VOLUME + k] = sign * (product + products / 3.0) / 64.0


@njit(cache=True, inline="always")
def _combine(p, scale, q):
    return p[0] + scale * q[0], p[1] + scale * q[1], p[2] + scale * q[2]


@njit(cache=True, inline="always")
def _volume_gradient(a, b, c, d, e, f):
    """Gradient of 64 volumes in the six vectors of `_shape_vectors`."""
    third = 1.0 / 3.0
    g_a = _combine(_cross(b, c), third, _cross(d, f))
    g_b = _combine(_cross(c, a), third, _cross(e, d))
    g_c = _combine(_cross(a, b), third, _cross(f, e))
    g_d = _combine(_cross(f, a), 1.0, _cross(b, e))
    g_e = _combine(_cross(d, b), 1.0, _cross(c, f))
    g_f = _combine(_cross(a, d), 1.0, _cross(e, c))
    return g_a, g_b, g_c, g_d, g_e, g_f


@njit(cache=True, fastmath={"contract"})
def _volume_jvp(work, sign, n):
    """Change of the volumes."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(a, b, c, d, e, f)
        d_a, d_b, d_c, d_d, d_e, d_f = _shape_vectors(work, 4 * RUN + k)
        straight = _dot(g_a, d_a) + _dot(g_b, d_b) + _dot(g_c, d_c)
        twisted = _dot(g_d, d_d) + _dot(g_e, d_e) + _dot(g_f, d_f)
        work[_VOLUME + k] = sign * (straight + twisted / 3.0) / 64.0


@njit(cache=True, inline="always")
def _put(work, m, k, mean, s, p, t, q):
    """Set the adjoint of edge m to ``mean + s p + t q``."""
    at = m * _EDGE + 4 * RUN + k
    work[at] = mean[0] + s * p[0] + t * q[0]
    work[at + RUN] = mean[1] + s * p[1] + t * q[1]
    work[at + 2 * RUN] = mean[2] + s * p[2] + t * q[2]


@njit(cache=True, inline="always")
def _scaled(factor, p):
    return factor * p[0], factor * p[1], factor * p[2]


@njit(cache=True, fastmath={"contract"})
def _volume_vjp(work, sign, n):
    """Set the adjoints of the edges to what the volumes' adjoints give."""
    for k in range(n):
        a, b, c, d, e, f = _shape_vectors(work, k)
        g_a, g_b, g_c, g_d, g_e, g_f = _volume_gradient(a, b, c, d, e, f)
        bar = sign * work[_VOLUME + k] / 64.0
        g_a, g_b, g_c = _scaled(bar, g_a), _scaled(bar, g_b), _scaled(bar, g_c)
        g_d, g_e, g_f = _scaled(bar / 3.0, g_d), _scaled(bar / 3.0, g_e), _scaled(bar / 3.0, g_f)
        _put(work, 0, k, g_a, -1.0, g_d, -1.0, g_f)
        _put(work, 1, k, g_a, 1.0, g_d, -1.0, g_f)
        _put(work, 2, k, g_a, -1.0, g_d, 1.0, g_f)
        _put(work, 3, k, g_a, 1.0, g_d, 1.0, g_f)
        _put(work, 4, k, g_b, -1.0, g_e, 0.0, g_e)
        _put(work, 5, k, g_b, -1.0, g_e, 0.0, g_e)
        _put(work, 6, k, g_b, 1.0, g_e, 0.0, g_e)
        _put(work, 7, k, g_b, 1.0, g_e, 0.0, g_e)
        _put(work, 8, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 9, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 10, k, g_c, 0.0, g_e, 0.0, g_e)
        _put(work, 11, k, g_c, 0.0, g_e, 0.0, g_e)


@njit(cache=True)
def _load(rows, work, n):
    """Take the points of a run, or their changes, from eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[_POINT + 3 * RUN * corner : _SIZE]
        for k in range(n):
            point[k], point[RUN + k], point[2 * RUN + k] = row[k].x, row[k].y, row[k].z


@njit(cache=True)
def _add_to(rows, work, n):
    """Add the adjoints of the points of a run to eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[_POINT + 3 * RUN * corner : _SIZE]
        for k in range(n):
            row[k].x += point[k]
            row[k].y += point[RUN + k]
            row[k].z += point[2 * RUN + k]


@njit(cache=True)
def _set_left_out(work, bits, triple, jacobian, n):
    """Give the corners that are left out set values."""
    for corner in range(8):
        at = work[_TRIPLE + corner * RUN : _SIZE]
        bit = np.uint8(1 << corner)
        for k in range(n):
            if bits[k] & bit:
                at[k], at[8 * RUN + k] = triple, jacobian


@njit(cache=True)
def _any_bit(bits, n):
    found = np.uint8(0)
    for k in range(n):
        found |= bits[k]
    return found != 0


@njit(cache=True)
def _copy(source, target, n):
    for k in range(n):
        target[k] = source[k]


@njit(cache=True)
def _store(work, triples, jacobians, volume, first, n):
    """Write the measures of a run from cell ``first`` on."""
    for corner in range(8):
        _copy(work[_TRIPLE + corner * RUN : _SIZE], triples[corner][first:], n)
        _copy(work[_JACOBIAN + corner * RUN : _SIZE], jacobians[corner][first:], n)
    _copy(work[_VOLUME:_SIZE], volume[first:], n)


@njit(cache=True)
def _load_adjoints(triples, jacobians, volume, work, first, n):
    """Read the adjoints of the measures of a run."""
    for corner in range(8):
        _copy(triples[corner][first:], work[_TRIPLE + corner * RUN : _SIZE], n)
        _copy(jacobians[corner][first:], work[_JACOBIAN + corner * RUN : _SIZE], n)
    _copy(volume[first:], work[_VOLUME:_SIZE], n)


@njit(cache=True)
def _measure_run(rows, bits, sign, work, n):
    _load(rows, work, n)
    _edges(work, n)
    _corners(work, sign, n)
    _volume(work, sign, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 1.0, np.inf, n)


@njit(cache=True)
def _jvp_run(rows, changes, bits, sign, work, n):
    _load(rows, work, n)
    _edges(work, n)
    _load(changes, work, n)
    _edge_changes(work, n)
    _corners_jvp(work, sign, n)
    _volume_jvp(work, sign, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 0.0, 0.0, n)


@njit(cache=True)
def _vjp_run(rows, bits, sign, work, adjoints, n):
    _load(rows, work, n)
    _edges(work, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 0.0, 0.0, n)
    _volume_vjp(work, sign, n)
    _corners_vjp(work, sign, n)
    _point_adjoints(work, sign, n)
    _add_to(adjoints, work, n)


@njit(cache=True)
def _rows_of(x, i, j, k):
    """Eight rows of points: the corners of the cells of a block from (i, j, k) on."""
    p, q, r, s = x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1]
    return p[k:], q[k:], r[k:], s[k:], p[k + 1 :], q[k + 1 :], r[k + 1 :], s[k + 1 :]


@njit(cache=True, nogil=True)
def block_measures(x, left_out, sign, triples, jacobians, volume):
    """Measure the cells of a block.

    Parameters
    ----------
    x : ndarray of POINT, shape (ni, nj, nk)
        Nodes.
    left_out : ndarray of uint8, shape (ni-1, nj-1, nk-1)
        Bit c is set where corner c is left out.
    sign : float
        Handedness.
    triples, jacobians : ndarray, shape (8, n_cells)
        Results at the corners, cells in C order; 1 and infinity at corners that are left out.
    volume : ndarray, shape (n_cells,)
        Result.
    """
    work, first = np.empty(_SIZE), 0
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            for k in range(0, left_out.shape[2], RUN):
                n = min(RUN, left_out.shape[2] - k)
                _measure_run(_rows_of(x, i, j, k), left_out[i, j][k:], sign, work, n)
                _store(work, triples, jacobians, volume, first, n)
                first += n


@njit(cache=True, nogil=True)
def block_jvp(x, d_x, left_out, sign, d_triples, d_jacobians, d_volume):
    """Change of what `block_measures` gives with the nodes; 0 at corners that are left out.

    Parameters
    ----------
    x, d_x : ndarray of POINT, shape (ni, nj, nk)
        Nodes and their change.
    left_out, sign
        See `block_measures`.
    d_triples, d_jacobians, d_volume
        Results, of the shapes there.
    """
    work, first = np.empty(_SIZE), 0
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            for k in range(0, left_out.shape[2], RUN):
                n = min(RUN, left_out.shape[2] - k)
                _jvp_run(_rows_of(x, i, j, k), _rows_of(d_x, i, j, k), left_out[i, j][k:], sign, work, n)
                _store(work, d_triples, d_jacobians, d_volume, first, n)
                first += n


@njit(cache=True, nogil=True)
def block_vjp(x, left_out, sign, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the nodes, from those of what `block_measures` gives, to ``x_bar``.

    Parameters
    ----------
    x, left_out, sign
        See `block_measures`.
    triples_bar, jacobians_bar, volume_bar
        Adjoints, of the shapes there; those of corners that are left out are not looked at.
    x_bar : ndarray of POINT, shape (ni, nj, nk)
        Added to.
    """
    work, first = np.empty(_SIZE), 0
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            for k in range(0, left_out.shape[2], RUN):
                n = min(RUN, left_out.shape[2] - k)
                _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
                _vjp_run(_rows_of(x, i, j, k), left_out[i, j][k:], sign, work, _rows_of(x_bar, i, j, k), n)
                first += n


@njit(cache=True)
def _rows_from(x, first):
    """Eight rows of points: the corners of the cells of a list from ``first`` on."""
    return (
        x[0][first:],
        x[1][first:],
        x[2][first:],
        x[3][first:],
        x[4][first:],
        x[5][first:],
        x[6][first:],
        x[7][first:],
    )


@njit(cache=True, nogil=True)
def list_measures(x, left_out, triples, jacobians, volume):
    """Measure a list of cells, `block_measures` for right-handed cells with corners ``x`` of shape (8, n_cells)."""
    work, n_cells = np.empty(_SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _measure_run(_rows_from(x, first), left_out[first:], 1.0, work, n)
        _store(work, triples, jacobians, volume, first, n)


@njit(cache=True, nogil=True)
def list_jvp(x, d_x, left_out, d_triples, d_jacobians, d_volume):
    """Change of what `list_measures` gives with the corners."""
    work, n_cells = np.empty(_SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _jvp_run(_rows_from(x, first), _rows_from(d_x, first), left_out[first:], 1.0, work, n)
        _store(work, d_triples, d_jacobians, d_volume, first, n)


@njit(cache=True, nogil=True)
def list_vjp(x, left_out, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the corners, from those of what `list_measures` gives, to ``x_bar``."""
    work, n_cells = np.empty(_SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
        _vjp_run(_rows_from(x, first), left_out[first:], 1.0, work, _rows_from(x_bar, first), n)
