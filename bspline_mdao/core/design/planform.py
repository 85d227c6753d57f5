"""Planform and section variables along a reference axis.

Each acts about the axis as moved by the variables before it, so they can be given in any order. The usual order is from
the section outwards: thickness and camber, chord and taper, twist, then span, sweep and dihedral. All but `Camber` are
maps of two kinds: `SectionMap` multiplies sections in their planes, `ShiftMap` shifts whole sections, by the formulas
of `section_maps`. Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...errors import InputError
from .displacement import Displacement
from .lattice import Lattice
from .reference_axis import AttachedRows, ReferenceAxis, StationSpline
from .section_maps import SectionMap, ShiftMap, along_vectors, rotation, scaling, shear
from .variable import AuxiliaryPoints, DesignMap, Layout

__all__ = [
    "Camber",
    "Chord",
    "Dihedral",
    "Span",
    "Sweep",
    "Taper",
    "ThicknessFactor",
    "Twist",
    "parabola",
]


@dataclass(frozen=True, eq=False)
class AlongAxis(OneLine, ABC):
    """A variable along a reference axis."""

    units: ClassVar[str | None] = None

    name: str  # name of the input of `SurfaceControl`
    axis: ReferenceAxis  # the axis about which it acts
    # lattice moved instead of all rows; everything embedded follows
    on: Lattice | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if not isinstance(self.axis, ReferenceAxis):
            raise InputError(f"'{self.name}': the axis is of type {type(self.axis).__name__}; give a ReferenceAxis")

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The axis, and the lattice if there is one."""
        return (self.axis,) if self.on is None else (self.axis, *self.on.auxiliary)

    def bind(self, layout: Layout) -> DesignMap:
        """Compute stations and directions on the baseline."""
        design_map = self._bind(self.axis.attach(layout))
        return design_map if self.on is None else self.on.extend(layout, design_map)

    @abstractmethod
    def _bind(self, attached: AttachedRows) -> DesignMap:
        """Return the map of all rows, which are attached to the axis."""


@dataclass(frozen=True, eq=False)
class AtStations(AlongAxis):
    """A variable with a value at each station along a reference axis, see `StationSpline`."""

    neutral: ClassVar[float] = 0.0

    # their number, evenly from the first (0) to the last point of the axis (1), or their positions; one is for all
    stations: int | Sequence[float] = 1
    order: int = field(default=4, kw_only=True)  # of the spline between them: 2 linear, 4 cubic

    @property
    def spline(self) -> StationSpline:
        """Interpolation between the stations."""
        return StationSpline.of(self.stations, self.order)


class _InSections(AtStations):
    """A variable that multiplies sections, in their planes about the axis, by a matrix."""

    unit: ClassVar[float] = 1.0  # unit of the values, in units of `_matrices`

    def _bind(self, attached: AttachedRows) -> SectionMap:
        along, spline = (attached.weights, attached.axis_rows), self.spline.matrix(attached.stations)
        return SectionMap(self.neutral, *along, self._axes(attached), spline, self._matrices, self.unit)

    def _axes(self, attached: AttachedRows) -> np.ndarray:
        return attached.section_axes

    @abstractmethod
    def _matrices(self, amounts: np.ndarray, /) -> np.ndarray:
        """Matrices, shape (n, 2, 2), from the values at sections, shape (n,), times the unit."""


class Twist(_InSections):
    """Rotate sections in their planes about the axis; values are in degrees, nose up positive.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,), in degrees; 0 on the baseline.
    axis : ReferenceAxis
        Axis of rotation of the sections: the quarter chord of `ReferenceAxis.of`, or your own points.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"twist": np.array([0.0, 5.0])})
    >>> (np.ptp(moved, axis=0) - np.ptp(baseline, axis=0)).round(4)  # the tip's leading and trailing edge
    array([0.    , 0.0872, 0.    ])
    """

    units = "deg"
    unit = np.radians(1.0)
    turns = "stream", "normal"

    _matrices = staticmethod(rotation)


@dataclass(frozen=True, eq=False)
class Chord(_InSections):
    """Scale sections about the axis; values are factors on the chord.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,); 1 on the baseline.
    axis : ReferenceAxis
        Axis about which sections are scaled, which stays in place.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.
    scales_thickness : bool
        Whether the thickness scales too, which preserves thickness over chord.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Chord("chord", wing.axis, stations=2)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"chord": np.array([1.0, 0.5])})
    >>> (baseline - moved).max(axis=0).round(3)  # the tip's trailing edge, three quarters behind the axis
    array([0.375, 0.   , 0.   ])
    """

    neutral = 1.0

    scales_thickness: bool = field(default=True, kw_only=True)

    @property
    def scales(self) -> tuple[str, ...]:
        """Direction of the baseline along which it scales; none if it scales all alike."""
        return () if self.scales_thickness else ("stream",)

    def _matrices(self, amounts: np.ndarray) -> np.ndarray:
        return scaling(amounts, amounts if self.scales_thickness else 1.0)

    def _axes(self, attached: AttachedRows) -> np.ndarray:
        return attached.chord_axes if not self.scales_thickness else attached.section_axes


class ThicknessFactor(_InSections):
    """Scale heights of sections normal to their chord lines, from the axis; values are factors on the thickness.

    The camber of a section scales with its thickness.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,); 1 on the baseline.
    axis : ReferenceAxis
        Line from which heights are measured, which stays in place.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> wing = DesignSurface.of(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> shape = wing.parametrization([ThicknessFactor("thickness", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"thickness": np.array([1.5])})
    >>> (np.ptp(moved, axis=0) / np.ptp(baseline, axis=0)).round(3)
    array([1. , 1.5, 1. ])
    """

    neutral = 1.0
    scales = ("normal",)

    def _matrices(self, amounts: np.ndarray) -> np.ndarray:
        return scaling(1.0, amounts)

    def _axes(self, attached: AttachedRows) -> np.ndarray:
        return attached.chord_axes


@dataclass(frozen=True, eq=False)
class Taper(AlongAxis):
    """Scale sections about the axis by a factor, linear from 1 at its first point to the value at its last.

    The factor applies to the ratio of tip and root chord; thickness over chord is preserved.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (1,); 1 on the baseline. It has no stations.
    axis : ReferenceAxis
        Axis about which sections are scaled, which stays in place.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Taper("taper", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"taper": np.array([0.5])})
    >>> (baseline - moved).max(axis=0).round(3)  # the tip's trailing edge, three quarters behind the axis
    array([0.375, 0.   , 0.   ])
    """

    def _bind(self, attached: AttachedRows) -> SectionMap:
        along, spline = (attached.weights, attached.axis_rows), csr_array(attached.stations[:, None])
        return SectionMap(1.0, *along, attached.section_axes, spline, _similar)


def _similar(factor: np.ndarray) -> np.ndarray:
    return scaling(factor, factor)


def parabola(part: np.ndarray) -> np.ndarray:
    """Camber line ``4 part (1 - part)`` along the chord, from 0 to 1: 1 in the middle."""
    return 4.0 * part * (1.0 - part)


@dataclass(frozen=True, eq=False)
class Camber(AtStations):
    """Add camber to sections, normal to their chord lines; values are in chords of the baseline, upwards positive.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,), in chords; 0 on the baseline.
    axis : ReferenceAxis
        Axis of the stations; camber itself is measured from the sections' chord lines.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.
    line : callable
        Camber line for a unit value: heights in chords at fractions of the chord, 0 at the leading and 1 at the
        trailing edge. By default `parabola`: the value is the height of the camber line in its middle.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Camber("camber", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"camber": np.array([0.02])})
    >>> (moved - baseline).max(axis=0).round(3)
    array([0.  , 0.02, 0.  ])
    """

    line: Callable[[np.ndarray], np.ndarray] = field(default=parabola, kw_only=True)

    def _bind(self, attached: AttachedRows) -> Displacement:
        heights = attached.chord_lengths * self._line(attached.chord_parts)
        spline = self.spline.matrix(attached.stations)
        return Displacement(along_vectors(heights[:, None] * attached.chord_axes[:, 1], spline))

    def _line(self, parts: np.ndarray) -> np.ndarray:
        heights = np.broadcast_to(self.line(parts), parts.shape)
        if not np.isfinite(heights).all():
            bad = parts[np.argmin(np.isfinite(heights))]
            raise InputError(
                f"'{self.name}': the camber line is not finite at the part {bad:.4g} of the chord; define it a "
                f"little below 0 and above 1 too, where control points stick out of the surface"
            )
        return heights


class _Shifting(AtStations):
    """A variable that shifts whole sections along one coordinate."""

    def _shift(
        self,
        attached: AttachedRows,
        coordinate: int,
        paths: np.ndarray,
        formula: Callable[[Any], Any],
        unit: float = 1.0,
    ) -> ShiftMap:
        """Shift along the stream (0), the normal (1) or the span (2) by slopes of a formula along paths."""
        along, direction = (attached.weights, attached.axis_rows), attached.frame.axes[coordinate]
        means = np.diff(self.spline.integral(attached.knots), axis=0) / np.diff(attached.knots)[:, None]
        return ShiftMap(self.neutral, *along, direction, paths, means, formula, unit)

    @staticmethod
    def _along_span(attached: AttachedRows) -> np.ndarray:
        return np.broadcast_to(attached.frame.axes[2], attached.directions.shape)


class Span(_Shifting):
    """Stretch the axis along the span and move sections with it; values are factors on spanwise lengths.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,); 1 on the baseline.
    axis : ReferenceAxis
        Axis, stretched from its first point on; sections move with the axis points they are attached to.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Span("span", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"span": np.array([1.5])})
    >>> (moved - baseline).max(axis=0).round(3)
    array([0., 0., 1.])
    """

    neutral = 1.0

    def _bind(self, attached: AttachedRows) -> ShiftMap:
        return self._shift(attached, 2, self._along_span(attached), _excess)


class Sweep(_Shifting):
    """Shear sections downstream along the axis as seen along the stream; values are angles in degrees.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,), in degrees; 0 on the
        baseline. Its tangent is added to the tangent of the existing sweep.
    axis : ReferenceAxis
        Axis, sheared from its first point on; sections move with it and keep their chords.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Sweep("sweep", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"sweep": np.array([10.0])})
    >>> (moved - baseline).max(axis=0).round(4)  # the tip goes back by 2 tan 10 deg
    array([0.3527, 0.    , 0.    ])
    """

    units = "deg"

    def _bind(self, attached: AttachedRows) -> ShiftMap:
        return self._shift(attached, 0, attached.directions, shear, np.radians(1.0))


class Dihedral(_Shifting):
    """Shear sections upwards along the span; values are angles in degrees.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement` of shape (n_stations,), in degrees; 0 on the
        baseline. Its tangent is added to the tangent of the existing dihedral.
    axis : ReferenceAxis
        Axis, sheared from its first point on; sections move with it and stay upright.
    stations : int or sequence of float
        Their number, evenly from the first point of the axis (0) to the last (1), or their positions:
        ``(0.0, 0.4, 1.0)``. A single station is a value for all.
    order : int
        Order of the spline between the stations: 2 straight lines, 4 cubics.
    on : Lattice, optional
        Lattice moved instead of the whole surface; everything embedded in it follows.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((9, 9, 5))))  # chord 1, semi-span 2, in the plane y = 0
    >>> shape = wing.parametrization([Dihedral("dihedral", wing.axis)])
    >>> baseline = wing.mesh.points[wing.mesh.surface_ids]
    >>> moved = shape.apply(baseline, {"dihedral": np.array([10.0])})
    >>> (moved - baseline).max(axis=0).round(4)  # the tip goes up by 2 tan 10 deg
    array([0.    , 0.3527, 0.    ])
    """

    units = "deg"

    def _bind(self, attached: AttachedRows) -> ShiftMap:
        return self._shift(attached, 1, self._along_span(attached), shear, np.radians(1.0))


def _excess(factor: np.ndarray) -> np.ndarray:
    return factor - 1.0
