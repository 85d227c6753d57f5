"""Lines of surface points along the span of a section: one for each point of its curve.

A grid about a section lies between two planes of symmetry, and its surface is the same in all parallel planes.
Theory: ``docs/theory/parametrization.rst``, "Sections as one curve".
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...base.numerics.vectors import lengths

__all__ = ["span_lines"]

_ALIKE = 1e-6
"""Distance across the span, relative to the size of the surface, up to which points are at one place of the curve:
planes of one section from a single-precision file agree this well."""


def span_lines(
    points: np.ndarray,  # (n, 3), points of a surface (m)
    edges: np.ndarray,  # int (n_edges, 2), edges between them
    in_plane_rows: np.ndarray,  # int (m,), points in planes of symmetry, and the unit normal of the plane of each
    in_plane_normals: np.ndarray,  # (m, 3)
) -> np.ndarray | None:
    """Rows of points, shape (n_lines, n_planes), from plane to plane; None if the surface is not a section."""
    # One half of a symmetric section ends on its plane of symmetry as well: any of the normals may be along the span.
    while len(in_plane_rows):
        is_parallel = np.abs(in_plane_normals @ in_plane_normals[0]) > 1.0 - _ALIKE
        lines = _lines_along(points, edges, in_plane_normals[0], in_plane_rows[is_parallel])
        if lines is not None:
            return lines
        in_plane_rows, in_plane_normals = in_plane_rows[~is_parallel], in_plane_normals[~is_parallel]
    return None


def _lines_along(points: np.ndarray, edges: np.ndarray, span: np.ndarray, in_planes: np.ndarray) -> np.ndarray | None:
    """Lines along one normal, between planes of symmetry that contain some of the points."""
    # 1. Edges along the span join the points of a line.
    # 2. All lines have equally many points, their ends are in the planes, and each is at one place of the curve.
    near, places = _ALIKE * np.linalg.norm(np.ptp(points, axis=0)), points @ span
    flat = points - places[:, None] * span
    first, second = edges.T
    is_along = (lengths(flat[second] - flat[first]) <= near) & (np.abs(places[second] - places[first]) > near)
    joined = coo_array((np.ones(is_along.sum()), (first[is_along], second[is_along])), shape=(len(points),) * 2)
    n_lines, line = connected_components(joined, directed=False)  # step 1
    n_planes, rest = divmod(len(points), n_lines)
    if rest or n_planes < 2 or (np.bincount(line) != n_planes).any():
        return None
    lines = np.lexsort((places, line)).reshape(n_lines, n_planes)
    ends = lines[:, [0, -1]]
    has_one_place = (lengths(flat[lines] - flat[lines[:, :1]]) <= near).all()
    has_planes = (np.ptp(places[ends], axis=0) <= near).all() and np.isin(ends, in_planes).all()
    return lines[np.argsort(lines[:, 0])] if has_one_place and has_planes else None  # step 2
