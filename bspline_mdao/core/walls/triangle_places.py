"""Places of triangles that are closest to a point, and whether they are local minima of the distance.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .normal_cones import BEHIND

__all__ = ["SAME_DISTANCE", "closest_place", "is_minimum", "is_on_fluid_side", "way_from"]

SAME_DISTANCE = 1e-9
"""Distances that differ by less than this fraction are the same: round-off of coordinates decides."""


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def closest_place(points, triangles, t, x, y, z):
    """Squared distance of a point p from a triangle, and the barycentric coordinates of its closest point."""
    # C. Ericson, Real-Time Collision Detection (2005), section 5.1.5: regions of corners, edges and the face in order,
    # with exact zeros for corners that the point does not depend on.
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
    cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
    abx, aby, abz, acx, acy, acz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    apx, apy, apz, bpx, bpy, bpz = x - ax, y - ay, z - az, x - bx, y - by, z - bz
    cpx, cpy, cpz = x - cx, y - cy, z - cz
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    u, v, w = 0.0, 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        u = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        u = 1.0 - v
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        u = 1.0 - w
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
        u = 1.0 - v - w
    dx, dy, dz = way_from(points, triangles, t, u, v, w, x, y, z)
    return dx * dx + dy * dy + dz * dz, u, v, w


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def way_from(points, triangles, t, u, v, w, x, y, z):
    """The vector from a place of a triangle to a point."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return (
        x - (u * points[i, 0] + v * points[j, 0] + w * points[k, 0]),
        y - (u * points[i, 1] + v * points[j, 1] + w * points[k, 1]),
        z - (u * points[i, 2] + v * points[j, 2] + w * points[k, 2]),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def is_minimum(x, y, z, t, distance, u, v, w, points, triangles, planes, around_starts, around, round_off):
    """Whether the closest place of a triangle is a local minimum of the distance to all, seen from the fluid."""
    if not distance > round_off or not is_on_fluid_side(x, y, z, t, u, v, w, points, triangles, planes):
        return False
    if min(min(u, v), w) > 0.0:
        return True
    # on an edge or a corner: no other triangle there may be nearer
    near = max(distance * (1.0 - SAME_DISTANCE) - round_off, 0.0)
    verdict = _by_lines(x, y, z, t, near, u, v, w, points, triangles, around_starts, around)
    if verdict != 0:
        return verdict > 0
    first = _first_corner(triangles, t, u, v, w)
    for at in range(around_starts[first], around_starts[first + 1]):
        neighbour = np.int64(around[at])
        if not _has_place(triangles, neighbour, t, u, v, w):
            continue
        if np.sqrt(closest_place(points, triangles, neighbour, x, y, z)[0]) < near:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _by_lines(x, y, z, t, near, u, v, w, points, triangles, around_starts, around):
    """Whether lines from a place of a triangle to corners of others there lead nearer to a point than ``near``."""
    # -1 if one does, 1 if all lead away, and then no triangle there leads nearer; 0 if round-off decides. Of a hundred
    # places that are tried about a point, all but one are settled by their first lines.
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    px, py, pz = way_from(points, triangles, t, u, v, w, x, y, z)
    fx = u * points[i, 0] + v * points[j, 0] + w * points[k, 0]
    fy = u * points[i, 1] + v * points[j, 1] + w * points[k, 1]
    fz = u * points[i, 2] + v * points[j, 2] + w * points[k, 2]
    square, first, is_clear = px * px + py * py + pz * pz, _first_corner(triangles, t, u, v, w), True
    for at in range(around_starts[first], around_starts[first + 1]):
        neighbour = np.int64(around[at])
        if not _has_place(triangles, neighbour, t, u, v, w):
            continue
        for corner in range(3):
            m = triangles[neighbour, corner]
            if (m == i and u > 0.0) or (m == j and v > 0.0) or (m == k and w > 0.0):
                continue
            ex, ey, ez = points[m, 0] - fx, points[m, 1] - fy, points[m, 2] - fz
            along, length = ex * px + ey * py + ez * pz, ex * ex + ey * ey + ez * ez
            if along > 0.0:
                part = min(1.0, along / length)
                if square - part * (2.0 * along - part * length) < near * near:
                    return -1
                is_clear = False
    return 1 if is_clear else 0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _first_corner(triangles, t, u, v, w):
    """The corner with the largest weight, the first of equal ones."""
    if u >= v and u >= w:
        return triangles[t, 0]
    return triangles[t, 1] if v >= w else triangles[t, 2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _has_place(triangles, neighbour, t, u, v, w):
    """Whether a triangle has all corners that a place of another one depends on."""
    a, b, c = triangles[neighbour, 0], triangles[neighbour, 1], triangles[neighbour, 2]
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return (u <= 0.0 or i in (a, b, c)) and (v <= 0.0 or j in (a, b, c)) and (w <= 0.0 or k in (a, b, c))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def is_on_fluid_side(x, y, z, t, u, v, w, points, triangles, planes):
    """Whether a point is on the side of a triangle that its normal points to, seen from a place of the triangle."""
    dx, dy, dz = way_from(points, triangles, t, u, v, w, x, y, z)
    height = planes[t, 0, 0] * dx + planes[t, 0, 1] * dy + planes[t, 0, 2] * dz
    return height >= -BEHIND * np.sqrt(dx * dx + dy * dy + dz * dz)
