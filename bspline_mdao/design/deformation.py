"""A deformation of the surface points of a mesh: maps one after the other, planes of symmetry kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from ..errors import InputError
from ..mesh.frame import Plane
from ..mesh.mesh import MovingMesh
from ..movement.mover import PLANE_TOLERANCE
from .point_maps import PointMap, jvp, vjp

__all__ = ["Deformation", "planes_of"]


@dataclass(frozen=True, eq=False)
class Deformation:
    """New places for the surface points of a mesh.

    Parameters
    ----------
    mesh : MovingMesh
        Whose surface it is.
    maps : tuple of PointMap
        What is done to the points, one after the other.
    """

    mesh: MovingMesh
    maps: tuple[PointMap, ...]

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move surface points.

        Parameters
        ----------
        points : ndarray, shape (n_surface, 3)
            Surface points (m), in the order of ``mesh.surface_ids``.

        Returns
        -------
        ndarray, shape (n_surface, 3)
            Moved points (m). Those on planes of symmetry are exactly in them.

        Raises
        ------
        InputError
            If a shape is wrong, or a point leaves a plane of symmetry.
        """
        if points.shape != (len(self.mesh.surface_ids), 3):
            raise InputError(
                f"deformation: surface points of shape {points.shape}; give shape ({len(self.mesh.surface_ids)}, 3)"
            )
        moved = points
        for point_map in self.maps:
            moved = point_map.apply(moved)
        return self._keep_in_planes(points, moved)

    def apply_to_nodes(self, nodes: np.ndarray, planes: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> np.ndarray:
        """Move nodes of the surface as its control points are moved.

        Parameters
        ----------
        nodes : ndarray, shape (n, 3)
            Nodes of the surface (m), such as those of a `bspline_mdao.SurfaceGrid`.
        planes : sequence of (ndarray of int, ndarray of shape (3,))
            Nodes on planes of symmetry, and the planes' unit normals.

        Returns
        -------
        ndarray, shape (n, 3)
            Moved nodes (m). Those on the planes stay exactly in them.
        """
        displacement = reduce(lambda points, point_map: point_map.apply(points), self.maps, nodes) - nodes
        for ids, normal in planes:
            displacement[ids] -= np.outer(displacement[ids] @ normal, normal)
        return nodes + displacement

    def jvp(self, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Differentiate `apply` along a direction in the points, shape (n_surface, 3)."""
        d_moved = d_points
        for point_map in self.maps:
            points, d_moved = point_map.apply(points), jvp(point_map, points, d_moved)
        return d_points + self.slide(d_moved - d_points)

    def vjp(self, points: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: shape (n_surface, 3), of shape (n_surface, 3)."""
        before = [points]
        for point_map in self.maps[:-1]:
            before.append(point_map.apply(before[-1]))
        slid = self.slide(bar)
        points_bar = slid
        for point_map, at in zip(self.maps[::-1], before[::-1]):
            points_bar = vjp(point_map, at, points_bar)
        return points_bar + bar - slid

    def _keep_in_planes(self, points, moved):
        """Refuse to leave a plane of symmetry, and take off round-off."""
        rows, normals = self.mesh.rail_rows, self.mesh.rail_normals
        off = np.abs(np.sum((moved - points)[rows] * normals, axis=1))
        if len(rows) and off.max() > PLANE_TOLERANCE * self.mesh.size:
            point = self.mesh.surface_ids[rows[np.argmax(off)]]
            raise InputError(
                f"deformation: {self.mesh.place_of_point(point)} would leave its plane of symmetry by {off.max():.3g} "
                f"m; choose one that keeps the plane"
            )
        kept = moved.copy()
        kept[rows] = (points + self.slide(moved - points))[rows]
        return kept

    def slide(self, displacement: np.ndarray) -> np.ndarray:
        """Take the normal part off displacements (n_surface, 3) of points on planes of symmetry; its own transpose."""
        rows, normals = self.mesh.rail_rows, self.mesh.rail_normals
        slid = displacement.copy()
        np.subtract.at(slid, rows, np.sum(displacement[rows] * normals, axis=1)[:, None] * normals)
        return slid


def planes_of(mesh: MovingMesh) -> tuple[Plane, ...]:
    """Planes of symmetry that the surface of a mesh ends on; without one, the other planes in which points slide."""
    places = mesh.points[mesh.surface_ids[mesh.rail_rows]]
    found = list(zip(mesh.rail_normals, np.sum(places * mesh.rail_normals, axis=1)))
    planes: list[Plane] = []
    for normal, offset in found or mesh.planes:
        if not any(_coincide(plane, normal, offset, mesh.size) for plane in planes):
            planes.append(Plane(normal, float(offset)))
    return tuple(planes)


def _coincide(plane, normal, offset, size):
    """Whether a plane has this normal and offset but for round-off and sign."""
    sign = np.sign(plane.normal @ normal)
    is_parallel = np.abs(sign * normal - plane.normal).max() < 1e-6
    return is_parallel and abs(sign * offset - plane.offset) < 1e-6 * size
