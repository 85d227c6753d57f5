"""Linear constraints among surface control points: pinned, in a plane, linked, opposite, mirrored.

Each gives homogeneous equations on the displacements of the points; `bspline_mdao.core.design.elimination` solves them.
Of two points that move equally one is the *leader*, and the *follower* depends on it. Theory:
``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ...base.checks import as_numbers, as_vector
from ...base.display import OneLine
from ...base.numerics.vectors import nearest_plane
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh
from .elimination import Equations
from .selection import Selection, Where, rows_of

__all__ = [
    "ConstrainedDirections",
    "EqualDisplacement",
    "InPlane",
    "Linked",
    "Mirrored",
    "Opposite",
    "Pinned",
    "axes_of",
    "pairs_of",
]

ConstrainedDirections = str | np.ndarray | Sequence | None
"""Coordinates by letter (``"xz"``), one vector or several; None for all three coordinates."""


@dataclass(frozen=True, eq=False)
class Pinned(OneLine):
    """Points that do not move: roots, wakes, fixed leading and trailing edges.

    Parameters
    ----------
    where : Selection or array_like of int
        The points; numbers are rows of ``mesh.surface_ids``.
    directions : str, array_like or None
        Directions in which they do not move: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import Pinned
    >>> from bspline_mdao.design import InBox
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> pinned = Pinned(InBox(low=(0.4, None, None)), directions="y")
    >>> pinned.equations(mesh, mesh.points[mesh.surface_ids]).matrix.shape[0]
    9
    """

    where: Where
    directions: ConstrainedDirections = None
    name: str = "pinned"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . d = 0`` for each point and direction n."""
        axes = axes_of(self.directions, self.name)
        return Equations.of(len(points), _rows(self.where, mesh, self.name)[:, None], axes[:, None])


@dataclass(frozen=True, eq=False)
class InPlane(OneLine):
    """Points of a plane that stay in it.

    Parameters
    ----------
    where : Selection or array_like of int
        The points; numbers are rows of ``mesh.surface_ids``.
    normal : array_like, shape (3,), or None
        Normal of the planes that the points stay in, possibly one for each point; by default the normal of the one
        plane that contains them all.
    name : str
        For messages.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import InPlane
    >>> from bspline_mdao.design import InBox
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> InPlane(InBox(low=(None, 0.4, None))).equations(mesh, mesh.points[mesh.surface_ids]).matrix.shape[0]
    9
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
        rows = _rows(self.where, mesh, self.name)
        normal = self._found(mesh, points, rows) if self.normal is None else self.normal
        return Equations.of(len(points), rows[:, None], axes_of(normal, self.name)[:1, None])

    def _found(self, mesh: MovingMesh, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Normal of the plane through the points."""
        normal, distances, tolerance = nearest_plane(points[rows])
        if np.linalg.matrix_rank(points[rows] - points[rows[0]], tol=tolerance) < 2:
            one = mesh.place_of_surface_point(rows[0])
            raise InputError(
                f"linear constraint '{self.name}': all points, {one} among them, are on one line; give a normal"
            )
        if distances.max() > tolerance:
            worst = mesh.place_of_surface_point(rows[np.argmax(distances)])
            raise InputError(
                f"linear constraint '{self.name}': {worst} is {distances.max():.3g} m off the plane through all; "
                f"give a normal"
            )
        return normal


@dataclass(frozen=True, eq=False)
class Linked(OneLine):
    """Points that move like others, such as the lower points of a trailing edge with its upper ones.

    Parameters
    ----------
    leaders, followers : Selection or array_like of int
        Pairs: numbers (rows of ``mesh.surface_ids``) in their order, selections by the least sum of squared distances
        on the baseline. A single leader leads all followers.
    directions : str, array_like or None
        Directions in which they move equally: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import Linked
    >>> from bspline_mdao.design import InBox, Local, Parametrization
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> top, bottom = InBox(low=(None, 0.4, None)), InBox(high=(None, -0.4, None))
    >>> shape = Parametrization(mesh, [Local("bumps", top, "y")], constraints=[Linked(top, bottom, "y")])
    >>> moved = shape.apply(mesh.points[mesh.surface_ids], {"bumps": np.full(9, 0.1)})
    >>> (moved - mesh.points[mesh.surface_ids])[bottom.rows(mesh), 1].round(6)  # the other side moves alike
    array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    """

    leaders: Where
    followers: Where
    directions: ConstrainedDirections = None
    name: str = "linked"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d_follower - d_leader) = 0`` for each pair and direction n."""
        pairs = pairs_of(self.leaders, self.followers, mesh, points, self.name)
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), -1.0)


@dataclass(frozen=True, eq=False)
class Opposite(OneLine):
    """Pairs of points with equal and opposite displacements, so that local variables neither twist nor shift.

    Parameters
    ----------
    leaders, followers : Selection or array_like of int
        Pairs, as in `Linked`.
    directions : str, array_like or None
        Directions in which they move oppositely: some of ``"xyz"``, a vector, shape (3,), or several; all by default.
    name : str
        For messages.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import Opposite
    >>> from bspline_mdao.design import InBox, Local, Parametrization
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> top, bottom = InBox(low=(None, 0.4, None)), InBox(high=(None, -0.4, None))
    >>> shape = Parametrization(mesh, [Local("bumps", top, "y")], constraints=[Opposite(top, bottom, "y")])
    >>> moved = shape.apply(mesh.points[mesh.surface_ids], {"bumps": np.full(9, 0.1)})
    >>> (moved - mesh.points[mesh.surface_ids])[bottom.rows(mesh), 1].round(6)  # the other side moves against it
    array([-0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1])
    """

    leaders: Where
    followers: Where
    directions: ConstrainedDirections = None
    name: str = "opposite"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d_follower + d_leader) = 0`` for each pair and direction n."""
        pairs = pairs_of(self.leaders, self.followers, mesh, points, self.name)
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), 1.0)


@dataclass(frozen=True, eq=False)
class EqualDisplacement:
    """Points that all have the same displacement as the first."""

    where: Where  # the points; numbers are rows of ``mesh.surface_ids``
    # directions in which they move equally: some of ``"xyz"``, a vector, shape (3,), or several; all by default
    directions: ConstrainedDirections = None
    name: str = "equal displacement"  # for messages

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``n . (d - d_first) = 0`` for each other point and direction n."""
        rows = _rows(self.where, mesh, self.name)
        pairs = np.column_stack([np.full(len(rows) - 1, rows[0]), rows[1:]])
        return _of_pairs(len(points), pairs, axes_of(self.directions, self.name), -1.0)


def _of_pairs(n_surface: int, pairs: np.ndarray, axes: np.ndarray, sign: float) -> Equations:
    """Equations ``n . (d_follower + sign d_leader) = 0``."""
    return Equations.of(n_surface, pairs, np.stack([sign * axes, axes], axis=1))


@dataclass(frozen=True, eq=False)
class Mirrored(OneLine):
    """Points that move as the mirror images of others; points on the plane stay in it.

    Parameters
    ----------
    normal : array_like, shape (3,)
        Normal of the plane, towards the side of the leaders.
    point : array_like, shape (3,)
        A point of the plane (m).
    leaders : Selection, array_like of int or None
        By default all points on the plane and on the side of the normal.
    followers : Selection, array_like of int or None
        Points that contain the partner of each leader; by default all surface control points.
    tolerance : float
        Largest distance of a partner from the mirror image of its leader, relative to the size of the mesh.
    name : str
        For messages.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import Mirrored
    >>> from bspline_mdao.design import InBox, Local, Parametrization
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> top, bottom = InBox(low=(None, 0.4, None)), InBox(high=(None, -0.4, None))
    >>> shape = Parametrization(mesh, [Local("bumps", top, "y")], constraints=[Mirrored((0.0, 1.0, 0.0), leaders=top)])
    >>> moved = shape.apply(mesh.points[mesh.surface_ids], {"bumps": np.full(9, 0.1)})
    >>> (moved - mesh.points[mesh.surface_ids])[bottom.rows(mesh), 1].round(6)
    array([-0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1, -0.1])
    """

    normal: np.ndarray
    point: np.ndarray | Sequence[float] = (0.0, 0.0, 0.0)
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
            _rows(leaders, mesh, self.name),
            _rows(followers, mesh, self.name),
        )
        mirrored = (points - 2.0 * heights[:, None] * normal)[leaders]
        partners = followers[self._partners(mesh, cKDTree(points[followers]), mirrored, leaders, near)]
        reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
        return Equations.of(
            len(points), np.column_stack([leaders, partners]), np.stack([-reflection, np.eye(3)], axis=1)
        )

    def _on_the_side_of_the_normal(self, heights: np.ndarray, near: float) -> np.ndarray:
        rows = np.flatnonzero(heights >= -near)
        if not len(rows):
            raise InputError(
                f"linear constraint '{self.name}': no point is on the side that the normal points to, the nearest is "
                f"{-heights.max():.3g} m off the plane; turn the normal, or move the plane"
            )
        return rows

    def _partners(
        self, mesh: MovingMesh, tree: cKDTree, mirrored: np.ndarray, leaders: np.ndarray, near: float
    ) -> np.ndarray:
        """Number of the single point of the tree at each mirrored place."""
        counts = tree.query_ball_point(mirrored, near, return_length=True)
        gaps, partners = tree.query(mirrored)
        for leader, count, gap in zip(leaders[counts != 1], counts[counts != 1], gaps[counts != 1]):
            none = f"no partner, the nearest point is {gap:.3g} m off its mirrored place; move the plane"
            several = f"{count} partners within {near:.3g} m of its mirrored place; move the plane"
            place = mesh.place_of_surface_point(leader)
            raise InputError(
                f"linear constraint '{self.name}': {place} has {several if count else none}, "
                f"change the tolerance, or name leaders and followers"
            )
        return partners


def _rows(where: Where, mesh: MovingMesh, name: str) -> np.ndarray:
    return rows_of(where, mesh, f"linear constraint '{name}'")


def axes_of(directions: ConstrainedDirections, name: str) -> np.ndarray:
    """Rows of directions, shape (n, 3), scaled to unit length unless they are along coordinates."""
    if directions is None or isinstance(directions, str):
        letters = "xyz" if directions is None else directions
        if not letters or set(letters) - set("xyz"):
            raise InputError(f"linear constraint '{name}': no direction is called '{directions}'; give some of 'xyz'")
        return np.eye(3)[["xyz".index(letter) for letter in letters]]
    vectors = np.atleast_2d(as_numbers(directions, f"linear constraint '{name}': direction"))
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if vectors.shape[1:] != (3,) or not np.isfinite(lengths).all() or not (lengths > 0.0).all():
        raise InputError(f"linear constraint '{name}': give directions of three coordinates that are not all zero")
    return vectors / lengths


def pairs_of(leaders: Where, followers: Where, mesh: MovingMesh, points: np.ndarray, name: str) -> np.ndarray:
    """Pairs (leader, follower) of rows, shape (n, 2)."""
    # A single leader leads all followers. Numbers are paired in their order; selections such that the sum of squared
    # distances on the baseline is least, which does not change if one whole side is shifted.
    first, second = (_rows(where, mesh, name) for where in (leaders, followers))
    if len(first) == 1:
        return np.column_stack([np.repeat(first, len(second)), second])
    if len(first) != len(second):
        raise InputError(
            f"linear constraint '{name}': {len(first)} points cannot be paired with {len(second)}; give as many"
        )
    if isinstance(leaders, Selection) or isinstance(followers, Selection):
        distances = cdist(points[second], points[first], "sqeuclidean")
        first = first[linear_sum_assignment(distances)[1]]
    return np.column_stack([first, second])
