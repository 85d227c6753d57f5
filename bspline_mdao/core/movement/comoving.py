"""Outer boundaries that follow the rigid part of the surface's motion.

A section that pitches by 45 degrees within a fixed far field shears the whole grid; nothing is sheared if the far field
pitches as well. So the move is made in a frame that follows the surface. The rigid motion nearest to the surface's own
(`bspline_mdao.core.walls.rigid_part`) is removed, any mover makes the remaining move with all fixed points fixed in
that frame, and the motion is put back. Planes in which points slide stay. A rigid motion is exact for any angle and
mover.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.display import OneLine
from ..mesh.moving_mesh import MovingMesh
from ..walls.rigid_part import RigidMotion, RigidPart
from .mover import Movement, MovementReport, Mover, differentiable

__all__ = ["ComovingFrame", "ComovingMovement"]


@dataclass(frozen=True, eq=False)
class ComovingFrame(OneLine):
    """Moves a mesh in a frame that follows its surface: outer boundaries follow the rigid part of its motion.

    All points that are fixed follow: the far field, and walls that are not part of the design surface. Points that
    slide in planes slide in them as before. Symmetry and sliding planes leave rotations about their normal and shifts
    along them. Two planes at an angle leave shifts along both. With patches that slide on non-planar surfaces, and with
    tied periodic sides, there is no rigid motion, and all fixed points stay.

    Parameters
    ----------
    mover : Mover
        Mover of the mesh within the frame.
    keep_factors : bool, optional
        As for `LinearElasticity`, for a mover that has this setting and leaves it open.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import ComovingFrame, LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mover = ComovingFrame(LinearElasticity(mesh))
    >>> half_turn = np.diag([-1.0, -1.0, 1.0])
    >>> movement = mover.move(mesh.points, mesh.points[mesh.surface_ids] @ half_turn)
    >>> bool(np.allclose(movement.points, mesh.points @ half_turn, atol=1e-12))
    True
    """

    mover: Mover
    keep_factors: bool | None = None

    @property
    def mesh(self) -> MovingMesh:
        """Mesh that is moved."""
        return self.mover.mesh

    def move(self, initial: np.ndarray, surface: np.ndarray, **options: Any) -> Movement:
        """Move points (n_points, 3) with surface points (n_surface, 3), both in metres.

        Options are passed to the mover's own ``move``.

        Raises
        ------
        InputError, MovementError
            As for the mover; also if the surface is turned inside out as a whole.
        """
        mover: Any = differentiable(self.mover) if self.keep_factors else self.mover
        if self.mesh.ties is not None or self.mesh.curved_slides:
            return mover.move(initial, surface, **options)
        ids = self.mesh.surface_ids
        motion = RigidPart(self.mesh.plane_normals).at(initial[ids], surface)
        return ComovingMovement(ids, surface, motion, mover.move(initial, motion.undo(surface), **options))


@dataclass(frozen=True, eq=False)
class ComovingMovement(OneLine):
    """A move in a frame that follows the surface."""

    surface_ids: np.ndarray  # (n_surface,) of int, points on the surface
    surface: np.ndarray  # (n_surface, 3), their new places (m)
    motion: RigidMotion  # motion of the frame
    inner: Movement  # move within it

    @property
    def points(self) -> np.ndarray:
        """Moved points, shape (n_points, 3), in metres; surface points are exactly at their given places."""
        points = self.motion.apply(self.inner.points)
        points[self.surface_ids] = self.surface
        return points

    @property
    def report(self) -> MovementReport:
        """Report of the move within the frame."""
        return self.inner.report

    @property
    def start(self) -> object:
        """Data that moves from the same initial points share, see `bspline_mdao.core.movement.mover.Mover`."""
        return getattr(self.inner, "start", None)

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points, shape (n_points, 3), with changes of the initial points and the surface."""
        rotation, shift = self.motion.rotation, self.motion.shift
        d_rotation, d_shift = self.motion.jvp(d_initial[self.surface_ids], d_surface)
        d_inside = (d_surface - d_shift) @ rotation + (self.surface - shift) @ d_rotation
        change = self.inner.jvp(d_initial, d_inside) @ rotation.T + self.inner.points @ d_rotation.T + d_shift
        change[self.surface_ids] = d_surface
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives with respect to the initial points and the surface."""
        rotation, shift = self.motion.rotation, self.motion.shift
        bar, surface_bar = bar.copy(), bar[self.surface_ids]
        bar[self.surface_ids] = 0.0
        initial_bar, inside_bar = self.inner.vjp(bar @ rotation)
        back = inside_bar @ rotation.T
        rotation_bar = bar.T @ self.inner.points + (self.surface - shift).T @ inside_bar
        of_initial, of_surface = self.motion.vjp(rotation_bar, bar.sum(axis=0) - back.sum(axis=0))
        initial_bar = initial_bar.copy()
        initial_bar[self.surface_ids] += of_initial
        return initial_bar, surface_bar + back + of_surface
