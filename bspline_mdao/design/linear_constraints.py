"""Linear constraints among surface control points: pinned, in a plane, linked, together, opposite.

Each gives homogeneous equations on the displacements of the points; `bspline_mdao.design.elimination` solves
them. Those that follow patches and symmetry are in `collinear` and `mirrored`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh.mesh import MovingMesh
from ..numerics.planes import nearest_plane
from .equations import Equations
from .pairing import Directions, Where, axes_of, pairs_of, place_of, rows_of

__all__ = ["InPlane", "Linked", "Opposite", "Pinned", "Together"]


@dataclass(frozen=True, eq=False)
class Pinned:
    """Points that do not move: roots, wakes, fixed leading and trailing edges.

    Parameters
    ----------
    where : Selection or array_like of int
        The points; numbers are rows of ``mesh.surface_ids``.
    directions : str, array_like or None
        In which they do not move: some of ``"xyz"``, a vector, shape (3,), or several; in none at all by default.
    name : str
        For messages.
    """

    where: Where
    directions: Directions = None
    name: str = "pinned"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . d = 0`` for each point and direction n."""
        axes = axes_of(self.directions, self.name)
        return Equations.of(
            len(points), rows_of(self.where, mesh, f"linear constraint '{self.name}'")[:, None], axes[:, None]
        )


@dataclass(frozen=True, eq=False)
class InPlane:
    """Points of a plane that stay in it.

    Parameters
    ----------
    where : Selection or array_like of int
        The points; numbers are rows of ``mesh.surface_ids``.
    normal : array_like, shape (3,), or None
        Normal of the planes that the points stay in, which may be one for each point; by default that of the one
        plane in which all of them are.
    name : str
        For messages.
    """

    where: Where
    normal: np.ndarray | None = None
    name: str = "in plane"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . d = 0`` for each point.

        Raises
        ------
        InputError
            If no normal is given and the points are not in one plane, or are on one line.
        """
        rows = rows_of(self.where, mesh, f"linear constraint '{self.name}'")
        normal = self._found(mesh, points, rows) if self.normal is None else self.normal
        return Equations.of(len(points), rows[:, None], axes_of(normal, self.name)[:1, None])

    def _found(self, mesh: MovingMesh, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Normal of the plane through the points."""
        normal, distances, tolerance = nearest_plane(points[rows])
        if np.linalg.matrix_rank(points[rows] - points[rows[0]], tol=tolerance) < 2:
            raise InputError(
                f"linear constraint '{self.name}': all points, {place_of(mesh, rows[0])} among them, are on one "
                f"line; give a normal"
            )
        if distances.max() > tolerance:
            worst = place_of(mesh, rows[np.argmax(distances)])
            raise InputError(
                f"linear constraint '{self.name}': {worst} is {distances.max():.3g} m off the plane through all; "
                f"give a normal"
            )
        return normal


@dataclass(frozen=True, eq=False)
class Linked:
    """Points that move as others do, such as the lower points of a trailing edge as its upper ones.

    Parameters
    ----------
    leaders, followers : Selection or array_like of int
        Pairs: numbers (rows of ``mesh.surface_ids``) in their order, selections by the least sum of squared distances
        on the baseline. One leader leads all followers.
    directions : str, array_like or None
        In which they move alike: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.
    """

    leaders: Where
    followers: Where
    directions: Directions = None
    name: str = "linked"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d_follower - d_leader) = 0`` for each pair and direction n."""
        pairs = pairs_of(self.leaders, self.followers, mesh, points, self.name)
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), -1.0)


@dataclass(frozen=True, eq=False)
class Together:
    """Points that all move alike; the first leads.

    Parameters
    ----------
    where : Selection or array_like of int
        The points; numbers are rows of ``mesh.surface_ids``.
    directions : str, array_like or None
        In which they move alike: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.
    """

    where: Where
    directions: Directions = None
    name: str = "together"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d - d_first) = 0`` for each other point and direction n."""
        rows = rows_of(self.where, mesh, f"linear constraint '{self.name}'")
        pairs = np.column_stack([np.full(len(rows) - 1, rows[0]), rows[1:]])
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), -1.0)


@dataclass(frozen=True, eq=False)
class Opposite:
    """Pairs of points with equal and opposite displacements, so that local variables neither twist nor shift.

    Parameters
    ----------
    leaders, followers : Selection or array_like of int
        Pairs, as in `Linked`.
    directions : str, array_like or None
        In which they move oppositely: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.
    """

    leaders: Where
    followers: Where
    directions: Directions = None
    name: str = "opposite"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d_follower + d_leader) = 0`` for each pair and direction n."""
        pairs = pairs_of(self.leaders, self.followers, mesh, points, self.name)
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), 1.0)


def _of_pairs(n_surface: int, pairs: np.ndarray, axes: np.ndarray, sign: float) -> Equations:
    """Equations ``n . (d_follower + sign d_leader) = 0``."""
    return Equations.of(n_surface, pairs, np.stack([sign * axes, axes], axis=1))
