"""Centres of faces and cells, and the sizes of cells in all directions, with their derivatives by the nodes.

The centre of a face of four corners is the centre of area of both its pairs of triangles, or the mean of its corners if
it has no area. With the centres c of a cell's faces and their area vectors S out of the cell, and the mean m of the
centres, the cell consists of the pyramids of its faces about m, whose volumes are v = S . (c - m) / 3: its centre is

    x = m + sum(0.75 v (c - m)) / sum(v) ,    or m where it has no volume,

and the sum of the squares of its three edges is ``2 sum((c - x) (c - x)^T)`` over its six faces.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, add_to, dot, less, row, scaled
from .face_centre import face_centre, has_diagonal
from .face_centre_derivatives import face_centre_jvp, face_centre_vjp

__all__ = [
    "cell_shapes",
    "cell_shapes_jvp",
    "cell_shapes_vjp",
    "face_centres",
    "face_centres_jvp",
    "face_centres_vjp",
]

SOLID = 1e-3
"""Volume of a cell, relative to its pyramids, above which it has a centre of volume."""


@njit(cache=True, error_model="numpy")
def face_centres(nodes, corners):
    """Centres of area and area vectors of faces, shapes (n_faces, 3), from corners, shape (n_faces, 4)."""
    # Real or complex.
    centres, areas = np.zeros((len(corners), 3), nodes.dtype), np.zeros((len(corners), 3), nodes.dtype)
    for f in range(len(corners)):
        a, b, c, d = _at(nodes, corners[f])
        if has_diagonal(a, b, c, d):
            centre, area = face_centre(a, b, c, d)
            add_to(centres, f, centre)
            add_to(areas, f, area)
        else:
            add_to(centres, f, _mean(a, b, c, d))
    return centres, areas


@njit(cache=True, error_model="numpy")
def face_centres_jvp(nodes, corners, d_nodes):
    """Change of the centres and area vectors with the nodes."""
    d_centres, d_areas = np.zeros((len(corners), 3)), np.zeros((len(corners), 3))
    for f in range(len(corners)):
        a, b, c, d = _at(nodes, corners[f])
        d_a, d_b, d_c, d_d = _at(d_nodes, corners[f])
        if has_diagonal(a, b, c, d):
            d_centre, d_area = face_centre_jvp(a, b, c, d, d_a, d_b, d_c, d_d)
            add_to(d_centres, f, d_centre)
            add_to(d_areas, f, d_area)
        else:
            add_to(d_centres, f, _mean(d_a, d_b, d_c, d_d))
    return d_centres, d_areas


@njit(cache=True, error_model="numpy")
def face_centres_vjp(nodes, corners, centres_bar, areas_bar):
    """Transposed product of `face_centres_jvp`, shape (n_nodes, 3)."""
    out = np.zeros_like(nodes)
    for f in range(len(corners)):
        a, b, c, d = _at(nodes, corners[f])
        if has_diagonal(a, b, c, d):
            bars = face_centre_vjp(a, b, c, d, (row(centres_bar, f), row(areas_bar, f)))
            for k in range(4):
                add_to(out, corners[f, k], bars[k])
        else:
            for k in range(4):
                add_to(out, corners[f, k], scaled(0.25, row(centres_bar, f)))
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _at(nodes, corners):
    """Four nodes."""
    return row(nodes, corners[0]), row(nodes, corners[1]), row(nodes, corners[2]), row(nodes, corners[3])


@njit(cache=True, error_model="numpy", inline="always")
def _mean(a, b, c, d):
    return scaled(0.25, add(add(a, b), add(c, d)))


@njit(cache=True, error_model="numpy")
def cell_shapes(centres, areas, left, right, n_cells):
    """Centres of cells, shape (n_cells, 3), and sums of the squares of their three edges, shape (n_cells, 3, 3)."""
    # From centres and area vectors of faces, real or complex.
    means, moments, volumes = _pyramids(centres, areas, left, right, n_cells)
    spreads = np.zeros((n_cells, 3, 3), centres.dtype)
    for cell in range(n_cells):
        if volumes[cell].real != 0.0:
            for d in range(3):
                means[cell, d] += moments[cell, d] / volumes[cell]
    for f in range(len(left)):
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            arm = less(row(centres, f), row(means, cell))
            for n in range(3):
                for m in range(3):
                    spreads[cell, n, m] += 2.0 * arm[n] * arm[m]
    return means, spreads


@njit(cache=True, error_model="numpy")
def cell_shapes_jvp(centres, areas, left, right, n_cells, d_centres, d_areas):
    """Change of the centres of cells and of the squares of their edges with the centres of their faces."""
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
            arm, d_arm = less(row(centres, f), row(means, cell)), less(row(d_centres, f), row(d_means, cell))
            volume = out * dot(row(areas, f), arm) / 3.0
            d_volume = out * (dot(row(d_areas, f), arm) + dot(row(areas, f), d_arm)) / 3.0
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
            arm, d_arm = less(row(centres, f), row(means, cell)), less(row(d_centres, f), row(d_means, cell))
            for n in range(3):
                for m in range(3):
                    d_spreads[cell, n, m] += 2.0 * (d_arm[n] * arm[m] + arm[n] * d_arm[m])
    return d_means, d_spreads


@njit(cache=True, error_model="numpy")
def cell_shapes_vjp(centres, areas, left, right, places_bar, spreads_bar):
    """Transposed product of `cell_shapes_jvp`: adjoints of the centres and the area vectors of faces, (n_faces, 3)."""
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
            arm = less(row(centres, f), row(means, cell))
            volume = out * dot(row(areas, f), arm) / 3.0
            volume_bar = volumes_bar[cell] + 0.75 * dot(row(moments_bar, cell), arm)
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
    """Means of the centres of the faces of cells, and moments and volumes of their pyramids about these."""
    # Volumes of cells without volume are zero to the last bit.
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
            arm = less(row(centres, f), row(means, cell))
            volume = out * dot(row(areas, f), arm) / 3.0
            volumes[cell] += volume
            sizes[cell] += abs(volume.real)
            for d in range(3):
                moments[cell, d] += 0.75 * volume * arm[d]
    for cell in range(n_cells):
        if not volumes[cell].real > SOLID * sizes[cell]:
            volumes[cell] = 0.0
    return means, moments, volumes
