"""Allowed widths of lattice spans, from the baseline walls: from the size of each body, and the gaps between bodies.

In each direction x a width is prescribed in intervals [a, b], and may grow with the distance from these,

    h(x) = min over i of h_i + log(growth) dist(x, [a_i, b_i]) ,

so neighbouring spans, which end where the integral of 1 / h is an integer, differ at most by the growth ratio. A body
needs a fraction of its longest side. Where two bodies are |v| apart, the gap needs |v|^2 / |v_d| divided by the number
of spans across it, in direction d: spans may be wide along the gap.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...base.display import OneLine
from .lattice_line import even_breaks

__all__ = ["Gap", "WallBody", "asked_in_gap", "bodies_of", "gaps_between", "graded_breaks"]

IN_GAP = 2.0
"""Number of spans across a gap. With 4, smallest volumes of sections of two and three elements, 1 % of a chord apart,
change by at most 0.05, and with 1 a flap that leaves its slot shrinks a cell to 0.28 instead of 0.55."""

THINNEST = 0.01
"""Smallest width of spans in a gap, relative to the longest side of its smaller body: bodies may touch."""

SAMPLES = 8
"""Number of places per narrowest width of an interval at which widths are compared."""


@dataclass(frozen=True, eq=False)
class WallBody(OneLine):
    """A connected set of wall nodes."""

    rows: np.ndarray  # int, its nodes among all wall nodes, ascending
    low: np.ndarray  # (3,), the corners of its box (m)
    high: np.ndarray

    def size(self, sides: Sequence[int]) -> float:
        """Longest of some sides of its box (m)."""
        return float((self.high - self.low)[list(sides)].max())


@dataclass(frozen=True, eq=False)
class Gap(OneLine):
    """Where two bodies are close to each other."""

    bodies: tuple[int, int]  # their numbers
    rows: np.ndarray  # int (n, 2), nodes of the first, and the nearest of the second, among all wall nodes
    starts: np.ndarray  # (n, 3), nodes of the first (m)
    vectors: np.ndarray  # (n, 3), from these to the nearest of the second (m)


Interval = tuple[float, float, float]
"""Ends of an interval in one direction, and the largest width of spans there (m)."""


def bodies_of(points: np.ndarray, faces: np.ndarray) -> tuple[WallBody, ...]:
    """Separate bodies, largest first: wall nodes, shape (n, 3), connected by faces, shape (m, 4)."""
    ends = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 3]].ravel()
    graph = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(len(points), len(points)))
    n, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(label, minlength=n))[:-1])
    bodies = [WallBody(rows, points[rows].min(axis=0), points[rows].max(axis=0)) for rows in parts]
    return tuple(sorted(bodies, key=lambda body: -float(np.linalg.norm(body.high - body.low))))


def gaps_between(points: np.ndarray, bodies: Sequence[WallBody], reach: Sequence[float]) -> tuple[Gap, ...]:
    """Find where bodies are within reach (m) of larger ones without touching them."""
    lows, highs = np.array([body.low for body in bodies]), np.array([body.high for body in bodies])
    near, trees, gaps = np.array(reach), {}, []
    for second, body in enumerate(bodies):
        apart = np.maximum(np.maximum(lows[:second] - body.high, body.low - highs[:second]), 0.0)
        for first in np.flatnonzero(np.linalg.norm(apart, axis=1) <= np.maximum(near[:second], near[second])).tolist():
            other = bodies[first].rows
            if first not in trees:
                trees[first] = cKDTree(points[other])
            bound = max(near[first], near[second])
            distances, nearest = trees[first].query(points[body.rows], distance_upper_bound=bound)
            is_near = np.isfinite(distances) & (distances > 0.0)
            if is_near.any():
                rows = np.stack([body.rows[is_near], other[nearest[is_near]]], axis=1)
                starts = points[rows[:, 0]]
                gaps.append(Gap((second, first), rows, starts, points[rows[:, 1]] - starts))
    return tuple(gaps)


def asked_in_gap(gap: Gap, axis: int, thinnest: float) -> list[Interval]:
    """Widths needed by a gap in one direction, at least ``thinnest`` (m): the narrowest of each part of it."""
    along = np.abs(gap.vectors[:, axis])
    is_across = along > 0.0
    start, along = gap.starts[is_across, axis], along[is_across]
    squares = np.einsum("nd,nd->n", gap.vectors[is_across], gap.vectors[is_across])
    widths = np.maximum(squares / (IN_GAP * along), thinnest)
    lows = np.minimum(start, start + gap.vectors[is_across, axis])
    if not len(widths):
        return []
    part = np.floor((lows - lows.min()) / widths.min()).astype(int)
    order = np.lexsort((widths, part))
    first = order[np.concatenate([[True], np.diff(part[order]) > 0])]
    return list(zip(lows[first], lows[first] + along[first], widths[first]))


def graded_breaks(even: tuple[float, float], asked: Sequence[Interval], growth: float) -> np.ndarray:
    """Ends of spans between two places; they are even if there is only one width."""
    if len({width for _, _, width in asked}) == 1 and asked[0][:2] == even:
        return even_breaks(*even, asked[0][2])
    slope, places = np.log(growth), [np.linspace(even[0], even[1], 2)]
    for low, high, width in asked:
        # from the interval outward in steps that grow like the widths, so that no change is missed
        n = int(np.ceil(np.log1p(slope * (even[1] - even[0]) / width) / slope * SAMPLES)) + 1
        steps = width / slope * np.expm1(slope * np.arange(n) / SAMPLES)
        places += [low - steps, high + steps, np.array([low, high])]
    at = np.unique(np.clip(np.concatenate(places), even[0], even[1]))
    at = at[np.concatenate([[True], np.diff(at) > 1e-12 * (even[1] - even[0])])]
    inverse = 1.0 / _widths_at(at, asked, slope)
    counted = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (inverse[1:] + inverse[:-1]))])
    n = max(1, int(np.ceil(counted[-1] - 1e-9)))
    breaks = np.interp(np.linspace(0.0, counted[-1], n + 1), counted, at)
    breaks[0], breaks[-1] = even
    return breaks


def _widths_at(places: np.ndarray, asked: Sequence[Interval], slope: float) -> np.ndarray:
    """Widths (m) at places, growing with the distance from the intervals by a slope."""
    found = np.full(len(places), np.inf)
    for low, high, width in asked:
        np.minimum(found, width + slope * np.maximum(np.maximum(low - places, places - high), 0.0), out=found)
    return found
