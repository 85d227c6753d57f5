"""Numbers for the points on which the nodes on faces of blocks lie: nodes that coincide are one point.

Two nodes coincide if they are closer than a small fraction of the local spacing, or than the round-off of the numbers
in the file allows, but never such that the two ends of a cell edge of non-zero length become one.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...base.numerics.threads import thread_count
from .block_layout import BlockLayout
from .shell import OnFaces, Shell

SPACING_TOLERANCE = 1e-4
"""Nodes closer than this fraction of the local spacing coincide."""

NEAR_MISS_TOLERANCE = 1e-2
"""Faces closer than this fraction of the local spacing, yet not coincident, are reported."""

ROUND_OFF_UNITS = 2.01
"""Nodes that differ by at most this many units in the last place coincide (two, as decimals are read in binary)..."""

THIN_CELL_LIMIT = 0.25
"""...unless that exceeds this fraction of the local spacing."""

MANY_NUMBERS = 1000
"""Number of different values above which few decimals mean that they were rounded."""

COLLAPSED_EDGE = 1e-12
"""A cell edge shorter than this fraction of the block's size has no length."""

COLLAPSED_LINE_RATIO = 1e-3
"""A grid line within round-off has no length if an adjacent one is longer by the inverse of this."""


@dataclass(frozen=True)
class Coincidence:
    """Numbers of the points on which the face nodes of the blocks lie."""

    # ids, near_ids: number of the point at each face node, -1 inside the block; ``near_ids`` also joins near misses
    ids: tuple[OnFaces, ...]
    near_ids: tuple[OnFaces, ...]
    # shortest edge of non-zero length at each face node, in metres; infinite inside the block
    spacing: tuple[OnFaces, ...]
    round_off: float  # relative precision of the stored coordinates
    unit: float  # absolute precision (m) of coordinates stored with a fixed number of decimals; 0 for others
    is_coarse: bool  # whether some cells are so thin that round-off had to be left out of the tolerance

    def rounding(self, points: np.ndarray) -> np.ndarray:
        """Return the largest difference (m) between two stored copies of points (..., 3), in each coordinate."""
        return _rounding(points, self.round_off, self.unit)


def find_coincidence(
    blocks: Sequence[Shell],  # nodes on the faces of each block, and next to them
) -> Coincidence:
    """Find the points on which the face nodes of all blocks lie, and number them."""
    round_off, unit = data_round_off(blocks), data_unit(blocks)
    spacing, *edges = zip(*(_face_edges(shell, round_off) for shell in blocks))
    points = np.concatenate([shell.points for shell in blocks])
    length = np.concatenate(spacing)
    length[np.isinf(length)] = 0.0
    rounding = _rounding(points, round_off, unit)
    is_coarse = bool(np.any(rounding > THIN_CELL_LIMIT * length))
    tolerance = np.maximum(SPACING_TOLERANCE * length, np.minimum(rounding, THIN_CELL_LIMIT * length))
    starts = BlockLayout.of(map(np.shape, spacing)).starts
    collapsed, real = (np.concatenate([pairs + start for pairs, start in zip(part, starts)], axis=1) for part in edges)
    ids = _merge_close(points, tolerance, _join(_equal_points(points), collapsed), real)
    near_ids = _merge_close(points, np.maximum(tolerance, NEAR_MISS_TOLERANCE * length), ids, real)
    spread = tuple(OnFaces(shell.nodes, lengths, np.inf) for shell, lengths in zip(blocks, spacing))
    return Coincidence(_spread(ids, blocks), _spread(near_ids, blocks), spread, round_off, unit, is_coarse)


def data_round_off(blocks: Sequence[Shell]) -> float:
    """Relative precision of stored coordinates: 4-byte reals, decimals of 5 to 12 digits, or 8-byte reals.

    Determined from numbers spread over the blocks. Fewer than 7 digits are accepted only for many different numbers.
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


def data_unit(blocks: Sequence[Shell]) -> float:
    """Unit (m) of coordinates stored with 4 to 10 decimals, many of which use the last; 0 for others."""
    values = _samples(blocks)
    if _are_single(values) or len(np.unique(values)) <= MANY_NUMBERS:
        return 0.0
    for decimals in range(4, 11):
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < 1e-2):
            return 10.0**-decimals if np.mean(np.rint(scaled) % 10.0 != 0.0) > 0.5 else 0.0
    return 0.0


def _samples(blocks: Sequence[Shell]) -> np.ndarray:
    """Absolute values of the samples of each block, without zeros."""
    values = np.abs(np.concatenate([shell.samples for shell in blocks]))
    return values[values > 1e-12 * values.max(initial=0.0)]


def _are_single(values: np.ndarray) -> bool:
    """Whether numbers are 4-byte reals."""
    with np.errstate(over="ignore"):
        return np.array_equal(values.astype(np.float32), values)


def _rounding(points: np.ndarray, round_off: float, unit: float) -> np.ndarray:
    return ROUND_OFF_UNITS * np.maximum(round_off * np.abs(points).max(axis=-1), unit)


def _face_edges(shell: Shell, round_off: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spacing at the face nodes of a block, and the end pairs of its collapsed and of its real face edges."""
    spacing = np.full(len(shell.points), np.inf)
    shortest = COLLAPSED_EDGE * shell.extent
    rounding = ROUND_OFF_UNITS * round_off * shell.largest
    collapsed, real = [np.empty((2, 0), dtype=int)], [np.empty((2, 0), dtype=int)]
    for face, inner_layer in enumerate(shell.inner_layers):
        if inner_layer is None:
            continue
        places = shell.nodes.face(face)
        layer, at = shell.points[places], spacing[places]
        _shorten(at, _norm(layer - inner_layer), shortest)
        for t in range(2):
            lines, inner = np.moveaxis(layer, t, 0), np.moveaxis(inner_layer, t, 0)
            length = _norm(lines[1:] - lines[:-1])
            length[(length <= shortest) | _are_points(lines, inner, rounding)] = 0.0
            near = np.moveaxis(at, t, 0)
            _shorten(near[1:], length, shortest)
            _shorten(near[:-1], length, shortest)
            ends = np.moveaxis(places, t, 0)
            ends = np.stack([ends[:-1], ends[1:]])
            collapsed.append(ends[:, length == 0.0])
            real.append(ends[:, length > 0.0])
        spacing[places] = at
    return spacing, np.concatenate(collapsed, axis=1), np.concatenate(real, axis=1)


def _shorten(spacing: np.ndarray, length: np.ndarray, shortest: float) -> None:
    """Lower the spacing in place to the length of an edge that is not collapsed."""
    np.minimum(spacing, np.where(length > shortest, length, np.inf), out=spacing)


def _are_points(lines: np.ndarray, inner: np.ndarray, rounding: float) -> np.ndarray:
    """Mark grid lines (n, m, 3), n nodes each, that are points but for round-off, as adjacent lines show."""
    extent, inner_layer = _norm(np.ptp(lines, axis=0)), _norm(np.ptp(inner, axis=0))
    inner_layer[1:] = np.maximum(inner_layer[1:], extent[:-1])
    inner_layer[:-1] = np.maximum(inner_layer[:-1], extent[1:])
    return (extent <= rounding) & (extent <= COLLAPSED_LINE_RATIO * inner_layer)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def _spread(ids: np.ndarray, blocks: Sequence[Shell]) -> tuple[OnFaces, ...]:
    """Ids of all face nodes block by block, -1 inside."""
    parts = BlockLayout.of((len(shell.points),) for shell in blocks).split(ids.astype(np.int32))
    return tuple(OnFaces(shell.nodes, part, np.int32(-1)) for shell, part in zip(blocks, parts))


def _equal_points(points: np.ndarray) -> np.ndarray:
    """Labels of points, equal if all three coordinates are."""
    order = np.lexsort(points.T)
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = np.any(points[order[1:]] != points[order[:-1]], axis=1)
    labels = np.empty(len(points), dtype=np.int64)
    labels[order] = np.cumsum(is_new) - 1
    return labels


def _join(labels: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Labels 0, 1, ..., merged for each pair of points, shape (2, n)."""
    n = int(labels.max(initial=-1)) + 1
    graph = coo_array((np.ones(pairs.shape[1], dtype=bool), (labels[pairs[0]], labels[pairs[1]])), shape=(n, n))
    return connected_components(graph.tocsr(), directed=False)[1][labels]


def _merge_close(points: np.ndarray, tolerance: np.ndarray, labels: np.ndarray, real: np.ndarray) -> np.ndarray:
    """Give points within tolerance the same label, except where that would join the ends of a real edge."""
    # Every label merges with its nearest neighbour until none is near enough. If a chain of merges has joined the two
    # ends of an edge, all points of the chain return to their initial labels.
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
