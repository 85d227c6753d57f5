"""Centres of faces and cells, and the sizes of cells in all directions, with their derivatives by the nodes.

The centre of a face of four corners is that of the areas of both its pairs of triangles, the mean of its corners where
it has no area. With the centres c of a cell's faces and their area vectors S out of the cell, and the mean m of the
centres, the cell consists of the pyramids of its faces about m, whose volumes are v = S . (c - m) / 3: its centre is

    x = m + sum(0.75 v (c - m)) / sum(v) ,    or m where it has no volume,

and the sum of the squares of its three edges is ``2 sum((c - x) (c - x)^T)`` over its six faces.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = [
    "cell_shapes",
    "cell_shapes_jvp",
    "cell_shapes_vjp",
    "face_centres",
    "face_centres_jvp",
    "face_centres_vjp",
]

FLAT = 1e-8
"""Area of a triangle by the squares of its face's diagonals from which on it counts: roots are smooth at none."""

SOLID = 1e-3
"""Volume of a cell by those of its pyramids from which on it has a centre of volume."""

TRIANGLES = ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3))
"""Corners of the triangles of both ways to halve a face; the first two have its area vector."""


@njit(cache=True, error_model="numpy")
def face_centres(nodes, corners):
    """Centres of area and area vectors of faces, shapes (n_faces, 3), of corners, shape (n_faces, 4).

    Real or complex.
    """
    centres, areas = np.zeros((len(corners), 3), nodes.dtype), np.zeros((len(corners), 3), nodes.dtype)
    for f in range(len(corners)):
        square, _ = _diagonals(nodes, nodes, corners[f])
        total = 0.0 * square
        for t in range(4):
            a, b, c = corners[f, TRIANGLES[t][0]], corners[f, TRIANGLES[t][1]], corners[f, TRIANGLES[t][2]]
            n = _normal(_less(nodes[b], nodes[a]), _less(nodes[c], nodes[a]))
            p = np.sqrt(_dot(n, n) + FLAT**2 * square * square)
            total += p
            for d in range(3):
                centres[f, d] += p * (nodes[a, d] + nodes[b, d] + nodes[c, d])
                if t < 2:
                    areas[f, d] += n[d]
        for d in range(3):
            if total.real > 0.0:
                centres[f, d] /= 3.0 * total
            else:
                centres[f, d] = 0.25 * (
                    nodes[corners[f, 0], d]
                    + nodes[corners[f, 1], d]
                    + nodes[corners[f, 2], d]
                    + nodes[corners[f, 3], d]
                )
    return centres, areas


@njit(cache=True, error_model="numpy")
def face_centres_jvp(nodes, corners, d_nodes):
    """Change of the centres and area vectors with the nodes."""
    d_centres, d_areas = np.zeros((len(corners), 3)), np.zeros((len(corners), 3))
    first, change = np.zeros(3), np.zeros(3)
    for f in range(len(corners)):
        square, d_square = _diagonals(nodes, d_nodes, corners[f])
        total = d_total = 0.0
        first[:], change[:] = 0.0, 0.0
        for t in range(4):
            a, b, c = corners[f, TRIANGLES[t][0]], corners[f, TRIANGLES[t][1]], corners[f, TRIANGLES[t][2]]
            u, v = _less(nodes[b], nodes[a]), _less(nodes[c], nodes[a])
            du, dv = _less(d_nodes[b], d_nodes[a]), _less(d_nodes[c], d_nodes[a])
            n, one, other = _normal(u, v), _normal(du, v), _normal(u, dv)
            p = np.sqrt(_dot(n, n) + FLAT**2 * square * square)
            dp = 0.0
            if p > 0.0:
                dp = (_dot(n, one) + _dot(n, other) + FLAT**2 * square * d_square) / p
            total += p
            d_total += dp
            for d in range(3):
                reach = nodes[a, d] + nodes[b, d] + nodes[c, d]
                first[d] += p * reach
                change[d] += dp * reach + p * (d_nodes[a, d] + d_nodes[b, d] + d_nodes[c, d])
                if t < 2:
                    d_areas[f, d] += one[d] + other[d]
        for d in range(3):
            if total > 0.0:
                d_centres[f, d] = (change[d] - first[d] * d_total / total) / (3.0 * total)
            else:
                for k in range(4):
                    d_centres[f, d] += 0.25 * d_nodes[corners[f, k], d]
    return d_centres, d_areas


@njit(cache=True, error_model="numpy")
def face_centres_vjp(nodes, corners, centres, centres_bar, areas_bar):
    """Transposed product of `face_centres_jvp`, shape (n_nodes, 3)."""
    out, n_bar = np.zeros_like(nodes), np.zeros(3)
    for f in range(len(corners)):
        square, _ = _diagonals(nodes, nodes, corners[f])
        total = 0.0
        for t in range(4):
            a, b, c = corners[f, TRIANGLES[t][0]], corners[f, TRIANGLES[t][1]], corners[f, TRIANGLES[t][2]]
            n = _normal(_less(nodes[b], nodes[a]), _less(nodes[c], nodes[a]))
            total += np.sqrt(_dot(n, n) + FLAT**2 * square * square)
        if not total > 0.0:
            for k in range(4):
                for d in range(3):
                    out[corners[f, k], d] += 0.25 * centres_bar[f, d]
        square_bar = 0.0
        for t in range(4):
            a, b, c = corners[f, TRIANGLES[t][0]], corners[f, TRIANGLES[t][1]], corners[f, TRIANGLES[t][2]]
            u, v = _less(nodes[b], nodes[a]), _less(nodes[c], nodes[a])
            n = _normal(u, v)
            p = np.sqrt(_dot(n, n) + FLAT**2 * square * square)
            p_bar = 0.0
            for d in range(3):
                n_bar[d] = areas_bar[f, d] if t < 2 else 0.0
                if p > 0.0:
                    weight = centres_bar[f, d] / (3.0 * total)
                    p_bar += weight * (nodes[a, d] + nodes[b, d] + nodes[c, d] - 3.0 * centres[f, d])
                    out[a, d] += p * weight
                    out[b, d] += p * weight
                    out[c, d] += p * weight
            if p > 0.0:
                square_bar += p_bar * FLAT**2 * square / p
                for d in range(3):
                    n_bar[d] += p_bar * n[d] / p
            u_bar, v_bar = _normal(v, n_bar), _normal(n_bar, u)
            for d in range(3):
                out[b, d] += u_bar[d]
                out[c, d] += v_bar[d]
                out[a, d] -= u_bar[d] + v_bar[d]
        for k in range(2):
            a, c = corners[f, k], corners[f, k + 2]
            for d in range(3):
                push = 2.0 * square_bar * (nodes[c, d] - nodes[a, d])
                out[c, d] += push
                out[a, d] -= push
    return out


@njit(cache=True, error_model="numpy")
def cell_shapes(centres, areas, left, right, n_cells):
    """Centres of cells, shape (n_cells, 3), and sums of the squares of their three edges, shape (n_cells, 3, 3).

    Of centres and area vectors of faces, real or complex.
    """
    means, moments, volumes = _pyramids(centres, areas, left, right, n_cells)
    spreads = np.zeros((n_cells, 3, 3), centres.dtype)
    for cell in range(n_cells):
        if volumes[cell].real != 0.0:
            for d in range(3):
                means[cell, d] += moments[cell, d] / volumes[cell]
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            arm = _less(centres[f], means[cell])
            for n in range(3):
                for m in range(3):
                    spreads[cell, n, m] += 2.0 * arm[n] * arm[m]
    return means, spreads


@njit(cache=True, error_model="numpy")
def cell_shapes_jvp(centres, areas, left, right, n_cells, d_centres, d_areas):
    """Change of the centres of cells and of the squares of their edges with those of their faces."""
    means, moments, volumes = _pyramids(centres, areas, left, right, n_cells)
    d_means, counts = np.zeros((n_cells, 3)), np.zeros(n_cells)
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            d_means[cell] += d_centres[f]
            counts[cell] += 1.0
    for cell in range(n_cells):
        d_means[cell] /= max(counts[cell], 1.0)
    d_moments, d_volumes = np.zeros((n_cells, 3)), np.zeros(n_cells)
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell, out = (left[f], 1.0) if side == 0 else (right[f], -1.0)
            arm, d_arm = _less(centres[f], means[cell]), _less(d_centres[f], d_means[cell])
            volume = out * _dot(areas[f], arm) / 3.0
            d_volume = out * (_dot(d_areas[f], arm) + _dot(areas[f], d_arm)) / 3.0
            d_volumes[cell] += d_volume
            for d in range(3):
                d_moments[cell, d] += 0.75 * (d_volume * arm[d] + volume * d_arm[d])
    d_spreads = np.zeros((n_cells, 3, 3))
    for cell in range(n_cells):
        if volumes[cell] != 0.0:
            for d in range(3):
                off = moments[cell, d] / volumes[cell]
                means[cell, d] += off
                d_means[cell, d] += (d_moments[cell, d] - off * d_volumes[cell]) / volumes[cell]
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            arm, d_arm = _less(centres[f], means[cell]), _less(d_centres[f], d_means[cell])
            for n in range(3):
                for m in range(3):
                    d_spreads[cell, n, m] += 2.0 * (d_arm[n] * arm[m] + arm[n] * d_arm[m])
    return d_means, d_spreads


@njit(cache=True, error_model="numpy")
def cell_shapes_vjp(centres, areas, left, right, places_bar, spreads_bar):
    """Transposed product of `cell_shapes_jvp`: what the centres and the area vectors of faces get, (n_faces, 3)."""
    n_cells = len(places_bar)
    means, moments, volumes = _pyramids(centres, areas, left, right, n_cells)
    centres_bar, areas_bar = np.zeros_like(centres), np.zeros_like(centres)
    means_bar, counts = places_bar.copy(), np.zeros(n_cells)
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            counts[cell] += 1.0
            for n in range(3):
                for m in range(3):
                    arm = centres[f, m] - means[cell, m]
                    if volumes[cell] != 0.0:
                        arm -= moments[cell, m] / volumes[cell]
                    push = 2.0 * (spreads_bar[cell, n, m] + spreads_bar[cell, m, n]) * arm
                    centres_bar[f, n] += push
                    means_bar[cell, n] -= push
    moments_bar, volumes_bar = np.zeros((n_cells, 3)), np.zeros(n_cells)
    for cell in range(n_cells):
        if volumes[cell] != 0.0:
            for d in range(3):
                moments_bar[cell, d] = means_bar[cell, d] / volumes[cell]
                volumes_bar[cell] -= moments_bar[cell, d] * moments[cell, d] / volumes[cell]
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell, out = (left[f], 1.0) if side == 0 else (right[f], -1.0)
            arm = _less(centres[f], means[cell])
            volume = out * _dot(areas[f], arm) / 3.0
            volume_bar = volumes_bar[cell] + 0.75 * _dot(moments_bar[cell], arm)
            for d in range(3):
                arm_bar = 0.75 * volume * moments_bar[cell, d] + volume_bar * out * areas[f, d] / 3.0
                areas_bar[f, d] += volume_bar * out * arm[d] / 3.0
                centres_bar[f, d] += arm_bar
                means_bar[cell, d] -= arm_bar
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            centres_bar[f] += means_bar[cell] / counts[cell]
    return centres_bar, areas_bar


@njit(cache=True, error_model="numpy")
def _pyramids(centres, areas, left, right, n_cells):
    """Means of the centres of the faces of cells, and moments and volumes of their pyramids about these.

    Volumes of cells that have none are zero to the last bit.
    """
    means, counts = np.zeros((n_cells, 3), centres.dtype), np.zeros(n_cells)
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            means[cell] += centres[f]
            counts[cell] += 1.0
    for cell in range(n_cells):
        means[cell] /= max(counts[cell], 1.0)
    moments, volumes = np.zeros((n_cells, 3), centres.dtype), np.zeros(n_cells, centres.dtype)
    sizes = np.zeros(n_cells)
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell, out = (left[f], 1.0) if side == 0 else (right[f], -1.0)
            arm = _less(centres[f], means[cell])
            volume = out * _dot(areas[f], arm) / 3.0
            volumes[cell] += volume
            sizes[cell] += abs(volume.real)
            for d in range(3):
                moments[cell, d] += 0.75 * volume * arm[d]
    for cell in range(n_cells):
        if not volumes[cell].real > SOLID * sizes[cell]:
            volumes[cell] = 0.0
    return means, moments, volumes


@njit(cache=True, error_model="numpy", inline="always")
def _diagonals(nodes, d_nodes, corners):
    """Sum of the squares of the diagonals of a face, and its change."""
    square, change = 0.0 * nodes[0, 0], 0.0 * d_nodes[0, 0]
    for k in range(2):
        for d in range(3):
            side = nodes[corners[k + 2], d] - nodes[corners[k], d]
            square += side * side
            change += 2.0 * side * (d_nodes[corners[k + 2], d] - d_nodes[corners[k], d])
    return square, change


@njit(cache=True, error_model="numpy", inline="always")
def _less(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy", inline="always")
def _normal(u, v):
    """Half the cross product."""
    return (
        0.5 * (u[1] * v[2] - u[2] * v[1]),
        0.5 * (u[2] * v[0] - u[0] * v[2]),
        0.5 * (u[0] * v[1] - u[1] * v[0]),
    )
