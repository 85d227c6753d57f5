"""Faces and cells of an unstructured mesh, judged as OpenFOAM's ``checkMesh`` defines it.

- *Non-orthogonality* of an inner face: the angle between its area vector and the line between the centres of its two
  cells.
- *Skewness* of a face: the distance between its centre and the point where that line meets it, divided by the extent of
  the face from its centre in that direction, but at least by a fifth of the length of the line. At the boundary the
  line runs along the normal from the centre of the cell, and two fifths of its length count.
- *Face pyramids*: the pyramids from the centres of the cells of a face to it. A face is oriented wrongly if one of them
  has a negative volume.

The centre of a face is the area-weighted mean of the centres of the triangles around the mean of its corners. The
centre and the volume of a cell are computed from the pyramids around the mean of the centres of its faces. The average
angle is the angle of the mean cosine.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.display import OneLine
from .mixed_cells import MixedMesh, face_keys
from .polygons import polygon_geometry

__all__ = ["BEYOND", "SEVERE", "SKEWED", "MeshQuality", "mesh_quality"]

SEVERE, BEYOND, SKEWED = 70.0, 90.0, 4.0
"""Angles (deg) and skewness above which ``checkMesh`` counts a face: up to `BEYOND` as severe, then as an error."""

ROUNDED = 1e-15
"""Negative volume (m^3) of a pyramid that ``checkMesh`` tolerates, whatever the size of the mesh."""

INNER_PART, OUTER_PART = 0.2, 0.4
"""Fractions of the line through a face that are lower bounds of its extent, inside and at the boundary."""


@dataclass(frozen=True, eq=False)
class _Faces:
    """Faces of a mesh, each once."""

    corners: np.ndarray  # int (n_corners,), corners of all faces in sequence, around the normal out of `owner`
    starts: np.ndarray  # int (n_faces + 1,), first corner of each
    owner: np.ndarray  # int (n_faces,), the cell on one side
    neighbour: np.ndarray  # int (n_faces,), the cell on the other side; -1 for none


@dataclass(frozen=True, eq=False)
class MeshQuality(OneLine):
    """Measures of the faces and cells of a mesh."""

    volumes: np.ndarray  # (n_cells,), volumes (m^3), with faces cut into triangles around their means
    is_inverted: np.ndarray  # bool (n_cells,), see `CellQuality`
    angles: np.ndarray  # (n_inner,), non-orthogonality of the faces between two cells (deg)
    cell_angles: np.ndarray  # (n_cells,), largest angle of the faces of each cell (deg); 0 without neighbours
    mean_angle: float  # the angle of the mean cosine (deg); 0 if there is none
    skewness: np.ndarray  # (n_faces,), skewness of all faces
    middles: np.ndarray  # (n_cells, 3), centres of the cells (m)
    # (n_faces, 2), volumes of the pyramids from the centres of its cells to each face (m^3); 0 if there is no cell
    pyramids: np.ndarray

    @property
    def n_severe(self) -> int:
        """Faces whose non-orthogonality is above `SEVERE`, but not above `BEYOND`."""
        return int(((self.angles > SEVERE) & (self.angles <= BEYOND)).sum())

    @property
    def n_beyond(self) -> int:
        """Faces whose non-orthogonality is above `BEYOND`."""
        return int((self.angles > BEYOND).sum())

    @property
    def n_wrong_pyramids(self) -> int:
        """Pyramids whose volume is negative: ``checkMesh`` calls them faces, and may count a face twice."""
        return int((self.pyramids < -ROUNDED).sum())

    @property
    def n_wrong_faces(self) -> int:
        """Faces with such a pyramid."""
        return int((self.pyramids < -ROUNDED).any(axis=1).sum())

    @property
    def n_skewed(self) -> int:
        """Faces whose skewness is above `SKEWED`."""
        return int((self.skewness > SKEWED).sum())


def mesh_quality(mesh: MixedMesh, points: np.ndarray | None = None) -> MeshQuality:
    """Measure the faces and cells of a mesh, with other nodes if given, shape (n, 3)."""
    x = mesh.points if points is None else mesh.as_nodes(points)
    faces, is_inverted = _faces(mesh), mesh.quality(x).is_inverted
    centres, areas = polygon_geometry(x, faces.corners, faces.starts)
    middles, volumes = _cell_centres(centres, areas, faces.owner, faces.neighbour, mesh.n_cells)
    cosines, skewness, pyramids = (np.zeros((len(centres), *more)) for more in ((), (), (2,)))
    between = faces.owner, faces.neighbour
    _judge(x, faces.corners, faces.starts, *between, centres, areas, middles, cosines, skewness, pyramids)
    is_inner = faces.neighbour >= 0
    inner = cosines[is_inner]
    mean = float(np.degrees(np.arccos(np.clip(inner.mean(), -1.0, 1.0)))) if len(inner) else 0.0
    angles = np.degrees(np.arccos(np.clip(inner, -1.0, 1.0)))
    cell_angles = np.zeros(mesh.n_cells)
    for side in between:
        np.maximum.at(cell_angles, side[is_inner], angles)
    return MeshQuality(volumes, is_inverted, angles, cell_angles, mean, skewness, middles, pyramids)


def _faces(mesh: MixedMesh) -> _Faces:
    """Find the faces of a mesh, each once; pieces of a polygon are joined."""
    rows, cells = mesh.cell_faces
    _, ids = np.unique(face_keys(rows, mesh.n_points), return_inverse=True)
    ids = ids.ravel()
    if mesh.polyhedra is not None and mesh.polygons is not None:
        first = len(rows) - len(mesh.polygons)
        of_polygon = np.full(int(mesh.polygons.max(initial=-1)) + 1, len(rows))
        np.minimum.at(of_polygon, mesh.polygons, ids[first:])
        ids[first:] = of_polygon[mesh.polygons]
    order = np.argsort(ids, kind="stable")
    starts = np.flatnonzero(np.diff(ids[order], prepend=-1))
    n = len(starts)
    corners, ends = np.empty(4 * len(rows), dtype=np.int64), np.zeros(n + 1, dtype=np.int64)
    owner, neighbour = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    _loops(rows, cells, order, np.append(starts, len(rows)), corners, ends, owner, neighbour)
    return _Faces(corners[: ends[-1]], ends, owner, neighbour)


@njit(cache=True)
def _loops(rows, cells, order, starts, corners, ends, owner, neighbour):
    """Write the corners of faces that may be in pieces, and their cells, as seen from the first cell."""
    at = 0
    for f in range(len(owner)):
        owner[f], neighbour[f], first = cells[order[starts[f]]], -1, at
        is_turned = False
        for k in range(starts[f], starts[f + 1]):
            row = order[k]
            if cells[row] != owner[f]:
                neighbour[f] = cells[row]
                continue
            a, b, c, d = rows[row, 0], rows[row, 1], rows[row, 2], rows[row, 3]
            if a == b:  # a triangle seen from the other cell
                a, b, c, d, is_turned = d, c, a, a, True
            if at == first:
                corners[at], corners[at + 1], corners[at + 2] = a, b, c
                at += 3
            else:  # the next piece of a fan
                corners[at] = c
                at += 1
            if d != c:
                corners[at] = d
                at += 1
        if is_turned:
            for k in range((at - first) // 2):
                corners[first + k], corners[at - 1 - k] = corners[at - 1 - k], corners[first + k]
        ends[f + 1] = at


@njit(cache=True)
def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _cell_centres(
    centres: np.ndarray, areas: np.ndarray, owner: np.ndarray, neighbour: np.ndarray, n_cells: int
) -> tuple[np.ndarray, np.ndarray]:
    """Centres of cells, shape (n_cells, 3), and their volumes, shape (n_cells,)."""
    means, weights, counts = np.zeros((n_cells, 3)), np.zeros((n_cells, 4)), np.zeros(n_cells)
    _add_means(centres, owner, neighbour, means, counts)
    means /= np.maximum(counts, 1.0)[:, None]
    _add_pyramids(centres, areas, owner, neighbour, means, weights)
    is_solid = np.abs(weights[:, 3]) > 0.0
    means[is_solid] += weights[is_solid, :3] / weights[is_solid, 3:]
    return means, weights[:, 3] / 3.0


@njit(cache=True)
def _add_means(centres, owner, neighbour, means, counts):
    """Sum the centres of the faces of every cell."""
    for f in range(len(centres)):
        for at in (owner[f], neighbour[f]):
            if at >= 0:
                counts[at] += 1.0
                for d in range(3):
                    means[at, d] += centres[f, d]


@njit(cache=True)
def _add_pyramids(centres, areas, owner, neighbour, means, weights):
    """Sum volumes times centres, and volumes, of the pyramids to the faces of every cell."""
    for f in range(len(centres)):
        for at, sign in ((owner[f], 1.0), (neighbour[f], -1.0)):
            if at >= 0:
                volume = sign * (_dot(areas[f], centres[f]) - _dot(areas[f], means[at]))
                weights[at, 3] += volume
                for d in range(3):
                    weights[at, d] += volume * 0.75 * (centres[f, d] - means[at, d])


@njit(cache=True, error_model="numpy")
def _judge(x, corners, starts, owner, neighbour, centres, areas, middles, cosines, skewness, pyramids):
    """Write the cosine of the non-orthogonality, which is 1 at the boundary, skewness and pyramids of every face."""
    tiny = 1e-300  # for faces that have shrunk to a point
    line, to_face, off = np.empty(3), np.empty(3), np.empty(3)
    for f in range(len(owner)):
        area, is_inner = areas[f], neighbour[f] >= 0
        size = np.sqrt(_dot(area, area))
        for d in range(3):
            to_face[d] = centres[f, d] - middles[owner[f], d]
        height = _dot(area, to_face)
        pyramids[f, 0] = height / 3.0
        if is_inner:
            pyramids[f, 1] = (_dot(area, middles[neighbour[f]]) - _dot(area, centres[f])) / 3.0
        for d in range(3):
            line[d] = (
                middles[neighbour[f], d] - middles[owner[f], d] if is_inner else area[d] * height / max(size**2, tiny)
            )
        along, reach = _dot(area, line), np.sqrt(_dot(line, line))
        cosines[f] = along / max(reach * size, tiny) if is_inner else 1.0
        for d in range(3):
            off[d] = to_face[d] - line[d] * height / (along if abs(along) > tiny else tiny)
        length = np.sqrt(_dot(off, off))
        extent = max((INNER_PART if is_inner else OUTER_PART) * reach, tiny)
        if length > 0.0:
            for k in range(starts[f], starts[f + 1]):
                extent = max(extent, abs(_dot(off, x[corners[k]]) - _dot(off, centres[f])) / length)
        skewness[f] = length / extent
