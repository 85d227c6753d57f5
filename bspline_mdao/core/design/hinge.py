"""Rotations about hinges: an axis through two points, and how much of a surface rotates about it.

A point x rotates about the axis through the points a and b, of direction u = (b - a) / |b - a|, by an angle t with
Rodrigues' formula, exact for any angle:

    a + cos t r + sin t u x r + (1 - cos t) u (u . r) ,    r = x - a .

The named deformation ``rotate`` and the design variable `bspline_mdao.design.Rotation` use it. Theory:
``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...base.checks import as_vector
from ...base.display import OneLine
from ...errors import InputError
from ..mesh.frame import mesh_frame
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from .reference_axis import ReferenceAxis

__all__ = ["BehindHinge", "Hinge", "NearestPart", "RotatedPart", "about_axis", "about_axis_rates"]

PARALLEL = 1e-6
"""Sine of the angle to the stream below which a hinge has nothing behind it."""

ON_LINE = 1e-9
"""Distance ahead of a hinge line or beyond its ends, relative to its length, up to which a point is on it:
round-off."""


@dataclass(frozen=True, eq=False)
class Hinge(OneLine):
    """An axis through two points, about which control surfaces, tails, blades and whole bodies rotate.

    Its points are among the rows moved by design variables: they move with the surface around them, and `HingePoints`
    moves only them.

    Parameters
    ----------
    first, second : array_like, shape (3,)
        Two points of the axis on the baseline (m). Positive angles follow the right-hand rule from the first to the
        second.
    name : str, optional
        Name of an output of `GridMovement`, shape (6,), with both points as moved by design variables (m), needed by a
        `bspline_mdao.flow.HingeMoment` about this hinge; no output without a name.

    Raises
    ------
    InputError
        If a point is not finite, both are the same, or the name is invalid.

    Examples
    --------
    >>> from bspline_mdao.design import Hinge
    >>> Hinge((0.7, 0.0, 0.0), (0.7, 0.0, 3.0)).points.tolist()
    [[0.7, 0.0, 0.0], [0.7, 0.0, 3.0]]
    """

    first: Any
    second: Any
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not (not self.name or self.name.isidentifier()):
            raise InputError(f"hinge: the name '{self.name}'; give one of letters, digits and _, such as 'flap_hinge'")
        if not np.any(self.points[0] != self.points[1]):
            raise InputError(f"hinge: both of its points are {self.points[0].tolist()}; give two different ones")

    @classmethod
    def on_chord(
        cls,
        mesh: MovingMesh,
        chord: float,
        span: tuple[float, float] = (0.0, 1.0),
        surface: SurfaceGrid | None = None,
        name: str = "",
    ) -> Hinge:
        """Place a hinge along a fraction of the chord, such that positive angles rotate the trailing edge down.

        Parameters
        ----------
        mesh : MovingMesh
            The control mesh, whose surface defines stream, normal and span.
        chord : float
            Fraction of the chord, 0 at the leading edge and 1 at the trailing edge.
        span : tuple of float
            Fractions of the span where it begins and ends.
        surface : SurfaceGrid, optional
            As for `ReferenceAxis.of`.
        name : str, optional
            As for `Hinge`.

        Returns
        -------
        Hinge

        Raises
        ------
        InputError
            As `ReferenceAxis.of`.

        Examples
        --------
        >>> from bspline_mdao import DesignSurface, fit_grid
        >>> from bspline_mdao.design import Hinge
        >>> from bspline_mdao.generators import flat_plate_grid
        >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
        >>> Hinge.on_chord(wing.mesh, 0.75, span=(0.2, 0.5)).points.round(6).tolist()
        [[0.75, 0.0, 1.0], [0.75, 0.0, 0.4]]
        """
        ends = ReferenceAxis.of(mesh, chord, 2, span, surface).points
        first, second = ends[::-1] if np.linalg.det(mesh_frame(mesh).axes) > 0.0 else ends
        return cls(first, second, name)

    @cached_property
    def points(self) -> np.ndarray:
        """Both points on the baseline (m), shape (2, 3)."""
        ends = ("first", self.first), ("second", self.second)
        return np.stack([as_vector(end, f"hinge: its {which} point") for which, end in ends])


@dataclass(frozen=True, eq=False)
class BehindHinge(OneLine):
    """Rotation by position: full behind the hinge line and between its ends, fading out ahead and beyond."""

    # Distances ahead of the line are perpendicular to it; distances normal to the plane of hinge and stream do not
    # count; the ends are cut along the stream. Both fade as 1 - p^2 (3 - 2 p), whose slope is continuous.

    hinge: np.ndarray  # (2, 3), points of the axis (m)
    stream: np.ndarray  # (3,), unit vector downstream
    blend: float  # distance ahead of the line over which rotation fades (m)
    ends: float  # distance beyond its ends over which rotation fades (m); 0: no rotation beyond them

    def __post_init__(self) -> None:
        if not self._across @ self._across > PARALLEL**2:
            raise InputError("hinge: its line is along the stream, so that nothing lies behind it; name patches")

    @cached_property
    def _line(self) -> np.ndarray:
        """Unit vector along the hinge."""
        line = self.hinge[1] - self.hinge[0]
        return line / np.sqrt(np.sum(line**2))

    @cached_property
    def _across(self) -> np.ndarray:
        """Component of the hinge's unit vector normal to the stream."""
        return self._line - (self._line @ self.stream) * self.stream

    @cached_property
    def _length(self) -> float:
        return float(np.linalg.norm(self.hinge[1] - self.hinge[0]))

    def ahead(self, points: np.ndarray) -> np.ndarray:
        """Distances (m) of points (n, 3) ahead of the hinge line, perpendicular to it."""
        behind = self.stream - (self.stream @ self._line) * self._line
        return -(points - self.hinge[0]) @ behind / np.linalg.norm(behind)

    def height(self, points: np.ndarray) -> np.ndarray:
        """Heights (m) of points (n, 3) above hinge and stream, on the side to which positive angles lift the rear."""
        normal = np.cross(self._line, self.stream)
        return (points - self.hinge[0]) @ normal / np.linalg.norm(normal)

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Fractions of the angle by which points (n, 3), in metres, rotate: from 0 to 1."""
        along = (points - self.hinge[0]) @ self._across / (self._across @ self._across)
        slack = ON_LINE * self._length
        weights = faded(self.ahead(points), self.blend, slack)
        for beyond in (-along, along - self._length):
            weights = weights * faded(beyond, self.ends, slack)
        return weights


def faded(distances: np.ndarray, reach: float, slack: float) -> np.ndarray:
    """1 up to a distance of zero, 0 from the reach on, a cubic in between; a step at the slack if there is no reach."""
    if not reach > slack:
        return np.where(distances.real > slack, 0.0, 1.0)
    part = np.where(distances.real < 0.0, 0.0, np.where(distances.real > reach, 1.0, distances / reach))
    return 1.0 - part**2 * (3.0 - 2.0 * part)


@dataclass(frozen=True, eq=False)
class NearestPart(OneLine):
    """A part of a surface, given by known points of it and of the rest: any other point belongs to the nearest."""

    part: np.ndarray  # (n, 3), points of the part (m)
    rest: np.ndarray  # (m, 3), points of the rest (m), none of which are in the part

    @classmethod
    def of(cls, points: np.ndarray, is_part: np.ndarray) -> NearestPart:
        """Divide points, shape (n, 3)."""
        return cls(points[is_part], points[~is_part])

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points (n, 3) are in the part."""
        to_part, to_rest = (
            tree.query(points.real)[0] if tree.n else np.full(len(points), np.inf) for tree in self._trees
        )
        return to_part <= to_rest

    def moved(self, by: Callable[[np.ndarray], np.ndarray]) -> NearestPart:
        """The part after a map has moved its points."""
        return NearestPart(by(self.part), by(self.rest))

    @cached_property
    def _trees(self) -> tuple[cKDTree, cKDTree]:
        return cKDTree(self.part), cKDTree(self.rest)


@dataclass(frozen=True, eq=False)
class RotatedPart(OneLine):
    """What rotates about a hinge: a whole part, everything behind the hinge line, or both."""

    whole: NearestPart | None = None
    behind: BehindHinge | None = None

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Fractions of the angle by which points (n, 3), in metres, rotate: from 0 to 1; complex if the points are."""
        weights = np.zeros(len(points)) if self.behind is None else self.behind.weights(points)
        return weights if self.whole is None else np.where(self.whole.contains(points), 1.0, weights)


def about_axis(
    points: np.ndarray,  # (n, 3), m
    hinge: np.ndarray,  # (2, 3), points of the axis (m)
    angles: np.ndarray,  # (n,) or (), rad
) -> np.ndarray:  # (n, 3), m
    """Rotate points about an axis; real or complex."""
    line = hinge[1] - hinge[0]
    line = line / np.sqrt(np.sum(line**2))
    arms, angles = points - hinge[0], np.asarray(angles)[..., None]
    along = (arms @ line)[:, None] * line
    # versine by the half angle, so that small angles keep their digits
    return points + np.sin(angles) * np.cross(line, arms) + 2.0 * np.sin(0.5 * angles) ** 2 * (along - arms)


def about_axis_rates(
    points: np.ndarray, hinge: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Differentiate `about_axis`, for angles (n,), with respect to each point and both axis points."""
    # Returns matrices (n, 3, 3), for the points and the first and second axis point.
    line = hinge[1] - hinge[0]
    length = np.sqrt(np.sum(line**2))
    line = line / length
    arms, sines = points - hinge[0], np.sin(angles)[:, None, None]
    versines = 2.0 * np.sin(0.5 * angles)[:, None, None] ** 2
    identity, projection = np.eye(3), np.outer(line, line)
    turned = identity + sines * _cross_matrix(line) + versines * (projection - identity)
    of_line = versines * ((arms @ line)[:, None, None] * identity + line[:, None] * arms[:, None, :])
    of_second = (of_line - sines * _cross_matrix(arms)) @ ((identity - projection) / length)
    return turned, identity - turned - of_second, of_second


def _cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Matrices of cross products with vectors (..., 3), shape (..., 3, 3)."""
    return np.cross(np.asarray(vectors)[..., None, :], np.eye(3)).swapaxes(-1, -2)
