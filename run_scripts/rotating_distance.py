"""Inverse distances with rotations, on all nodes of a grid: the method of most other tools, to compare with.

E. Luke, E. Collins and E. Blades, "A fast mesh deformation method using explicit interpolation", Journal of
Computational Physics 231, 2012, as IDWarp uses it: the nodes of the walls alone tell the others where to go, each by
its displacement and its rotation. All sums are direct.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from bspline_mdao import Grid, SurfaceGrid, fit_grid
from bspline_mdao.design.named_deformations import parse_deformation
from bspline_mdao.mesh.boundary import moving_mesh

REACH = 0.25
"""Part of the size of the walls within which they hold the nodes to them; IDWarp's default."""


@dataclass(frozen=True, eq=False)
class RotatingDistance:
    """A grid whose nodes follow those of its walls.

    Parameters
    ----------
    grid : Grid
        The grid, with patches.
    """

    grid: Grid

    @cached_property
    def _model(self):
        return fit_grid(self.grid)

    @cached_property
    def _surface(self) -> SurfaceGrid:
        return SurfaceGrid.of(self._model)

    def move(self, deformation: str) -> np.ndarray:
        """Nodes of the moved grid, shape (n_nodes, 3), in metres; the deformation is applied to the nodes of walls."""
        surface, nodes = self._surface, self.grid.to_vector().reshape(-1, 3)
        target = surface.points
        for point_map in parse_deformation(deformation, self._model, moving_mesh(self._model)).maps:
            target = point_map.apply(target)
        rotations, areas = turned(surface, target), areas_of(surface)
        centres, moved = surface.points, target
        for plane in surface.planes:
            mirror = np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal)
            shift = 2.0 * plane.offset * plane.normal
            centres, moved = (np.concatenate([x, x @ mirror + shift]) for x in (centres, moved))
            rotations = np.concatenate([rotations, mirror @ rotations @ mirror])
            areas = np.concatenate([areas, areas])
        size = float(np.linalg.norm(np.ptp(surface.points, axis=0)))
        new = _moved(nodes, centres, moved, np.ascontiguousarray(rotations), areas, size, REACH)
        new[surface.rows] = target
        return new


def corners_of(surface: SurfaceGrid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two tangents and the normal of every quad, shapes (n_quads, 3, 3), as columns, the normal as long as they are."""
    a, b, c, d = (points[surface.quads[:, n]] for n in range(4))
    along, across = (b + c - a - d) / 2.0, (c + d - a - b) / 2.0
    normal = np.cross(c - a, d - b) / 2.0
    length = np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    return np.stack([along, across, normal / np.maximum(length, 1e-300)], axis=2)


def turned(surface: SurfaceGrid, target: np.ndarray) -> np.ndarray:
    """Rotations of the nodes of a surface, shape (n, 3, 3): polar factors of the sums of those of their quads."""
    before, after = corners_of(surface, surface.points), corners_of(surface, target)
    sums = np.zeros((surface.n_points, 3, 3))
    lengths = np.maximum((before**2).sum(axis=1, keepdims=True), 1e-300)
    for n in range(4):
        np.add.at(sums, surface.quads[:, n], (after / lengths) @ before.transpose(0, 2, 1))
    left, _, right = np.linalg.svd(sums)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right


def areas_of(surface: SurfaceGrid) -> np.ndarray:
    """Share of the nodes in the area of the surface, shape (n,)."""
    areas = np.zeros(surface.n_points)
    a, b, c, d = (surface.points[surface.quads[:, n]] for n in range(4))
    quads = 0.125 * np.linalg.norm(np.cross(c - a, d - b), axis=1)
    for n in range(4):
        np.add.at(areas, surface.quads[:, n], quads)
    return areas


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(nodes, centres, moved, rotations, areas, size, reach):
    """Weighted means of the rigid motions of all centres."""
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
