"""The functions of `.simd_contraction` in plain numba, for versions of numba and llvmlite that they do not work with.

Same arguments, same storage, same results to round-off, several times slower. Differences against the anchor are kept,
so that what is exact there is exact here. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
from numba import njit

from ...base.numerics.rows import subtract_row
from ..splines.volume import basis_products

SOURCE = zlib.crc32(Path(__file__).read_bytes())
"""Checksum of this file, see `.simd_contraction.SOURCE`."""

try:  # the same as beside it, since compiled kernels of the cache hold this number
    from ...base.numerics.simd import LANES
except Exception:  # whatever a moved function of llvmlite raises
    LANES = 4

TILE = 256
"""Most nodes that `sum_over_nodes` is given at a time."""

MARGIN = 0
"""Elements beyond their end that row numbers are read."""


@njit(cache=True, nogil=True, error_model="numpy")
def load_net(control_points, corner, steps, net, p_0, p_1, p_2):
    """Copy the differences of a sub-net to ``net``."""
    cube = net[: 3 * p_0 * p_1 * p_2].reshape((p_0, p_1, p_2, 3))
    for a in range(p_0):
        for b in range(p_1):
            for c in range(p_2):
                for d in range(3):
                    cube[a, b, c, d] = control_points[corner + 3 * (a * steps[0] + b * steps[1] + c * steps[2]) + d]
    for c in range(1, p_2):
        for a in range(p_0):
            for b in range(p_1):
                subtract_row(cube[a, b, 0], cube[a, b, c])
    for b in range(1, p_1):
        for a in range(p_0):
            for c in range(p_2):
                subtract_row(cube[a, 0, c], cube[a, b, c])
    for a in range(1, p_0):
        for b in range(p_1):
            for c in range(p_2):
                subtract_row(cube[0, b, c], cube[a, b, c])


@njit(cache=True, nogil=True, error_model="numpy")
def add_net(control_points, corner, steps, net, p_0, p_1, p_2):
    """Add ``net`` to the control points that its differences were taken from: the transpose of `load_net`."""
    cube = net[: 3 * p_0 * p_1 * p_2].reshape((p_0, p_1, p_2, 3))
    for a in range(1, p_0):
        for b in range(p_1):
            for c in range(p_2):
                subtract_row(cube[a, b, c], cube[0, b, c])
    for b in range(1, p_1):
        for a in range(p_0):
            for c in range(p_2):
                subtract_row(cube[a, b, c], cube[a, 0, c])
    for c in range(1, p_2):
        for a in range(p_0):
            for b in range(p_1):
                subtract_row(cube[a, b, c], cube[a, b, 0])
    for a in range(p_0):
        for b in range(p_1):
            for c in range(p_2):
                for d in range(3):
                    control_points[corner + 3 * (a * steps[0] + b * steps[1] + c * steps[2]) + d] += cube[a, b, c, d]


@njit(cache=True, nogil=True, error_model="numpy")
def functions_of_node(orders, basis, n, i, values):
    """Write the functions of node ``i`` of a group of ``n`` to ``values``, one for the first of each direction."""
    m = stored = 0
    for d in range(3):
        values[m] = 1.0
        for a in range(1, orders[d]):
            values[m + a] = basis[stored * n + i]
            stored += 1
        m += orders[d]


@njit(cache=True, nogil=True, error_model="numpy")
def sum_over_net(net, basis, n, rows, out, p_0, p_1, p_2):
    """Points of a group of nodes from one sub-net, Eq. (3)."""
    values, products = np.empty(p_0 + p_1 + p_2), np.empty(p_0 * p_1 * p_2)
    for i in range(n):
        functions_of_node((p_0, p_1, p_2), basis, n, i, values)
        basis_products((p_0, p_1, p_2), values, products)
        for d in range(3):
            total = 0.0
            for m in range(products.size):
                total += products[m] * net[3 * m + d]
            out[3 * np.int64(rows[i]) + d] = total


@njit(cache=True, nogil=True, error_model="numpy")
def sum_over_net_turned(net, basis, turn, fractions, vectors, n, rows, out, p_0, p_1, p_2):
    """As `sum_over_net`, with the turned vectors of the nodes added to their points."""
    sum_over_net(net, basis, n, rows, out, p_0, p_1, p_2)
    powers = np.empty(8)
    for i in range(n):
        _set_powers(fractions, n, i, powers)
        for d in range(3):
            for k in range(3):
                entry = 0.0
                for m in range(8):
                    entry += powers[m] * turn[8 * (3 * d + k) + m]
                out[3 * np.int64(rows[i]) + d] += entry * vectors[k * n + i]


@njit(cache=True, nogil=True, error_model="numpy")
def _set_powers(fractions, n, i, powers):
    """Write 1, u, v, uv, w, uw, vw, uvw of node ``i`` of a group of ``n``."""
    powers[0] = 1.0
    for d in range(3):
        for m in range(2**d):
            powers[2**d + m] = powers[m] * np.float64(fractions[d * n + i])


@njit(cache=True, nogil=True, error_model="numpy")
def gather_points(bar, rows, n, points):
    """Copy rows of ``bar`` to ``points``, group by group, and zeros beyond the last node."""
    for i in range(-(-n // LANES) * LANES):
        group, lane = divmod(i, LANES)
        for d in range(3):
            points[LANES * (3 * group + d) + lane] = bar[3 * np.int64(rows[i]) + d] if i < n else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def sum_over_nodes(net, basis, n, points, rows, bar, p_0, p_1, p_2):
    """Add the products of the functions with the points of ``n`` nodes, summed over the nodes, to ``net``."""
    values, products = np.empty(p_0 + p_1 + p_2), np.empty(p_0 * p_1 * p_2)
    for first in range(0, n, LANES):
        for i in range(min(LANES, n - first)):
            functions_of_node((p_0, p_1, p_2), basis[first * (values.size - 3) :], min(LANES, n - first), i, values)
            basis_products((p_0, p_1, p_2), values, products)
            for m in range(products.size):
                for d in range(3):
                    net[3 * m + d] += products[m] * points[3 * first + LANES * d + i]


@njit(cache=True, nogil=True, error_model="numpy")
def sum_turns(sums, fractions, vectors, n, points):
    """Add the derivatives in the coefficients of a rotation to ``sums``: the transpose of `sum_over_net_turned`."""
    powers = np.empty(8)
    for first in range(0, n, LANES):
        size = min(LANES, n - first)
        for i in range(size):
            _set_powers(fractions[3 * first :], size, i, powers)
            for d in range(3):
                for k in range(3):
                    product = points[3 * first + LANES * d + i] * vectors[3 * first + k * size + i]
                    for m in range(8):
                        sums[8 * (3 * d + k) + m] += powers[m] * product
