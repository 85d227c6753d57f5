"""Corner triple products, corner Jacobians and volumes of runs of cells, and their derivatives.

Corners and signs are those of `.hexahedron`. All three measures are functions of the twelve edges of a cell, and so are
their derivatives. Points come and go as eight rows, one per corner of the cells.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .hexahedron_layout import (
    JACOBIAN,
    POINTS,
    RUN,
    SIZE,
    TRIPLE,
    VOLUME,
    at_each_corner,
    at_each_edge,
    cross,
    dot,
    set_vector,
    vector,
)
from .hexahedron_volume import volumes, volumes_jvp, volumes_vjp

__all__ = ["block_jvp", "block_measures", "block_summary", "block_vjp", "list_jvp", "list_measures", "list_vjp"]

TINY = 1e-190
"""Added to a squared length before it is inverted, so that an edge of no length has a triple product of 0."""


@njit(inline="always")
def _edge(work, edge, start, end, n):
    """Edges between two corners with their inverse lengths."""
    for k in range(n):
        p, q = vector(work, start + k), vector(work, end + k)
        x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        set_vector(work, edge + k, x, y, z)
        work[edge + 3 * RUN + k] = 1.0 / np.sqrt(x * x + y * y + z * z + TINY)


@njit(inline="always")
def _edge_change(work, edge, start, end, n):
    """Change of the edges with the corners."""
    for k in range(n):
        p, q = vector(work, start + k), vector(work, end + k)
        set_vector(work, edge + 4 * RUN + k, q[0] - p[0], q[1] - p[1], q[2] - p[2])


@njit(inline="always")
def _corner(work, u, v, w, corner, sign, n):
    """Triple products of unit edges and Jacobians at one corner."""
    for k in range(n):
        jacobian = sign * dot(cross(vector(work, u + k), vector(work, v + k)), vector(work, w + k))
        inverse = work[u + 3 * RUN + k] * work[v + 3 * RUN + k] * work[w + 3 * RUN + k]
        work[TRIPLE + corner * RUN + k] = jacobian * inverse
        work[JACOBIAN + corner * RUN + k] = jacobian


@njit(inline="always")
def _corner_jvp(work, u, v, w, corner, sign, n):
    """Change of the triple products and Jacobians at one corner."""
    for k in range(n):
        a, b, c = vector(work, u + k), vector(work, v + k), vector(work, w + k)
        i_a, i_b, i_c = work[u + 3 * RUN + k], work[v + 3 * RUN + k], work[w + 3 * RUN + k]
        d_a, d_b, d_c = vector(work, u + 4 * RUN + k), vector(work, v + 4 * RUN + k), vector(work, w + 4 * RUN + k)
        ab = cross(a, b)
        change = sign * (dot(cross(b, c), d_a) + dot(cross(c, a), d_b) + dot(ab, d_c))
        stretch = i_a * i_a * dot(a, d_a) + i_b * i_b * dot(b, d_b) + i_c * i_c * dot(c, d_c)
        work[TRIPLE + corner * RUN + k] = (i_a * i_b * i_c) * (change - sign * dot(ab, c) * stretch)
        work[JACOBIAN + corner * RUN + k] = change


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
        a, b, c = vector(work, u + k), vector(work, v + k), vector(work, w + k)
        i_a, i_b, i_c = work[u + 3 * RUN + k], work[v + 3 * RUN + k], work[w + 3 * RUN + k]
        ab, scaled = cross(a, b), sign * work[TRIPLE + corner * RUN + k] * (i_a * i_b * i_c)
        factor, shrink = sign * work[JACOBIAN + corner * RUN + k] + scaled, scaled * dot(ab, c)
        _add(work, u + 4 * RUN + k, factor, cross(b, c), shrink * i_a * i_a, a)
        _add(work, v + 4 * RUN + k, factor, cross(c, a), shrink * i_b * i_b, b)
        _add(work, w + 4 * RUN + k, factor, ab, shrink * i_c * i_c, c)


@njit(inline="always")
def _point_adjoint(work, u, v, w, corner, sign, n):
    """Adjoint of a corner from those of its three edges, each of which it starts or ends."""
    s, t, r = 2.0 * (corner & 1) - 1.0, 2.0 * ((corner >> 1) & 1) - 1.0, 2.0 * (corner >> 2) - 1.0
    for k in range(n):
        a, b, c = vector(work, u + 4 * RUN + k), vector(work, v + 4 * RUN + k), vector(work, w + 4 * RUN + k)
        x, y, z = s * a[0] + t * b[0] + r * c[0], s * a[1] + t * b[1] + r * c[1], s * a[2] + t * b[2] + r * c[2]
        set_vector(work, POINTS + 3 * RUN * corner + k, x, y, z)


_edges, _edge_changes = at_each_edge(_edge), at_each_edge(_edge_change)
_corners, _corners_jvp, _corners_vjp = (
    at_each_corner(_corner),
    at_each_corner(_corner_jvp),
    at_each_corner(_corner_vjp),
)
_point_adjoints = at_each_corner(_point_adjoint)


@njit(cache=True)
def _load(rows, work, n):
    """Take the points of a run, or their changes, from eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[POINTS + 3 * RUN * corner : SIZE]
        for k in range(n):
            point[k], point[RUN + k], point[2 * RUN + k] = row[k].x, row[k].y, row[k].z


@njit(cache=True)
def _add_to(rows, work, n):
    """Add the adjoints of the points of a run to eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[POINTS + 3 * RUN * corner : SIZE]
        for k in range(n):
            row[k].x += point[k]
            row[k].y += point[RUN + k]
            row[k].z += point[2 * RUN + k]


@njit(cache=True)
def _set_left_out(work, bits, triple, jacobian, n):
    """Give the corners that are left out set values."""
    for corner in range(8):
        at = work[TRIPLE + corner * RUN : SIZE]
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
        _copy(work[TRIPLE + corner * RUN : SIZE], triples[corner][first:], n)
        _copy(work[JACOBIAN + corner * RUN : SIZE], jacobians[corner][first:], n)
    _copy(work[VOLUME:SIZE], volume[first:], n)


@njit(cache=True)
def _load_adjoints(triples, jacobians, volume, work, first, n):
    """Read the adjoints of the measures of a run."""
    for corner in range(8):
        _copy(triples[corner][first:], work[TRIPLE + corner * RUN : SIZE], n)
        _copy(jacobians[corner][first:], work[JACOBIAN + corner * RUN : SIZE], n)
    _copy(volume[first:], work[VOLUME:SIZE], n)


@njit(cache=True)
def _measure_run(rows, bits, sign, work, n):
    _load(rows, work, n)
    _edges(work, n)
    _corners(work, sign, n)
    volumes(work, sign, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 1.0, np.inf, n)


@njit(cache=True)
def _jvp_run(rows, changes, bits, sign, work, n):
    _load(rows, work, n)
    _edges(work, n)
    _load(changes, work, n)
    _edge_changes(work, n)
    _corners_jvp(work, sign, n)
    volumes_jvp(work, sign, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 0.0, 0.0, n)


@njit(cache=True)
def _vjp_run(rows, bits, sign, work, adjoints, n):
    _load(rows, work, n)
    _edges(work, n)
    if _any_bit(bits, n):
        _set_left_out(work, bits, 0.0, 0.0, n)
    volumes_vjp(work, sign, n)
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


@njit(cache=True)
def _summarize(work, q, corner, jacobian, n):
    """Product of the triple products of each cell, their minimum and that of the Jacobians."""
    for k in range(n):
        t, j = TRIPLE + k, JACOBIAN + k
        q[k], corner[k], jacobian[k] = work[t], work[t], work[j]
    for at in range(RUN, 8 * RUN, RUN):
        triples, jacobians = work[TRIPLE + at : SIZE], work[JACOBIAN + at : SIZE]
        for k in range(n):
            q[k] *= triples[k]
            corner[k] = triples[k] if triples[k] < corner[k] else corner[k]
            jacobian[k] = jacobians[k] if jacobians[k] < jacobian[k] else jacobian[k]


@njit(cache=True, nogil=True)
def block_summary(x, left_out, sign, q, corner, jacobian, volume):
    """Product and smallest of the corner triple products, smallest corner Jacobian and volume of the cells of a block.

    Parameters
    ----------
    x, left_out, sign
        See `block_measures`.
    q, corner, jacobian, volume : ndarray, shape (n_cells,)
        Results.
    """
    work, first = np.empty(SIZE), 0
    for i in range(left_out.shape[0]):
        for j in range(left_out.shape[1]):
            for k in range(0, left_out.shape[2], RUN):
                n = min(RUN, left_out.shape[2] - k)
                _measure_run(_rows_of(x, i, j, k), left_out[i, j][k:], sign, work, n)
                _summarize(work, q[first:], corner[first:], jacobian[first:], n)
                _copy(work[VOLUME:SIZE], volume[first:], n)
                first += n


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
        _vjp_run(_rows_from(x, first), left_out[first:], 1.0, work, _rows_from(x_bar, first), n)
