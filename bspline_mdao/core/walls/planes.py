"""Planes that nodes stay in: projectors onto them, unit normals as functions of points on them, and mirror images.

The area vector of a planar part of the boundary is a sum of half cross products of pairs of arms, each the difference
of two points: the diagonals of its quads or, since inner contributions cancel, the arms from one point to the ends of
the segments around its outline. Either is exact in coordinates that all points share. The normal is the area vector
divided by its length.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...grids.topology.node_numbering import NodesByRow

__all__ = ["MirrorMeans", "PlaneNormal", "projectors_of"]


@dataclass(frozen=True, eq=False)
class PlaneNormal:
    """Mean unit normal of a planar part of the boundary. Made by `of_quads` or `of_outline`."""

    # first, second: (2, n) of int, numbers of the points at which the two arms of every pair start and end
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def of_quads(cls, quads: np.ndarray) -> PlaneNormal:
        """Normal of quads, given by the numbers of their corners, shape (n, 4), all oriented alike."""
        return cls(quads[:, [0, 2]].T, quads[:, [1, 3]].T)

    @classmethod
    def of_outline(cls, faces: Sequence[np.ndarray]) -> PlaneNormal:
        """Normal of the outlines of faces, each the numbers of its points, shape (ni, nj), all oriented alike."""
        pairs = []
        for ids in faces:
            for side in (ids[:, 0], ids[-1, :], ids[::-1, -1], ids[0, ::-1]):
                pairs.append(np.stack([side[:-1], side[1:]]))
        starts, ends = np.concatenate(pairs, axis=1)
        origin = np.broadcast_to(starts[:1], starts.shape)
        return cls(np.stack([origin, starts]), np.stack([origin, ends]))

    @property
    def ids(self) -> np.ndarray:
        """Numbers of all points that the normal depends on, ascending."""
        return np.unique([self.first, self.second])

    def among(self, ids: np.ndarray) -> PlaneNormal:
        """The same normal with points renumbered by their places among ascending numbers."""
        return PlaneNormal(np.searchsorted(ids, self.first), np.searchsorted(ids, self.second))

    def area_vector(self, points: np.ndarray | NodesByRow) -> np.ndarray:
        """Integral of the normal over the part, shape (3,), for points of shape (n_points, 3), or the ones needed."""
        return 0.5 * np.cross(*self._arms(points)).sum(axis=0)

    def normal_and_area(self, points: np.ndarray) -> tuple[np.ndarray, float]:
        """Unit normal, shape (3,), and the length of the area vector; both 0 if the part is closed."""
        area = self.area_vector(points)
        length = np.sqrt(np.sum(area * area))
        return (area / length if length else area), length

    def normal(self, points: np.ndarray) -> np.ndarray:
        """Unit normal, shape (3,)."""
        return self.normal_and_area(points)[0]

    def normal_jvp(self, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the normal with the points: the area's change across the normal, divided by its length."""
        normal, length = self.normal_and_area(points)
        (u, v), (d_u, d_v) = self._arms(points), self._arms(d_points)
        d_area = 0.5 * (np.cross(d_u, v) + np.cross(u, d_v)).sum(axis=0)
        return (d_area - normal * (normal @ d_area)) / length

    def add_normal_vjp(self, points: np.ndarray, bar: np.ndarray, points_bar: np.ndarray) -> None:
        """Add the transpose of `normal_jvp` to ``points_bar``."""
        normal, length = self.normal_and_area(points)
        area_bar = 0.5 * (bar - normal * (normal @ bar)) / length
        u, v = self._arms(points)
        u_bar, v_bar = np.cross(v, area_bar), np.cross(area_bar, u)
        for at, part in zip((*self.first, *self.second), (-u_bar, u_bar, -v_bar, v_bar)):
            np.add.at(points_bar, at, part)

    def _arms(self, points: np.ndarray | NodesByRow) -> tuple[np.ndarray, np.ndarray]:
        (a, c), (b, d) = self.first, self.second
        return points[c] - points[a], points[d] - points[b]


@dataclass(frozen=True, eq=False)
class MirrorMeans:
    """Means of matrices and their mirror images, for points in planes of symmetry: M <- (M + H' M H) / 2."""

    # H = I - 2 n (x) n mirrors in a plane at rest, H' in the current plane.

    # tuple of (ndarray of int, ndarray of shape (3,)), points in planes, and the normals at rest. Planes that share
    # points are at right angles.
    planes: tuple[tuple[np.ndarray, np.ndarray], ...]
    normals: np.ndarray  # (n_planes, 3), normals now
    seen: tuple[np.ndarray, ...]  # each (n, 3, 3), M of the points of each plane before averaging

    @classmethod
    def of(
        cls, planes: Sequence[tuple[np.ndarray, np.ndarray]], normals: np.ndarray | None, matrices: np.ndarray
    ) -> MirrorMeans:
        """Replace matrices, shape (n, 3, 3), by the means with their mirror images, in place."""
        normals = np.reshape([n for _, n in planes], (-1, 3)) if normals is None else np.asarray(normals)
        if normals.shape != (len(planes), 3):
            raise InputError(f"rotations: normals of shape {normals.shape}; give shape ({len(planes)}, 3)")
        seen = []
        for (ids, at_rest), normal in zip(planes, normals):
            seen.append(matrices[ids])
            matrices[ids] = 0.5 * (seen[-1] + _mirror(normal) @ seen[-1] @ _mirror(at_rest))
        return cls(tuple(planes), normals, tuple(seen))

    def jvp(self, change: np.ndarray, d_normals: np.ndarray | None) -> None:
        """Turn the change of the matrices before averaging into the change of the means, in place."""
        for k, (ids, at_rest) in enumerate(self.planes):
            normal, change_seen = self.normals[k], change[ids]
            mean = 0.5 * (change_seen + _mirror(normal) @ change_seen @ _mirror(at_rest))
            if d_normals is not None:
                d_mirror = -2.0 * (np.outer(d_normals[k], normal) + np.outer(normal, d_normals[k]))
                mean = mean + 0.5 * d_mirror @ self.seen[k] @ _mirror(at_rest)
            change[ids] = mean

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, in place; returns the derivatives with respect to the normals."""
        normals_bar = np.zeros_like(self.normals, dtype=np.result_type(self.normals, bar))
        for k in range(len(self.planes) - 1, -1, -1):
            (ids, at_rest), normal = self.planes[k], self.normals[k]
            mirror_bar = 0.5 * np.einsum("nij,nkj->ik", bar[ids], self.seen[k] @ _mirror(at_rest))
            normals_bar[k] = -2.0 * (mirror_bar + mirror_bar.T) @ normal
            bar[ids] = 0.5 * (bar[ids] + _mirror(normal) @ bar[ids] @ _mirror(at_rest))
        return normals_bar


def projectors_of(planes: Sequence[tuple[np.ndarray, np.ndarray]], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Distinct projectors onto planes, shape (m, 3, 3), the first the identity, and the number for each point."""
    plane_of, found = np.zeros(n, dtype=np.int16), [np.eye(3)]
    for ids, normal in planes:
        normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        for number in np.unique(plane_of[ids]).tolist():
            plane_of[ids[plane_of[ids] == number]] = len(found)
            found.append(found[number] - np.outer(normal, normal @ found[number]))
    return np.array(found), plane_of


def _mirror(normal: np.ndarray) -> np.ndarray:
    """Matrix of the mirror image in a plane with a unit normal."""
    return np.eye(3) - 2.0 * np.outer(normal, normal)
