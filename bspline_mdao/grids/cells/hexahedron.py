"""Measures of hexahedral cells, of blocks and of lists: Q of Eq. (9), corner triple products, Jacobians, volumes.

Corner numbers and formulas are as in `.orthogonality`. The triple product of the unit edges at a corner has one sign at
all corners of a good cell: the handedness of the block. Real blocks are left-handed as often as right-handed, so
everything here is measured relative to the sign of most cells of the block.

A corner at which an edge has collapsed is *degenerate*: it has no triple product, and does not count.

- `cell_quality` measures all cells of a block.
- `element_measures` and its transpose measure a list of elements, corner by corner, for differentiation.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ...base.display import OneLine
from ...errors import InputError
from .cell_loops import as_points, block_summary, list_measures, list_vjp
from .orthogonality import TINY

__all__ = [
    "COLLAPSE_TOLERANCE",
    "UPPER_CORNERS",
    "CellQuality",
    "ElementMeasures",
    "cell_quality",
    "collapsed_corners",
    "element_measures",
    "element_measures_vjp",
    "flat_direction",
    "mean_normal",
    "measured",
    "stack_plane",
    "summed_areas",
    "unit_normal",
]

COLLAPSE_TOLERANCE = 1e-12
"""A corner is degenerate if an edge is shorter than this fraction of the block's size: round-off of coordinates may
give a collapsed edge some length."""

UPPER_CORNERS = np.uint8(0b11110000)
"""Corners 4 to 7, which a planar block does not have."""


@dataclass(frozen=True)
class CellQuality(OneLine):
    """Measures of every cell of a block of ``(ni, nj, nk)`` nodes."""

    # A fully mirrored cell also has q = 1: validity is `is_valid`, never q alone. In a planar block (one node deep) the
    # flat direction has one cell, the product has four corners, and Jacobian and volume are areas (m^2).

    # orthogonality, Eq. (9): product of the corner triple products of unit edges; 1 if edges are orthogonal
    q: np.ndarray  # (ni-1, nj-1, nk-1)
    min_corner: np.ndarray  # smallest corner triple product of unit edges, relative to the handedness of the block
    # smallest corner Jacobian, the triple product of the edges themselves, relative to the handedness (m^3)
    min_jacobian: np.ndarray
    volume: np.ndarray  # volume of the trilinear cell, relative to the handedness (m^3)
    handedness: int  # +1 or -1, the sign of most cells of the block

    @property
    def is_valid(self) -> np.ndarray:
        """Cells whose corners all have a positive triple product."""
        return self.min_corner > 0.0


def cell_quality(
    nodes: np.ndarray,
    degenerate_corners: np.ndarray | None = None,
    handedness: int | None = None,
    normal: np.ndarray | None = None,
) -> CellQuality:
    """Measure all cells of a block, or all elements of a control mesh, Eq. (9).

    Parameters
    ----------
    nodes : ndarray, shape (ni, nj, nk, 3)
        Node coordinates (m). One direction may have a single node; the block is then measured in its plane.
    degenerate_corners : ndarray of uint8, shape (ni-1, nj-1, nk-1), optional
        Bit c is set if corner c is degenerate; by default determined from ``nodes``. While a grid moves, pass those of
        the baseline, so that the measure stays differentiable.
    handedness : int, optional
        +1 or -1; by default the sign of most cells. While a grid moves, pass that of the baseline.
    normal : ndarray, shape (3,), optional
        Third edges of a planar block; by default the unit mean normal of its cells.

    Returns
    -------
    CellQuality
        ``q``, ``min_corner``, ``min_jacobian`` and ``volume`` of every cell. A cell whose corners are all degenerate
        gets zeros, and so counts as invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.grids import cell_quality
    >>> cube = np.stack(np.meshgrid(*3 * [[0.0, 1.0]], indexing="ij"), axis=-1)
    >>> cell_quality(cube).q
    array([[[1.]]])
    """
    # `InputError` if fewer than two directions have two nodes
    flat = flat_direction(nodes.shape)
    if degenerate_corners is None:
        degenerate_corners = collapsed_corners(nodes)
    if flat is None:
        return CellQuality(*_measure(nodes, degenerate_corners, handedness))
    degenerate_corners = np.moveaxis(degenerate_corners, flat, 2) | UPPER_CORNERS
    *measures, handedness = _measure(_extrude(nodes, flat, normal), degenerate_corners, handedness)
    q, min_corner, min_jacobian, volume = (np.moveaxis(values, 2, flat) for values in measures)
    return CellQuality(q, min_corner, min_jacobian, volume, handedness)


def collapsed_corners(
    nodes: np.ndarray,  # (ni, nj, nk, 3), node coordinates (m)
    size: float | None = None,  # diagonal of the block's box (m), if the nodes are a piece of it
) -> np.ndarray:
    """Find the corners of cells at which an edge has collapsed."""
    # returns uint8 (ni-1, nj-1, nk-1), bit c is set if an edge at corner c is shorter than `COLLAPSE_TOLERANCE` times
    # the diagonal of the block's box. In a planar block the bits refer to the block with its flat direction moved
    # last
    flat = flat_direction(nodes.shape)
    points = as_points(nodes if flat is None else _extrude(nodes, flat))
    if size is None:
        size = float(np.linalg.norm([nodes[..., c].max() - nodes[..., c].min() for c in range(3)]))
    shortest = max(COLLAPSE_TOLERANCE * size, 2.0 * np.sqrt(TINY))  # shorter edges would have no unit vector
    if not _has_short_edge(points, shortest):
        bits = np.zeros([n - 1 for n in points.shape], dtype=np.uint8)
    else:
        bits = _collapsed_bits(points, shortest)
    return bits if flat is None else np.moveaxis(bits, 2, flat)


def flat_direction(shape: tuple[int, ...]) -> int | None:  # none if there is none
    """Find the direction of nodes of shape (ni, nj, nk, 3) with a single node."""
    if len(shape) != 4 or shape[3] != 3 or sum(n > 1 for n in shape[:3]) < 2:
        raise InputError(f"cell quality: nodes of shape {shape}; give (ni, nj, nk, 3) with cells in two directions")
    return next((d for d in range(3) if shape[d] == 1), None)


def mean_normal(plane: np.ndarray) -> np.ndarray:
    """Unit mean normal, shape (3,), of the cells of nodes (n, m, 3); the z direction if they have no area."""
    return unit_normal(summed_areas(plane))


def summed_areas(plane: np.ndarray) -> np.ndarray:
    """Sum of twice the area vectors (m^2), shape (3,), of the cells of nodes (n, m, 3)."""
    return np.cross(plane[1:, 1:] - plane[:-1, :-1], plane[:-1, 1:] - plane[1:, :-1]).sum(axis=(0, 1))


def unit_normal(area: np.ndarray) -> np.ndarray:
    """Unit vector along a sum of area vectors; the z direction if they cancel."""
    length = np.linalg.norm(area)
    return area / length if length > 0.0 else np.array([0.0, 0.0, 1.0])


def stack_plane(plane: np.ndarray, normal: np.ndarray | float) -> np.ndarray:
    """Return nodes (n, m, 3) with depth: shape (n, m, 2, 3), the second layer displaced by ``normal``."""
    return np.stack([plane, plane + normal], axis=2)


@dataclass(frozen=True)
class ElementMeasures:
    """Measures of elements, relative to their handedness."""

    triples: np.ndarray  # (n_e, 8), corner triple products of unit edges; 1 at degenerate corners
    # corner Jacobians, triple products of the edges themselves (m^3); infinite at degenerate corners
    jacobians: np.ndarray  # (n_e, 8)
    volume: np.ndarray  # (n_e,), volumes of the trilinear elements (m^3)


def element_measures(
    corners: np.ndarray,  # (n_e, 8, 3), corners (m), numbered a + 2 b + 4 d
    handedness: np.ndarray,  # (n_e,), +1 or -1 for each element, or one number for all
    degenerate_corners: np.ndarray,  # uint8 (n_e,), bit c is set where corner c is degenerate
) -> ElementMeasures:
    """Measure elements. `InputError` if the shapes of the arrays do not match."""
    sign = _signs(corners, handedness, degenerate_corners)
    n = len(corners)
    measures = np.empty((8, n)), np.empty((8, n)), np.empty(n)
    list_measures(_corner_rows(corners), degenerate_corners, *measures)
    triples, jacobians, volume = (sign * values for values in measures)
    if degenerate_corners.any():  # their values have no sign
        masks = np.unpackbits(degenerate_corners[None], axis=0, bitorder="little").astype(bool)
        triples[masks], jacobians[masks] = 1.0, np.inf
    return ElementMeasures(triples.T, jacobians.T, volume)


def element_measures_vjp(
    # see `element_measures`
    corners: np.ndarray,
    handedness: np.ndarray,
    degenerate_corners: np.ndarray,
    # adjoints of the corner measures; unused at degenerate corners
    triples_bar: np.ndarray,  # (n_e, 8)
    volume_bar: np.ndarray,  # (n_e,), adjoints of the volumes
    jacobians_bar: np.ndarray | None = None,  # (n_e, 8)
) -> np.ndarray:  # (n_e, 8, 3)
    """Adjoint of the corners from the adjoints of the measures."""
    sign = _signs(corners, handedness, degenerate_corners)
    if jacobians_bar is None:
        jacobians_bar = np.zeros((len(corners), 8))
    bars = [np.ascontiguousarray(sign * np.transpose(bar)) for bar in (triples_bar, jacobians_bar, volume_bar)]
    rows_bar = np.zeros((8, len(corners), 3))
    list_vjp(_corner_rows(corners), degenerate_corners, *bars, as_points(rows_bar))
    return np.ascontiguousarray(rows_bar.transpose(1, 0, 2))


def _measure(nodes: np.ndarray, degenerate_corners: np.ndarray, handedness: int | None) -> tuple[Any, ...]:
    """Compute the fields of `CellQuality` of a block with cells in all three directions."""
    points = as_points(nodes)
    if handedness is None:
        middle = degenerate_corners.shape[0] // 2
        measures = measured(points[middle : middle + 2], degenerate_corners[middle : middle + 1], 1)
        handedness = _majority(measures[3])
        measures = measured(points, degenerate_corners, handedness)
        if _majority(measures[3]) < 0:  # the middle of the block has the other sign than most of it
            handedness = -handedness
            measures = measured(points, degenerate_corners, handedness)
    else:
        measures = measured(points, degenerate_corners, handedness)
    return (*measures, handedness)


def measured(
    points: np.ndarray,  # (ni, nj, nk), nodes as records
    degenerate_corners: np.ndarray,  # uint8 (ni-1, nj-1, nk-1), bit c is set where corner c is degenerate
    handedness: int,  # +1 or -1
) -> np.ndarray:  # (4, ni-1, nj-1, nk-1)
    """Measure all cells: the fields of `CellQuality` in order; zeros if all corners are degenerate."""
    degenerate_corners = np.ascontiguousarray(degenerate_corners)
    measures = np.empty((4, *degenerate_corners.shape))
    block_summary(points, degenerate_corners, float(handedness), *measures.reshape(4, -1))
    for is_set, value in (degenerate_corners == 255, 0.0), (np.isnan(measures[0]), np.nan):  # comparisons lose a NaN
        if is_set.any():
            measures[:, is_set] = value
    return measures


def _majority(volume: np.ndarray) -> int:
    """Sign of most of the volumes."""
    return -1 if np.count_nonzero(volume < 0.0) > np.count_nonzero(volume > 0.0) else 1


def _extrude(nodes: np.ndarray, flat: int, normal: np.ndarray | None = None) -> np.ndarray:
    """Return a planar block with depth along a normal, by default its mean normal, its flat direction moved last."""
    plane = np.moveaxis(nodes, flat, 2)[:, :, 0]
    return stack_plane(plane, mean_normal(plane) if normal is None else normal)


@njit(cache=True, inline="always")
def _square(p, q):
    """Square of the distance between two points."""
    x, y, z = q.x - p.x, q.y - p.y, q.z - p.z
    return x * x + y * y + z * z


@njit(cache=True)
def _count_short(start, end, shortest_square):
    """Count the edges between two rows of points that are shorter than a length."""
    n_short = 0
    for k in range(min(start.shape[0], end.shape[0])):
        n_short += _square(start[k], end[k]) < shortest_square
    return n_short


@njit(cache=True)
def _has_short_edge(x, shortest):
    """Whether any edge of a block is that short: most blocks have none, and this is fast."""
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
            along_i, along_j, along_k = (
                x[i + 1 - a, j + b, k + d],
                x[i + a, j + 1 - b, k + d],
                x[i + a, j + b, k + 1 - d],
            )
            least = min(_square(here, along_i), _square(here, along_j), _square(here, along_k))
            bits[i, j, k] |= np.uint8(least < shortest * shortest) << np.uint8(corner)
    return bits


def _signs(corners: np.ndarray, handedness: np.ndarray | float, degenerate_corners: np.ndarray) -> np.ndarray:
    """Check the arrays and return the handedness as numbers."""
    sign = np.asarray(handedness, dtype=np.float64)
    n = len(corners)
    if corners.shape != (n, 8, 3) or sign.shape not in ((), (n,)) or degenerate_corners.shape != (n,):
        raise InputError(
            f"elements: corners of shape {corners.shape}, handedness of {sign.shape} and degenerate corners of "
            f"{degenerate_corners.shape} do not fit; give (n, 8, 3), (n,) and (n,)"
        )
    return sign


def _corner_rows(corners: np.ndarray) -> np.ndarray:
    return as_points(corners.transpose(1, 0, 2))
