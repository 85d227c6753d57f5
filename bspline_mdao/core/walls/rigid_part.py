"""The rigid motion nearest to a motion of points, in the least-squares sense, and its derivative.

Points x0 go to x. With the means m0 and m, and M = sum (x - m) (x0 - m0)^T, it is the rotation R nearest to M (see
`rotation_group`) and the shift m - R m0. Planes that have to stay where they are leave a rotation about the normal of
one plane, or none with several, and shifts along all of them.

P. H. Schoenemann, "A generalized solution of the orthogonal Procrustes problem", Psychometrika 31, 1966, pp. 1-10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...base.numerics.rotation_group import nearest_rotations, rotation_changes
from ...errors import MovementError
from .planes import MirrorMeans

__all__ = ["RigidMotion", "RigidPart"]

SAME_PLANE = 1e-4
"""Normals count as equal up to this angle (rad): planes in files are flat to single precision."""


@dataclass(frozen=True, eq=False)
class RigidPart(OneLine):
    """The map from moved points to the nearest rigid motion."""

    normals: np.ndarray  # (n_planes, 3), unit normals of planes that stay where they are

    @property
    def _along(self) -> np.ndarray:
        """Orthonormal directions in which nothing may shift, shape (m, 3)."""
        _, sizes, rows = np.linalg.svd(self.normals.reshape(-1, 3))
        return rows[: np.count_nonzero(sizes > SAME_PLANE)]

    def at(self, initial: np.ndarray, moved: np.ndarray) -> RigidMotion:
        """Nearest rigid motion of points, shape (n, 3), before and after (m)."""
        along = self._along
        arms = initial - initial.mean(axis=0), moved - moved.mean(axis=0)
        matrices, stiffness, is_fine = (arms[1].T @ arms[0])[None].copy(), np.empty((1, 3, 3)), np.ones(1, dtype=bool)
        mirrored = None
        if len(along) > 1:
            matrices[:], stiffness[:] = np.eye(3), np.eye(3)
        else:
            mirrored = MirrorMeans.of([(np.zeros(1, dtype=int), normal) for normal in along], None, matrices)
            nearest_rotations(matrices, stiffness, is_fine, (0, 1))
        if not is_fine[0]:
            raise MovementError("movement: the surface is turned inside out as a whole; take a smaller step")
        means = initial.mean(axis=0), moved.mean(axis=0)
        in_planes = np.eye(3) - along.T @ along
        shift = in_planes @ (means[1] - matrices[0] @ means[0])
        return RigidMotion(matrices[0], shift, arms, means[0], in_planes, stiffness, mirrored)


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A rigid motion ``x -> R x + shift``, and its derivative in the points that it was found from."""

    rotation: np.ndarray  # (3, 3), R
    shift: np.ndarray  # (3,), shift (m)
    # two of shape (n, 3), the points before and after, less their means (m)
    arms: tuple[np.ndarray, np.ndarray]
    mean: np.ndarray  # (3,), mean of the points before (m)
    in_planes: np.ndarray  # (3, 3), projector onto allowed shifts
    stiffness: np.ndarray  # (1, 3, 3), ``tr(S) I - S``, see `rotation_group`
    mirrored: MirrorMeans | None  # mean with the mirror image; None if nothing turns

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points, shape (n, 3)."""
        return points @ self.rotation.T + self.shift

    def undo(self, points: np.ndarray) -> np.ndarray:
        """Move points, shape (n, 3), back."""
        return (points - self.shift) @ self.rotation

    def jvp(self, d_initial: np.ndarray, d_moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of rotation and shift with changes of the points, each of shape (n, 3)."""
        change = np.zeros((1, 3, 3))
        if self.mirrored is not None:
            change[0] = d_moved.T @ self.arms[0] + self.arms[1].T @ d_initial  # arms sum to zero: means do not matter
            self.mirrored.jvp(change, None)
            rotation_changes(self.rotation[None], self.stiffness, change, (0, 1))
        d_shift = d_moved.mean(axis=0) - self.rotation @ d_initial.mean(axis=0) - change[0] @ self.mean
        return change[0], self.in_planes @ d_shift

    def vjp(self, rotation_bar: np.ndarray, shift_bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        n, shift_bar = len(self.arms[0]), self.in_planes @ shift_bar
        initial_bar = np.tile(-self.rotation.T @ shift_bar / n, (n, 1))
        moved_bar = np.tile(shift_bar / n, (n, 1))
        if self.mirrored is not None:
            bar = (rotation_bar - np.outer(shift_bar, self.mean))[None]
            rotation_changes(self.rotation[None], self.stiffness, bar, (0, 1))
            self.mirrored.vjp(bar)
            moved_bar += self.arms[0] @ bar[0].T
            initial_bar += self.arms[1] @ bar[0]
        return initial_bar, moved_bar
