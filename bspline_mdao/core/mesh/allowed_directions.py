"""Directions in which points of a mesh may move: everywhere, in planes, or nowhere.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.numerics.mean_planes import MeanPlane, mean_planes, near_enough
from ...base.numerics.vectors import is_line, nearest_plane
from ...errors import InputError
from ...grids.topology.periodic_ties import Ties

__all__ = ["AllowedDirections", "required_planes", "sliding_planes"]

INDEPENDENT = 1e-3
"""A normal counts if it leaves the span of the others by more than this, about 0.06 deg: more than the error of planes
in real grids, less than any corner between two planes."""


@dataclass(eq=False)
class AllowedDirections:
    """Directions in which points may move, gathered face by face."""

    # surface, fixed: (n_points,) of bool, points on the design surface, and points that may not move
    surface: np.ndarray
    fixed: np.ndarray
    n_normals: np.ndarray  # (n_points,) of int, number of directions in which each point may not move
    # (n_points, 3, 3), the first ``n_normals`` rows are these directions, orthonormal; the others are zero
    basis: np.ndarray

    @classmethod
    def of(cls, n_points: int) -> AllowedDirections:
        """Points all of which may move."""
        no = np.zeros(n_points, dtype=bool)
        return cls(no, no.copy(), np.zeros(n_points, dtype=np.int8), np.zeros((n_points, 3, 3)))

    def fix(self, ids: np.ndarray) -> None:
        """Fix points in all directions."""
        self.fixed[ids] = True

    def keep_in_plane(self, ids: np.ndarray, normal: np.ndarray) -> None:
        """Fix points in the direction of a unit normal, shape (3,), or of one per point, shape (n, 3)."""
        normals = np.broadcast_to(normal, (len(ids), 3))
        left = normals - np.einsum("nij,nik,nk->nj", self.basis[ids], self.basis[ids], normals)
        length = np.linalg.norm(left, axis=1)
        is_new = (length > INDEPENDENT) & (self.n_normals[ids] < 3)
        new = ids[is_new]
        self.basis[new, self.n_normals[new]] = left[is_new] / length[is_new, None]
        self.n_normals[new] += 1

    def tie(self, ties: Ties) -> Ties:
        """Fix in all points of a group what is fixed in one; return the groups on the surface and the others."""
        is_split = self.surface[ties.originals] != self.surface[ties.copies]
        ties = ties.without(ties.originals[is_split])
        ties.raise_alike(self.fixed)
        self._keep_in_planes(ties.on_axis, ties.across)
        for k in range(3):
            self._keep_in_planes(ties.originals, np.einsum("nji,nj->ni", ties.turns, self.basis[ties.copies, k]))
        for k in range(3):
            self._keep_in_planes(ties.copies, np.einsum("nij,nj->ni", ties.turns, self.basis[ties.originals, k]))
        return ties

    def _keep_in_planes(self, ids: np.ndarray, normals: np.ndarray) -> None:
        """Fix points in the directions of normals, shape (n, 3), that are not zero; repeated normals do no harm."""
        order = np.flatnonzero(normals.any(axis=1))
        order = order[np.argsort(ids[order], kind="stable")]
        _, starts, counts = np.unique(ids[order], return_index=True, return_counts=True)
        time = np.arange(len(order)) - np.repeat(starts, counts)
        for n in range(counts.max(initial=0)):
            self.keep_in_plane(ids[order[time == n]], normals[order[time == n]])

    def fields(self) -> dict[str, Any]:
        """Return the fields of a `bspline_mdao.core.mesh.moving_mesh.MovingMesh` that describe them, by name."""
        surface_ids = np.flatnonzero(self.surface).astype(np.int32)
        if not len(surface_ids):
            raise InputError("movement: no point is on the design surface; check the patches")
        counts = self.n_normals[surface_ids]
        in_plane_rows = np.repeat(np.arange(len(surface_ids), dtype=np.int32), counts)
        normals = np.concatenate([np.zeros(0, dtype=int), *(np.arange(n) for n in counts[counts > 0])])
        is_free, frames = self._directions()
        is_free[self.fixed | self.surface] = False
        return {
            "surface_ids": surface_ids,
            "is_free": is_free,
            "frames": frames,
            "in_plane_rows": in_plane_rows,
            "in_plane_normals": self.basis[surface_ids[in_plane_rows], normals],
        }

    def _directions(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Free directions: in coordinate axes if all normals are along axes, in frames otherwise."""
        if ((np.abs(self.basis) == 1.0).sum(axis=(1, 2)) == self.n_normals).all():
            return ~(self.basis != 0.0).any(axis=1), None
        _, _, rows = np.linalg.svd(self.basis)  # the rows of the normals' space come first, the null space last
        return np.arange(3) >= self.n_normals[:, None], rows


def required_planes(
    parts: Sequence[np.ndarray],  # points of each patch, shape (n, 3)
    whats: Sequence[str],  # names of the patches, for messages
    why: str = "is of kind symmetry",  # why they have to be planar
    advice: str = "mend the grid, or make its kind 'other'",  # what to do if one is not
) -> list[MeanPlane]:
    """Mean planes of patches that have to be planar up to their roughness; `InputError` if one is not."""
    planes, near = mean_planes(parts), near_enough(parts)
    for plane, what in zip(planes, whats):
        if plane.roughness > near:
            raise InputError(f"{what} {why}, but leaves its plane by {plane.roughness:.3g} m; {advice}")
    return planes


def sliding_planes(
    faces: Sequence[np.ndarray],  # of int, points of each face
    points: np.ndarray,  # (n_points, 3), all points (m)
    surface: np.ndarray,  # bool (n_points,), points on the design surface
) -> list[tuple[np.ndarray, float] | None]:  # unit normal and offset (m) of the plane of each face that slides
    """Faces that slide by default: planar ones that the design surface ends on, and faces in the same planes."""
    nearest = [nearest_plane(points[ids]) for ids in faces]
    is_planar = [
        distances.max() <= near and not is_line(points[ids]) for ids, (_, distances, near) in zip(faces, nearest)
    ]
    planes: list[tuple[np.ndarray, float] | None] = [None] * len(faces)
    for touched in (n for n, ids in enumerate(faces) if is_planar[n] and surface[ids].any()):
        normal, _, near = nearest[touched]
        plane = normal, float(normal @ points[faces[touched]].mean(axis=0))
        for n, ids in enumerate(faces):
            if is_planar[n] and np.abs(points[ids] @ normal - plane[1]).max() <= max(near, nearest[n][2]):
                planes[n] = plane
    return planes
