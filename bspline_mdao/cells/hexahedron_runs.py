"""Corner triple products, corner Jacobians and volumes of runs of cells, and their derivatives.

Corners and signs are those of `.hexahedron`. All three measures are functions of the twelve edges of a cell, and so are
their derivatives: straight-line code on tuples, in a loop over the cells of a run, which the compiler turns into vector
instructions whose lanes are cells. Points come and go as eight rows, one per corner of the cells. The loop itself reads
and writes one workspace, rows at fixed distances, since the compiler can see that these do not overlap::

    triple products of corners 0..7, Jacobians of corners 0..7, volume,
    corners 0..7: x, y, z of the points or of their adjoints,
    corners 0..7: x, y, z of the changes of the points
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .hexahedron_volume import FAST, cross, dot, volume_of, volume_of_jvp, volume_of_vjp

__all__ = [
    "as_points",
    "block_jvp",
    "block_measures",
    "block_summary",
    "block_vjp",
    "list_jvp",
    "list_measures",
    "list_vjp",
]

TINY = 1e-190
"""Added to a squared length before it is inverted, so that an edge of no length has a triple product of 0."""

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, whose fixed stride lets loops over points vectorise."""

RUN = 64
"""Cells of a run: its rows of the workspace fit the first-level cache."""

JACOBIAN = 8 * RUN
VOLUME = 16 * RUN
POINTS = 17 * RUN
CHANGES = 41 * RUN
SIZE = 65 * RUN


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


@njit(cache=True)
def _load(rows, work, at, n):
    """Take the points of a run, or their changes, from eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[at + 3 * RUN * corner : SIZE]
        for k in range(n):
            point[k], point[RUN + k], point[2 * RUN + k] = row[k].x, row[k].y, row[k].z


@njit(**FAST)
def _at(row, k):
    """Index of an entry of a row as an unsigned number: signed ones may count from the end, which hinders vectors."""
    return np.uint64(row) + np.uint64(k)


@njit(**FAST)
def _between(work, p, q, k):
    """Vector from one point to another."""
    return (
        work[_at(q, k)] - work[_at(p, k)],
        work[_at(q + RUN, k)] - work[_at(p + RUN, k)],
        work[_at(q + 2 * RUN, k)] - work[_at(p + 2 * RUN, k)],
    )


@njit(**FAST)
def _edges(work, at, k):
    """Edges of a cell whose corners are in rows from ``at`` on: four along xi, four along eta, four along zeta."""
    p0, p1, p2, p3 = at, at + 3 * RUN, at + 6 * RUN, at + 9 * RUN
    p4, p5, p6, p7 = at + 12 * RUN, at + 15 * RUN, at + 18 * RUN, at + 21 * RUN
    return (
        (_between(work, p0, p1, k), _between(work, p2, p3, k), _between(work, p4, p5, k), _between(work, p6, p7, k)),
        (_between(work, p0, p2, k), _between(work, p1, p3, k), _between(work, p4, p6, k), _between(work, p5, p7, k)),
        (_between(work, p0, p4, k), _between(work, p1, p5, k), _between(work, p2, p6, k), _between(work, p3, p7, k)),
    )


@njit(**FAST)
def _inverse(e):
    """Inverse of the length of an edge."""
    return 1.0 / np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + TINY)


@njit(**FAST)
def _inverses(edges):
    """Inverse lengths of four edges."""
    return _inverse(edges[0]), _inverse(edges[1]), _inverse(edges[2]), _inverse(edges[3])


@njit(**FAST)
def _corner(sign, edges, inverses):
    """Triple product and Jacobian of a corner."""
    jacobian = sign * dot(cross(edges[0], edges[1]), edges[2])
    return jacobian * (inverses[0] * inverses[1] * inverses[2]), jacobian


@njit(**FAST)
def _set(work, row, k, sign, edges, inverses):
    """Write the triple product and the Jacobian of a corner."""
    work[_at(row, k)], work[_at(JACOBIAN + row, k)] = _corner(sign, edges, inverses)


@njit(**FAST)
def _set_change(work, row, k, sign, edges, inverses, changes):
    """Write the change of the triple product and of the Jacobian of a corner."""
    (a, b, c), (i_a, i_b, i_c), (d_a, d_b, d_c) = edges, inverses, changes
    ab = cross(a, b)
    change = sign * (dot(cross(b, c), d_a) + dot(cross(c, a), d_b) + dot(ab, d_c))
    stretch = i_a * i_a * dot(a, d_a) + i_b * i_b * dot(b, d_b) + i_c * i_c * dot(c, d_c)
    work[_at(row, k)] = (i_a * i_b * i_c) * (change - sign * dot(ab, c) * stretch)
    work[_at(JACOBIAN + row, k)] = change


@njit(**FAST)
def _blend(factor, p, shrink, q):
    """``factor p - shrink q``."""
    return factor * p[0] - shrink * q[0], factor * p[1] - shrink * q[1], factor * p[2] - shrink * q[2]


@njit(**FAST)
def _corner_vjp(work, row, k, sign, edges, inverses):
    """Adjoints of the three edges of a corner from those of its triple product and Jacobian."""
    (a, b, c), (i_a, i_b, i_c) = edges, inverses
    ab, scaled = cross(a, b), sign * work[_at(row, k)] * (i_a * i_b * i_c)
    factor, shrink = sign * work[_at(JACOBIAN + row, k)] + scaled, scaled * dot(ab, c)
    return (
        _blend(factor, cross(b, c), shrink * i_a * i_a, a),
        _blend(factor, cross(c, a), shrink * i_b * i_b, b),
        _blend(factor, ab, shrink * i_c * i_c, c),
    )


@njit(**FAST)
def _set_adjoint(work, row, k, signs, edge_bars):
    """Write the adjoint of a corner from those of its three edges, each of which it ends (1) or starts (-1)."""
    (s, t, r), (a, b, c) = signs, edge_bars
    work[_at(row, k)] = s * a[0] + t * b[0] + r * c[0]
    work[_at(row + RUN, k)] = s * a[1] + t * b[1] + r * c[1]
    work[_at(row + 2 * RUN, k)] = s * a[2] + t * b[2] + r * c[2]


@njit(cache=True)
def _set_left_out(work, bits, triple, jacobian, n):
    """Give the corners that are left out set values."""
    found = np.uint8(0)
    for k in range(n):
        found |= bits[k]
    if found == 0:
        return
    for corner in range(8):
        at, bit = work[corner * RUN : SIZE], np.uint8(1 << corner)
        for k in range(n):
            if bits[k] & bit:
                at[k], at[JACOBIAN + k] = triple, jacobian


@njit(**FAST)
def _at_corners(xi, eta, zeta):
    """Of what belongs to the twelve edges, the triples that belong to the corners."""
    return (
        (xi[0], eta[0], zeta[0]),
        (xi[0], eta[1], zeta[1]),
        (xi[1], eta[0], zeta[2]),
        (xi[1], eta[1], zeta[3]),
        (xi[2], eta[2], zeta[0]),
        (xi[2], eta[3], zeta[1]),
        (xi[3], eta[2], zeta[2]),
        (xi[3], eta[3], zeta[3]),
    )


@njit(**FAST)
def _measure_run(rows, bits, sign, work, n):
    """Write triple products, Jacobians and volumes of a run."""
    _load(rows, work, POINTS, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        edges = _at_corners(xi, eta, zeta)
        inverses = _at_corners(_inverses(xi), _inverses(eta), _inverses(zeta))
        _set(work, 0 * RUN, k, sign, edges[0], inverses[0])
        _set(work, 1 * RUN, k, sign, edges[1], inverses[1])
        _set(work, 2 * RUN, k, sign, edges[2], inverses[2])
        _set(work, 3 * RUN, k, sign, edges[3], inverses[3])
        _set(work, 4 * RUN, k, sign, edges[4], inverses[4])
        _set(work, 5 * RUN, k, sign, edges[5], inverses[5])
        _set(work, 6 * RUN, k, sign, edges[6], inverses[6])
        _set(work, 7 * RUN, k, sign, edges[7], inverses[7])
        work[_at(VOLUME, k)] = sign * volume_of(xi, eta, zeta)
    _set_left_out(work, bits, 1.0, np.inf, n)


@njit(**FAST)
def _jvp_run(rows, changes, bits, sign, work, n):
    """Write the changes of triple products, Jacobians and volumes of a run."""
    _load(rows, work, POINTS, n)
    _load(changes, work, CHANGES, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        d_xi, d_eta, d_zeta = _edges(work, CHANGES, k)
        edges, d_edges = _at_corners(xi, eta, zeta), _at_corners(d_xi, d_eta, d_zeta)
        inverses = _at_corners(_inverses(xi), _inverses(eta), _inverses(zeta))
        _set_change(work, 0 * RUN, k, sign, edges[0], inverses[0], d_edges[0])
        _set_change(work, 1 * RUN, k, sign, edges[1], inverses[1], d_edges[1])
        _set_change(work, 2 * RUN, k, sign, edges[2], inverses[2], d_edges[2])
        _set_change(work, 3 * RUN, k, sign, edges[3], inverses[3], d_edges[3])
        _set_change(work, 4 * RUN, k, sign, edges[4], inverses[4], d_edges[4])
        _set_change(work, 5 * RUN, k, sign, edges[5], inverses[5], d_edges[5])
        _set_change(work, 6 * RUN, k, sign, edges[6], inverses[6], d_edges[6])
        _set_change(work, 7 * RUN, k, sign, edges[7], inverses[7], d_edges[7])
        work[_at(VOLUME, k)] = sign * volume_of_jvp((xi, eta, zeta), (d_xi, d_eta, d_zeta))
    _set_left_out(work, bits, 0.0, 0.0, n)


@njit(**FAST)
def _sum(p, q, r):
    """Sum of three vectors."""
    return p[0] + q[0] + r[0], p[1] + q[1] + r[1], p[2] + q[2] + r[2]


@njit(**FAST)
def _vjp_run(rows, bits, sign, work, n):
    """Write the adjoints of the corners of a run from those of the measures in the workspace."""
    _set_left_out(work, bits, 0.0, 0.0, n)
    _load(rows, work, POINTS, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        edges = _at_corners(xi, eta, zeta)
        inverses = _at_corners(_inverses(xi), _inverses(eta), _inverses(zeta))
        a, b, c = volume_of_vjp((xi, eta, zeta), sign * work[_at(VOLUME, k)])
        bar_0 = _corner_vjp(work, 0 * RUN, k, sign, edges[0], inverses[0])
        bar_1 = _corner_vjp(work, 1 * RUN, k, sign, edges[1], inverses[1])
        bar_2 = _corner_vjp(work, 2 * RUN, k, sign, edges[2], inverses[2])
        bar_3 = _corner_vjp(work, 3 * RUN, k, sign, edges[3], inverses[3])
        bar_4 = _corner_vjp(work, 4 * RUN, k, sign, edges[4], inverses[4])
        bar_5 = _corner_vjp(work, 5 * RUN, k, sign, edges[5], inverses[5])
        bar_6 = _corner_vjp(work, 6 * RUN, k, sign, edges[6], inverses[6])
        bar_7 = _corner_vjp(work, 7 * RUN, k, sign, edges[7], inverses[7])
        bars = _at_corners(
            (
                _sum(a[0], bar_0[0], bar_1[0]),
                _sum(a[1], bar_2[0], bar_3[0]),
                _sum(a[2], bar_4[0], bar_5[0]),
                _sum(a[3], bar_6[0], bar_7[0]),
            ),
            (
                _sum(b[0], bar_0[1], bar_2[1]),
                _sum(b[1], bar_1[1], bar_3[1]),
                _sum(b[2], bar_4[1], bar_6[1]),
                _sum(b[3], bar_5[1], bar_7[1]),
            ),
            (
                _sum(c[0], bar_0[2], bar_4[2]),
                _sum(c[1], bar_1[2], bar_5[2]),
                _sum(c[2], bar_2[2], bar_6[2]),
                _sum(c[3], bar_3[2], bar_7[2]),
            ),
        )
        _set_adjoint(work, POINTS + 0 * RUN, k, (-1.0, -1.0, -1.0), bars[0])
        _set_adjoint(work, POINTS + 3 * RUN, k, (1.0, -1.0, -1.0), bars[1])
        _set_adjoint(work, POINTS + 6 * RUN, k, (-1.0, 1.0, -1.0), bars[2])
        _set_adjoint(work, POINTS + 9 * RUN, k, (1.0, 1.0, -1.0), bars[3])
        _set_adjoint(work, POINTS + 12 * RUN, k, (-1.0, -1.0, 1.0), bars[4])
        _set_adjoint(work, POINTS + 15 * RUN, k, (1.0, -1.0, 1.0), bars[5])
        _set_adjoint(work, POINTS + 18 * RUN, k, (-1.0, 1.0, 1.0), bars[6])
        _set_adjoint(work, POINTS + 21 * RUN, k, (1.0, 1.0, 1.0), bars[7])


@njit(cache=True)
def _add_adjoints(work, rows, n):
    """Add the adjoints of the points of a run to eight rows: one corner at a time, since cells share points."""
    for corner in range(8):
        row, point = rows[corner], work[POINTS + 3 * RUN * corner : SIZE]
        for k in range(n):
            row[k].x += point[k]
            row[k].y += point[RUN + k]
            row[k].z += point[2 * RUN + k]


@njit(cache=True)
def _copy(source, target, n):
    for k in range(n):
        target[k] = source[k]


@njit(cache=True)
def _store(work, triples, jacobians, volume, first, n):
    """Write the measures of a run from cell ``first`` on."""
    for corner in range(8):
        _copy(work[corner * RUN : SIZE], triples[corner][first:], n)
        _copy(work[JACOBIAN + corner * RUN : SIZE], jacobians[corner][first:], n)
    _copy(work[VOLUME:SIZE], volume[first:], n)


@njit(cache=True)
def _load_adjoints(triples, jacobians, volume, work, first, n):
    """Read the adjoints of the measures of a run."""
    for corner in range(8):
        _copy(triples[corner][first:], work[corner * RUN : SIZE], n)
        _copy(jacobians[corner][first:], work[JACOBIAN + corner * RUN : SIZE], n)
    _copy(volume[first:], work[VOLUME:SIZE], n)


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
    work, first = np.empty(SIZE), 0
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
    work, first = np.empty(SIZE), 0
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
    work, first = np.empty(SIZE), 0
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            for k in range(0, left_out.shape[2], RUN):
                n = min(RUN, left_out.shape[2] - k)
                _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
                _vjp_run(_rows_of(x, i, j, k), left_out[i, j][k:], sign, work, n)
                _add_adjoints(work, _rows_of(x_bar, i, j, k), n)
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


@njit(**FAST)
def _vector(p, q):
    """Vector from one point to another."""
    return q.x - p.x, q.y - p.y, q.z - p.z


@njit(**FAST)
def _with(so_far, bits, bit, sign, edges, inverses):
    """Product and least of the triple products and least Jacobian with one corner more, unless it is left out."""
    triple, jacobian = _corner(sign, edges, inverses)
    is_out = bits & bit
    triple, jacobian = 1.0 if is_out else triple, np.inf if is_out else jacobian
    product, least, smallest = so_far
    return product * triple, triple if triple < least else least, jacobian if jacobian < smallest else smallest


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def block_summary(x, left_out, sign, q, corner, jacobian, volume):
    """Product and smallest of the corner triple products, smallest corner Jacobian and volume of the cells of a block.

    Four results are few enough for the compiler to see that nothing overlaps: they need no workspace.

    Parameters
    ----------
    x, left_out, sign
        See `block_measures`.
    q, corner, jacobian, volume : ndarray, shape (n_cells,)
        Results.
    """
    n = left_out.shape[2]
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            a, b, c, d = x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1]
            e, f, g, h = a[1:], b[1:], c[1:], d[1:]
            bits, first = left_out[i, j], (i * left_out.shape[1] + j) * n
            row_q, row_corner = q[first : first + n], corner[first : first + n]
            row_jacobian, row_volume = jacobian[first : first + n], volume[first : first + n]
            for k in range(n):
                p0, p1, p2, p3, p4, p5, p6, p7 = a[k], b[k], c[k], d[k], e[k], f[k], g[k], h[k]
                xi = _vector(p0, p1), _vector(p2, p3), _vector(p4, p5), _vector(p6, p7)
                eta = _vector(p0, p2), _vector(p1, p3), _vector(p4, p6), _vector(p5, p7)
                zeta = _vector(p0, p4), _vector(p1, p5), _vector(p2, p6), _vector(p3, p7)
                edges = _at_corners(xi, eta, zeta)
                inverses = _at_corners(_inverses(xi), _inverses(eta), _inverses(zeta))
                so_far = _with((1.0, np.inf, np.inf), bits[k], np.uint8(1), sign, edges[0], inverses[0])
                so_far = _with(so_far, bits[k], np.uint8(2), sign, edges[1], inverses[1])
                so_far = _with(so_far, bits[k], np.uint8(4), sign, edges[2], inverses[2])
                so_far = _with(so_far, bits[k], np.uint8(8), sign, edges[3], inverses[3])
                so_far = _with(so_far, bits[k], np.uint8(16), sign, edges[4], inverses[4])
                so_far = _with(so_far, bits[k], np.uint8(32), sign, edges[5], inverses[5])
                so_far = _with(so_far, bits[k], np.uint8(64), sign, edges[6], inverses[6])
                row_q[k], row_corner[k], row_jacobian[k] = _with(
                    so_far, bits[k], np.uint8(128), sign, edges[7], inverses[7]
                )
                row_volume[k] = sign * volume_of(xi, eta, zeta)


@njit(cache=True, nogil=True)
def list_measures(x, left_out, triples, jacobians, volume):
    """Measure a list of cells, `block_measures` for right-handed cells with corners ``x`` of shape (8, n_cells)."""
    work, n_cells = np.empty(SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _measure_run(_rows_from(x, first), left_out[first:], 1.0, work, n)
        _store(work, triples, jacobians, volume, first, n)


@njit(cache=True, nogil=True)
def list_jvp(x, d_x, left_out, d_triples, d_jacobians, d_volume):
    """Change of what `list_measures` gives with the corners."""
    work, n_cells = np.empty(SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _jvp_run(_rows_from(x, first), _rows_from(d_x, first), left_out[first:], 1.0, work, n)
        _store(work, d_triples, d_jacobians, d_volume, first, n)


@njit(cache=True, nogil=True)
def list_vjp(x, left_out, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the corners, from those of what `list_measures` gives, to ``x_bar``."""
    work, n_cells = np.empty(SIZE), x.shape[1]
    for first in range(0, n_cells, RUN):
        n = min(RUN, n_cells - first)
        _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
        _vjp_run(_rows_from(x, first), left_out[first:], 1.0, work, n)
        _add_adjoints(work, _rows_from(x_bar, first), n)
