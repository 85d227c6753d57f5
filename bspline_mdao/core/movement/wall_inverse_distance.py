"""Inverse distances with rotations, on all nodes of a grid: the method of most other tools, for comparison.

Only the nodes of the walls move the others, each by its displacement and its rotation:
``x_new = sum_i w_i (x_i_new + R_i (x - x_i)) / sum_i w_i`` with ``w_i = A_i (L / r)^3 (1 + reach^5 (L / r)^2)``, where
``r`` is the distance from the wall node, ``A_i`` its fraction of the area and ``L`` the size of the walls. All sums are
direct.

E. Luke, E. Collins and E. Blades, "A fast mesh deformation method using explicit interpolation", Journal of
Computational Physics 231, 2012, as implemented in IDWarp.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..mesh.surface import SurfaceGrid

__all__ = ["move_nodes"]


def move_nodes(nodes: np.ndarray, surface: SurfaceGrid, target: np.ndarray, reach: float = 0.25) -> np.ndarray:
    """Move all nodes of a grid with its wall nodes.

    Parameters
    ----------
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of the grid (m).
    surface : SurfaceGrid
        Its walls.
    target : ndarray, shape (surface.n_points, 3)
        New places of the nodes of the walls (m).
    reach : float
        Distance, relative to the size of the walls, within which nodes follow the nearest wall nodes; IDWarp's default.

    Returns
    -------
    ndarray, shape (n_nodes, 3)
        Moved nodes (m).

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.movers import move_nodes
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> nodes, surface = model.regenerate().to_vector().reshape(-1, 3), SurfaceGrid.of(model)
    >>> moved = move_nodes(nodes, surface, surface.points + [0.0, 0.01, 0.0])
    >>> bool(abs(moved[surface.rows] - surface.points - [0.0, 0.01, 0.0]).max() < 1e-10)
    True
    """
    rotations, areas = _rotations(surface, target), _areas(surface)
    centres, moved = surface.points, target
    for plane in surface.planes:  # mirror images in planes of symmetry count too
        mirror = np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal)
        shift = 2.0 * plane.offset * plane.normal
        centres, moved = (np.concatenate([x, x @ mirror + shift]) for x in (centres, moved))
        rotations = np.concatenate([rotations, mirror @ rotations @ mirror])
        areas = np.concatenate([areas, areas])
    size = float(np.linalg.norm(np.ptp(surface.points, axis=0)))
    new = _moved(nodes, centres, moved, np.ascontiguousarray(rotations), areas, size, reach)
    new[surface.rows] = target
    return new


def _frames(surface: SurfaceGrid, points: np.ndarray) -> np.ndarray:
    """Two tangents and a normal of the same length of every quad, shape (n_quads, 3, 3), as columns."""
    a, b, c, d = (points[surface.quads[:, n]] for n in range(4))
    along, across = (b + c - a - d) / 2.0, (c + d - a - b) / 2.0
    normal = np.cross(c - a, d - b) / 2.0
    length = np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    return np.stack([along, across, normal / np.maximum(length, 1e-300)], axis=2)  # a collapsed quad has no normal


def _rotations(surface: SurfaceGrid, target: np.ndarray) -> np.ndarray:
    """Rotations of the nodes of a surface, shape (n, 3, 3): polar factors of the sums over their quads."""
    before, after = _frames(surface, surface.points), _frames(surface, target)
    sums = np.zeros((surface.n_points, 3, 3))
    lengths = np.maximum((before**2).sum(axis=1, keepdims=True), 1e-300)
    for n in range(4):
        np.add.at(sums, surface.quads[:, n], (after / lengths) @ before.transpose(0, 2, 1))
    left, _, right = np.linalg.svd(sums)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right


def _areas(surface: SurfaceGrid) -> np.ndarray:
    """Area of the surface that belongs to each node, shape (n,)."""
    areas = np.zeros(surface.n_points)
    a, b, c, d = (surface.points[surface.quads[:, n]] for n in range(4))
    quads = 0.125 * np.linalg.norm(np.cross(c - a, d - b), axis=1)
    for n in range(4):
        np.add.at(areas, surface.quads[:, n], quads)
    return areas


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(nodes, centres, moved, rotations, areas, size, reach):
    """Weighted means of the rigid motions of all centres, at every node."""
    new = np.empty_like(nodes)
    for j in range(len(nodes)):
        x, y, z = nodes[j]
        total, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
        for i in range(len(centres)):
            dx, dy, dz = x - centres[i, 0], y - centres[i, 1], z - centres[i, 2]
            ratio = size * size / (dx * dx + dy * dy + dz * dz + 1e-24 * size * size)
            weight = areas[i] * ratio * np.sqrt(ratio) * (1.0 + reach**5 * ratio)
            turn = rotations[i]
            total += weight
            sx += weight * (moved[i, 0] + turn[0, 0] * dx + turn[0, 1] * dy + turn[0, 2] * dz)
            sy += weight * (moved[i, 1] + turn[1, 0] * dx + turn[1, 1] * dy + turn[1, 2] * dz)
            sz += weight * (moved[i, 2] + turn[2, 0] * dx + turn[2, 1] * dy + turn[2, 2] * dz)
        new[j, 0], new[j, 1], new[j, 2] = sx / total, sy / total, sz / total
    return new
