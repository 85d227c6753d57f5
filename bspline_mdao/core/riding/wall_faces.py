"""The walls of an embedded mesh: its faces on the walls of the fitted grid.

A face of the mesh belongs to the nearest boundary face of the grid with the same orientation, if it is at most half the
width of either above or below it. A marker is a wall if most of its area belongs to walls; without markers every face
of the skin is treated separately.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.quads import area_vectors
from ...grids.topology.boundary_surface import BoundarySurface
from ..model.fitted_model import FittedModel

__all__ = ["GridBoundary", "WallFaces", "markers_mostly"]

N_NEAREST = 12
"""Number of boundary quads compared with a face: more than meet at an edge of a flat wall and a plane."""

ABOVE = 0.5
"""Distance of a face from the plane of its boundary quad, relative to the width of either, up to which it may belong to
it: two cuts of a round nose are an eighth of their width apart if that equals the radius."""


@dataclass(frozen=True, eq=False)
class GridBoundary:
    """Boundary quads of the fitted grid on the baseline. Made by `GridBoundary.of`."""

    tree: cKDTree  # their centres
    # sizes, widths: (n,), their longest diagonals, and their areas divided by these (m)
    sizes: np.ndarray
    widths: np.ndarray
    normals: np.ndarray  # (n, 3), their unit normals; zero without area
    is_wall: np.ndarray  # (n,) of bool, whether they are on a wall
    patch: np.ndarray  # (n,), their patch

    @classmethod
    def of(cls, model: FittedModel) -> GridBoundary:
        """Collect them from a fitted grid."""
        topology, nodes = model.topology, model.grid_map().nodes
        surface = BoundarySurface.of(topology, nodes, topology.boundary)
        x = nodes[surface.rows][surface.quads]
        sizes, widths, normals = _measured(x)
        kinds = np.array([face.kind == "wall" for face in topology.boundary])
        names = np.array([str(face.patch) for face in topology.boundary])
        face = surface.quad_faces
        return cls(cKDTree(x.mean(axis=1)), sizes, widths, normals, kinds[face], names[face])

    def size_at(self, points: np.ndarray) -> np.ndarray:
        """Size of the boundary quads next to points, shape (n,)."""
        return self.sizes[self.tree.query(points)[1]]

    def on_patches(self, points: np.ndarray, patches: Collection[str]) -> np.ndarray:
        """Whether wall points, shape (n, 3), are on some patches of walls."""
        walls = np.flatnonzero(self.is_wall)
        _, near = cKDTree(self.tree.data[walls]).query(points)
        return np.isin(self.patch[walls[near]], list(patches))

    def on_walls(self, x: np.ndarray) -> np.ndarray:
        """Whether faces by their corners, shape (n, 4, 3), are on walls."""
        return self._are_on(x, self.is_wall)

    def on_patch(self, x: np.ndarray, patch: str) -> np.ndarray:
        """Whether faces by their corners, shape (n, 4, 3), are on a patch, wall or not."""
        return self._are_on(x, self.patch == patch)

    def _are_on(self, x: np.ndarray, is_wanted: np.ndarray) -> np.ndarray:
        middles, (_, widths, normals) = x.mean(axis=1), _measured(x)
        k = min(N_NEAREST, len(self.sizes))
        distances, near = (part.reshape(len(x), k) for part in self.tree.query(middles, k))
        alike = np.abs(np.einsum("nkd,nd->nk", self.normals[near], normals))
        best = np.argmin(distances + self.sizes[near] * (1.0 - alike), axis=1)
        rows = np.arange(len(x))
        chosen = near[rows, best]
        off = np.abs(np.einsum("nd,nd->n", middles - self.tree.data[chosen], self.normals[chosen]))
        is_near = distances[rows, best] < 2.0 * self.sizes[chosen]
        is_near &= off < ABOVE * np.maximum(widths, self.widths[chosen])
        return is_wanted[chosen] & is_near


def _measured(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longest diagonals of quads by their corners, shape (n, 4, 3), areas divided by these, and unit normals."""
    # Normals are zero for quads without area. Area divided by diagonal is the width of a long quad, and less for a
    # square.
    areas = area_vectors(x)
    lengths = np.linalg.norm(areas, axis=1)
    normals = np.divide(areas, lengths[:, None], out=np.zeros_like(areas), where=lengths[:, None] > 0.0)
    sizes = np.maximum(np.linalg.norm(x[:, 2] - x[:, 0], axis=1), np.linalg.norm(x[:, 3] - x[:, 1], axis=1))
    return sizes, np.divide(lengths, sizes, out=np.zeros_like(sizes), where=sizes > 0.0), normals


@dataclass(frozen=True, eq=False)
class WallFaces(OneLine):
    """Faces of a mesh that are walls."""

    names: tuple[str, ...]  # markers that are walls; one, ``"skin"``, if there are no markers
    faces: np.ndarray  # (n, 4) of int, faces around the normal into the mesh
    marker: np.ndarray  # (n,) of int, marker of each

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,  # the mesh
        boundary: GridBoundary,  # boundary of the fitted grid
        wanted: Sequence[str] | None = None,  # markers, by name or pattern, instead of the found ones
    ) -> WallFaces:
        """Find them."""
        if not mesh.markers:
            if wanted:
                raise InputError(f"{mesh.source}: has no markers, so none is '{wanted[0]}'; leave the option out")
            skin = mesh.skin
            faces = skin[boundary.on_walls(mesh.points[skin])][:, ::-1]
            return cls(("skin",), faces, np.zeros(len(faces), dtype=int))
        names = cls._named(mesh, wanted) if wanted else cls._found(mesh, boundary)
        faces = [mesh.into_fluid(mesh.markers[name]) for name in names]
        marker = np.repeat(np.arange(len(names)), [len(part) for part in faces])
        return cls(names, np.concatenate([np.zeros((0, 4), dtype=int), *faces]), marker)

    @classmethod
    def none(cls) -> WallFaces:
        """No faces."""
        return cls((), np.zeros((0, 4), dtype=int), np.zeros(0, dtype=int))

    def followed_by(self, faces: Mapping[str, np.ndarray]) -> WallFaces:
        """These, followed by named other faces, each (n, 4) around the normal into the mesh."""
        numbers = len(self.names) + np.repeat(np.arange(len(faces)), [len(part) for part in faces.values()])
        return WallFaces(
            (*self.names, *faces),
            np.concatenate([self.faces, *faces.values()]),
            np.concatenate([self.marker, numbers]),
        )

    @staticmethod
    def _named(mesh: MixedMesh, wanted: Sequence[str]) -> tuple[str, ...]:
        markers = mesh.markers or {}
        for pattern in wanted:
            if not any(fnmatchcase(name, pattern) for name in markers):
                raise InputError(f"{mesh.source}: no marker is '{pattern}'; its markers are {', '.join(markers)}")
        return tuple(name for name in markers if any(fnmatchcase(name, pattern) for pattern in wanted))

    @staticmethod
    def _found(mesh: MixedMesh, boundary: GridBoundary) -> tuple[str, ...]:
        return markers_mostly(mesh, boundary.on_walls)


def markers_mostly(mesh: MixedMesh, is_on: Callable[[np.ndarray], np.ndarray]) -> tuple[str, ...]:
    """Markers of a mesh with most of their area on something, by their corners, shape (n, 4, 3)."""
    names = []
    for name, faces in (mesh.markers or {}).items():
        x = mesh.points[faces]
        areas = np.linalg.norm(area_vectors(x), axis=1)
        if len(faces) and areas[is_on(x)].sum() > 0.5 * areas.sum():
            names.append(name)
    return tuple(names)
