"""Cuts of surfaces with planes across an axis."""

from __future__ import annotations

import numpy as np

__all__ = ["cut", "cut_lines"]


def cut(
    points: np.ndarray,  # (n_points, 3), corners (m)
    quads: np.ndarray,  # (n, 4) of int, their numbers
    axis: int,  # the axis
    place: float,  # coordinate of the plane (m)
) -> np.ndarray:  # (n_segments, 2, 3), ends of the segments (m)
    """Cut quads with a plane across an axis."""
    places, segments, _ = _segments(points, quads, axis, place)
    return places[segments]


def cut_lines(
    points: np.ndarray,  # (n_points, 3), corners (m)
    quads: np.ndarray,  # (n, 4) of int, their numbers
    axis: int,  # the axis
    place: float,  # coordinate of the plane (m)
    diagonals: bool = False,  # whether lines have points on the diagonals of quads, which lie beside a curved wall
) -> list[np.ndarray]:  # each (n, 3), points (m)
    """Cut quads with a plane across an axis, and join the segments to lines; closed ones end where they begin."""
    places, segments, is_on_side = _segments(points, quads, axis, place)
    ends, others = segments.T.ravel(), segments[:, ::-1].T.ravel()
    order = np.argsort(ends, kind="stable")
    counts = np.bincount(ends, minlength=len(places))
    slot = np.arange(len(ends)) - np.repeat(np.cumsum(counts) - counts, counts)
    links = np.full((len(places), max(2, int(counts.max(initial=0)))), -1)
    links[ends[order], slot] = others[order]
    lines, is_left = [], np.ones(len(places), dtype=bool)
    for start in np.argsort(counts, kind="stable"):  # open lines from their ends
        at, line = int(start), []
        while at >= 0 and is_left[at]:
            is_left[at] = False
            line.append(at)
            at = next((int(n) for n in links[at] if n >= 0 and is_left[n]), -1)
        if line:
            kept = line if diagonals else [n for n in line if is_on_side[n]]
            lines.append(places[[*kept, kept[0]] if counts[start] > 1 else kept])
    return lines


def _segments(
    points: np.ndarray, quads: np.ndarray, axis: int, place: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points where a plane cuts the triangles of quads, two of them for each that is cut, and which are on sides."""
    heights = points[:, axis] - place
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    above = heights[triangles] > 0.0
    triangles, above = (array[above.any(axis=1) & ~above.all(axis=1)] for array in (triangles, above))
    # the corner on its own side of the plane first
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    turned = np.take_along_axis(triangles, (alone[:, None] + np.arange(3)) % 3, axis=1)
    edges = np.sort(np.stack([turned[:, [0, 0]], turned[:, 1:]], axis=-1), axis=-1).reshape(-1, 2)
    edges, number = np.unique(edges, axis=0, return_inverse=True)
    a, b = edges.T
    part = (heights[a] / (heights[a] - heights[b]))[:, None]
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    is_on_side = np.isin(a * len(points) + b, sides @ [len(points), 1])
    return points[a] + part * (points[b] - points[a]), number.reshape(-1, 2), is_on_side
