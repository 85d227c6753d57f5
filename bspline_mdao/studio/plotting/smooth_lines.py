"""Smooth curves through the points of coarse grids, so pictures show shapes instead of polygons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator

from .cuts import cut_lines

__all__ = ["PIECES", "curve_through", "outline_through", "outlines_at"]

PIECES = 8
"""Pieces of the curve between two points."""

CORNER = np.cos(np.radians(60.0))
"""Cosine of the angle between segments beyond which an edge is sharp; noses of 32 cells turn by 40 degrees."""

UNEVEN = 8.0
"""Ratio of neighbouring segments from which cubics swing: walls of triangles that are cut anywhere, coarsest noses."""

SAME = 1e-6
"""Distance, relative to the size of an outline, below which points coincide."""


def outline_through(
    points: np.ndarray,  # (n, d), around a section; if it is closed, the last is the first
) -> np.ndarray:  # (m, d); if it is closed, from its last point downstream on
    """Cubic splines around a section between its sharp edges; Akima's where its points are very uneven."""
    near = SAME * np.ptp(points)
    line = points[np.linalg.norm(np.diff(points, axis=0, prepend=points[:1] + 1.0), axis=1) > near]
    if len(line) < 3:
        return line
    line = _from_the_tail(line, near)
    steps = np.diff(line, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    edges = 1 + np.flatnonzero(np.sum(directions[1:] * directions[:-1], axis=1) < CORNER)
    is_round = not len(edges) and (line[0] == line[-1]).all() and directions[0] @ directions[-1] >= CORNER
    ends, parts = "periodic" if is_round else "not-a-knot", []
    for start, end in zip([0, *edges], [*edges, len(steps)]):
        piece = line[start : end + 1]
        lengths = _lengths(piece)
        ratios = np.diff(np.log(np.diff(lengths)))
        is_even = len(ratios) > 1 and np.abs(ratios).max() < np.log(UNEVEN)
        parts.append(CubicSpline(lengths, piece, bc_type=ends)(_dense(lengths)) if is_even else curve_through(piece))
    return np.concatenate(parts)


def outlines_at(
    place: float,  # coordinate of the plane (m)
    points: np.ndarray,  # (n, 3), nodes of walls (m)
    quads: np.ndarray,  # (n_faces, 4) of int, their faces; those that meet share their nodes
    order: Sequence[int],  # axes downstream, up, and across the plane
) -> list[np.ndarray]:  # each (m, 2), downstream and up (m)
    """Sections of walls as smooth curves."""
    lines = cut_lines(points, quads, order[2], place)
    return [outline_through(line[:, list(order[:2])]) for line in lines]


def curve_through(
    points: np.ndarray,  # (n, d), along an edge or a distribution
) -> np.ndarray:  # (m, d)
    """Modified Akima splines, which keep straight parts straight next to a kink; the abscissa turns at points alone."""
    points = points[np.linalg.norm(np.diff(points, axis=0, prepend=points[:1] + 1.0), axis=1) > SAME * np.ptp(points)]
    if len(points) < 3:
        return points
    lengths = _lengths(points)
    curve = Akima1DInterpolator(lengths, points, method="makima")(_dense(lengths))
    curve[:, 0] = PchipInterpolator(lengths, points[:, 0])(_dense(lengths))  # Akima's doubles back beside steps
    return curve


def _lengths(points: np.ndarray) -> np.ndarray:
    """Length of a polygon up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _dense(lengths: np.ndarray) -> np.ndarray:
    """Parameters at and between points."""
    n = len(lengths)
    return np.interp(np.arange(PIECES * (n - 1) + 1) / PIECES, np.arange(n), lengths)


def _from_the_tail(line: np.ndarray, near: float) -> np.ndarray:
    """A closed line from its last point downstream on; an open one unchanged."""
    if np.linalg.norm(line[0] - line[-1]) > near:
        return line
    line = np.roll(line[:-1], -int(np.argmax(line[:-1, 0])), axis=0)
    return np.concatenate([line, line[:1]])
