"""Planform and section variables along a reference axis.

Each works about the axis as the variables before it have left it, so that they can be given in any order. The usual one
is from the section outwards: thickness and camber, chord and taper, twist, then span, sweep and dihedral.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from .axis import ReferenceAxis
from .displacement import Displacement
from .formulas import scaled, slope, turned
from .hung_rows import HungRows
from .sections import SectionMap, along_vectors
from .shifts import ShiftMap
from .stations import StationSpline
from .variable import Carried, DesignMap, Layout

if TYPE_CHECKING:
    from .lattice import Lattice

__all__ = ["Camber", "Chord", "Dihedral", "Span", "Sweep", "Taper", "ThicknessFactor", "Twist", "parabola"]


@dataclass(frozen=True, eq=False)
class AlongAxis(ABC):
    """A variable along a reference axis.

    Parameters
    ----------
    name : str
        Name of the input of `SurfaceControl`.
    axis : ReferenceAxis
        What it works about.
    on : Lattice, optional
        Lattice that is moved instead of all rows; what it embeds follows.
    """

    units: ClassVar[str | None] = None

    name: str
    axis: ReferenceAxis
    on: Lattice | None = field(default=None, kw_only=True)

    def __post_init__(self):
        if not isinstance(self.axis, ReferenceAxis):
            raise InputError(f"'{self.name}': the axis is of type {type(self.axis).__name__}; give a ReferenceAxis")

    @property
    def carried(self) -> tuple[Carried, ...]:
        """The axis, and the lattice if there is one."""
        return (self.axis,) if self.on is None else (self.axis, *self.on.carried)

    def bind(self, layout: Layout) -> DesignMap:
        """Decide stations and directions on the baseline.

        Raises
        ------
        InputError
            If the axis or its stations do not fit the surface.
        """
        design_map = self._bind(self.axis.hang(layout))
        return design_map if self.on is None else self.on.lead(layout, design_map)

    @abstractmethod
    def _bind(self, hung: HungRows) -> DesignMap:
        """Map of all rows."""


@dataclass(frozen=True, eq=False)
class AtStations(AlongAxis):
    """A variable with a value at each of several stations along a reference axis, see `StationSpline`.

    Parameters
    ----------
    name, axis, on
        See `AlongAxis`.
    stations : int or sequence of float
        Their number, evenly from the first (0) to the last point of the axis (1), or where they are. One is a value for
        all.
    order : int
        Order of the spline between them: 2 linear, 4 cubic.
    """

    neutral: ClassVar[float] = 0.0

    stations: int | Sequence[float] = 1
    order: int = field(default=4, kw_only=True)

    @property
    def spline(self) -> StationSpline:
        """Interpolation between the stations."""
        return StationSpline.of(self.stations, self.order)


class _InSections(AtStations):
    """Sections multiplied by a matrix."""

    def _bind(self, hung: HungRows) -> SectionMap:
        spline = self.spline.matrix(hung.stations)
        return SectionMap(self.neutral, hung, self._axes(hung), spline, self._matrices)

    def _axes(self, hung: HungRows) -> np.ndarray:
        return hung.section_axes

    @abstractmethod
    def _matrices(self, amounts) -> np.ndarray:
        """Matrices of the values at sections."""


class Twist(_InSections):
    """Turn sections in their planes about the axis; values in degrees, upstream end up positive."""

    units = "deg"

    def _matrices(self, amounts):
        return turned(np.radians(1.0) * amounts)


@dataclass(frozen=True, eq=False)
class Chord(_InSections):
    """Scale sections about the axis; values are factors on the chord.

    Parameters
    ----------
    name, axis, stations, order, on
        See `AtStations`.
    scales_thickness : bool
        Whether the thickness goes along, so that thickness over chord stays.
    """

    neutral = 1.0

    scales_thickness: bool = field(default=True, kw_only=True)

    def _matrices(self, amounts):
        return scaled(amounts, amounts if self.scales_thickness else 1.0)

    def _axes(self, hung):
        return hung.chord_axes if not self.scales_thickness else hung.section_axes


class ThicknessFactor(_InSections):
    """Scale heights of sections normal to their chord lines, from the axis; values are factors on the thickness.

    The camber of a section is scaled with its thickness.
    """

    neutral = 1.0

    def _matrices(self, amounts):
        return scaled(1.0, amounts)

    def _axes(self, hung):
        return hung.chord_axes


@dataclass(frozen=True, eq=False)
class Taper(AlongAxis):
    """Scale sections about the axis, not at its first point and by the value at its last, linearly between.

    The factor is on the ratio of tip and root chord; thickness over chord stays.
    """

    def _bind(self, hung: HungRows) -> SectionMap:
        return SectionMap(1.0, hung, hung.section_axes, csr_array(hung.stations[:, None]), _similar)


def parabola(part: np.ndarray) -> np.ndarray:
    """Camber line ``4 part (1 - part)`` over the parts of the chord: 1 in the middle."""
    return 4.0 * part * (1.0 - part)


@dataclass(frozen=True, eq=False)
class Camber(AtStations):
    """Add camber to sections, normal to their chord lines; values are in chords of the baseline, upwards positive.

    Parameters
    ----------
    name, axis, stations, order, on
        See `AtStations`.
    line : callable
        Camber line of a unit value: heights in chords at parts of the chord, 0 the leading and 1 the trailing edge.
    """

    line: Callable[[np.ndarray], np.ndarray] = field(default=parabola, kw_only=True)

    def _bind(self, hung: HungRows) -> Displacement:
        heights = hung.chord_lengths * self._line(hung.chord_parts)
        spline = self.spline.matrix(hung.stations)
        return Displacement(along_vectors(heights[:, None] * hung.chord_axes[:, 1], spline))

    def _line(self, parts: np.ndarray) -> np.ndarray:
        heights = np.broadcast_to(self.line(parts), parts.shape)
        if not np.isfinite(heights).all():
            bad = parts[np.argmin(np.isfinite(heights))]
            raise InputError(
                f"'{self.name}': the camber line is not finite at the part {bad:.4g} of the chord; define it a "
                f"little beyond 0 and 1 too, where control points stick out of the surface"
            )
        return heights


class _Shifting(AtStations):
    """Sections shifted as wholes."""

    def _shift(self, hung: HungRows, coordinate: int, paths, slopes) -> ShiftMap:
        """Shift along the stream (0), the normal (1) or the span (2) by slopes along paths."""
        return ShiftMap(self.neutral, hung, hung.frame.axes[coordinate], paths, self.spline, slopes)

    @staticmethod
    def _along_span(hung: HungRows):
        return np.broadcast_to(hung.frame.axes[2], hung.directions.shape)


class Span(_Shifting):
    """Stretch the axis along the span, and carry sections along as they are; values are factors on lengths of span."""

    neutral = 1.0

    def _bind(self, hung):
        return self._shift(hung, 2, self._along_span(hung), _excess)


class Sweep(_Shifting):
    """Shear sections downstream along the axis as seen along the stream; values are angles in degrees."""

    units = "deg"

    def _bind(self, hung):
        return self._shift(hung, 0, hung.directions, _slope_of_degrees)


class Dihedral(_Shifting):
    """Shear sections upwards along the span; values are angles in degrees."""

    units = "deg"

    def _bind(self, hung):
        return self._shift(hung, 1, self._along_span(hung), _slope_of_degrees)


def _excess(factor):
    return factor - 1.0


def _slope_of_degrees(angle):
    return slope(np.radians(1.0) * angle)


def _similar(factor):
    return scaled(factor, factor)
