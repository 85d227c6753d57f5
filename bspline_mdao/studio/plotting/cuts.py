"""Cuts of surfaces with planes across an axis."""

from __future__ import annotations

import numpy as np

__all__ = ["cut"]


def cut(
    points: np.ndarray,  # (n_points, 3), corners (m)
    quads: np.ndarray,  # (n, 4) of int, their numbers
    axis: int,  # the axis
    place: float,  # coordinate of the plane (m)
) -> np.ndarray:  # (n_segments, 2, 3), ends of the segments (m)
    """Cut quads with a plane across an axis."""
    heights = points[:, axis] - place
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    above = heights[triangles] > 0.0
    triangles, above = (array[above.any(axis=1) & ~above.all(axis=1)] for array in (triangles, above))
    # the corner that is alone on its side first
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    turned = np.take_along_axis(triangles, (alone[:, None] + np.arange(3)) % 3, axis=1)
    a, ends = turned[:, [0]], turned[:, 1:]
    part = heights[a] / (heights[a] - heights[ends])
    return points[a] + part[..., None] * (points[ends] - points[a])
