"""Two neighbouring layers of the nodes of a block in the form that loops over cells read: by coordinate and edge.

A node belongs to eight cells and an edge to four. Nodes are split into rows of x, y and z once, with the inverse
lengths of edges along eta and zeta, and of the edges xi between the layers; cells then read what they need. Adjoints of
nodes return in the same way: contributions of the lower and of the upper corners of cells along zeta in separate rows,
so that nothing is read right after it was written.
"""

from __future__ import annotations

from numba import njit

from ...base.numerics.lanes import LANES, add_points, aligned_zeros, load, load_points, store
from .orthogonality import FAST, between, inverse_length

__all__ = ["add_corners", "add_layer", "corners_of", "inverses_of", "new_bars", "new_layers", "read_layers"]

N_ROWS = 5
"""Rows of a layer: x, y, z, inverse lengths of edges along eta, and along zeta."""

N_BARS = 6
"""Rows of adjoints of a layer: x, y and z from the lower corners of cells, and from their upper corners."""


@njit(inline="always")
def line_of(shape):
    """Number of places of a line of nodes along zeta: whole registers."""
    return (shape[2] + LANES - 1) // LANES * LANES


@njit(inline="always")
def new_layers(shape):
    """Room for two layers of nodes of shape (ni, nj, nk), and the edges between them."""
    return aligned_zeros((2 * N_ROWS + 1) * shape[1] * line_of(shape) + LANES)


@njit(inline="always")
def new_bars(shape):
    """Zeros for the adjoints of two layers, preceded by a register of zeros."""
    return aligned_zeros(2 * N_BARS * shape[1] * line_of(shape) + LANES)


@njit(inline="always")
def _point(layers, at, size):
    """Points from a place on."""
    return load(layers, at, LANES), load(layers, at + size, LANES), load(layers, at + 2 * size, LANES)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def read_layers(x, i, layers):
    """Read layer i + 1 of nodes in place of layer i - 1; at the beginning layer 0 as well."""
    line, n_nodes = line_of(x.shape), x.shape[2]
    points, size = x.reshape(-1), x.shape[1] * line
    for layer in range(i + (i > 0), i + 2):
        here, below = (layer % 2) * N_ROWS * size, ((layer + 1) % 2) * N_ROWS * size
        for j in range(x.shape[1]):
            for k in range(0, n_nodes, LANES):
                at, first = here + j * line + k, (layer * x.shape[1] + j) * n_nodes + k
                p = load_points(points, first, min(LANES, n_nodes - k))
                store(layers, at, LANES, p[0])
                store(layers, at + size, LANES, p[1])
                store(layers, at + 2 * size, LANES, p[2])
        for at in range(0, size, LANES):  # no cell reads beyond the end of a line, or below layer 0
            p = _point(layers, here + at, size)
            eta, zeta = _point(layers, here + at + line, size), _point(layers, here + at + 1, size)
            store(layers, here + 3 * size + at, LANES, inverse_length(between(p, eta)))
            store(layers, here + 4 * size + at, LANES, inverse_length(between(p, zeta)))
            xi = _point(layers, below + at, size)
            store(layers, 2 * N_ROWS * size + at, LANES, inverse_length(between(p, xi)))


@njit(**FAST)
def corners_of(layers, shape, i, j, k):
    """Corners of cells from (i, j, k) on, between two layers that have been read."""
    line = line_of(shape)
    size, at = shape[1] * line, j * line + k
    low, high = (i % 2) * N_ROWS * size + at, ((i + 1) % 2) * N_ROWS * size + at
    return (
        _point(layers, low, size),
        _point(layers, high, size),
        _point(layers, low + line, size),
        _point(layers, high + line, size),
        _point(layers, low + 1, size),
        _point(layers, high + 1, size),
        _point(layers, low + line + 1, size),
        _point(layers, high + line + 1, size),
    )


@njit(inline="always")
def _four(layers, p, q, r, s):
    return load(layers, p, LANES), load(layers, q, LANES), load(layers, r, LANES), load(layers, s, LANES)


@njit(**FAST)
def inverses_of(layers, shape, i, j, k):
    """Inverse lengths of the twelve edges of those cells: four along xi, along eta, and along zeta."""
    line = line_of(shape)
    size, at = shape[1] * line, j * line + k
    low, high = (i % 2) * N_ROWS * size + at, ((i + 1) % 2) * N_ROWS * size + at
    xi, eta, zeta = 2 * N_ROWS * size + at, 3 * size, 4 * size
    return (
        _four(layers, xi, xi + line, xi + 1, xi + line + 1),
        _four(layers, low + eta, high + eta, low + eta + 1, high + eta + 1),
        _four(layers, low + zeta, high + zeta, low + line + zeta, high + line + zeta),
    )


@njit(**FAST)
def _add(bars, at, size, n, vector):
    """Add ``n`` vectors from a place on."""
    store(bars, at, n, load(bars, at, LANES) + vector[0])
    store(bars, at + size, n, load(bars, at + size, LANES) + vector[1])
    store(bars, at + 2 * size, n, load(bars, at + 2 * size, LANES) + vector[2])


@njit(**FAST)
def add_corners(bars, shape, i, j, k, n, corners):
    """Add adjoints of `corners_of` for ``n`` cells."""
    line = line_of(shape)
    size, at = shape[1] * line, LANES + j * line + k
    low, high = (i % 2) * N_BARS * size + at, ((i + 1) % 2) * N_BARS * size + at
    upper = 3 * size
    _add(bars, low, size, n, corners[0])
    _add(bars, high, size, n, corners[1])
    _add(bars, low + line, size, n, corners[2])
    _add(bars, high + line, size, n, corners[3])
    _add(bars, low + upper, size, n, corners[4])
    _add(bars, high + upper, size, n, corners[5])
    _add(bars, low + line + upper, size, n, corners[6])
    _add(bars, high + line + upper, size, n, corners[7])


@njit(cache=True, nogil=True, error_model="numpy")
def add_layer(x_bar, i, bars):
    """Add the adjoints of layer i to those of the nodes, and leave zeros for layer i + 2."""
    line, n_nodes = line_of(x_bar.shape), x_bar.shape[2]
    points, size = x_bar.reshape(-1), x_bar.shape[1] * line
    here = LANES + (i % 2) * N_BARS * size
    for j in range(x_bar.shape[1]):
        for k in range(0, n_nodes, LANES):
            at = here + j * line + k
            p, q = (
                _point(bars, at, size),
                _point(bars, at + 3 * size - 1, size),
            )  # the last place of a line is empty
            bar = p[0] + q[0], p[1] + q[1], p[2] + q[2]
            add_points(points, (i * x_bar.shape[1] + j) * n_nodes + k, min(LANES, n_nodes - k), bar)
    bars[here : here + N_BARS * size] = 0.0
