"""Numbers for the points on which the nodes on faces of blocks lie: nodes that coincide are one point.

Two nodes coincide if they are closer than a small part of the local spacing, or than the round-off of the numbers in
the file allows, but never so that the two ends of a cell edge of non-zero length become one.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..numerics.threads import thread_count

SPACING_TOLERANCE = 1e-4
"""Nodes closer than this part of the local spacing coincide."""

NEAR_MISS_TOLERANCE = 1e-2
"""Faces closer than this part of the local spacing, yet not coincident, are reported."""

ROUND_OFF_UNITS = 2.01
"""Nodes that differ by no more units in the last place of the data coincide (two, as decimals are seen in binary)..."""

THIN_CELL_LIMIT = 0.25
"""...unless that is more than this part of the local spacing."""

MANY_NUMBERS = 1000
"""Different numbers that have few decimals only if they were rounded."""

COLLAPSED_EDGE = 1e-12
"""A cell edge shorter than this part of the block's size has no length."""

COLLAPSED_LINE_RATIO = 1e-3
"""A grid line within round-off has no length if one beside it is longer by the inverse of this."""


@dataclass(frozen=True)
class Coincidence:
    """Numbers of the points on which the face nodes of the blocks lie.

    Parameters
    ----------
    ids, near_ids : tuple of ndarray of int32, each of the block's shape
        Number of the point at each face node, -1 inside the block; ``near_ids`` also takes near misses as one.
    spacing : tuple of ndarray, each of the block's shape
        Shortest edge of non-zero length at each face node, in metres; infinite inside the block.
    round_off : float
        Relative precision of the coordinates as stored.
    unit : float
        Absolute precision (m) of coordinates stored with a fixed number of decimals; 0 for others.
    is_coarse : bool
        Whether cells are so thin somewhere that round-off had to be left out of the tolerance.
    """

    ids: tuple[np.ndarray, ...]
    near_ids: tuple[np.ndarray, ...]
    spacing: tuple[np.ndarray, ...]
    round_off: float
    unit: float
    is_coarse: bool

    def rounding(self, points: np.ndarray) -> np.ndarray:
        """Return how far apart (m) each of points (..., 3) may be stored twice, in each coordinate."""
        return _rounding(points, self.round_off, self.unit)


def find_coincidence(blocks: Sequence[np.ndarray]) -> Coincidence:
    """Find the points on which the face nodes of all blocks lie, and number them.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (ni, nj, nk, 3)
        Nodes of each block, in metres.
    """
    round_off, unit = data_round_off(blocks), data_unit(blocks)
    masks = [_face_mask(nodes.shape[:3]) for nodes in blocks]
    spacing, *edges = zip(*(_face_edges(nodes, round_off) for nodes in blocks))
    points = np.concatenate([nodes[mask] for nodes, mask in zip(blocks, masks)])
    length = np.concatenate([s[mask] for s, mask in zip(spacing, masks)])
    length[np.isinf(length)] = 0.0
    rounding = _rounding(points, round_off, unit)
    is_coarse = bool(np.any(rounding > THIN_CELL_LIMIT * length))
    tolerance = np.maximum(SPACING_TOLERANCE * length, np.minimum(rounding, THIN_CELL_LIMIT * length))
    collapsed, real = (_compress(part, masks) for part in edges)
    ids = _merge_close(points, tolerance, _join(_equal_points(points), collapsed), real)
    near_ids = _merge_close(points, np.maximum(tolerance, NEAR_MISS_TOLERANCE * length), ids, real)
    return Coincidence(_spread(ids, masks), _spread(near_ids, masks), spacing, round_off, unit, is_coarse)


def data_round_off(blocks: Sequence[np.ndarray]) -> float:
    """Relative precision with which coordinates are stored: 4-byte reals, decimals of 5 to 12 digits, or 8-byte reals.

    Judged from numbers spread over the blocks. Less than 7 digits are believed only of many different numbers.
    """
    values = _samples(blocks)
    if _are_single(values):
        return float(np.finfo(np.float32).eps)
    exponent = np.floor(np.log10(values))
    for digits in range(5 if len(np.unique(values)) > MANY_NUMBERS else 7, 13):
        scaled = values * 10.0 ** (digits - 1 - exponent)
        if np.all(np.abs(scaled - np.rint(scaled)) < 1e-2):
            return 10.0 ** (1 - digits)
    return float(np.finfo(np.float64).eps)


def data_unit(blocks: Sequence[np.ndarray]) -> float:
    """Unit (m) of coordinates stored with 4 to 10 decimals, many of which use the last; 0 for others."""
    values = _samples(blocks)
    if _are_single(values) or len(np.unique(values)) <= MANY_NUMBERS:
        return 0.0
    for decimals in range(4, 11):
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < 1e-2):
            return 10.0**-decimals if np.mean(np.rint(scaled) % 10.0 != 0.0) > 0.5 else 0.0
    return 0.0


def _samples(blocks: Sequence[np.ndarray], n_samples: int = 3000) -> np.ndarray:
    """Absolute values of about ``n_samples`` numbers of each block, spread over it; those that are zero left out."""
    samples = [nodes.reshape(-1, 3)[:: max(1, nodes.size // n_samples)] for nodes in blocks]
    values = np.abs(np.concatenate(samples).ravel())
    return values[values > 1e-12 * values.max(initial=0.0)]


def _are_single(values: np.ndarray) -> bool:
    """Whether numbers are 4-byte reals."""
    with np.errstate(over="ignore"):
        return np.array_equal(values.astype(np.float32), values)


def _rounding(points: np.ndarray, round_off: float, unit: float) -> np.ndarray:
    return ROUND_OFF_UNITS * np.maximum(round_off * np.abs(points).max(axis=-1), unit)


def _face_mask(shape) -> np.ndarray:
    """Mark the nodes on the faces of a block."""
    mask = np.zeros(shape, dtype=bool)
    for d in range(3):
        if shape[d] > 1:
            np.moveaxis(mask, d, 0)[[0, -1]] = True
    return mask


def _face_edges(nodes: np.ndarray, round_off: float):
    """Spacing at the face nodes of a block, and the pairs of nodes of its collapsed and of its real face edges."""
    shape = nodes.shape[:3]
    spacing = np.full(shape, np.inf)
    numbers = np.arange(spacing.size).reshape(shape)
    shortest = COLLAPSED_EDGE * np.ptp(nodes.reshape(-1, 3), axis=0).max()
    rounding = ROUND_OFF_UNITS * round_off * np.abs(nodes).max()
    collapsed, real = [np.empty((2, 0), dtype=int)], [np.empty((2, 0), dtype=int)]
    for d, side in ((d, side) for d in range(3) if shape[d] > 1 for side in (0, -1)):
        layers, at, face_numbers = (np.moveaxis(a, d, 0)[:: 1 + 2 * side] for a in (nodes, spacing, numbers))
        _shorten(at[0], _norm(layers[0] - layers[1]), shortest)
        for t in range(2):
            lines, inner = np.moveaxis(layers[0], t, 0), np.moveaxis(layers[1], t, 0)
            length = _norm(lines[1:] - lines[:-1])
            length[(length <= shortest) | _are_points(lines, inner, rounding)] = 0.0
            near = np.moveaxis(at[0], t, 0)
            _shorten(near[1:], length, shortest)
            _shorten(near[:-1], length, shortest)
            ends = np.moveaxis(face_numbers[0], t, 0)
            ends = np.stack([ends[:-1], ends[1:]])
            collapsed.append(ends[:, length == 0.0])
            real.append(ends[:, length > 0.0])
    return spacing, np.concatenate(collapsed, axis=1), np.concatenate(real, axis=1)


def _shorten(spacing: np.ndarray, length: np.ndarray, shortest: float) -> None:
    """Lower the spacing in place to the length of an edge that is not collapsed."""
    np.minimum(spacing, np.where(length > shortest, length, np.inf), out=spacing)


def _are_points(lines: np.ndarray, inner: np.ndarray, rounding: float) -> np.ndarray:
    """Mark grid lines (n, m, 3), n nodes each, that are points but for round-off, as the lines beside them show."""
    extent, beside = _norm(np.ptp(lines, axis=0)), _norm(np.ptp(inner, axis=0))
    beside[1:] = np.maximum(beside[1:], extent[:-1])
    beside[:-1] = np.maximum(beside[:-1], extent[1:])
    return (extent <= rounding) & (extent <= COLLAPSED_LINE_RATIO * beside)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def _compress(pairs: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Pairs of flat node numbers of each block as pairs of places in the list of all face nodes."""
    start, placed = 0, []
    for block_pairs, mask in zip(pairs, masks):
        place = np.cumsum(mask) - 1 + start
        placed.append(place[block_pairs])
        start += int(mask.sum())
    return np.concatenate(placed, axis=1)


def _spread(ids: np.ndarray, masks: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Ids of all face nodes as one array per block, -1 inside."""
    spread = [np.full(mask.shape, -1, dtype=np.int32) for mask in masks]
    ends = np.cumsum([int(mask.sum()) for mask in masks])[:-1]
    for array, mask, part in zip(spread, masks, np.split(ids, ends)):
        array[mask] = part
    return tuple(spread)


def _equal_points(points: np.ndarray) -> np.ndarray:
    """Labels of points, equal where all three coordinates are."""
    order = np.lexsort(points.T)
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = np.any(points[order[1:]] != points[order[:-1]], axis=1)
    labels = np.empty(len(points), dtype=np.int64)
    labels[order] = np.cumsum(is_new) - 1
    return labels


def _join(labels: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Labels 0, 1, ... with those of each pair of points, shape (2, n), made one."""
    n = int(labels.max(initial=-1)) + 1
    graph = coo_array((np.ones(pairs.shape[1], dtype=bool), (labels[pairs[0]], labels[pairs[1]])), shape=(n, n))
    return connected_components(graph.tocsr(), directed=False)[1][labels]


def _merge_close(points: np.ndarray, tolerance: np.ndarray, labels: np.ndarray, real: np.ndarray) -> np.ndarray:
    """Give points within tolerance one label, except where that would join the ends of a real edge.

    Every label merges with its nearest neighbour until none is near enough. Where a chain of merges has joined the
    two ends of an edge, all points of the chain fall back to the labels they came with.
    """
    merged = labels
    while (pairs := _nearest_pairs(points, tolerance, merged)).size:
        merged = _join(merged, pairs)
    a, b = merged[real]
    is_spoilt = np.zeros(int(merged.max(initial=-1)) + 1, dtype=bool)
    is_spoilt[a[a == b]] = True
    return np.unique(np.where(is_spoilt[merged], len(is_spoilt) + labels, merged), return_inverse=True)[1]


def _nearest_pairs(points: np.ndarray, tolerance: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Pairs of points, one for each label, that are nearest to each other and within the tolerance of both."""
    _, first = np.unique(labels, return_index=True)
    if len(first) < 2:
        return np.empty((2, 0), dtype=int)
    least = np.full(len(first), np.inf)
    np.minimum.at(least, labels, tolerance)
    distance, near = cKDTree(points[first]).query(points[first], k=2, workers=thread_count(None))
    partner = np.where(near[:, 0] == np.arange(len(first)), near[:, 1], near[:, 0])
    is_close = distance[:, 1] <= np.minimum(least, least[partner])
    return np.stack([first[is_close], first[partner[is_close]]])
