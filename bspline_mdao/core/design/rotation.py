"""Rotation of a part of the surface about a hinge as a design variable, and the positions of the hinge's two points.

A row x rotates about the hinge's current points a and b by w v: v is the value, and w the row's fraction of it, fixed
on the baseline. So a hinge follows earlier variables of the surface, and `HingePoints` moves only the hinge. Theory:
``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ...base.checks import require_kind
from ...base.display import OneLine
from ...errors import InputError
from ..mesh.frame import mesh_frame
from .displacement import Direction, Displacement, directions_of, displacements
from .hinge import BehindHinge, Hinge, about_axis, about_axis_rates
from .section_maps import along_vectors
from .selection import Where, rows_of
from .variable import AuxiliaryPoints, Layout, MapPartials

__all__ = ["HingePoints", "Rotation", "RotationMap"]


@dataclass(frozen=True, eq=False)
class Rotation(OneLine):
    """Rotate a part of the surface about a hinge by any angle; the value is in degrees, 0 on the baseline.

    What rotates is determined on the baseline: by default the whole surface; otherwise the points of ``where`` as a
    whole, everything behind the hinge line with a ``blend``, or both. Axes, lattices and other hinges rotate like the
    surface at their position, so a tab follows its flap.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (1,), in degrees; 0 on the baseline.
    hinge : Hinge
        The axis. It follows earlier variables of the surface; with `HingePoints` before this variable its position is
        variable, too.
    where : Selection or array_like of int, optional
        Points that rotate as a whole, such as ``OnPatch(model, "flap*")`` behind a gap; numbers are rows of
        ``mesh.surface_ids``.
    blend : float, optional
        Distance ahead of the hinge line (m) over which rotation fades: then everything behind the line and between its
        ends rotates. The stream comes from the surface's box, see `bspline_mdao.movers.mesh_frame`.
    ends : float, optional
        Distance beyond the ends of the hinge (m) over which rotation fades, by default ``blend``; 0: no rotation
        beyond.

    Raises
    ------
    InputError
        If the hinge is invalid, or a distance is negative or given without ``blend``.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import Hinge, Rotation
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> flap = Rotation("flap", Hinge.on_chord(wing.mesh, 0.75), blend=0.1)
    >>> shape = wing.parametrization([flap])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"flap": np.array([30.0])})
    >>> (moved - baseline).min(axis=0).round(3)  # the trailing edge, a quarter of the chord behind the hinge
    array([-0.033, -0.125,  0.   ])
    """

    units: ClassVar[str | None] = "deg"
    turns: ClassVar[tuple[str, ...]] = ("stream", "normal")

    name: str
    hinge: Hinge
    where: Where | None = None
    blend: float | None = None
    ends: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        require_kind(self.hinge, Hinge, f"'{self.name}': the hinge", "give a Hinge")
        for what, value in (("blend", self.blend), ("ends", self.ends)):
            if value is not None and not 0.0 <= value < np.inf:
                raise InputError(f"'{self.name}': {what} {value}; give a distance in metres")
        if not self.blend and (self.ends is not None or self.blend is not None):
            raise InputError(f"'{self.name}': give a positive blend, or neither blend nor ends")

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The hinge."""
        return (self.hinge,)

    def bind(self, layout: Layout) -> RotationMap:
        """Determine on the baseline what rotates.

        Raises
        ------
        InputError
            If nothing is selected, or nothing rotates.
        """
        weights = self._weights(layout)
        hinge = layout.rows(self.hinge)
        weights[hinge] = 0.0  # where it is
        if not weights[layout.rows()].any():
            raise InputError(f"'{self.name}': no point of the surface is behind the hinge line, between its ends")
        return RotationMap(np.arange(hinge.start, hinge.stop), weights)

    def _weights(self, layout: Layout) -> np.ndarray:
        """Fraction of the angle by which every row rotates, shape (n_rows,)."""
        if self.where is None and self.blend is None:
            return np.ones(len(layout.points))
        weights = np.zeros(len(layout.points))
        if self.blend is not None:
            stream, ends = mesh_frame(layout.mesh).axes[0], self.blend if self.ends is None else self.ends
            weights = BehindHinge(self.hinge.points, stream, self.blend, ends).weights(layout.points)
        if self.where is not None:
            surface = layout.points[layout.rows()]
            is_whole = np.zeros(len(surface), dtype=bool)
            is_whole[rows_of(self.where, layout.mesh, f"'{self.name}'")] = True
            _, nearest = cKDTree(surface).query(layout.points[layout.n_surface :])
            weights[np.concatenate([is_whole, is_whole[nearest]])] = 1.0
        return weights


@dataclass(frozen=True, eq=False)
class RotationMap(OneLine):
    """Rotate rows about the axis through two of them, by fractions of an angle in degrees."""

    hinge_rows: np.ndarray  # int (2,), rows of the hinge's points
    weights: np.ndarray  # (n_rows,), fraction of the angle by which each row rotates

    initial: ClassVar[np.ndarray] = np.zeros(1)
    """The angle at which nothing rotates."""

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        return about_axis(points, points[self.hinge_rows], self._angles(values))

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        n, rows = len(points), np.flatnonzero(self.weights)
        hinge, angles = points[self.hinge_rows], self._angles(values)[rows]
        rates = about_axis_rates(points[rows], hinge, angles)
        stay = np.setdiff1d(np.arange(n), rows)
        influenced = np.concatenate([rows, rows, rows, stay])
        influences = np.concatenate([rows, *(np.full(len(rows), row) for row in self.hinge_rows), stay])
        blocks = np.concatenate([*rates, np.broadcast_to(np.eye(3), (len(stay), 3, 3))])
        at = np.broadcast_to(3 * influenced[:, None, None] + np.arange(3)[:, None], blocks.shape)
        of = np.broadcast_to(3 * influences[:, None, None] + np.arange(3), blocks.shape)
        d_points = csr_array((blocks.ravel(), (at.ravel(), of.ravel())), shape=(3 * n, 3 * n))
        line = (hinge[1] - hinge[0]) / np.linalg.norm(hinge[1] - hinge[0])
        speeds = np.zeros_like(points)
        speeds[rows] = np.radians(1.0) * np.cross(line, about_axis(points[rows], hinge, angles) - hinge[0])
        amounts = csr_array((self.weights[rows], (rows, np.zeros(len(rows), dtype=int))), shape=(n, 1))
        return MapPartials(d_points, along_vectors(speeds, amounts))

    def _angles(self, values: np.ndarray) -> np.ndarray:
        return np.radians(1.0) * self.weights * values[0]


@dataclass(frozen=True, eq=False)
class HingePoints(OneLine):
    """Move the two points of a hinge; a later `Rotation` about it follows.

    Values are displacements, initially zero: first the first point's along every direction, then the second point's.
    The rotating part remains as determined on the baseline.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (2 n_directions,), in metres; 0 on the
        baseline.
    hinge : Hinge
        The hinge.
    direction : str or array_like
        Coordinate axes by name, ``"x"`` or several as in ``"xyz"``; or a vector, shape (3,).

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import Hinge, HingePoints, Rotation
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> hinge = Hinge.on_chord(wing.mesh, 0.75)
    >>> shape = wing.parametrization([HingePoints("line", hinge, "xy"), Rotation("flap", hinge, blend=0.1)])
    >>> shape.initial["line"]
    array([0., 0., 0., 0.])
    """

    units: ClassVar[str | None] = "m"

    name: str
    hinge: Hinge
    direction: Direction = "xyz"

    def __post_init__(self) -> None:
        require_kind(self.hinge, Hinge, f"'{self.name}': the hinge", "give a Hinge")

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The hinge."""
        return (self.hinge,)

    def bind(self, layout: Layout) -> Displacement:
        """Find the rows of the hinge.

        Raises
        ------
        InputError
            If there is no such direction.
        """
        rows = layout.rows(self.hinge)
        directions = directions_of(self.direction, 2, None, f"'{self.name}'")
        return Displacement(displacements(np.arange(rows.start, rows.stop), directions, len(layout.points)))
