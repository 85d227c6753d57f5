"""Cones of the normals of a surface, by which a search leaves out boxes that hold no local minimum of the distance.

At a local minimum the way from the surface to the point is a normal of the surface: that of a triangle or, on an edge
or a corner, a mean of those around. Seen from a corner c with triangles all around, whose normals are within an angle t
of an axis a, the surface is the graph of a function f over the plane across a, of slope at most tan t. No edge e leads
nearer to the point p, d . e <= 0 for d = p - c; for the one along the part of d in that plane, of length h, that is
h <= -d_a f <= |d_a| tan t. So d is within t of a, or of -a; up to 45 degrees the latter is not the side that the
surface looks to. (D. Johnson and E. Cohen, Spatialized normal cone hierarchies, 2001, leave out boxes so.)

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["cones_of_boxes", "has_no_minimum", "unit_normals"]

WIDEST = np.radians(44.0)
"""Half angle of a cone from which on it says nothing."""

MARGIN = 0.01
"""What cones are wider than normals (rad): round-off decides whether a triangle as narrow as that is nearer."""


def unit_normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals of triangles with area, shape (n_triangles, 3, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def cones_of_boxes(
    points: np.ndarray,  # (n, 3), corners (m)
    triangles: np.ndarray,  # (n_triangles, 3) of int, corners of triangles in the order of the tree
    starts: np.ndarray,  # (n_leaves + 1,) of int, first triangle of every leaf
) -> np.ndarray:
    """Find the cones of a binary tree of boxes."""
    # Returns (2 n_leaves, 5), axis of each box, and cosine and sine of the half angle about it that holds the normals
    # of its triangles and of those that share corners with them; zeros where that is wider than `WIDEST`, or a corner
    # has no triangles all around. Box k holds boxes 2 k and 2 k + 1; the first of all is number 1.
    cones, n_leaves = np.zeros((2 * (len(starts) - 1), 5)), len(starts) - 1
    if not len(triangles):
        return cones
    normals = unit_normals(points[triangles])
    angles = _angles_around(normals, triangles, len(points))
    n_boxes = n_leaves
    while n_boxes:
        first = starts[:: n_leaves // n_boxes]
        axes = np.add.reduceat(normals, first[:-1])
        axes /= np.maximum(np.linalg.norm(axes, axis=1), np.finfo(float).tiny)[:, None]
        offsets = np.arccos(np.clip(np.einsum("td,td->t", normals, np.repeat(axes, np.diff(first), axis=0)), -1.0, 1.0))
        widest = np.maximum.reduceat(offsets + angles, first[:-1]) + MARGIN
        narrow = np.flatnonzero(widest < WIDEST)
        cones[n_boxes + narrow] = np.column_stack([axes, np.cos(widest), np.sin(widest)])[narrow]
        n_boxes //= 2
    return cones


def _angles_around(normals: np.ndarray, triangles: np.ndarray, n_points: int) -> np.ndarray:
    """Largest angle between each triangle and those that share corners with it; pi where some are missing."""
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    keys, counts = np.unique(edges @ [n_points, 1], return_counts=True)
    back = edges[:, ::-1] @ np.array([n_points, 1])
    at = np.minimum(np.searchsorted(keys, back), len(keys) - 1)
    is_open = np.zeros(n_points, dtype=bool)
    is_open[edges[(keys[at] != back) | (counts[at] != 1)]] = True
    order = np.argsort(triangles, axis=None, kind="stable")
    counts = np.bincount(triangles.ravel(), minlength=n_points)
    n_around = counts[triangles.ravel()]  # triangles at each corner of each triangle, one after the other
    firsts = np.cumsum(counts) - counts
    within = np.arange(n_around.sum()) - np.repeat(np.cumsum(n_around) - n_around, n_around)
    other = order[np.repeat(firsts[triangles.ravel()], n_around) + within] // 3
    this = np.repeat(np.repeat(np.arange(len(triangles)), 3), n_around)
    cosines = np.einsum("pd,pd->p", normals[this], normals[other])
    n_pairs = n_around.reshape(-1, 3).sum(axis=1)
    least = np.minimum.reduceat(cosines, np.cumsum(n_pairs) - n_pairs)
    return np.where(is_open[triangles].any(axis=1), np.pi, np.arccos(np.clip(least, -1.0, 1.0)))


@njit(cache=True, nogil=True, error_model="numpy")
def has_no_minimum(box, cone, p):
    """Whether no way from a box to a point p outside it is in the box's cone."""
    if cone[3] == 0.0:
        return False
    along = size = distance = 0.0
    for d in range(3):
        off = p[d] - 0.5 * (box[d] + box[3 + d])
        along += cone[d] * off
        distance += off * off
        size += 0.25 * (box[3 + d] - box[d]) ** 2
    if size >= distance:
        return False
    # the way from the box's middle, give or take the angle under which half the box is seen
    return along < cone[3] * np.sqrt(distance - size) - cone[4] * np.sqrt(size)
