"""The hexahedral cell: orthogonality (Eq. 9), corner triple products, corner Jacobians and volume.

Corners are numbered ``c = a + 2 b + 4 d`` with a, b, d = 0, 1 along i, j, k. The three edges that meet at a corner are
taken in the direction of rising index, whichever end the corner is on::

        6-------7
       /|      /|        k
      4-------5 |        | j
      | 2-----|-3        |/
      |/      |/         0--- i
      0-------1

so that the triple product ``(u x v) . w`` of the unit edges has one sign at all corners of a good cell: the handedness
of the block. Real blocks are left-handed as often as right-handed; everything here is measured relative to the sign
that most cells of the block have.

A cell is measured by a few small functions of its points, inlined into a loop along k whose vector lanes are cells.
Points and measures are arrays of records, because their fixed stride is what lets the compiler vectorise that loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..errors import InputError

__all__ = ["COLLAPSE_TOLERANCE", "CellQuality", "cell_quality", "collapsed_corners"]

COLLAPSE_TOLERANCE = 1e-12
"""A corner at which an edge is shorter than this fraction of the block's size is left out."""

_POINT = np.dtype([(name, np.float64) for name in "xyz"])
_MEASURES = np.dtype([(name, np.float64) for name in ("q", "min_corner", "min_jacobian", "volume")])

_TINY = 1e-190
"""Added to a squared length before it is inverted, so that an edge of no length has a triple product of 0."""

_UPPER_CORNERS = np.uint8(0b11110000)
"""Corners 4 to 7: the ones that a planar block does not have."""


@dataclass(frozen=True)
class CellQuality:
    """Measures of every cell of a block of ``(ni, nj, nk)`` nodes.

    Parameters
    ----------
    q : ndarray, shape (ni-1, nj-1, nk-1)
        Orthogonality, Eq. (9): product of the corner triple products of unit edges; 1 where edges are orthogonal.
    min_corner : ndarray, same shape
        Smallest corner triple product of unit edges, relative to the handedness of the block.
    min_jacobian : ndarray, same shape
        Smallest corner Jacobian, the triple product of the edges themselves, relative to the handedness (m^3).
    volume : ndarray, same shape
        Volume of the trilinear cell, relative to the handedness (m^3).
    handedness : int
        +1 or -1, the sign that most cells of the block have.

    Notes
    -----
    A fully mirrored cell also has q = 1: validity is `is_valid`, never q alone. In a planar block (one node deep) the
    flat direction has one cell, the product has four corners, and Jacobian and volume are areas (m^2).
    """

    q: np.ndarray
    min_corner: np.ndarray
    min_jacobian: np.ndarray
    volume: np.ndarray
    handedness: int

    @property
    def is_valid(self) -> np.ndarray:
        """Cells of which every corner has a positive triple product."""
        return self.min_corner > 0.0


def cell_quality(nodes: np.ndarray, left_out: np.ndarray | None = None) -> CellQuality:
    """Measure all cells of a block, or all elements of a control mesh.

    Parameters
    ----------
    nodes : ndarray, shape (ni, nj, nk, 3)
        Node coordinates (m). One direction may have a single node; the block is then measured in its plane.
    left_out : ndarray of uint8, shape (ni-1, nj-1, nk-1), optional
        Bit c is set where corner c is left out. `collapsed_corners` of ``nodes`` by default; give that of the baseline
        while a grid moves, so that the measure stays differentiable.

    Returns
    -------
    CellQuality
        A cell none of whose corners is left is given zeros, and so counts as invalid.

    Raises
    ------
    InputError
        If fewer than two directions have two nodes.
    """
    flat = _flat_direction(nodes.shape)
    if left_out is None:
        left_out = collapsed_corners(nodes)
    if flat is None:
        return CellQuality(*_measure(_points(nodes), left_out))
    *measures, handedness = _measure(_points(_extrude(nodes, flat)), np.moveaxis(left_out, flat, 2) | _UPPER_CORNERS)
    return CellQuality(*(np.moveaxis(values, 2, flat) for values in measures), handedness)


def collapsed_corners(nodes: np.ndarray) -> np.ndarray:
    """Find the corners of cells at which an edge has collapsed.

    Parameters
    ----------
    nodes : ndarray, shape (ni, nj, nk, 3)
        Node coordinates (m).

    Returns
    -------
    ndarray of uint8, shape (ni-1, nj-1, nk-1)
        Bit c is set where an edge at corner c is shorter than `COLLAPSE_TOLERANCE` times the diagonal of the block's
        box. In a planar block the bits are those of the block with its flat direction moved last.
    """
    flat = _flat_direction(nodes.shape)
    points = _points(nodes if flat is None else _extrude(nodes, flat))
    size = np.linalg.norm([nodes[..., c].max() - nodes[..., c].min() for c in range(3)])
    shortest = max(COLLAPSE_TOLERANCE * size, 2.0 * np.sqrt(_TINY))
    if not _has_short_edge(points, shortest):
        bits = np.zeros([n - 1 for n in points.shape], dtype=np.uint8)
    else:
        bits = _collapsed_bits(points, shortest)
    return bits if flat is None else np.moveaxis(bits, 2, flat)


def _measure(points, left_out):
    """Compute the fields of `CellQuality` of a block of points with cells in all three directions."""
    measures = np.empty(left_out.shape, dtype=_MEASURES)
    middle = slice(left_out.shape[0] // 2, left_out.shape[0] // 2 + 1)
    _measure_cells(points[middle.start : middle.stop + 1], left_out[middle], 1.0, measures[middle])
    handedness = _majority(measures["volume"][middle])
    _measure_cells(points, left_out, float(handedness), measures)
    if _majority(measures["volume"]) < 0:  # the middle of the block has the other sign than most of it
        handedness = -handedness
        _measure_cells(points, left_out, float(handedness), measures)
    measures[left_out == 255] = 0.0
    measures[np.isnan(measures["q"])] = np.nan  # comparisons lose a NaN
    return (*(measures[name] for name in _MEASURES.names), handedness)


def _majority(volume):
    """Sign that most of the volumes have."""
    return -1 if np.count_nonzero(volume < 0.0) > np.count_nonzero(volume > 0.0) else 1


def _points(nodes):
    """View nodes (ni, nj, nk, 3) as records (ni, nj, nk)."""
    return np.ascontiguousarray(nodes, dtype=np.float64).view(_POINT)[..., 0]


def _flat_direction(shape):
    """Find the direction with a single node, None where there is none."""
    if len(shape) != 4 or shape[3] != 3 or sum(n > 1 for n in shape[:3]) < 2:
        raise InputError(f"cell quality: nodes of shape {shape}; give (ni, nj, nk, 3) with cells in two directions")
    return next((d for d in range(3) if shape[d] == 1), None)


def _extrude(nodes, flat):
    """Give a planar block unit depth along its mean normal, its flat direction moved last."""
    plane = np.moveaxis(nodes, flat, 2)[:, :, 0]
    normal = np.cross(plane[1:, 1:] - plane[:-1, :-1], plane[:-1, 1:] - plane[1:, :-1]).sum(axis=(0, 1))
    length = np.linalg.norm(normal)
    unit = normal / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    return np.stack([plane, plane + unit], axis=2)


@njit(cache=True, inline="always")
def _edge(start, end):
    """Edge between two points with its inverse length: (x, y, z, 1 / length)."""
    x, y, z = end.x - start.x, end.y - start.y, end.z - start.z
    return x, y, z, 1.0 / np.sqrt(x * x + y * y + z * z + _TINY)


@njit(cache=True, inline="always")
def _triple(u, v, w):
    """``(u x v) . w``."""
    return (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1] + (u[0] * v[1] - u[1] * v[0]) * w[2]


@njit(cache=True, inline="always")
def _corner(u, v, w, sign, is_out):
    """Corner Jacobian and triple product of unit edges; neutral values where the corner is left out."""
    jacobian = sign * _triple(u, v, w)
    triple = jacobian * (u[3] * v[3] * w[3])
    return np.inf if is_out else jacobian, 1.0 if is_out else triple


@njit(cache=True, inline="always")
def _least(a, b, c, d):
    """Smallest of four numbers, written so that it vectorises."""
    ab, cd = a if a < b else b, c if c < d else d
    return ab if ab < cd else cd


@njit(cache=True, inline="always")
def _mean(p, q, r, s):
    """Mean of four vectors."""
    return 0.25 * (p[0] + q[0] + r[0] + s[0]), 0.25 * (p[1] + q[1] + r[1] + s[1]), 0.25 * (p[2] + q[2] + r[2] + s[2])


@njit(cache=True, inline="always")
def _twist(p, q, r, s):
    """Mean change of an edge across the cell, from edges p, q on one side to r, s on the other."""
    return 0.5 * (r[0] + s[0] - p[0] - q[0]), 0.5 * (r[1] + s[1] - p[1] - q[1]), 0.5 * (r[2] + s[2] - p[2] - q[2])


@njit(cache=True, inline="always")
def _volume(i, j, k):
    """Volume of the trilinear cell with edges i0 i2 i4 i6, j0 j1 j4 j5, k0 k1 k2 k3, named by the corner they start at.

    The Jacobian integrated term by term: of the products of the mean edges a, b, c and the bilinear terms d (xi eta),
    e (eta zeta), f (zeta xi), four are even in all parameters.
    """
    a, b, c = _mean(i[0], i[1], i[2], i[3]), _mean(j[0], j[1], j[2], j[3]), _mean(k[0], k[1], k[2], k[3])
    d, e, f = _twist(i[0], i[2], i[1], i[3]), _twist(j[0], j[1], j[2], j[3]), _twist(i[0], i[1], i[2], i[3])
    return _triple(a, b, c) + (_triple(a, d, f) + _triple(d, b, e) + _triple(f, e, c)) / 12.0


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _measure_row(x0, x1, x2, x3, bits, sign, measures):
    """Measure the cells between four rows of points: corners 0 to 3 at k, corners 4 to 7 at k + 1."""
    for k in range(measures.shape[0]):
        n, out = k + 1, bits[k]
        i0, i2, i4, i6 = _edge(x0[k], x1[k]), _edge(x2[k], x3[k]), _edge(x0[n], x1[n]), _edge(x2[n], x3[n])
        j0, j1, j4, j5 = _edge(x0[k], x2[k]), _edge(x1[k], x3[k]), _edge(x0[n], x2[n]), _edge(x1[n], x3[n])
        k0, k1, k2, k3 = _edge(x0[k], x0[n]), _edge(x1[k], x1[n]), _edge(x2[k], x2[n]), _edge(x3[k], x3[n])
        v0, t0 = _corner(i0, j0, k0, sign, out & 1 != 0)
        v1, t1 = _corner(i0, j1, k1, sign, out & 2 != 0)
        v2, t2 = _corner(i2, j0, k2, sign, out & 4 != 0)
        v3, t3 = _corner(i2, j1, k3, sign, out & 8 != 0)
        v4, t4 = _corner(i4, j4, k0, sign, out & 16 != 0)
        v5, t5 = _corner(i4, j5, k1, sign, out & 32 != 0)
        v6, t6 = _corner(i6, j4, k2, sign, out & 64 != 0)
        v7, t7 = _corner(i6, j5, k3, sign, out & 128 != 0)
        q = t0 * t1 * t2 * t3 * t4 * t5 * t6 * t7
        corner = _least(_least(t0, t1, t2, t3), t4, t5, _least(t6, t7, t6, t7))
        jacobian = _least(_least(v0, v1, v2, v3), v4, v5, _least(v6, v7, v6, v7))
        cell = measures[k]
        cell.q = q
        cell.min_corner = corner
        cell.min_jacobian = jacobian
        cell.volume = sign * _volume((i0, i2, i4, i6), (j0, j1, j4, j5), (k0, k1, k2, k3))


@njit(cache=True)
def _measure_cells(x, left_out, sign, measures):
    """Measure all cells of a block."""
    for i in range(measures.shape[0]):
        for j in range(measures.shape[1]):
            _measure_row(x[i, j], x[i + 1, j], x[i, j + 1], x[i + 1, j + 1], left_out[i, j], sign, measures[i, j])


@njit(cache=True)
def _count_short(start, end, shortest_square):
    """Count the edges between two rows of points that are shorter than a length."""
    n_short = 0
    for k in range(min(start.shape[0], end.shape[0])):
        x, y, z = end[k].x - start[k].x, end[k].y - start[k].y, end[k].z - start[k].z
        n_short += x * x + y * y + z * z < shortest_square
    return n_short


@njit(cache=True)
def _has_short_edge(x, shortest):
    """Tell whether any edge of a block is that short: most blocks have none, and this is quick."""
    n_short, square = 0, shortest * shortest
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            n_short += _count_short(x[i, j], x[i, j, 1:], square)
            n_short += _count_short(x[i, j], x[max(i - 1, 0), j], square) if i > 0 else 0
            n_short += _count_short(x[i, j], x[i, max(j - 1, 0)], square) if j > 0 else 0
    return n_short > 0


@njit(cache=True)
def _collapsed_bits(x, shortest):
    """Corners with an edge shorter than ``shortest``, as bits."""
    ni, nj, nk = x.shape
    bits = np.zeros((ni - 1, nj - 1, nk - 1), dtype=np.uint8)
    for i, j, k in np.ndindex(bits.shape):
        for corner in range(8):
            a, b, d = corner & 1, (corner >> 1) & 1, corner >> 2
            here = x[i + a, j + b, k + d]
            u, v, w = (
                _edge(here, x[i + 1 - a, j + b, k + d]),
                _edge(here, x[i + a, j + 1 - b, k + d]),
                _edge(here, x[i + a, j + b, k + 1 - d]),
            )
            bits[i, j, k] |= np.uint8(max(u[3], v[3], w[3]) * shortest > 1.0) << np.uint8(corner)
    return bits
