"""Two sides of a surface that stay mirror images of each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..checks import as_vector
from ..errors import InputError
from ..mesh.mesh import MovingMesh
from .equations import Equations
from .pairing import Where, axes_of, place_of, rows_of

__all__ = ["Mirrored"]


@dataclass(frozen=True, eq=False)
class Mirrored:
    """Points that move as the mirror images of others; points on the plane stay in it.

    Parameters
    ----------
    normal : array_like, shape (3,)
        Normal of the plane, towards the side that leads.
    point : array_like, shape (3,)
        A point of the plane (m).
    leaders : Selection, array_like of int or None
        The points that lead; by default all on the plane and on the side that the normal points to.
    followers : Selection, array_like of int or None
        Among which each leader has its partner; by default all surface control points.
    tolerance : float
        How far from the mirrored place of a leader its partner may be, relative to the size of the mesh.
    name : str
        For messages.
    """

    normal: np.ndarray
    point: np.ndarray = (0.0, 0.0, 0.0)
    leaders: Where | None = None
    followers: Where | None = None
    tolerance: float = 1e-6
    name: str = "mirrored"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``d_follower - (I - 2 n n^T) d_leader = 0`` for each leader.

        Raises
        ------
        InputError
            If a leader has no partner, or several.
        """
        normal, near = axes_of(self.normal, self.name)[0], self.tolerance * mesh.size
        heights = (points - as_vector(self.point, f"linear constraint '{self.name}': point")) @ normal
        leaders = self._on_the_side_of_the_normal(heights, near) if self.leaders is None else self.leaders
        followers = np.arange(len(points)) if self.followers is None else self.followers
        leaders, followers = (
            rows_of(leaders, mesh, f"linear constraint '{self.name}'"),
            rows_of(followers, mesh, f"linear constraint '{self.name}'"),
        )
        mirrored = (points - 2.0 * heights[:, None] * normal)[leaders]
        partners = followers[self._partners(mesh, cKDTree(points[followers]), mirrored, leaders, near)]
        reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
        return Equations.of(
            len(points), np.column_stack([leaders, partners]), np.stack([-reflection, np.eye(3)], axis=1)
        )

    def _on_the_side_of_the_normal(self, heights, near) -> np.ndarray:
        rows = np.flatnonzero(heights >= -near)
        if not len(rows):
            raise InputError(
                f"linear constraint '{self.name}': no point is on the side that the normal points to, the nearest is "
                f"{-heights.max():.3g} m off the plane; turn the normal, or move the plane"
            )
        return rows

    def _partners(self, mesh, tree, mirrored, leaders, near) -> np.ndarray:
        """Number of the one point of the tree at each mirrored place."""
        counts = tree.query_ball_point(mirrored, near, return_length=True)
        gaps, partners = tree.query(mirrored)
        for leader, count, gap in zip(leaders[counts != 1], counts[counts != 1], gaps[counts != 1]):
            none = f"no partner, the nearest point is {gap:.3g} m off its mirrored place; move the plane"
            several = f"{count} partners within {near:.3g} m of its mirrored place; move the plane"
            raise InputError(
                f"linear constraint '{self.name}': {place_of(mesh, leader)} has {several if count else none}, "
                f"change the tolerance, or name leaders and followers"
            )
        return partners
