"""Fixed surfaces that points slide on: planes, cylinders, cones, spheres and surfaces of revolution.

Each is a level set F = 0 of a smooth function of space, with its gradient and Hessian. Nothing else is needed: the
closest point, on one surface or on the curve in which two meet, follows (`.closest`). For all except `Revolution` the
function is the distance, positive outside.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from ...base.checks import as_array, as_direction, as_numbers, as_vector
from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...errors import InputError, MovementError

__all__ = ["Cone", "Cylinder", "FixedSurface", "Levels", "Plane", "Revolution", "Sphere", "refuse_far", "require_near"]

Vector = Sequence[float] | np.ndarray


class Levels(NamedTuple):
    """A function of space at points, real or complex."""

    values: np.ndarray  # (n,)
    gradients: np.ndarray  # (n, 3)
    hessians: np.ndarray  # (n, 3, 3)


class FixedSurface(OneLine, ABC):
    """A surface that stays where it is, for nodes that slide on it."""

    @abstractmethod
    def levels(self, points: np.ndarray) -> Levels:
        """The function whose zeros are the surface, at points, shape (n, 3), in metres; real or complex."""
        # `MovementError` if it has no gradient at a point, as on the axis of a cylinder

    def near(self, points: np.ndarray) -> np.ndarray:
        """Starting points (m) of the search for the points nearest to given ones, shape (n, 3)."""
        return points

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Return distances of points, shape (n, 3), from the surface (m), to first order; shape (n,), not negative."""
        values, gradients, _ = self.levels(points)
        return np.abs(values) / lengths(gradients)


@dataclass(frozen=True, eq=False, repr=False)
class Plane(FixedSurface):
    """A plane."""

    normal: np.ndarray  # (3,), unit normal
    offset: float  # product of the normal and its points (m)

    def levels(self, points: np.ndarray) -> Levels:
        """Distance from the plane."""
        n = len(points)
        return Levels(points @ self.normal - self.offset, np.tile(self.normal, (n, 1)), np.zeros((n, 3, 3)))


class _InMeridian(NamedTuple):
    """A function f(x, r) of the place along an axis and the distance from it, with its derivatives, each (n,)."""

    value: np.ndarray
    x: np.ndarray | float
    r: np.ndarray | float
    xx: np.ndarray | float = 0.0
    rr: np.ndarray | float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class _AboutAxis(FixedSurface):
    """A surface of revolution, whose function depends on x along the axis and the distance r from it."""

    origin: Vector
    direction: Vector

    def __post_init__(self) -> None:
        self._axis  # noqa: B018 - what is no axis is refused here

    @cached_property
    def _axis(self) -> tuple[np.ndarray, np.ndarray]:
        what = type(self).__name__.lower()
        return as_vector(self.origin, f"{what}: origin"), as_direction(self.direction, f"{what}: direction")

    @property
    def _about(self) -> str:
        """The axis in words: the name of a coordinate axis, or its direction, and a point if it misses the origin."""
        origin, along = self._axis
        along = along * np.sign(along[np.argmax(np.abs(along))])
        name = "xyz"[int(np.argmax(along))] if along.max() > 1.0 - STRAIGHT else f"the direction {_rounded(along)}"
        point = origin - (origin @ along) * along
        is_off = np.abs(point).max() > STRAIGHT * max(np.abs(origin).max(), 1.0)
        return name + (f" through {_rounded(point)}" if is_off else "")

    @abstractmethod
    def _in_meridian(self, x: np.ndarray, r: np.ndarray) -> _InMeridian:
        """The function of x and r (m), both of shape (n,)."""

    def levels(self, points: np.ndarray) -> Levels:
        """See `FixedSurface.levels`."""
        origin, along = self._axis
        x = (points - origin) @ along
        across = points - origin - x[:, None] * along
        r = np.sqrt((across * across).sum(axis=1))
        if len(r) and np.abs(r).min() <= ON_AXIS * max(np.abs(points - origin).max(), np.abs(r).max()):
            point = points[np.argmin(np.abs(r))].real.round(6).tolist()
            raise MovementError(f"{type(self).__name__.lower()}: the point {point} is on the axis")
        at, outwards = self._in_meridian(x, r), across / r[:, None]
        parts = [np.broadcast_to(part, x.shape)[:, None] for part in at[1:]]
        around = np.eye(3) - np.multiply.outer(along, along) - outwards[:, :, None] * outwards[:, None, :]
        hessians = (
            parts[2][..., None] * np.multiply.outer(along, along)
            + parts[3][..., None] * outwards[:, :, None] * outwards[:, None, :]
            + (parts[1] / r[:, None])[..., None] * around
        )
        return Levels(at.value, parts[0] * along + parts[1] * outwards, hessians)


STRAIGHT = 1e-9
"""Largest departures of an axis from a coordinate axis, and from the origin, that are rounding."""

ON_AXIS = 1e-12
"""Points nearer to an axis than this fraction of their distance from its origin have no outward direction."""


@dataclass(frozen=True, eq=False, repr=False)
class Cylinder(_AboutAxis):
    """A circular cylinder, such as a casing or the wall of a tunnel.

    Parameters
    ----------
    origin : array_like, shape (3,)
        A point of the axis (m).
    direction : array_like, shape (3,)
        Along the axis, of any length.
    radius : float
        Radius (m).

    Raises
    ------
    InputError
        If the axis has no direction, or the radius is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import Cylinder
    >>> Cylinder(origin=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=0.5).distances(np.array([[3.0, 0.0, 0.6]]))
    array([0.1])
    """

    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_positive(self.radius, "cylinder: radius")

    def __str__(self) -> str:
        return f"a cylinder of radius {self.radius:.6g} about {self._about}"

    def _in_meridian(self, x: np.ndarray, r: np.ndarray) -> _InMeridian:
        return _InMeridian(r - self.radius, 0.0, 1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Cone(_AboutAxis):
    """A circular cone.

    Parameters
    ----------
    origin : array_like, shape (3,)
        Its apex (m).
    direction : array_like, shape (3,)
        From the apex along the axis, towards where the cone widens, of any length.
    half_angle : float
        Angle between axis and cone (rad), between 0 and pi / 2.

    Raises
    ------
    InputError
        If the axis has no direction, or the angle is not between 0 and pi / 2.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import Cone
    >>> cone = Cone(origin=(0.0, 0.0, 0.0), direction=(0.0, 0.0, 2.0), half_angle=np.pi / 4)
    >>> cone.distances(np.array([[0.0, 1.0, 1.0]])).round(12)
    array([0.])
    """

    half_angle: float

    def __post_init__(self) -> None:
        super().__post_init__()
        angle = as_numbers(self.half_angle, "cone: half angle")
        if angle.shape or not 0.0 < angle < 0.5 * np.pi:
            raise InputError(f"cone: half angle {self.half_angle}; give one between 0 and pi / 2, in rad")

    def __str__(self) -> str:
        apex = _rounded(np.asarray(self.origin))
        return f"a cone of half angle {np.degrees(self.half_angle):.6g} deg with its apex at {apex}"

    def _in_meridian(self, x: np.ndarray, r: np.ndarray) -> _InMeridian:
        sine, cosine = np.sin(self.half_angle), np.cos(self.half_angle)
        return _InMeridian(cosine * r - sine * x, -sine, cosine)


@dataclass(frozen=True, eq=False, repr=False)
class Revolution(_AboutAxis):
    """A surface of revolution, such as the casing of a compressor: a smooth curve rotated about an axis.

    Parameters
    ----------
    origin : array_like, shape (3,)
        A point of the axis (m).
    direction : array_like, shape (3,)
        Along the axis, of any length.
    profile : array_like, shape (n, 2)
        Distances along the axis from the origin, ascending, and radii there (m), at least 4 points. A cubic spline with
        continuous curvature goes through them.

    Raises
    ------
    InputError
        If the axis has no direction, or the profile is not made of radii along it.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import Revolution
    >>> x = np.linspace(0.0, 2.0, 21)
    >>> nozzle = Revolution((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.column_stack([x, 1.0 - 0.2 * np.sin(x)]))
    >>> nozzle.distances(np.array([[1.0, 0.0, 1.0 - 0.2 * np.sin(1.0)]])).round(12)
    array([0.])
    """

    profile: np.ndarray | Sequence[Sequence[float]]

    def __post_init__(self) -> None:
        super().__post_init__()
        points = as_array(self.profile, "revolution: profile")
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 4 or not np.isfinite(points).all():
            raise InputError(f"revolution: a profile of shape {points.shape}; give shape (n, 2), 4 points at least")
        if not (np.diff(points[:, 0]) > 0.0).all():
            number = int(np.argmin(np.diff(points[:, 0]))) + 2
            raise InputError(f"revolution: point {number} of the profile is not farther along the axis; sort them")
        if points[:, 1].min() <= 0.0:
            raise InputError(f"revolution: a radius of {points[:, 1].min():g} m in the profile; give positive ones")

    def __str__(self) -> str:
        radii = np.asarray(self.profile)[:, 1]
        return f"a surface of revolution about {self._about}, of radii {radii.min():.6g} to {radii.max():.6g}"

    @cached_property
    def _radius(self) -> CubicSpline:
        return CubicSpline(*np.transpose(self.profile))

    def _in_meridian(self, x: np.ndarray, r: np.ndarray) -> _InMeridian:
        if not np.iscomplexobj(x):
            return _InMeridian(r - self._radius(x), -self._radius(x, 1), 1.0, -self._radius(x, 2))
        # a cubic at a complex place: Taylor's series of four terms about its real part
        step, rates = 1j * x.imag, [self._radius(x.real, order) for order in range(4)]
        radius = rates[0] + step * (rates[1] + step * (rates[2] + step * rates[3] / 3.0) / 2.0)
        slope, bend = rates[1] + step * (rates[2] + step * rates[3] / 2.0), rates[2] + step * rates[3]
        return _InMeridian(r - radius, -slope, 1.0, -bend)


@dataclass(frozen=True, eq=False, repr=False)
class Sphere(FixedSurface):
    """A sphere, such as an outer boundary.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its centre (m).
    radius : float
        Radius (m).

    Raises
    ------
    InputError
        If the centre is not a point, or the radius is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import Sphere
    >>> Sphere(center=(0.0, 0.0, 0.0), radius=2.0).distances(np.array([[0.0, 3.0, 0.0]]))
    array([1.])
    """

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        as_vector(self.center, "sphere: center")
        _require_positive(self.radius, "sphere: radius")

    def __str__(self) -> str:
        return f"a sphere of radius {self.radius:.6g} about {_rounded(np.asarray(self.center))}"

    def levels(self, points: np.ndarray) -> Levels:
        """Distance from the sphere."""
        away = points - np.asarray(self.center)
        r = np.sqrt((away * away).sum(axis=1))
        if len(r) and not np.abs(r).min() > ON_AXIS * self.radius:
            raise MovementError(f"sphere: a point is at its centre, {np.asarray(self.center).tolist()}")
        outwards = away / r[:, None]
        hessians = (np.eye(3) - outwards[:, :, None] * outwards[:, None, :]) / r[:, None, None]
        return Levels(r - self.radius, outwards, hessians)


FAR = 0.01
"""Nodes farther from a given surface than this fraction of their size were meant for another one."""


def require_near(
    surface: FixedSurface,  # a surface that is given
    points: np.ndarray,  # (n, 3), nodes that are meant to be on it (m)
    place_of: Callable[[int], str],  # names one of them
    what: str,  # what they belong to, for messages
    size: str,  # what their size is called
    cure: str,  # what to do besides correcting the surface
) -> tuple[int, float]:  # the node that is farthest off, and by how much (m)
    """Refuse a given surface if nodes are far from it."""
    try:
        distances = surface.distances(points)
    except MovementError as error:
        raise InputError(f"{what}: {error}; fix or release it, or give another surface") from error
    return refuse_far(distances, points, place_of, what, f"the given {type(surface).__name__}", size, cure)


def refuse_far(
    distances: np.ndarray,  # (n,), of nodes from what they are meant to be on (m)
    points: np.ndarray,  # (n, 3), these nodes (m)
    place_of: Callable[[int], str],  # names one of them
    what: str,  # what they belong to, for messages
    whose: str,  # what they are meant to be on
    size: str,  # what their size is called
    cure: str,  # what to do besides correcting the surface
) -> tuple[int, float]:  # the node that is farthest off, and by how much (m)
    """Refuse nodes that are far from the surface that they are meant to be on."""
    worst, extent = int(np.argmax(distances)), float(np.linalg.norm(np.ptp(points, axis=0)))
    if distances[worst] > FAR * extent:
        raise InputError(
            f"{what}: {place_of(worst)} is {distances[worst]:.3g} m off {whose}, more than {FAR:g} of {size}; correct "
            f"the surface, or {cure}"
        )
    return worst, float(distances[worst])


def _rounded(vector: np.ndarray) -> str:
    """A vector with few digits, free of rounding."""
    least = STRAIGHT * max(float(np.abs(vector).max()), 1.0)
    return f"({', '.join(f'{x:.6g}' for x in np.where(np.abs(vector) < least, 0.0, vector))})"


def _require_positive(value: float, what: str) -> None:
    number = as_numbers(value, what)
    if number.shape or not 0.0 < number < np.inf:
        raise InputError(f"{what} {value}; give a positive number in metres")
