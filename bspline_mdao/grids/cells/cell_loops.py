"""Loops that measure all cells of a block or of a list: the formulas of `.orthogonality`, many cells at a time.

The formulas are straight-line code on the twelve edges of one cell. Here they stand in a loop over a batch of cells,
which the compiler turns into SIMD instructions, one cell per lane. Points come and go as eight rows, one per corner of
the cells. The loop itself reads and writes one workspace, rows at fixed distances, since the compiler can see that
these do not overlap::

    triple products of corners 0..7, Jacobians of corners 0..7, volume,
    corners 0..7: x, y, z of the points or of their adjoints,
    corners 0..7: x, y, z of the changes of the points

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .orthogonality import (
    FAST,
    at_corners,
    cell_volume,
    cell_volume_jvp,
    cell_volume_vjp,
    corner_jvp,
    corner_measures,
    corner_vjp,
    edges_vjp,
    inverse_lengths,
)

__all__ = [
    "as_points",
    "block_jvp",
    "block_measures",
    "block_summary",
    "block_vjp",
    "list_measures",
    "list_vjp",
]

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, whose fixed stride lets loops over points vectorise."""

BATCH = 64
"""Cells of a batch: its rows of the workspace, 33 kB, are about as large as the first-level cache."""

JACOBIAN = 8 * BATCH
VOLUME = 16 * BATCH
POINTS = 17 * BATCH
CHANGES = 41 * BATCH
SIZE = 65 * BATCH


def as_points(
    nodes: np.ndarray,  # (..., 3), coordinates (m)
) -> np.ndarray:  # (...)
    """View coordinates ``(..., 3)`` as records of type `POINT`; copied where they are not contiguous."""
    return np.ascontiguousarray(nodes, dtype=np.float64).view(POINT)[..., 0]


@njit(cache=True)
def _load(rows, work, at, n):
    """Read the points of a batch, or their changes, from eight rows."""
    for corner in range(8):
        row, point = rows[corner], work[at + 3 * BATCH * corner : SIZE]
        for k in range(n):
            point[k], point[BATCH + k], point[2 * BATCH + k] = row[k].x, row[k].y, row[k].z


@njit(**FAST)
def _at(row, k):
    """Index of an entry of a row as an unsigned number: signed ones may count from the end, which hinders vectors."""
    return np.uint64(row) + np.uint64(k)


@njit(**FAST)
def _between(work, p, q, k):
    """Vector from one point to another."""
    return (
        work[_at(q, k)] - work[_at(p, k)],
        work[_at(q + BATCH, k)] - work[_at(p + BATCH, k)],
        work[_at(q + 2 * BATCH, k)] - work[_at(p + 2 * BATCH, k)],
    )


@njit(**FAST)
def _edges(work, at, k):
    """Edges of a cell whose corners are in rows from ``at`` on: four along xi, four along eta, four along zeta."""
    p0, p1, p2, p3 = at, at + 3 * BATCH, at + 6 * BATCH, at + 9 * BATCH
    p4, p5, p6, p7 = at + 12 * BATCH, at + 15 * BATCH, at + 18 * BATCH, at + 21 * BATCH
    return (
        (_between(work, p0, p1, k), _between(work, p2, p3, k), _between(work, p4, p5, k), _between(work, p6, p7, k)),
        (_between(work, p0, p2, k), _between(work, p1, p3, k), _between(work, p4, p6, k), _between(work, p5, p7, k)),
        (_between(work, p0, p4, k), _between(work, p1, p5, k), _between(work, p2, p6, k), _between(work, p3, p7, k)),
    )


@njit(**FAST)
def _set(work, row, k, triple_and_jacobian):
    """Write the triple product and the Jacobian of a corner, or their changes."""
    work[_at(row, k)], work[_at(JACOBIAN + row, k)] = triple_and_jacobian


@njit(**FAST)
def _bars_of_corner(work, row, k, sign, edges, inverses):
    """Adjoints of the three edges of a corner from those of its triple product and Jacobian in the workspace."""
    return corner_vjp(sign, edges, inverses, work[_at(row, k)], work[_at(JACOBIAN + row, k)])


@njit(**FAST)
def _set_adjoint(work, row, k, signs, edge_bars):
    """Write the adjoint of a corner from those of its three edges, each of which it ends (1) or starts (-1)."""
    (s, t, r), (a, b, c) = signs, edge_bars
    work[_at(row, k)] = s * a[0] + t * b[0] + r * c[0]
    work[_at(row + BATCH, k)] = s * a[1] + t * b[1] + r * c[1]
    work[_at(row + 2 * BATCH, k)] = s * a[2] + t * b[2] + r * c[2]


@njit(cache=True)
def _set_degenerate(work, bits, triple, jacobian, n):
    """Write given values for degenerate corners; most batches have none, which is found out first."""
    found = np.uint8(0)
    for k in range(n):
        found |= bits[k]
    if found == 0:
        return
    for corner in range(8):
        at, bit = work[corner * BATCH : SIZE], np.uint8(1 << corner)
        for k in range(n):
            if bits[k] & bit:
                at[k], at[JACOBIAN + k] = triple, jacobian


@njit(**FAST)
def _measure_batch(rows, bits, sign, work, n):
    """Write triple products, Jacobians and volumes of a batch."""
    _load(rows, work, POINTS, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        edges = at_corners(xi, eta, zeta)
        inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
        _set(work, 0 * BATCH, k, corner_measures(sign, edges[0], inverses[0]))
        _set(work, 1 * BATCH, k, corner_measures(sign, edges[1], inverses[1]))
        _set(work, 2 * BATCH, k, corner_measures(sign, edges[2], inverses[2]))
        _set(work, 3 * BATCH, k, corner_measures(sign, edges[3], inverses[3]))
        _set(work, 4 * BATCH, k, corner_measures(sign, edges[4], inverses[4]))
        _set(work, 5 * BATCH, k, corner_measures(sign, edges[5], inverses[5]))
        _set(work, 6 * BATCH, k, corner_measures(sign, edges[6], inverses[6]))
        _set(work, 7 * BATCH, k, corner_measures(sign, edges[7], inverses[7]))
        work[_at(VOLUME, k)] = sign * cell_volume(xi, eta, zeta)
    _set_degenerate(work, bits, 1.0, np.inf, n)


@njit(**FAST)
def _jvp_batch(rows, changes, bits, sign, work, n):
    """Write the changes of triple products, Jacobians and volumes of a batch."""
    _load(rows, work, POINTS, n)
    _load(changes, work, CHANGES, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        d_xi, d_eta, d_zeta = _edges(work, CHANGES, k)
        edges, d_edges = at_corners(xi, eta, zeta), at_corners(d_xi, d_eta, d_zeta)
        inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
        _set(work, 0 * BATCH, k, corner_jvp(sign, edges[0], inverses[0], d_edges[0]))
        _set(work, 1 * BATCH, k, corner_jvp(sign, edges[1], inverses[1], d_edges[1]))
        _set(work, 2 * BATCH, k, corner_jvp(sign, edges[2], inverses[2], d_edges[2]))
        _set(work, 3 * BATCH, k, corner_jvp(sign, edges[3], inverses[3], d_edges[3]))
        _set(work, 4 * BATCH, k, corner_jvp(sign, edges[4], inverses[4], d_edges[4]))
        _set(work, 5 * BATCH, k, corner_jvp(sign, edges[5], inverses[5], d_edges[5]))
        _set(work, 6 * BATCH, k, corner_jvp(sign, edges[6], inverses[6], d_edges[6]))
        _set(work, 7 * BATCH, k, corner_jvp(sign, edges[7], inverses[7], d_edges[7]))
        work[_at(VOLUME, k)] = sign * cell_volume_jvp((xi, eta, zeta), (d_xi, d_eta, d_zeta))
    _set_degenerate(work, bits, 0.0, 0.0, n)


@njit(**FAST)
def _vjp_batch(rows, bits, sign, work, n):
    """Write the adjoints of the corners of a batch from those of the measures in the workspace."""
    _set_degenerate(work, bits, 0.0, 0.0, n)
    _load(rows, work, POINTS, n)
    for k in range(n):
        xi, eta, zeta = _edges(work, POINTS, k)
        edges = at_corners(xi, eta, zeta)
        inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
        a, b, c = cell_volume_vjp((xi, eta, zeta), sign * work[_at(VOLUME, k)])
        bar_0 = _bars_of_corner(work, 0 * BATCH, k, sign, edges[0], inverses[0])
        bar_1 = _bars_of_corner(work, 1 * BATCH, k, sign, edges[1], inverses[1])
        bar_2 = _bars_of_corner(work, 2 * BATCH, k, sign, edges[2], inverses[2])
        bar_3 = _bars_of_corner(work, 3 * BATCH, k, sign, edges[3], inverses[3])
        bar_4 = _bars_of_corner(work, 4 * BATCH, k, sign, edges[4], inverses[4])
        bar_5 = _bars_of_corner(work, 5 * BATCH, k, sign, edges[5], inverses[5])
        bar_6 = _bars_of_corner(work, 6 * BATCH, k, sign, edges[6], inverses[6])
        bar_7 = _bars_of_corner(work, 7 * BATCH, k, sign, edges[7], inverses[7])
        bars = at_corners(*edges_vjp((bar_0, bar_1, bar_2, bar_3, bar_4, bar_5, bar_6, bar_7), (a, b, c)))
        _set_adjoint(work, POINTS + 0 * BATCH, k, (-1.0, -1.0, -1.0), bars[0])
        _set_adjoint(work, POINTS + 3 * BATCH, k, (1.0, -1.0, -1.0), bars[1])
        _set_adjoint(work, POINTS + 6 * BATCH, k, (-1.0, 1.0, -1.0), bars[2])
        _set_adjoint(work, POINTS + 9 * BATCH, k, (1.0, 1.0, -1.0), bars[3])
        _set_adjoint(work, POINTS + 12 * BATCH, k, (-1.0, -1.0, 1.0), bars[4])
        _set_adjoint(work, POINTS + 15 * BATCH, k, (1.0, -1.0, 1.0), bars[5])
        _set_adjoint(work, POINTS + 18 * BATCH, k, (-1.0, 1.0, 1.0), bars[6])
        _set_adjoint(work, POINTS + 21 * BATCH, k, (1.0, 1.0, 1.0), bars[7])


@njit(cache=True)
def _add_adjoints(work, rows, n):
    """Add the adjoints of the points of a batch to eight rows: one corner at a time, since cells share points."""
    for corner in range(8):
        row, point = rows[corner], work[POINTS + 3 * BATCH * corner : SIZE]
        for k in range(n):
            row[k].x += point[k]
            row[k].y += point[BATCH + k]
            row[k].z += point[2 * BATCH + k]


@njit(cache=True)
def _copy(source, target, n):
    for k in range(n):
        target[k] = source[k]


@njit(cache=True)
def _store(work, triples, jacobians, volume, first, n):
    """Write the measures of a batch from cell ``first`` on."""
    for corner in range(8):
        _copy(work[corner * BATCH : SIZE], triples[corner][first:], n)
        _copy(work[JACOBIAN + corner * BATCH : SIZE], jacobians[corner][first:], n)
    _copy(work[VOLUME:SIZE], volume[first:], n)


@njit(cache=True)
def _load_adjoints(triples, jacobians, volume, work, first, n):
    """Read the adjoints of the measures of a batch."""
    for corner in range(8):
        _copy(triples[corner][first:], work[corner * BATCH : SIZE], n)
        _copy(jacobians[corner][first:], work[JACOBIAN + corner * BATCH : SIZE], n)
    _copy(volume[first:], work[VOLUME:SIZE], n)


@njit(cache=True)
def _rows_of(x, i, j, k):
    """Eight rows of points: the corners of the cells of a block from (i, j, k) on."""
    p, q, r, s = x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1]
    return p[k:], q[k:], r[k:], s[k:], p[k + 1 :], q[k + 1 :], r[k + 1 :], s[k + 1 :]


@njit(cache=True, nogil=True)
def block_measures(
    x,  # (ni, nj, nk), nodes
    degenerate,  # uint8 (ni-1, nj-1, nk-1), bit c is set where corner c is degenerate
    sign,  # handedness
    # results at the corners, cells in C order; 1 and infinity at corners that are degenerate
    triples,  # (8, n_cells)
    jacobians,  # (8, n_cells)
    volume,  # (n_cells,), result
):
    """Measure the cells of a block."""
    work, first = np.empty(SIZE), 0
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], BATCH):
                n = min(BATCH, degenerate.shape[2] - k)
                _measure_batch(_rows_of(x, i, j, k), degenerate[i, j][k:], sign, work, n)
                _store(work, triples, jacobians, volume, first, n)
                first += n


@njit(cache=True, nogil=True)
def block_jvp(
    # nodes and their change
    x,  # (ni, nj, nk)
    d_x,  # (ni, nj, nk)
    # see `block_measures`
    degenerate,
    sign,
    # results, of the shapes there
    d_triples,
    d_jacobians,
    d_volume,
):
    """Change of what `block_measures` gives with the nodes; 0 at corners that are degenerate."""
    work, first = np.empty(SIZE), 0
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], BATCH):
                n = min(BATCH, degenerate.shape[2] - k)
                _jvp_batch(_rows_of(x, i, j, k), _rows_of(d_x, i, j, k), degenerate[i, j][k:], sign, work, n)
                _store(work, d_triples, d_jacobians, d_volume, first, n)
                first += n


@njit(cache=True, nogil=True)
def block_vjp(
    # see `block_measures`
    x,
    degenerate,
    sign,
    # adjoints, of the shapes there; those of corners that are degenerate are not looked at
    triples_bar,
    jacobians_bar,
    volume_bar,
    x_bar,  # (ni, nj, nk), added to
):
    """Add the adjoint of the nodes, from those of what `block_measures` gives, to ``x_bar``."""
    work, first = np.empty(SIZE), 0
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], BATCH):
                n = min(BATCH, degenerate.shape[2] - k)
                _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
                _vjp_batch(_rows_of(x, i, j, k), degenerate[i, j][k:], sign, work, n)
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
    """Product and least of the triple products and least Jacobian with one corner more, unless it is degenerate."""
    triple, jacobian = corner_measures(sign, edges, inverses)
    is_out = bits & bit
    triple, jacobian = 1.0 if is_out else triple, np.inf if is_out else jacobian
    product, least, smallest = so_far
    return product * triple, triple if triple < least else least, jacobian if jacobian < smallest else smallest


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def block_summary(
    # see `block_measures`
    x,
    degenerate,
    sign,
    # results
    q,  # (n_cells,)
    corner,  # (n_cells,)
    jacobian,  # (n_cells,)
    volume,  # (n_cells,)
):
    """Product and smallest of the corner triple products, smallest corner Jacobian and volume of a block's cells."""
    # Four results are few enough for the compiler to see that nothing overlaps: they need no workspace.
    n = degenerate.shape[2]
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            a, b, c, d = x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1]
            e, f, g, h = a[1:], b[1:], c[1:], d[1:]
            bits, first = degenerate[i, j], (i * degenerate.shape[1] + j) * n
            row_q, row_corner = q[first : first + n], corner[first : first + n]
            row_jacobian, row_volume = jacobian[first : first + n], volume[first : first + n]
            for k in range(n):
                p0, p1, p2, p3, p4, p5, p6, p7 = a[k], b[k], c[k], d[k], e[k], f[k], g[k], h[k]
                xi = _vector(p0, p1), _vector(p2, p3), _vector(p4, p5), _vector(p6, p7)
                eta = _vector(p0, p2), _vector(p1, p3), _vector(p4, p6), _vector(p5, p7)
                zeta = _vector(p0, p4), _vector(p1, p5), _vector(p2, p6), _vector(p3, p7)
                edges = at_corners(xi, eta, zeta)
                inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
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
                row_volume[k] = sign * cell_volume(xi, eta, zeta)


@njit(cache=True, nogil=True)
def list_measures(x, degenerate, triples, jacobians, volume):
    """Measure a list of cells, `block_measures` for right-handed cells with corners ``x`` of shape (8, n_cells)."""
    work, n_cells = np.empty(SIZE), x.shape[1]
    for first in range(0, n_cells, BATCH):
        n = min(BATCH, n_cells - first)
        _measure_batch(_rows_from(x, first), degenerate[first:], 1.0, work, n)
        _store(work, triples, jacobians, volume, first, n)


@njit(cache=True, nogil=True)
def list_vjp(x, degenerate, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the corners, from those of what `list_measures` gives, to ``x_bar``."""
    work, n_cells = np.empty(SIZE), x.shape[1]
    for first in range(0, n_cells, BATCH):
        n = min(BATCH, n_cells - first)
        _load_adjoints(triples_bar, jacobians_bar, volume_bar, work, first, n)
        _vjp_batch(_rows_from(x, first), degenerate[first:], 1.0, work, n)
        _add_adjoints(work, _rows_from(x_bar, first), n)
