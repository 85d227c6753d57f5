"""Rotations of the surface from its points at rest to where they go, and how they fade out into the volume.

1. Every surface point takes the rotation that fits best what the quads around it do
   (`bspline_mdao.walls.rotations.LocalRotations`), as a vector that is continued along the surface.
2. The vectors are extended by the harmonic field of `bspline_mdao.movement.guided_gradients`: zero at fixed points, and
   along the normal where points slide in a plane, which then turn in it.

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh.control_net import surface_quads
from ..mesh.moving_mesh import MovingMesh
from ..walls.rotations import LocalRotations, Rotations
from .rotation_vectors import unwrapped, vectors_jvp, vectors_vjp

__all__ = ["SurfaceVectors", "directions_of_rotation", "surface_rotations"]

SAME_PLANE = 6
"""Decimals to which the normals of one plane agree."""


def surface_rotations(mesh: MovingMesh) -> LocalRotations:
    """What the rotation of each surface point is made of.

    What lies on two planes of symmetry never turns.
    """
    ids, normals = mesh.in_plane_rows, mesh.in_plane_normals
    planes, number = np.unique(np.round(normals * _sign(normals), SAME_PLANE), axis=0, return_inverse=True)
    number = number.ravel()
    rows, n_planes = np.unique(ids, return_counts=True)
    return LocalRotations.of(
        mesh.points[mesh.surface_ids],
        quads=surface_quads(mesh),
        planes=[(ids[number == k], normals[number == k][0]) for k in range(len(planes))],
        fixed=rows[n_planes > 1],
    )


def _sign(normals):
    """Sign of the largest component of each normal, shape (n, 1)."""
    largest = np.argmax(np.abs(normals), axis=1)[:, None]
    return np.sign(np.take_along_axis(normals, largest, axis=1))


def directions_of_rotation(mesh: MovingMesh) -> np.ndarray:
    """Directions, in the frame of each point, that it may turn about, bool, shape (n_points, 3).

    What moves freely turns freely, what slides in a plane turns about its normal, and all else does not turn.
    """
    n_free = mesh.is_free.sum(axis=1)[:, None]
    return (n_free == 3) | ((n_free == 2) & ~mesh.is_free)


@dataclass(frozen=True, eq=False)
class SurfaceVectors:
    """Rotation vectors of the surface points in one move, shape (n_surface, 3), and their derivative."""

    rotations: Rotations
    values: np.ndarray

    @classmethod
    def of(cls, local: LocalRotations, initial: np.ndarray, surface: np.ndarray) -> SurfaceVectors:
        """Vectors of a move of surface points, both of shape (n_surface, 3)."""
        rotations = local.at(initial, surface)
        return cls(rotations, unwrapped(rotations.matrices, local.starts, local.neighbours))

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the vectors."""
        return vectors_jvp(self.values, self.rotations.matrices, self.rotations.jvp(d_initial, d_surface))

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        return self.rotations.vjp(vectors_vjp(self.values, self.rotations.matrices, bar))
