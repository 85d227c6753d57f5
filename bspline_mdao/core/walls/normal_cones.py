"""Cones of the normals of a surface, by which a search skips boxes without a local minimum of the distance.

At a local minimum the vector from the surface to the point is a normal of the surface: the normal of a triangle or, on
an edge or a corner, a mean of the normals around it. Seen from a corner c with triangles all around, whose normals are
within an angle t of an axis a, the surface is the graph of a function f over the plane normal to a, of slope at most
tan t. At a minimum no edge e leads nearer to the point p, d . e <= 0 for d = p - c. For the edge along the part of d in
that plane, of length h, this is h <= -d_a f <= |d_a| tan t. So d is within t of a, or of -a. In the latter case it is
more than a right angle from the triangle's own normal, so on the other side, if that normal is within 90 degrees - t of
a. (D. Johnson and E. Cohen, Spatialized normal cone hierarchies, 2001, exclude boxes this way.) A triangle has its own
normal as the axis, and the vector from its closest place is in its cone or not. A box stands for all vectors out of it.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["BEHIND", "cones_of", "has_no_minimum", "unit_normals"]

WIDEST = np.radians(85.0)
"""Half angle from which on a cone excludes nothing: slopes grow beyond any bound."""

MARGIN = 0.01
"""Margin of cones (rad): round-off decides whether a triangle as narrow as this is nearer."""

BEHIND = 1e-6
"""Sine of the angle up to which a point behind a triangle counts as in front: it is in its plane up to round-off."""


def unit_normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals of triangles with area, shape (n_triangles, 3, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def cones_of(
    points: np.ndarray,  # (n, 3), corners (m)
    triangles: np.ndarray,  # (n_triangles, 3) of int, corners of triangles in the order of the tree
    starts: np.ndarray,  # (n_leaves + 1,) of int, first triangle of every leaf
    boxes: np.ndarray,  # (2 n_leaves, 6), lower and upper corner of every box
) -> tuple[np.ndarray, np.ndarray]:
    """Find the cones of a binary tree of boxes, and of its triangles."""
    # Returns (2 n_leaves, 9): axis of each box; cosine of the half angle about it that contains the normals of its
    # triangles and of triangles that share corners with them, and its sine times the radius of the ball around the box;
    # the ball's centre; the squared radius. Cosines are zero if the cone excludes nothing, or a corner has no triangles
    # all around. Box k contains boxes 2 k and 2 k + 1; the root is number 1.
    # Returns (n_triangles,): cosine of each triangle; the one of all that it faces if there is no other.
    n_leaves = len(starts) - 1
    cones = np.zeros((2 * n_leaves, 9))
    if not len(triangles):
        return cones, np.zeros(0)
    normals = unit_normals(points[triangles])
    angles = _angles_around(normals, triangles, len(points))
    cones[:, 5:8] = 0.5 * (boxes[:, :3] + boxes[:, 3:])
    cones[:, 8] = 0.25 * np.sum((boxes[:, 3:] - boxes[:, :3]) ** 2, axis=1)
    n_boxes = n_leaves
    while n_boxes:
        first = starts[:: n_leaves // n_boxes]
        axes = np.add.reduceat(normals, first[:-1])
        axes /= np.maximum(np.linalg.norm(axes, axis=1), np.finfo(float).tiny)[:, None]
        offsets = np.arccos(np.clip(np.einsum("td,td->t", normals, np.repeat(axes, np.diff(first), axis=0)), -1.0, 1.0))
        widest, spread = (np.maximum.reduceat(part, first[:-1]) + MARGIN for part in (offsets + angles, offsets))
        narrow = np.flatnonzero((widest < WIDEST) & (widest + spread < 0.5 * np.pi))
        at = n_boxes + narrow
        cones[at, :3], cones[at, 3] = axes[narrow], np.cos(widest[narrow])
        cones[at, 4] = np.sin(widest[narrow]) * np.sqrt(cones[at, 8])
        n_boxes //= 2
    return cones, np.where(angles + MARGIN < WIDEST, np.cos(angles + MARGIN), -BEHIND)


def _angles_around(normals: np.ndarray, triangles: np.ndarray, n_points: int) -> np.ndarray:
    """Largest angle between each triangle and its neighbours that share corners; pi if some are missing."""
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def has_no_minimum(cones, box, px, py, pz):
    """Whether no vector from a ball to a point outside it is in its cone."""
    x, y, z = px - cones[box, 5], py - cones[box, 6], pz - cones[box, 7]
    along, beyond = cones[box, 0] * x + cones[box, 1] * y + cones[box, 2] * z, x * x + y * y + z * z - cones[box, 8]
    # the vector from the centre, plus or minus the angle that half the ball subtends
    return cones[box, 3] != 0.0 and beyond > 0.0 and along < cones[box, 3] * np.sqrt(beyond) - cones[box, 4]
