"""Centres and area vectors of faces of any number of corners, as in OpenFOAM: triangles around their means."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["polygon_geometry"]


def polygon_geometry(
    points: np.ndarray,  # (n_points, 3), points (m)
    corners: np.ndarray,  # int (n_corners,), corners of the faces in sequence
    starts: np.ndarray,  # int (n_faces + 1,), first corner of each
) -> tuple[np.ndarray, np.ndarray]:  # centres (m) and area vectors (m^2), each of shape (n_faces, 3)
    """Cut faces into triangles around the means of their corners, whose areas weight the centres."""
    centres, areas = np.empty((len(starts) - 1, 3)), np.empty((len(starts) - 1, 3))
    _centres(points, corners, starts, centres, areas)
    return centres, areas


@njit(cache=True)
def _triangle(p, q, r):
    """Area vector of a triangle."""
    u0, u1, u2, v0, v1, v2 = q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2]
    return 0.5 * (u1 * v2 - u2 * v1), 0.5 * (u2 * v0 - u0 * v2), 0.5 * (u0 * v1 - u1 * v0)


@njit(cache=True, error_model="numpy")
def _centres(x, corners, starts, centres, areas):
    """Write the centre and the area vector of every face."""
    mean = np.empty(3)
    for f in range(len(centres)):
        begin, n = starts[f], starts[f + 1] - starts[f]
        for d in range(3):
            mean[d] = 0.0
            for k in range(n):
                mean[d] += x[corners[begin + k], d]
            mean[d] /= n
            centres[f, d] = areas[f, d] = 0.0
        whole = 0.0
        for k in range(n):
            p, q = x[corners[begin + k]], x[corners[begin + (k + 1) % n]]
            part = _triangle(p, q, mean)
            size = np.sqrt(part[0] ** 2 + part[1] ** 2 + part[2] ** 2)
            whole += size
            for d in range(3):
                areas[f, d] += part[d]
                centres[f, d] += size * (p[d] + q[d] + mean[d]) / 3.0
        for d in range(3):
            centres[f, d] = centres[f, d] / whole if whole > 0.0 else mean[d]
