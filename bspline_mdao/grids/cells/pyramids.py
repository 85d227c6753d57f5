r"""Pyramids between the centres of cells and their faces: volumes, and products with their derivatives.

The centre c of a cell is the mean of the centres m of its faces, weighted by their areas \|a\|::

    v = a . (m - c) / 3 ,    c = sum |a| m / sum |a| .

Tetrahedra, pyramids, prisms, hexahedra and polyhedra are treated alike: a cell is inverted if one of its pyramids is
not positive. Faces are quads as in `.mixed_cells`; triangles repeat a corner. Pieces of a polygon make one pyramid
together.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.display import OneLine

__all__ = ["Pyramids", "middle_and_area"]


@dataclass(frozen=True, eq=False)
class Pyramids(OneLine):
    """Pyramids of all faces of cells at one set of nodes; made by `of`."""

    points: np.ndarray  # (n, 3), nodes (m)
    faces: np.ndarray  # int (n_faces, 4), around the outward normals of the cells
    cells: np.ndarray  # int (n_faces,), cell of each
    sums: np.ndarray  # (n_cells, 4), areas times centres, and areas, of the faces of each cell
    pyramid: np.ndarray | None = None  # int (n_faces,), pyramid of each, ascending; None if each has its own

    @classmethod
    def of(
        cls,
        points: np.ndarray,
        faces: np.ndarray,
        cells: np.ndarray,
        n_cells: int,
        pyramid: np.ndarray | None = None,
    ) -> Pyramids:
        """Find the centres of cells."""
        points, sums = np.ascontiguousarray(points), np.zeros((n_cells, 4))
        _add_middles(points, faces, cells, sums)
        return cls(points, faces, cells, sums, pyramid)

    @property
    def volumes(self) -> np.ndarray:
        """Volumes of the pyramids (m^3), shape (n_pyramids,)."""
        return self._whole(_volumes(self.points, self.faces, self.cells, self.sums))

    @property
    def of_cells(self) -> np.ndarray:
        """Sum and smallest of the volumes of the pyramids of each cell (m^3), shape (n_cells, 2)."""
        cells, volumes = self.cells, self.volumes
        if self.pyramid is not None:
            cells = np.empty_like(cells, shape=len(volumes))
            cells[self.pyramid] = self.cells
        return _sums_and_least(volumes, cells, len(self.sums))

    def jvp(self, d_points: np.ndarray) -> np.ndarray:
        """Change of the volumes, shape (n_pyramids,), with the nodes, shape (n, 3)."""
        d_points, d_sums = np.ascontiguousarray(d_points), np.zeros_like(self.sums)
        _add_middles_jvp(self.points, d_points, self.faces, self.cells, d_sums)
        return self._whole(_volumes_jvp(self.points, d_points, self.faces, self.cells, self.sums, d_sums))

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, from shape (n_pyramids,) to shape (n, 3)."""
        points_bar = np.zeros_like(self.points)
        of_faces = np.ascontiguousarray(bar if self.pyramid is None else bar[self.pyramid])
        _add_vjp(self.points, self.faces, self.cells, self.sums, of_faces, points_bar)
        return points_bar

    def _whole(self, pieces: np.ndarray) -> np.ndarray:
        """Sums over the pieces of each pyramid."""
        return pieces if self.pyramid is None else np.bincount(self.pyramid, pieces)


@njit(cache=True, error_model="numpy", forceinline=True)
def _corners(faces, f):
    """Corners of a face without a repeated one, and the weight of the last: zero for a triangle."""
    a, b, c, d = faces[f, 0], faces[f, 1], faces[f, 2], faces[f, 3]
    if a == b:
        return a, c, d, d, 0.0
    return a, b, c, d, 0.0 if c == d else 1.0


@njit(cache=True, error_model="numpy", forceinline=True)
def middle_and_area(x, faces, f):
    """Centre and area vector of a face."""
    p, q, r, s, last = _corners(faces, f)
    part = 1.0 / (3.0 + last)
    m0 = part * (x[p, 0] + x[q, 0] + x[r, 0] + last * x[s, 0])
    m1 = part * (x[p, 1] + x[q, 1] + x[r, 1] + last * x[s, 1])
    m2 = part * (x[p, 2] + x[q, 2] + x[r, 2] + last * x[s, 2])
    u0, u1, u2 = x[r, 0] - x[p, 0], x[r, 1] - x[p, 1], x[r, 2] - x[p, 2]
    v0, v1, v2 = x[s, 0] - x[q, 0], x[s, 1] - x[q, 1], x[s, 2] - x[q, 2]
    return m0, m1, m2, 0.5 * (u1 * v2 - u2 * v1), 0.5 * (u2 * v0 - u0 * v2), 0.5 * (u0 * v1 - u1 * v0)


@njit(cache=True, error_model="numpy", forceinline=True)
def _face_jvp(x, dx, faces, f):
    """Change of the centre and of the area vector of a face."""
    p, q, r, s, last = _corners(faces, f)
    part = 1.0 / (3.0 + last)
    m0 = part * (dx[p, 0] + dx[q, 0] + dx[r, 0] + last * dx[s, 0])
    m1 = part * (dx[p, 1] + dx[q, 1] + dx[r, 1] + last * dx[s, 1])
    m2 = part * (dx[p, 2] + dx[q, 2] + dx[r, 2] + last * dx[s, 2])
    u0, u1, u2 = x[r, 0] - x[p, 0], x[r, 1] - x[p, 1], x[r, 2] - x[p, 2]
    v0, v1, v2 = x[s, 0] - x[q, 0], x[s, 1] - x[q, 1], x[s, 2] - x[q, 2]
    f0, f1, f2 = dx[r, 0] - dx[p, 0], dx[r, 1] - dx[p, 1], dx[r, 2] - dx[p, 2]
    g0, g1, g2 = dx[s, 0] - dx[q, 0], dx[s, 1] - dx[q, 1], dx[s, 2] - dx[q, 2]
    a0 = 0.5 * (f1 * v2 - f2 * v1 + u1 * g2 - u2 * g1)
    a1 = 0.5 * (f2 * v0 - f0 * v2 + u2 * g0 - u0 * g2)
    a2 = 0.5 * (f0 * v1 - f1 * v0 + u0 * g1 - u1 * g0)
    return m0, m1, m2, a0, a1, a2


@njit(cache=True, error_model="numpy", forceinline=True)
def _area(sums):
    """Area of the faces of a cell; a small number if it has shrunk to a point."""
    return max(sums, 1e-300)


@njit(cache=True, error_model="numpy")
def _add_middles(x, faces, cells, sums):
    """Sum areas times centres, and areas, of the faces of every cell, shape (n_cells, 4)."""
    for f in range(len(faces)):
        m0, m1, m2, a0, a1, a2 = middle_and_area(x, faces, f)
        area, at = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2), cells[f]
        sums[at, 0] += area * m0
        sums[at, 1] += area * m1
        sums[at, 2] += area * m2
        sums[at, 3] += area


@njit(cache=True, error_model="numpy")
def _add_middles_jvp(x, dx, faces, cells, d_sums):
    for f in range(len(faces)):
        m0, m1, m2, a0, a1, a2 = middle_and_area(x, faces, f)
        d0, d1, d2, b0, b1, b2 = _face_jvp(x, dx, faces, f)
        area, at = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2), cells[f]
        d_area = (a0 * b0 + a1 * b1 + a2 * b2) / _area(area)
        d_sums[at, 0] += d_area * m0 + area * d0
        d_sums[at, 1] += d_area * m1 + area * d1
        d_sums[at, 2] += d_area * m2 + area * d2
        d_sums[at, 3] += d_area


@njit(cache=True, error_model="numpy")
def _volumes(x, faces, cells, sums):
    volumes = np.empty(len(faces))
    for f in range(len(faces)):
        m0, m1, m2, a0, a1, a2 = middle_and_area(x, faces, f)
        at = cells[f]
        area = _area(sums[at, 3])
        volumes[f] = (
            a0 * (m0 - sums[at, 0] / area) + a1 * (m1 - sums[at, 1] / area) + a2 * (m2 - sums[at, 2] / area)
        ) / 3.0
    return volumes


@njit(cache=True, error_model="numpy")
def _sums_and_least(volumes, cells, n_cells):
    found = np.zeros((n_cells, 2))
    found[:, 1] = np.inf
    for f in range(len(volumes)):
        found[cells[f], 0] += volumes[f]
        found[cells[f], 1] = min(found[cells[f], 1], volumes[f])
    return found


@njit(cache=True, error_model="numpy")
def _volumes_jvp(x, dx, faces, cells, sums, d_sums):
    changes = np.empty(len(faces))
    for f in range(len(faces)):
        m0, m1, m2, a0, a1, a2 = middle_and_area(x, faces, f)
        d0, d1, d2, b0, b1, b2 = _face_jvp(x, dx, faces, f)
        at = cells[f]
        area, d_area = _area(sums[at, 3]), d_sums[at, 3]
        c0, c1, c2 = sums[at, 0] / area, sums[at, 1] / area, sums[at, 2] / area
        e0, e1, e2 = (
            (d_sums[at, 0] - c0 * d_area) / area,
            (d_sums[at, 1] - c1 * d_area) / area,
            (d_sums[at, 2] - c2 * d_area) / area,
        )
        changes[f] = (
            b0 * (m0 - c0) + b1 * (m1 - c1) + b2 * (m2 - c2) + a0 * (d0 - e0) + a1 * (d1 - e1) + a2 * (d2 - e2)
        ) / 3.0
    return changes


@njit(cache=True, error_model="numpy")
def _add_vjp(x, faces, cells, sums, bar, x_bar):
    """Add the adjoint of the nodes from the volumes: first through the centres of cells, then through the faces."""
    middles_bar = np.zeros((len(sums), 3))
    for f in range(len(faces)):
        _, _, _, a0, a1, a2 = middle_and_area(x, faces, f)
        at, weight = cells[f], bar[f] / 3.0
        middles_bar[at, 0] -= weight * a0
        middles_bar[at, 1] -= weight * a1
        middles_bar[at, 2] -= weight * a2
    for f in range(len(faces)):
        m0, m1, m2, a0, a1, a2 = middle_and_area(x, faces, f)
        at, weight = cells[f], bar[f] / 3.0
        area, length = _area(sums[at, 3]), np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
        o0, o1, o2 = m0 - sums[at, 0] / area, m1 - sums[at, 1] / area, m2 - sums[at, 2] / area
        s0, s1, s2 = middles_bar[at, 0] / area, middles_bar[at, 1] / area, middles_bar[at, 2] / area
        along = (s0 * o0 + s1 * o1 + s2 * o2) / _area(length)
        n0, n1, n2 = weight * o0 + along * a0, weight * o1 + along * a1, weight * o2 + along * a2
        k0, k1, k2 = weight * a0 + length * s0, weight * a1 + length * s1, weight * a2 + length * s2
        p, q, r, s, last = _corners(faces, f)
        u0, u1, u2 = x[r, 0] - x[p, 0], x[r, 1] - x[p, 1], x[r, 2] - x[p, 2]
        v0, v1, v2 = x[s, 0] - x[q, 0], x[s, 1] - x[q, 1], x[s, 2] - x[q, 2]
        f0, f1, f2 = 0.5 * (v1 * n2 - v2 * n1), 0.5 * (v2 * n0 - v0 * n2), 0.5 * (v0 * n1 - v1 * n0)
        g0, g1, g2 = 0.5 * (n1 * u2 - n2 * u1), 0.5 * (n2 * u0 - n0 * u2), 0.5 * (n0 * u1 - n1 * u0)
        part = 1.0 / (3.0 + last)
        x_bar[p, 0] += part * k0 - f0
        x_bar[p, 1] += part * k1 - f1
        x_bar[p, 2] += part * k2 - f2
        x_bar[r, 0] += part * k0 + f0
        x_bar[r, 1] += part * k1 + f1
        x_bar[r, 2] += part * k2 + f2
        x_bar[q, 0] += part * k0 - g0
        x_bar[q, 1] += part * k1 - g1
        x_bar[q, 2] += part * k2 - g2
        x_bar[s, 0] += last * part * k0 + g0
        x_bar[s, 1] += last * part * k1 + g1
        x_bar[s, 2] += last * part * k2 + g2
