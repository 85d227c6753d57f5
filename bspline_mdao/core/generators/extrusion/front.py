"""The front of an extrusion: differences to neighbours, normals, areas, and cells between two fronts.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SMOOTH_MITRE, SHARP_MITRE = 1.2, 1.35
"""Mitres that separate smooth surfaces from edges. Up to the first, faces around a node are chords of a smooth surface,
turned by 67 degrees, whose height is along its normal. From the second, turned by 84 degrees, they meet in an edge, and
heights are above each of them."""

LARGEST_MITRE = 2.0
"""Largest move of a node where faces meet in an edge, relative to the step: 2, as at a wedge of 60 degrees."""


@njit(cache=True)
def differences(x, starts, nodes, image, maps, shifts):
    """Differences of all nodes to their neighbours, and their lengths: (n_neighbours, 3), (n_neighbours,)."""
    d = np.empty((len(nodes), 3))
    length = np.empty(len(nodes))
    for i in range(len(starts) - 1):
        for k in range(starts[i], starts[i + 1]):
            j, m = nodes[k], image[k]
            u, v, w = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            if m:
                u, v, w = (
                    maps[m, 0, 0] * u + maps[m, 0, 1] * v + maps[m, 0, 2] * w + shifts[m, 0],
                    maps[m, 1, 0] * u + maps[m, 1, 1] * v + maps[m, 1, 2] * w + shifts[m, 1],
                    maps[m, 2, 0] * u + maps[m, 2, 1] * v + maps[m, 2, 2] * w + shifts[m, 2],
                )
            d[k, 0], d[k, 1], d[k, 2] = u, v, w
            length[k] = math.sqrt(u * u + v * v + w * w)
    return d, length


@njit(cache=True, error_model="numpy")
def normals_and_areas(d, starts, is_edge):
    """Unit normals (n, 3), mitres (n,) and areas (n,) of nodes from the differences to their neighbours."""
    # Normals of the faces around a node are weighted by their angles there, so they do not depend on the sizes of the
    # faces. A step of mitre times s along the normal leaves the planes of the faces by s, on average. Inside smooth
    # surfaces a node leaves by s the plane normal to the sum of area vectors. Where ``is_edge`` (n,) faces count
    # separately.
    n = len(starts) - 1
    normals, mitres, areas = np.zeros((n, 3)), np.ones(n), np.zeros(n)
    for i in range(n):
        lo, hi = starts[i], starts[i + 1]
        sx = sy = sz = ax = ay = az = angles = area = 0.0
        for k in range(lo, hi):
            p = k + 1 if k + 1 < hi else lo
            cx = d[k, 1] * d[p, 2] - d[k, 2] * d[p, 1]
            cy = d[k, 2] * d[p, 0] - d[k, 0] * d[p, 2]
            cz = d[k, 0] * d[p, 1] - d[k, 1] * d[p, 0]
            size = math.sqrt(cx * cx + cy * cy + cz * cz)
            if size > 0.0:
                angle = math.atan2(size, d[k, 0] * d[p, 0] + d[k, 1] * d[p, 1] + d[k, 2] * d[p, 2])
                sx, sy, sz = sx + angle / size * cx, sy + angle / size * cy, sz + angle / size * cz
                ax, ay, az = ax + cx, ay + cy, az + cz
                angles += angle
                area += size
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        normals[i, 0], normals[i, 1], normals[i, 2] = sx / length, sy / length, sz / length
        mitre = min(angles / length, LARGEST_MITRE)
        edge = 1.0 if is_edge[i] else min(max((mitre - SMOOTH_MITRE) / (SHARP_MITRE - SMOOTH_MITRE), 0.0), 1.0)
        # the height above a smooth surface is measured along the sum of area vectors, see `FirstCells`
        slant = math.sqrt(ax * ax + ay * ay + az * az) * length / max(ax * sx + ay * sy + az * sz, 0.5 * area * length)
        mitres[i] = (1.0 - edge) * slant + edge * mitre
        areas[i] = area / ((hi - lo) * math.sin(2.0 * math.pi / (hi - lo)))
    return normals, mitres, areas


@njit(cache=True)
def smooth(values, starts, nodes, weight, cycles):
    """Blend values (n,) with the means of their neighbours, in place, for some cycles."""
    for _ in range(cycles):
        before = values.copy()
        for i in range(len(values)):
            total = 0.0
            for k in range(starts[i], starts[i + 1]):
                total += before[nodes[k]]
            values[i] = (1.0 - weight) * before[i] + weight * total / (starts[i + 1] - starts[i])


@njit(cache=True, error_model="numpy")
def smallest_corner(x, y, quads):
    """Smallest triple product of unit edges of the cells between two fronts, each (n, 3), and its quad."""
    # Corners with edges of zero length, at poles, are left out; NaN counts as the smallest.
    least, worst = np.inf, -1
    for q in range(len(quads)):
        for c in range(4):
            here, after, before = quads[q, c], quads[q, (c + 1) % 4], quads[q, (c + 3) % 4]
            if here in (after, before):
                continue
            ux, uy, uz = y[here, 0] - x[here, 0], y[here, 1] - x[here, 1], y[here, 2] - x[here, 2]
            height = math.sqrt(ux * ux + uy * uy + uz * uz)
            for layer in range(2):
                z = y if layer else x
                ax, ay, az = z[after, 0] - z[here, 0], z[after, 1] - z[here, 1], z[after, 2] - z[here, 2]
                bx, by, bz = z[before, 0] - z[here, 0], z[before, 1] - z[here, 1], z[before, 2] - z[here, 2]
                triple = ux * (ay * bz - az * by) + uy * (az * bx - ax * bz) + uz * (ax * by - ay * bx)
                a, b = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
                corner = triple / (height * a * b)
                if corner != corner:
                    return corner, q
                if corner < least:
                    least, worst = corner, q
    return least, worst
