"""Loops that measure all cells of a block or of a list: the formulas of `.orthogonality`, many cells at a time.

The formulas are straight-line code on the twelve edges of one cell. Here they are called with `Lanes`, one cell in each
(`bspline_mdao.base.numerics.lanes`). Points come and go as flat arrays of records, from eight offsets, one per corner
of the cells. What is not asked for is given as an array of no size, of which nothing is read, and nothing written to
it.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.lanes import (
    LANES,
    add_points,
    least_of,
    load,
    load_bits,
    load_points,
    positive,
    smaller,
    spread,
    store,
    sum_of,
    with_bits,
    within,
)
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
    "block_numbers",
    "block_summary",
    "block_vjp",
    "list_measures",
    "list_vjp",
]

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, as kernels take it."""


def as_points(
    nodes: np.ndarray,  # (..., 3), coordinates (m)
) -> np.ndarray:  # (...)
    """View coordinates ``(..., 3)`` as records of type `POINT`; copied where they are not contiguous."""
    return np.ascontiguousarray(nodes, dtype=np.float64).view(POINT)[..., 0]


@njit(**FAST)
def _between(p, q):
    """Vector from one point to another."""
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@njit(**FAST)
def _edges(x, at, n):
    """Edges of ``n`` cells whose corners start at eight places of ``x``: four along xi, along eta, and along zeta."""
    p0, p1, p2, p3 = (
        load_points(x, at[0], n),
        load_points(x, at[1], n),
        load_points(x, at[2], n),
        load_points(x, at[3], n),
    )
    p4, p5, p6, p7 = (
        load_points(x, at[4], n),
        load_points(x, at[5], n),
        load_points(x, at[6], n),
        load_points(x, at[7], n),
    )
    return (
        (_between(p0, p1), _between(p2, p3), _between(p4, p5), _between(p6, p7)),
        (_between(p0, p2), _between(p1, p3), _between(p4, p6), _between(p5, p7)),
        (_between(p0, p4), _between(p1, p5), _between(p2, p6), _between(p3, p7)),
    )


@njit(**FAST)
def _room(array, n):
    """Count the lanes that are read from an array or written to it: none where it has no size."""
    return n if array.size > 0 else 0


@njit(**FAST)
def _set(triples, jacobians, corner, n_cells, cell, n, bits, values, without):
    """Write the triple product and the Jacobian of a corner of cells, or their changes, unless it is degenerate."""
    place, bit = corner * n_cells + cell, np.uint8(1 << corner)
    store(triples, place, _room(triples, n), with_bits(bits, bit, values[0], without[0]))
    store(jacobians, place, _room(jacobians, n), with_bits(bits, bit, values[1], without[1]))


@njit(**FAST)
def _bars_of_corner(triples_bar, jacobians_bar, corner, n_cells, cell, n, bits, sign, edges, inverses):
    """Adjoints of the three edges of a corner from those of its triple product and Jacobian; none where degenerate."""
    place, bit = corner * n_cells + cell, np.uint8(1 << corner)
    triple_bar = with_bits(bits, bit, load(triples_bar, place, _room(triples_bar, n)), 0.0)
    jacobian_bar = with_bits(bits, bit, load(jacobians_bar, place, _room(jacobians_bar, n)), 0.0)
    return corner_vjp(sign, edges, inverses, triple_bar, jacobian_bar)


@njit(**FAST)
def _add_adjoint(x_bar, at, n, signs, edge_bars):
    """Add the adjoint of a corner from those of its three edges, each of which it ends (1) or starts (-1)."""
    (s, t, r), (a, b, c) = signs, edge_bars
    bar = s * a[0] + t * b[0] + r * c[0], s * a[1] + t * b[1] + r * c[1], s * a[2] + t * b[2] + r * c[2]
    add_points(x_bar, at, n, bar)


@njit(**FAST)
def _measure(x, at, degenerate, sign, triples, jacobians, volume, cell, n):
    """Measure ``n`` cells from number ``cell`` on."""
    bits, n_cells, without = load_bits(degenerate, cell, n), degenerate.size, (1.0, np.inf)
    xi, eta, zeta = _edges(x, at, n)
    edges = at_corners(xi, eta, zeta)
    inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
    values = corner_measures(sign, edges[0], inverses[0])
    _set(triples, jacobians, 0, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[1], inverses[1])
    _set(triples, jacobians, 1, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[2], inverses[2])
    _set(triples, jacobians, 2, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[3], inverses[3])
    _set(triples, jacobians, 3, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[4], inverses[4])
    _set(triples, jacobians, 4, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[5], inverses[5])
    _set(triples, jacobians, 5, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[6], inverses[6])
    _set(triples, jacobians, 6, n_cells, cell, n, bits, values, without)
    values = corner_measures(sign, edges[7], inverses[7])
    _set(triples, jacobians, 7, n_cells, cell, n, bits, values, without)
    store(volume, cell, _room(volume, n), sign * cell_volume(xi, eta, zeta))


@njit(**FAST)
def _measure_jvp(x, d_x, at, degenerate, sign, d_triples, d_jacobians, d_volume, cell, n):
    """Change of what `_measure` writes."""
    bits, n_cells, without = load_bits(degenerate, cell, n), degenerate.size, (0.0, 0.0)
    xi, eta, zeta = _edges(x, at, n)
    d_xi, d_eta, d_zeta = _edges(d_x, at, n)
    edges, d_edges = at_corners(xi, eta, zeta), at_corners(d_xi, d_eta, d_zeta)
    inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
    values = corner_jvp(sign, edges[0], inverses[0], d_edges[0])
    _set(d_triples, d_jacobians, 0, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[1], inverses[1], d_edges[1])
    _set(d_triples, d_jacobians, 1, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[2], inverses[2], d_edges[2])
    _set(d_triples, d_jacobians, 2, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[3], inverses[3], d_edges[3])
    _set(d_triples, d_jacobians, 3, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[4], inverses[4], d_edges[4])
    _set(d_triples, d_jacobians, 4, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[5], inverses[5], d_edges[5])
    _set(d_triples, d_jacobians, 5, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[6], inverses[6], d_edges[6])
    _set(d_triples, d_jacobians, 6, n_cells, cell, n, bits, values, without)
    values = corner_jvp(sign, edges[7], inverses[7], d_edges[7])
    _set(d_triples, d_jacobians, 7, n_cells, cell, n, bits, values, without)
    store(d_volume, cell, _room(d_volume, n), sign * cell_volume_jvp((xi, eta, zeta), (d_xi, d_eta, d_zeta)))


@njit(**FAST)
def _measure_vjp(x, at, degenerate, sign, triples_bar, jacobians_bar, volume_bar, x_bar, cell, n):
    """Add the adjoints of the corners of cells from those of what `_measure` writes."""
    bits, n_cells, tb, jb = load_bits(degenerate, cell, n), degenerate.size, triples_bar, jacobians_bar
    xi, eta, zeta = _edges(x, at, n)
    edges = at_corners(xi, eta, zeta)
    inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
    a, b, c = cell_volume_vjp((xi, eta, zeta), sign * load(volume_bar, cell, _room(volume_bar, n)))
    bar_0 = _bars_of_corner(tb, jb, 0, n_cells, cell, n, bits, sign, edges[0], inverses[0])
    bar_1 = _bars_of_corner(tb, jb, 1, n_cells, cell, n, bits, sign, edges[1], inverses[1])
    bar_2 = _bars_of_corner(tb, jb, 2, n_cells, cell, n, bits, sign, edges[2], inverses[2])
    bar_3 = _bars_of_corner(tb, jb, 3, n_cells, cell, n, bits, sign, edges[3], inverses[3])
    bar_4 = _bars_of_corner(tb, jb, 4, n_cells, cell, n, bits, sign, edges[4], inverses[4])
    bar_5 = _bars_of_corner(tb, jb, 5, n_cells, cell, n, bits, sign, edges[5], inverses[5])
    bar_6 = _bars_of_corner(tb, jb, 6, n_cells, cell, n, bits, sign, edges[6], inverses[6])
    bar_7 = _bars_of_corner(tb, jb, 7, n_cells, cell, n, bits, sign, edges[7], inverses[7])
    bars = at_corners(*edges_vjp((bar_0, bar_1, bar_2, bar_3, bar_4, bar_5, bar_6, bar_7), (a, b, c)))
    _add_adjoint(x_bar, at[0], n, (-1.0, -1.0, -1.0), bars[0])
    _add_adjoint(x_bar, at[1], n, (1.0, -1.0, -1.0), bars[1])
    _add_adjoint(x_bar, at[2], n, (-1.0, 1.0, -1.0), bars[2])
    _add_adjoint(x_bar, at[3], n, (1.0, 1.0, -1.0), bars[3])
    _add_adjoint(x_bar, at[4], n, (-1.0, -1.0, 1.0), bars[4])
    _add_adjoint(x_bar, at[5], n, (1.0, -1.0, 1.0), bars[5])
    _add_adjoint(x_bar, at[6], n, (-1.0, 1.0, 1.0), bars[6])
    _add_adjoint(x_bar, at[7], n, (1.0, 1.0, 1.0), bars[7])


@njit(**FAST)
def _with(so_far, bits, bit, sign, edges, inverses):
    """Product and least of the triple products and least Jacobian with one corner more, unless it is degenerate."""
    triple, jacobian = corner_measures(sign, edges, inverses)
    triple, jacobian = with_bits(bits, bit, triple, 1.0), with_bits(bits, bit, jacobian, np.inf)
    product, least, smallest = so_far
    return product * triple, smaller(triple, least), smaller(jacobian, smallest)


@njit(**FAST)
def _summarized(x, at, degenerate, sign, cell, n):
    """Q, the smallest triple product, the smallest Jacobian and the volume of ``n`` cells."""
    bits = load_bits(degenerate, cell, n)
    xi, eta, zeta = _edges(x, at, n)
    edges = at_corners(xi, eta, zeta)
    inverses = at_corners(inverse_lengths(xi), inverse_lengths(eta), inverse_lengths(zeta))
    so_far = _with((1.0, np.inf, np.inf), bits, np.uint8(1), sign, edges[0], inverses[0])
    so_far = _with(so_far, bits, np.uint8(2), sign, edges[1], inverses[1])
    so_far = _with(so_far, bits, np.uint8(4), sign, edges[2], inverses[2])
    so_far = _with(so_far, bits, np.uint8(8), sign, edges[3], inverses[3])
    so_far = _with(so_far, bits, np.uint8(16), sign, edges[4], inverses[4])
    so_far = _with(so_far, bits, np.uint8(32), sign, edges[5], inverses[5])
    so_far = _with(so_far, bits, np.uint8(64), sign, edges[6], inverses[6])
    so_far = _with(so_far, bits, np.uint8(128), sign, edges[7], inverses[7])
    return so_far[0], so_far[1], so_far[2], sign * cell_volume(xi, eta, zeta)


@njit(**FAST)
def _corners_of_block(shape, i, j, k):
    """Places of the corners of the cells of a block from (i, j, k) on."""
    row, layer = shape[2], shape[1] * shape[2]
    at = i * layer + j * row + k
    return at, at + layer, at + row, at + layer + row, at + 1, at + layer + 1, at + row + 1, at + layer + row + 1


@njit(**FAST)
def _corners_of_list(shape, first):
    """Places of the corners of the cells of a list from one on."""
    n = shape[1]
    return first, n + first, 2 * n + first, 3 * n + first, 4 * n + first, 5 * n + first, 6 * n + first, 7 * n + first


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
    points, flags, t, c = x.reshape(-1), degenerate.reshape(-1), triples.reshape(-1), jacobians.reshape(-1)
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n, at = min(LANES, degenerate.shape[2] - k), _corners_of_block(x.shape, i, j, k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                _measure(points, at, flags, sign, t, c, volume, cell, n)


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
    points, change, flags = x.reshape(-1), d_x.reshape(-1), degenerate.reshape(-1)
    t, c = d_triples.reshape(-1), d_jacobians.reshape(-1)
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n, at = min(LANES, degenerate.shape[2] - k), _corners_of_block(x.shape, i, j, k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                _measure_jvp(points, change, at, flags, sign, t, c, d_volume, cell, n)


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
    points, flags, bar = x.reshape(-1), degenerate.reshape(-1), x_bar.reshape(-1)
    t, c = triples_bar.reshape(-1), jacobians_bar.reshape(-1)
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n, at = min(LANES, degenerate.shape[2] - k), _corners_of_block(x.shape, i, j, k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                _measure_vjp(points, at, flags, sign, t, c, volume_bar, bar, cell, n)


@njit(cache=True, nogil=True)
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
    points, flags = x.reshape(-1), degenerate.reshape(-1)
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n, at = min(LANES, degenerate.shape[2] - k), _corners_of_block(x.shape, i, j, k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                measures = _summarized(points, at, flags, sign, cell, n)
                store(q, cell, n, measures[0])
                store(corner, cell, n, measures[1])
                store(jacobian, cell, n, measures[2])
                store(volume, cell, n, measures[3])


@njit(cache=True, nogil=True)
def block_numbers(x, degenerate, sign):
    """Count the valid cells of a block, see `block_measures`; the sum of Q, the smallest Q, corner and volume."""
    points, flags = x.reshape(-1), degenerate.reshape(-1)
    n_valid, total = spread(0.0), spread(0.0)
    least_q, least_corner, least_volume = spread(np.inf), spread(np.inf), spread(np.inf)
    for i in range(degenerate.shape[0]):
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n, at = min(LANES, degenerate.shape[2] - k), _corners_of_block(x.shape, i, j, k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                q, corner, _, volume = _summarized(points, at, flags, sign, cell, n)
                n_valid, total = n_valid + within(n, positive(corner), 0.0), total + within(n, q, 0.0)
                least_q = smaller(within(n, q, np.inf), least_q)
                least_corner = smaller(within(n, corner, np.inf), least_corner)
                least_volume = smaller(within(n, volume, np.inf), least_volume)
    return sum_of(n_valid), sum_of(total), least_of(least_q), least_of(least_corner), least_of(least_volume)


@njit(cache=True, nogil=True)
def list_measures(x, degenerate, triples, jacobians, volume):
    """Measure a list of cells, `block_measures` for right-handed cells with corners ``x`` of shape (8, n_cells)."""
    points, t, c = x.reshape(-1), triples.reshape(-1), jacobians.reshape(-1)
    for cell in range(0, x.shape[1], LANES):
        n, at = min(LANES, x.shape[1] - cell), _corners_of_list(x.shape, cell)
        _measure(points, at, degenerate, 1.0, t, c, volume, cell, n)


@njit(cache=True, nogil=True)
def list_vjp(x, degenerate, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the corners, from those of what `list_measures` gives, to ``x_bar``."""
    points, bar, t, c = x.reshape(-1), x_bar.reshape(-1), triples_bar.reshape(-1), jacobians_bar.reshape(-1)
    for cell in range(0, x.shape[1], LANES):
        n, at = min(LANES, x.shape[1] - cell), _corners_of_list(x.shape, cell)
        _measure_vjp(points, at, degenerate, 1.0, t, c, volume_bar, bar, cell, n)
