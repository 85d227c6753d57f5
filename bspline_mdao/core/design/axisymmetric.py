"""Bodies, hubs, casings and nozzles about an axis: factors on the distance from it, and on lengths along it.

A point x at the fraction s of the axis from a to b, with unit vector u along it, moves to

    x + (f(s) - 1) r   or   x + (f - 1) u u . (x - a) ,    r = x - a - u u . (x - a) .

The named deformations ``radius`` and ``axial`` and the design variable `bspline_mdao.design.RadiusFactor` use it. A
surface that is periodic by a rotation about the axis stays so. Theory: ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import as_vector
from ...base.display import OneLine
from ...errors import InputError
from .reference_axis import StationSpline
from .variable import AuxiliaryPoints, DesignMap, Layout, MapPartials, block_diagonal

__all__ = ["RadiusFactor", "ScaleRadius", "StretchAlong"]


@dataclass(frozen=True, eq=False)
class _Line:
    """A line through two points."""

    points: np.ndarray  # (2, 3), in metres

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit vector along it."""
        along = self.points[1] - self.points[0]
        return along / np.linalg.norm(along)

    @property
    def length(self) -> float:
        """Distance of both points (m)."""
        return float(np.linalg.norm(self.points[1] - self.points[0]))

    def along(self, points: np.ndarray) -> np.ndarray:
        """Distances (m) along it from its first point, shape (n,)."""
        return (points - self.points[0]) @ self.direction

    def parts(self, points: np.ndarray) -> np.ndarray:
        """Positions of points along it, 0 at its first point and 1 at its second, shape (n,)."""
        return self.along(points) / self.length

    def outwards(self, points: np.ndarray) -> np.ndarray:
        """Vectors from it to points, perpendicular to it, shape (n, 3)."""
        return points - self.points[0] - self.along(points)[:, None] * self.direction


@dataclass(frozen=True, eq=False)
class ScaleRadius:
    """Scale distances from an axis by ``amount``, everywhere or in the middle of an interval of the axis."""

    axis: np.ndarray  # (2, 3), two points of it (m)
    amount: float = 1.0
    ends: tuple[float, float] | None = None  # interval of the axis over which the factor rises and falls

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        line = _Line(self.axis)
        return points + ((self.amount - 1.0) * self._weights(line.parts(points)))[:, None] * line.outwards(points)

    def _weights(self, parts: np.ndarray) -> np.ndarray:
        """1 in the middle, 0 at both ends and beyond, with zero slope there."""
        if self.ends is None:
            return np.ones_like(parts)
        place = (parts - self.ends[0]) / (self.ends[1] - self.ends[0])
        return np.where((place.real > 0.0) & (place.real < 1.0), 16.0 * place**2 * (1.0 - place) ** 2, 0.0)


@dataclass(frozen=True, eq=False)
class StretchAlong:
    """Scale lengths along an axis from its first point; ``amount`` is the factor."""

    axis: np.ndarray  # (2, 3), two points of it (m)
    amount: float = 1.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        line = _Line(self.axis)
        return points + (self.amount - 1.0) * line.along(points)[:, None] * line.direction


@dataclass(frozen=True, eq=False)
class RadiusFactor(OneLine):
    """Factors on the distance from an axis at stations along it, for hubs, casings, nozzles and bodies.

    Values are interpolated between stations at the points' positions when the variable is applied, and constant beyond
    the ends: a surface of revolution stays one, wherever its nodes are. A surface that is periodic by a rotation about
    the axis stays so. Axes and lattices move with the surface at their place.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,); 1 on the baseline.
    axis : sequence of two points
        Two points of the axis (m), at stations 0 and 1.
    stations : int or sequence of float
        Number of stations, evenly from 0 to 1, or their positions.
    order : int
        Order of the spline between them: 2 straight lines, 4 cubics.

    Raises
    ------
    InputError
        If the axis or the stations are invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import RadiusFactor
    >>> from bspline_mdao.generators import brick_grid
    >>> body = DesignSurface.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> wider = RadiusFactor("radius", axis=[(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)], stations=3)
    >>> shape, points = body.parametrization([wider]), body.mesh.points[body.mesh.surface_ids]
    >>> moved = shape.apply(points, {"radius": np.array([1.0, 1.2, 1.0])})
    >>> float(np.ptp(moved[:, 1]).round(6))
    1.2
    """

    units: ClassVar[str | None] = None
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    name: str
    axis: Sequence
    stations: int | Sequence[float] = 1
    order: int = 4

    def __post_init__(self) -> None:
        if np.shape(self.axis) != (2, 3):
            raise InputError(f"'{self.name}': an axis of shape {np.shape(self.axis)}; give two points x, y, z")
        if not np.any(self._line.points[0] != self._line.points[1]):
            raise InputError(f"'{self.name}': both points of the axis are the same; give two different ones")
        self._spline  # noqa: B018 - invalid stations are refused here

    @cached_property
    def _line(self) -> _Line:
        ends = zip(("first", "second"), self.axis)
        return _Line(np.stack([as_vector(end, f"'{self.name}': {which} point of the axis") for which, end in ends]))

    @cached_property
    def _spline(self) -> StationSpline:
        return StationSpline.of(self.stations, self.order)

    def bind(self, layout: Layout) -> DesignMap:
        """Move rows depending on their positions."""
        return _RadiusMap(self._line, self._spline)


@dataclass(frozen=True, eq=False)
class _RadiusMap:
    """A `RadiusFactor`, see `bspline_mdao.core.design.variable.DesignMap`."""

    line: _Line
    spline: StationSpline

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves."""
        return np.ones(self.spline.n_values)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        part = self.line.parts(points)
        basis = self.spline.basis(part.real)
        if np.iscomplexobj(part):  # a complex step: first order suffices
            basis = basis + 1j * part.imag[:, None] * self.spline.slopes(part.real)
        return points + (basis @ (values - 1.0))[:, None] * self.line.outwards(points)

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`: rows may depend on all values, since they may move anywhere along the axis."""
        part, outwards, along = self.line.parts(points), self.line.outwards(points), self.line.direction
        basis, slopes = self.spline.basis(part), self.spline.slopes(part) @ (values - 1.0) / self.line.length
        across = np.eye(3) - np.multiply.outer(along, along)
        blocks = np.eye(3) + (basis @ (values - 1.0))[:, None, None] * across
        blocks += slopes[:, None, None] * outwards[:, :, None] * along
        by_values = (outwards[:, :, None] * basis[:, None, :]).reshape(points.size, -1)
        columns = np.tile(np.arange(len(values)), points.size)
        starts = len(values) * np.arange(points.size + 1)
        matrix = csr_array((by_values.ravel(), columns, starts), shape=by_values.shape)
        return MapPartials(block_diagonal(blocks), matrix)
