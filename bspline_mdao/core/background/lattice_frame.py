"""Coordinates of a lattice: Cartesian, or cylindrical about the axis of a rotation between periodic sides.

Cylindrical coordinates are x along the axis, the radius r, and r0 times the angle, with a radius r0 of the walls, so
all are lengths. Displacements and rotations are taken along their directions at the point,

    u = Q(theta)^T A d ,    d: components of the displacements of control points, A: the basis functions,

so anything independent of the angle moves equally all around. On the axis the only direction is along it.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.periodic_pair import Motion

__all__ = ["AROUND", "ON_AXIS", "CylindricalFrame", "Directions", "LatticeFrame"]

AROUND = 2
"""Direction of cylindrical coordinates around the axis."""

ON_AXIS = 1e-6
"""Fraction of the size of a mesh by which a node on an axis may be off it: single precision."""


@dataclass(frozen=True, eq=False)
class Directions(OneLine):
    """Directions of the coordinates at points."""

    rows: np.ndarray  # (3, 3), unit vectors for all points, or (n, 3, 3), for each; zero rows are missing directions

    def local(self, vectors: np.ndarray) -> np.ndarray:
        """Components of vectors, shape (n, 3), along the directions."""
        return vectors @ self.rows.T if self.rows.ndim == 2 else np.einsum("nij,nj->ni", self.rows, vectors)

    def space(self, components: np.ndarray) -> np.ndarray:
        """Transpose of `local`: vectors from components, shape (n, 3)."""
        return components @ self.rows if self.rows.ndim == 2 else np.einsum("nij,ni->nj", self.rows, components)


@dataclass(frozen=True, eq=False)
class LatticeFrame(OneLine):
    """Cartesian coordinates."""

    axes: np.ndarray  # (3, 3), rows are the unit vectors of the directions

    @property
    def is_cartesian(self) -> bool:
        """Whether directions are the same everywhere."""
        return True

    @property
    def sign(self) -> float:
        """One if directions are right-handed, else minus one: the factor of rotation vectors."""
        return float(np.sign(np.linalg.det(self.axes)))

    def to_local(self, points: np.ndarray) -> np.ndarray:
        """Coordinates of points, both of shape (n, 3), in metres."""
        return points @ self.axes.T

    def to_space(self, coordinates: np.ndarray) -> np.ndarray:
        """Points of coordinates, both of shape (n, 3), in metres."""
        return coordinates @ self.axes

    def directions(self, points: np.ndarray) -> Directions:
        """Directions at points, shape (n, 3), in metres."""
        return Directions(self.axes)

    def directions_at(self, coordinates: np.ndarray) -> Directions:
        """Directions at coordinates, shape (n, 3), in metres."""
        return Directions(self.axes)

    @property
    def across_axis(self) -> np.ndarray:
        """Unit vectors in which points on the axis do not move, shape (n, 3)."""
        return np.zeros((0, 3))

    def is_on_axis(self, points: np.ndarray) -> np.ndarray:
        """Whether points, shape (n, 3), are on the axis."""
        return np.zeros(len(points), dtype=bool)

    def side_on_axis(self, low: float) -> tuple[int, int] | None:
        """Direction and end of the side on the axis, if there is one, for a direction that begins at ``low`` (m)."""
        return None

    def steepness(self, radii: np.ndarray) -> np.ndarray:
        """Ratio of slopes in space around the axis to slopes in the coordinate, at radii (m): there is no axis."""
        return np.ones_like(radii)

    def turns_of_copies(self, points: np.ndarray, firsts: np.ndarray) -> np.ndarray | None:
        """Rotations of the displacements of copies of points, both of shape (n, 3): none."""
        return None


@dataclass(frozen=True, eq=False)
class CylindricalFrame(LatticeFrame):
    """Cylindrical coordinates: ``axes`` are the axis, and the directions of r and of the angle at angle zero."""

    motion: Motion  # the rotation between periodic sides
    radius: float  # r0 (m)
    near: float  # distance from the axis up to which points are on it (m)

    @classmethod
    def about(
        cls,
        motion: Motion,  # the rotation between periodic sides
        points: np.ndarray,  # (n, 3), nodes of the mesh (m)
        walls: np.ndarray,  # (n_walls, 3), wall nodes (m)
    ) -> CylindricalFrame:
        """Cut the circle at an angle without nodes, or anywhere if there is none."""
        axis = np.array(motion.axis)
        across = np.eye(3)[np.argmin(np.abs(axis))]
        across = across - (across @ axis) * axis
        across /= np.linalg.norm(across)
        near = ON_AXIS * float(np.linalg.norm(np.ptp(points, axis=0)))
        frame = cls(np.stack([axis, across, np.cross(axis, across)]), motion, 1.0, near)
        local = frame.to_local(points)
        angles = np.sort(local[local[:, 1] > near, 2])
        gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
        widest = int(np.argmax(gaps))
        middle = angles[widest] + 0.5 * gaps[widest] + np.pi
        turned = np.cos(middle) * frame.axes[1] + np.sin(middle) * frame.axes[2]
        radii = frame.to_local(walls)[:, 1]
        return cls(
            np.stack([axis, turned, np.cross(axis, turned)]), motion, 0.5 * float(radii.min() + radii.max()), near
        )

    @property
    def is_cartesian(self) -> bool:
        """No."""
        return False

    @property
    def period(self) -> float:
        """Period of the mesh in the third coordinate (m)."""
        return self.radius * abs(self.motion.angle)

    def to_local(self, points: np.ndarray) -> np.ndarray:
        """Coordinates of points, both of shape (n, 3), in metres."""
        along, x, y = ((points - self.motion.point) @ self.axes.T).T
        radius = np.hypot(x, y)
        angle = np.where(radius <= self.near, 0.0, np.arctan2(y, x))  # on the axis it would be rounding error
        return np.stack([along, radius, self.radius * angle], axis=1)

    def to_space(self, coordinates: np.ndarray) -> np.ndarray:
        """Points of coordinates, both of shape (n, 3), in metres."""
        along, radius, angle = coordinates[:, 0], coordinates[:, 1], coordinates[:, 2] / self.radius
        local = np.stack([along, radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        return local @ self.axes + self.motion.point

    def directions(self, points: np.ndarray) -> Directions:
        """Directions at points, shape (n, 3), in metres: only along the axis for points on it."""
        rows = self.directions_at(self.to_local(points)).rows
        rows[self.is_on_axis(points), 1:] = 0.0
        return Directions(rows)

    def directions_at(self, coordinates: np.ndarray) -> Directions:
        """Directions at coordinates, shape (n, 3), in metres."""
        return Directions(self._turned(coordinates[:, 2] / self.radius))

    @property
    def across_axis(self) -> np.ndarray:
        """Unit vectors in which points on the axis do not move, shape (2, 3)."""
        return self.axes[1:]

    def is_on_axis(self, points: np.ndarray) -> np.ndarray:
        """Whether points, shape (n, 3), are on the axis."""
        return self.to_local(points)[:, 1] <= self.near

    def side_on_axis(self, low: float) -> tuple[int, int] | None:
        """Direction and end of the lattice side on the axis, if radii that begin at ``low`` (m) reach it."""
        return (1, 0) if low <= self.near else None

    def steepness(self, radii: np.ndarray) -> np.ndarray:
        """Ratio of slopes in space around the axis to slopes in the coordinate, at radii (m)."""
        return self.radius / radii

    def turns_of_copies(self, points: np.ndarray, firsts: np.ndarray) -> np.ndarray:
        """Rotations of the displacements of copies of points, both of shape (n, 3), as matrices (n, 3, 3)."""
        periods, turns = self._periods(points, firsts), np.tile(np.eye(3), (len(points), 1, 1))
        is_turned = periods != 0.0
        rows = self._turned(self.motion.angle * periods[is_turned])
        turns[is_turned] = np.swapaxes(rows, 1, 2) @ self.axes
        return turns

    def directions_of_copies(self, points: np.ndarray, firsts: np.ndarray) -> Directions:
        """Directions at copies of points, both of shape (n, 3): the originals' directions up to whole periods."""
        angles = self.to_local(firsts)[:, 2] / self.radius
        rows = self._turned(angles + self.motion.angle * self._periods(points, firsts))
        rows[self.is_on_axis(points), 1:] = 0.0
        return Directions(rows)

    def _periods(self, points: np.ndarray, firsts: np.ndarray) -> np.ndarray:
        """Number of periods by which copies are ahead of their originals, both of shape (n, 3)."""
        angles, others = (self.to_local(each)[:, 2] / self.radius for each in (points, firsts))
        return np.where(self.is_on_axis(points), 0.0, np.round((angles - others) / self.motion.angle))

    def _turned(self, angles: np.ndarray) -> np.ndarray:
        """Directions at angles (rad), shape (n, 3, 3)."""
        rows, (cosine, sine) = np.empty((len(angles), 3, 3)), (np.cos(angles), np.sin(angles))
        rows[:, 0] = self.axes[0]
        rows[:, 1] = np.outer(cosine, self.axes[1]) + np.outer(sine, self.axes[2])
        rows[:, 2] = np.outer(cosine, self.axes[2]) - np.outer(sine, self.axes[1])
        return rows
