"""Loops that measure all cells of a block or of a list: the formulas of `.orthogonality`, many cells at a time.

The formulas are straight-line code on the twelve edges of one cell. Here they are called with `Lanes`, one cell in each
(`bspline_mdao.base.numerics.lanes`). Points are read and written as flat arrays of records, from eight offsets, one per
corner of the cells. Quantities that are not wanted are passed as arrays of no size, which are neither read nor
written.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.lanes import (
    LANES,
    add_points,
    aligned_zeros,
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
from .lane_bounds import (
    VOLUME,
    Q,
    add_changes,
    add_terms,
    add_weights,
    finish,
    finish_jvp,
    finish_vjp,
    new_rows,
    rows_of,
    set_totals,
    take_references,
)
from .node_layers import add_corners, add_layer, corners_of, inverses_of, new_bars, new_layers, read_layers
from .orthogonality import (
    FAST,
    at_corners,
    between,
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
    "block_bounds",
    "block_jvp",
    "block_numbers",
    "block_summary",
    "block_vjp",
    "list_measures",
    "list_vjp",
]

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, the type of kernels."""


def as_points(
    nodes: np.ndarray,  # (..., 3), coordinates (m)
) -> np.ndarray:  # (...)
    """View coordinates ``(..., 3)`` as records of type `POINT`; copied if they are not contiguous."""
    return np.ascontiguousarray(nodes, dtype=np.float64).view(POINT)[..., 0]


@njit(**FAST)
def _points(x, at, n):
    """``n`` points from each of eight places of ``x`` on."""
    return (
        load_points(x, at[0], n),
        load_points(x, at[1], n),
        load_points(x, at[2], n),
        load_points(x, at[3], n),
        load_points(x, at[4], n),
        load_points(x, at[5], n),
        load_points(x, at[6], n),
        load_points(x, at[7], n),
    )


@njit(**FAST)
def _edges(p):
    """Edges of cells with eight corners: four along xi, along eta, and along zeta."""
    return (
        (between(p[0], p[1]), between(p[2], p[3]), between(p[4], p[5]), between(p[6], p[7])),
        (between(p[0], p[2]), between(p[1], p[3]), between(p[4], p[6]), between(p[5], p[7])),
        (between(p[0], p[4]), between(p[1], p[5]), between(p[2], p[6]), between(p[3], p[7])),
    )


@njit(**FAST)
def _inverses(edges):
    """Inverse lengths of edges."""
    return inverse_lengths(edges[0]), inverse_lengths(edges[1]), inverse_lengths(edges[2])


@njit(**FAST)
def _set(triples, jacobians, place, n, bits, bit, values, without):
    """Write the triple product and the Jacobian of a corner of cells, or their changes, unless it is degenerate."""
    store(triples, place, n, with_bits(bits, bit, values[0], without[0]))
    if jacobians.size > 0:
        store(jacobians, place, n, with_bits(bits, bit, values[1], without[1]))


@njit(**FAST)
def _bars_of_corner(triples_bar, jacobians_bar, place, n, bits, bit, sign, edges, inverses):
    """Adjoints of the three edges of a corner from its triple product and Jacobian; none if degenerate."""
    triple_bar = with_bits(bits, bit, load(triples_bar, place, n), 0.0)
    jacobian_bar = load(jacobians_bar, place, n if jacobians_bar.size > 0 else 0)
    return corner_vjp(sign, edges, inverses, triple_bar, with_bits(bits, bit, jacobian_bar, 0.0))


@njit(**FAST)
def _bar_of_point(signs, edge_bars):
    """Adjoint of a corner from the adjoints of its three edges, each of which it ends (1) or starts (-1)."""
    (s, t, r), (a, b, c) = signs, edge_bars
    return s * a[0] + t * b[0] + r * c[0], s * a[1] + t * b[1] + r * c[1], s * a[2] + t * b[2] + r * c[2]


@njit(**FAST)
def _measure(edges, inverses, bits, sign, triples, jacobians, volume, n_cells, cell, n):
    """Measure ``n`` cells of ``n_cells``, from number ``cell`` on."""
    without = (1.0, np.inf)
    e, i = at_corners(*edges), at_corners(*inverses)
    values = corner_measures(sign, e[0], i[0])
    _set(triples, jacobians, 0 * n_cells + cell, n, bits, np.uint8(1), values, without)
    values = corner_measures(sign, e[1], i[1])
    _set(triples, jacobians, n_cells + cell, n, bits, np.uint8(2), values, without)
    values = corner_measures(sign, e[2], i[2])
    _set(triples, jacobians, 2 * n_cells + cell, n, bits, np.uint8(4), values, without)
    values = corner_measures(sign, e[3], i[3])
    _set(triples, jacobians, 3 * n_cells + cell, n, bits, np.uint8(8), values, without)
    values = corner_measures(sign, e[4], i[4])
    _set(triples, jacobians, 4 * n_cells + cell, n, bits, np.uint8(16), values, without)
    values = corner_measures(sign, e[5], i[5])
    _set(triples, jacobians, 5 * n_cells + cell, n, bits, np.uint8(32), values, without)
    values = corner_measures(sign, e[6], i[6])
    _set(triples, jacobians, 6 * n_cells + cell, n, bits, np.uint8(64), values, without)
    values = corner_measures(sign, e[7], i[7])
    _set(triples, jacobians, 7 * n_cells + cell, n, bits, np.uint8(128), values, without)
    if volume.size > 0:
        store(volume, cell, n, sign * cell_volume(edges[0], edges[1], edges[2]))


@njit(**FAST)
def _measure_jvp(edges, d_edges, inverses, bits, sign, d_triples, d_jacobians, d_volume, n_cells, cell, n):
    """Change of the results of `_measure`."""
    without = (0.0, 0.0)
    e, d_e, i = at_corners(*edges), at_corners(*d_edges), at_corners(*inverses)
    values = corner_jvp(sign, e[0], i[0], d_e[0])
    _set(d_triples, d_jacobians, 0 * n_cells + cell, n, bits, np.uint8(1), values, without)
    values = corner_jvp(sign, e[1], i[1], d_e[1])
    _set(d_triples, d_jacobians, n_cells + cell, n, bits, np.uint8(2), values, without)
    values = corner_jvp(sign, e[2], i[2], d_e[2])
    _set(d_triples, d_jacobians, 2 * n_cells + cell, n, bits, np.uint8(4), values, without)
    values = corner_jvp(sign, e[3], i[3], d_e[3])
    _set(d_triples, d_jacobians, 3 * n_cells + cell, n, bits, np.uint8(8), values, without)
    values = corner_jvp(sign, e[4], i[4], d_e[4])
    _set(d_triples, d_jacobians, 4 * n_cells + cell, n, bits, np.uint8(16), values, without)
    values = corner_jvp(sign, e[5], i[5], d_e[5])
    _set(d_triples, d_jacobians, 5 * n_cells + cell, n, bits, np.uint8(32), values, without)
    values = corner_jvp(sign, e[6], i[6], d_e[6])
    _set(d_triples, d_jacobians, 6 * n_cells + cell, n, bits, np.uint8(64), values, without)
    values = corner_jvp(sign, e[7], i[7], d_e[7])
    _set(d_triples, d_jacobians, 7 * n_cells + cell, n, bits, np.uint8(128), values, without)
    if d_volume.size > 0:
        store(d_volume, cell, n, sign * cell_volume_jvp(edges, d_edges))


@njit(**FAST)
def _measure_vjp(edges, inverses, bits, sign, triples_bar, jacobians_bar, volume_bars, n_cells, cell, n):
    """Adjoints of the eight corners of cells, from the adjoints of `_measure` and of the edges by the volume."""
    e, i, tb, jb = at_corners(*edges), at_corners(*inverses), triples_bar, jacobians_bar
    bar_0 = _bars_of_corner(tb, jb, 0 * n_cells + cell, n, bits, np.uint8(1), sign, e[0], i[0])
    bar_1 = _bars_of_corner(tb, jb, n_cells + cell, n, bits, np.uint8(2), sign, e[1], i[1])
    bar_2 = _bars_of_corner(tb, jb, 2 * n_cells + cell, n, bits, np.uint8(4), sign, e[2], i[2])
    bar_3 = _bars_of_corner(tb, jb, 3 * n_cells + cell, n, bits, np.uint8(8), sign, e[3], i[3])
    bar_4 = _bars_of_corner(tb, jb, 4 * n_cells + cell, n, bits, np.uint8(16), sign, e[4], i[4])
    bar_5 = _bars_of_corner(tb, jb, 5 * n_cells + cell, n, bits, np.uint8(32), sign, e[5], i[5])
    bar_6 = _bars_of_corner(tb, jb, 6 * n_cells + cell, n, bits, np.uint8(64), sign, e[6], i[6])
    bar_7 = _bars_of_corner(tb, jb, 7 * n_cells + cell, n, bits, np.uint8(128), sign, e[7], i[7])
    corner_bars = bar_0, bar_1, bar_2, bar_3, bar_4, bar_5, bar_6, bar_7
    return _bars_of_points(edges_vjp(edges, inverses, corner_bars, volume_bars))


@njit(**FAST)
def _bars_of_points(edge_bars):
    """Adjoints of the eight corners of cells from the adjoints of the edges."""
    bars = at_corners(*edge_bars)
    return (
        _bar_of_point((-1.0, -1.0, -1.0), bars[0]),
        _bar_of_point((1.0, -1.0, -1.0), bars[1]),
        _bar_of_point((-1.0, 1.0, -1.0), bars[2]),
        _bar_of_point((1.0, 1.0, -1.0), bars[3]),
        _bar_of_point((-1.0, -1.0, 1.0), bars[4]),
        _bar_of_point((1.0, -1.0, 1.0), bars[5]),
        _bar_of_point((-1.0, 1.0, 1.0), bars[6]),
        _bar_of_point((1.0, 1.0, 1.0), bars[7]),
    )


@njit(**FAST)
def _with(so_far, bits, bit, sign, edges, inverses):
    """Product and least of the triple products and least Jacobian with one more corner, unless it is degenerate."""
    triple, jacobian = corner_measures(sign, edges, inverses)
    triple, jacobian = with_bits(bits, bit, triple, 1.0), with_bits(bits, bit, jacobian, np.inf)
    product, least, smallest = so_far
    return product * triple, smaller(triple, least), smaller(jacobian, smallest)


@njit(**FAST)
def _summarized(edges, all_inverses, bits, sign):
    """Q, the smallest triple product, the smallest Jacobian and the volume of cells."""
    (xi, eta, zeta), inverses = edges, at_corners(*all_inverses)
    edges = at_corners(xi, eta, zeta)
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
def block_bounds(
    x,  # (ni, nj, nk), nodes
    degenerate,  # uint8 (ni-1, nj-1, nk-1), bit c is set where corner c is degenerate
    sign,  # handedness
    inverse_volume,  # (n_cells,), 1 / volume on the baseline; 0 without volume
    bounds,  # of `BOUND`, references and totals are set
    q,  # (n_cells,), result, or of no size
):
    """Bound measures of the cells of a block, and write Q of each."""
    flags, layers = degenerate.reshape(-1), new_layers(x.shape)
    rows, totals = new_rows(), aligned_zeros(bounds.size * LANES)
    triples, jacobians, volume = rows_of(bounds, rows)
    for i in range(degenerate.shape[0]):
        read_layers(x, i, layers)
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n = min(LANES, degenerate.shape[2] - k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                edges = _edges(corners_of(layers, x.shape, i, j, k))
                inverses = inverses_of(layers, x.shape, i, j, k)
                bits = load_bits(flags, cell, n)
                _measure(edges, inverses, bits, sign, triples, jacobians, volume, LANES, 0, LANES)
                finish(rows, jacobians, volume, load(inverse_volume, cell, n), n)
                if q.size > 0:
                    store(q, cell, n, load(rows, Q * LANES, LANES))
                add_terms(bounds, rows, totals)
    set_totals(bounds, totals)


@njit(cache=True, nogil=True)
def block_jvp(
    # see `block_bounds`; references belong to the values
    x,
    d_x,  # (ni, nj, nk), change of the nodes
    degenerate,
    sign,
    inverse_volume,
    bounds,  # totals are set to the changes of the bounds
    d_q,  # (n_cells,), result, or of no size
):
    """Change of `block_bounds` with the nodes."""
    flags, layers = degenerate.reshape(-1), new_layers(x.shape)
    rows, totals = new_rows(), aligned_zeros(bounds.size * LANES)
    triples, jacobians, volume = rows_of(bounds, rows)
    change, d_rows = d_x.reshape(-1), new_rows()
    d_triples, d_jacobians, d_volume = rows_of(bounds, d_rows)
    take_references(bounds)
    for i in range(degenerate.shape[0]):
        read_layers(x, i, layers)
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n = min(LANES, degenerate.shape[2] - k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                edges = _edges(corners_of(layers, x.shape, i, j, k))
                inverses = inverses_of(layers, x.shape, i, j, k)
                d_edges = _edges(_points(change, _corners_of_block(x.shape, i, j, k), n))
                bits, inverse = load_bits(flags, cell, n), load(inverse_volume, cell, n)
                _measure(edges, inverses, bits, sign, triples, jacobians, volume, LANES, 0, LANES)
                _measure_jvp(edges, d_edges, inverses, bits, sign, d_triples, d_jacobians, d_volume, LANES, 0, LANES)
                finish_jvp(rows, d_rows, d_jacobians, d_volume, inverse)
                finish(rows, jacobians, volume, inverse, n)
                if d_q.size > 0:
                    store(d_q, cell, n, load(d_rows, Q * LANES, LANES))
                add_changes(bounds, rows, d_rows, totals)
    set_totals(bounds, totals)


@njit(cache=True, nogil=True)
def block_vjp(
    # see `block_bounds`; references belong to the values, seeds are their adjoints
    x,
    degenerate,
    sign,
    inverse_volume,
    bounds,
    q_bar,  # (n_cells,), adjoint of Q of each cell, or of no size
    x_bar,  # (ni, nj, nk), added to
):
    """Add the adjoint of the nodes, from the adjoints of `block_bounds`, to ``x_bar``."""
    flags, layers, node_bars = degenerate.reshape(-1), new_layers(x.shape), new_bars(x.shape)
    rows, bars = new_rows(), new_rows()
    triples, jacobians, volume = rows_of(bounds, rows)
    triples_bar, jacobians_bar, volume_bar = rows_of(bounds, bars)
    take_references(bounds)
    for i in range(degenerate.shape[0]):
        read_layers(x, i, layers)
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n = min(LANES, degenerate.shape[2] - k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                edges = _edges(corners_of(layers, x.shape, i, j, k))
                inverses = inverses_of(layers, x.shape, i, j, k)
                bits, inverse = load_bits(flags, cell, n), load(inverse_volume, cell, n)
                _measure(edges, inverses, bits, sign, triples, jacobians, volume, LANES, 0, LANES)
                finish(rows, jacobians, volume, inverse, n)
                bars[:] = 0.0
                if q_bar.size > 0:
                    store(bars, Q * LANES, LANES, load(q_bar, cell, n))
                has_corners, has_volume = add_weights(bounds, rows, bars)
                has_corners = has_corners or q_bar.size > 0
                if not (has_corners or has_volume):
                    continue
                finish_vjp(rows, bars, jacobians_bar, volume_bar, inverse)
                volume_bars = cell_volume_vjp(edges, sign * load(bars, VOLUME * LANES, LANES))
                if has_corners:
                    point_bars = _measure_vjp(
                        edges, inverses, bits, sign, triples_bar, jacobians_bar, volume_bars, LANES, 0, LANES
                    )
                else:
                    point_bars = _bars_of_points(volume_bars)
                add_corners(node_bars, x.shape, i, j, k, n, point_bars)
        add_layer(x_bar, i, node_bars)
    add_layer(x_bar, degenerate.shape[0], node_bars)


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
    flags, layers = degenerate.reshape(-1), new_layers(x.shape)
    for i in range(degenerate.shape[0]):
        read_layers(x, i, layers)
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n = min(LANES, degenerate.shape[2] - k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                edges = _edges(corners_of(layers, x.shape, i, j, k))
                inverses = inverses_of(layers, x.shape, i, j, k)
                measures = _summarized(edges, inverses, load_bits(flags, cell, n), sign)
                store(q, cell, n, measures[0])
                store(corner, cell, n, measures[1])
                store(jacobian, cell, n, measures[2])
                store(volume, cell, n, measures[3])


@njit(cache=True, nogil=True)
def block_numbers(x, degenerate, sign):
    """Count the valid cells of a block, see `block_measures`; the sum of Q, the smallest Q, corner and volume."""
    flags, layers = degenerate.reshape(-1), new_layers(x.shape)
    n_valid, total = spread(0.0), spread(0.0)
    least_q, least_corner, least_volume = spread(np.inf), spread(np.inf), spread(np.inf)
    for i in range(degenerate.shape[0]):
        read_layers(x, i, layers)
        for j in range(degenerate.shape[1]):
            for k in range(0, degenerate.shape[2], LANES):
                n = min(LANES, degenerate.shape[2] - k)
                cell = (i * degenerate.shape[1] + j) * degenerate.shape[2] + k
                edges = _edges(corners_of(layers, x.shape, i, j, k))
                inverses = inverses_of(layers, x.shape, i, j, k)
                q, corner, _, volume = _summarized(edges, inverses, load_bits(flags, cell, n), sign)
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
        edges = _edges(_points(points, at, n))
        bits, inverses = load_bits(degenerate, cell, n), _inverses(edges)
        _measure(edges, inverses, bits, 1.0, t, c, volume, x.shape[1], cell, n)


@njit(cache=True, nogil=True)
def list_vjp(x, degenerate, triples_bar, jacobians_bar, volume_bar, x_bar):
    """Add the adjoint of the corners, from the adjoints of `list_measures`, to ``x_bar``."""
    points, bar, t, c = x.reshape(-1), x_bar.reshape(-1), triples_bar.reshape(-1), jacobians_bar.reshape(-1)
    for cell in range(0, x.shape[1], LANES):
        n, at = min(LANES, x.shape[1] - cell), _corners_of_list(x.shape, cell)
        edges = _edges(_points(points, at, n))
        bits, inverses = load_bits(degenerate, cell, n), _inverses(edges)
        volume_bars = cell_volume_vjp(edges, load(volume_bar, cell, n))
        bars = _measure_vjp(edges, inverses, bits, 1.0, t, c, volume_bars, x.shape[1], cell, n)
        add_points(bar, at[0], n, bars[0])
        add_points(bar, at[1], n, bars[1])
        add_points(bar, at[2], n, bars[2])
        add_points(bar, at[3], n, bars[3])
        add_points(bar, at[4], n, bars[4])
        add_points(bar, at[5], n, bars[5])
        add_points(bar, at[6], n, bars[6])
        add_points(bar, at[7], n, bars[7])
