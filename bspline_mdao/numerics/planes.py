"""Planes through points."""

from __future__ import annotations

import numpy as np

__all__ = ["is_line", "nearest_plane"]

PLANAR = 1e-5
"""A patch is planar when its points leave the plane by less than this part of the patch's size."""

ALIGNED = 1e-5
"""A normal that leaves a coordinate axis by less than this is that axis."""


def is_line(points: np.ndarray) -> bool:
    """Whether points are in one line, which lies in many planes."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(sizes) < 2 or sizes[1] <= PLANAR * sizes[0]


def nearest_plane(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Plane through points, shape (n, 3): unit normal, distances (n,) of the points, and what is near enough (m)."""
    centred = points - points.mean(axis=0)
    _, sizes, directions = np.linalg.svd(centred, full_matrices=len(points) < 3)
    axis = np.argmax(np.abs(directions[2]))
    is_axis = 1.0 - abs(directions[2, axis]) < ALIGNED**2 / 2.0
    normal = np.eye(3)[axis] if is_axis else directions[2]
    return normal, np.abs(centred @ directions[2]), PLANAR * sizes[0] / np.sqrt(len(points))
