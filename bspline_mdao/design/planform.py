"""Planform and section variables along a reference axis.

Each works about the axis as the variables before it have left it, so that they can be given in any order. The usual one
is from the section outwards: thickness and camber, chord and taper, twist, then span, sweep and dihedral. All but
`Camber` are maps of two kinds: `SectionMap` multiplies sections in their planes, `ShiftMap` shifts them as wholes, by
the formulas of `section_formulas`. Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from .displacement import Displacement
from .lattice import Lattice
from .reference_axis import AttachedRows, ReferenceAxis, StationSpline
from .section_formulas import rotation, scaling, shear
from .variable import AuxiliaryPoints, DesignMap, Layout, MapPartials, rates_of

__all__ = [
    "Camber",
    "Chord",
    "Dihedral",
    "SectionMap",
    "ShiftMap",
    "Span",
    "Sweep",
    "Taper",
    "ThicknessFactor",
    "Twist",
    "along_vectors",
    "parabola",
]


@dataclass(frozen=True, eq=False)
class AlongAxis(ABC):
    """A variable along a reference axis.

    Parameters
    ----------
    name : str
        Name of the input of `SurfaceControl`.
    axis : ReferenceAxis
        The axis about which it works.
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
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The axis, and the lattice if there is one."""
        return (self.axis,) if self.on is None else (self.axis, *self.on.auxiliary)

    def bind(self, layout: Layout) -> DesignMap:
        """Decide stations and directions on the baseline.

        Raises
        ------
        InputError
            If the axis or its stations do not fit the surface.
        """
        design_map = self._bind(self.axis.attach(layout))
        return design_map if self.on is None else self.on.extend(layout, design_map)

    @abstractmethod
    def _bind(self, attached: AttachedRows) -> DesignMap:
        """Return the map of all rows, which are attached to the axis."""


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
    """A variable that multiplies sections, in their planes about the axis, by a matrix."""

    def _bind(self, attached: AttachedRows) -> SectionMap:
        spline = self.spline.matrix(attached.stations)
        return SectionMap(self.neutral, attached, self._axes(attached), spline, self._matrices)

    def _axes(self, attached: AttachedRows) -> np.ndarray:
        return attached.section_axes

    @abstractmethod
    def _matrices(self, amounts) -> np.ndarray:
        """Matrices, shape (n, 2, 2), of the values at sections, shape (n,)."""


class Twist(_InSections):
    """Turn sections in their planes about the axis; values in degrees, upstream end up positive."""

    units = "deg"

    def _matrices(self, amounts):
        return rotation(np.radians(1.0) * amounts)


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
        return scaling(amounts, amounts if self.scales_thickness else 1.0)

    def _axes(self, attached):
        return attached.chord_axes if not self.scales_thickness else attached.section_axes


class ThicknessFactor(_InSections):
    """Scale heights of sections normal to their chord lines, from the axis; values are factors on the thickness.

    The camber of a section is scaled with its thickness.
    """

    neutral = 1.0

    def _matrices(self, amounts):
        return scaling(1.0, amounts)

    def _axes(self, attached):
        return attached.chord_axes


@dataclass(frozen=True, eq=False)
class Taper(AlongAxis):
    """Scale sections about the axis by a factor that is 1 at its first point and the value at its last, linear between.

    The factor is on the ratio of tip and root chord; thickness over chord stays.
    """

    def _bind(self, attached: AttachedRows) -> SectionMap:
        return SectionMap(1.0, attached, attached.section_axes, csr_array(attached.stations[:, None]), _similar)


def _similar(factor):
    return scaling(factor, factor)


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
    """A variable that shifts sections as wholes along one coordinate."""

    def _shift(self, attached: AttachedRows, coordinate: int, paths, slopes) -> ShiftMap:
        """Shift along the stream (0), the normal (1) or the span (2) by slopes along paths."""
        return ShiftMap(self.neutral, attached, attached.frame.axes[coordinate], paths, self.spline, slopes)

    @staticmethod
    def _along_span(attached: AttachedRows):
        return np.broadcast_to(attached.frame.axes[2], attached.directions.shape)


class Span(_Shifting):
    """Stretch the axis along the span; sections move along unchanged. Values are factors on lengths of span."""

    neutral = 1.0

    def _bind(self, attached):
        return self._shift(attached, 2, self._along_span(attached), _excess)


class Sweep(_Shifting):
    """Shear sections downstream along the axis as seen along the stream; values are angles in degrees."""

    units = "deg"

    def _bind(self, attached):
        return self._shift(attached, 0, attached.directions, _slope_of_degrees)


class Dihedral(_Shifting):
    """Shear sections upwards along the span; values are angles in degrees."""

    units = "deg"

    def _bind(self, attached):
        return self._shift(attached, 1, self._along_span(attached), _slope_of_degrees)


def _excess(factor):
    return factor - 1.0


def _slope_of_degrees(angle):
    return shear(np.radians(1.0) * angle)


@dataclass(frozen=True, eq=False)
class SectionMap:
    """Multiply places in the planes of sections, about the axis as it is, by a matrix of an amount per section.

    Row x with the axis point c, the axes E (2 x 3) of its section and the amount a moves to
    ``x + E^T (M(a) - 1) E (x - c)``.

    Parameters
    ----------
    neutral : float
        Amount, and value, at which nothing moves.
    attached : AttachedRows
        The rows, attached to the axis.
    axes : ndarray, shape (n_rows, 2, 3)
        Two orthonormal directions in the plane of each row's section.
    spline : csr_array, shape (n_rows, n_values)
        Amounts of sections, less the neutral one, of values less the neutral one.
    matrices : callable
        Matrices, shape (n_rows, 2, 2), of amounts, shape (n_rows,); complex-safe.
    """

    neutral: float
    attached: AttachedRows
    axes: np.ndarray
    spline: csr_array
    matrices: Callable[[np.ndarray], np.ndarray]

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return np.full(self.spline.shape[1], self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        changes = self.matrices(self._amounts(values)) - np.eye(2)
        return points + self._in_space(np.einsum("nij,nj->ni", changes, self._in_plane(points)))

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        amounts = self._amounts(values)
        changes = self.axes.swapaxes(1, 2) @ (self.matrices(amounts) - np.eye(2)) @ self.axes
        rates = rates_of(self.matrices, amounts)
        moved = self._in_space(np.einsum("nij,nj->ni", rates, self._in_plane(points)))
        return MapPartials(self._points_jacobian(changes), along_vectors(moved, self.spline))

    def _amounts(self, values):
        return self.neutral + self.spline @ (values - self.neutral)

    def _in_plane(self, points):
        """Coordinates about the axis in the plane of the section, shape (n_rows, 2)."""
        return np.einsum("nij,nj->ni", self.axes, points - self.attached.centres(points))

    def _in_space(self, local):
        return np.einsum("nij,ni->nj", self.axes, local)

    def _points_jacobian(self, changes) -> csr_array:
        """Derivative with respect to the row itself and to the points of the axis, of changes (n_rows, 3, 3)."""
        weights, n = self.attached.weights.tocoo(), len(changes)
        influenced = np.concatenate([np.arange(n), weights.row])
        influences = np.concatenate([np.arange(n), self.attached.axis_rows[weights.col]])
        d_axis = -weights.data[:, None, None] * changes[weights.row]
        data = np.concatenate([np.eye(3) + changes, d_axis])
        rows = np.broadcast_to(3 * influenced[:, None, None] + np.arange(3)[:, None], data.shape)
        columns = np.broadcast_to(3 * influences[:, None, None] + np.arange(3), data.shape)
        return csr_array((data.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, 3 * n))


def along_vectors(vectors: np.ndarray, amounts: csr_array) -> csr_array:
    """Displacements along a vector per row, shape (n_rows, 3), of amounts per row and value, shape (n_rows, n_values).

    Returns
    -------
    csr_array, shape (3 n_rows, n_values)
        xyz interleaved; entries that happen to be zero are kept.
    """
    entries = amounts.tocoo()
    data = vectors[entries.row] * entries.data[:, None]
    rows = 3 * entries.row[:, None] + np.arange(3)
    shape = 3 * amounts.shape[0], amounts.shape[1]
    return csr_array((data.ravel(), (rows.ravel(), np.repeat(entries.col, 3))), shape=shape)


@dataclass(frozen=True, eq=False)
class ShiftMap:
    """Shift sections in one direction by the integral of a slope along the axis, from its first point on.

    The slope is interpolated between stations. Over the segment i of the axis it has the mean ``sum_k B_ik m_k``, which
    counts for the length ``l_i`` of the segment along its path ``g_i`` as it is. Points of the axis move in the
    direction d by the sums up to them, and rows as the axis at their stations, with weights W:
    ``x_p + d sum_qi W_pq [i < q] l_i B_ik m_k``. So sections stay attached at their stations.

    Parameters
    ----------
    neutral : float
        Value at which the slope is none.
    attached : AttachedRows
        The rows, attached to the axis.
    direction : ndarray, shape (3,)
        In which sections are shifted.
    paths : ndarray, shape (n_axis - 1, 3)
        Unit vector for every segment of the axis, along which its length counts.
    spline : StationSpline
        Between the values.
    slopes : callable
        Slopes, shape (n_values,), of values; complex-safe, one by one.
    """

    neutral: float
    attached: AttachedRows
    direction: np.ndarray
    paths: np.ndarray
    spline: StationSpline
    slopes: Callable[[np.ndarray], np.ndarray]

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return np.full(self.spline.n_values, self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        shifts = self._sums @ (self._lengths(points) * (self._means @ self.slopes(values)))
        return points + shifts[:, None] * self.direction

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        rates = rates_of(self.slopes, values)
        d_values = self._sums @ (self._lengths(points)[:, None] * self._means * rates)
        d_points = (self._sums * (self._means @ self.slopes(values))) @ self._steps
        return MapPartials(self._points_jacobian(d_points), self._matrix(d_values, self._influence_of_values))

    def _lengths(self, points):
        return np.sum(np.diff(points[self.attached.axis_rows], axis=0) * self.paths, axis=1)

    @cached_property
    def _means(self) -> np.ndarray:
        """Mean influence of every value over every segment, shape (n_axis - 1, n_values)."""
        knots = self.attached.knots
        return np.diff(self.spline.integral(knots), axis=0) / np.diff(knots)[:, None]

    @cached_property
    def _sums(self) -> np.ndarray:
        """Sums of the slopes over segments up to every row, as weights of shape (n_rows, n_axis - 1)."""
        n = len(self.attached.knots)
        return self.attached.weights @ np.tri(n, n - 1, -1)

    @cached_property
    def _steps(self) -> np.ndarray:
        """Derivatives of the lengths of segments in the points of the axis, shape (n_axis - 1, 3 n_axis)."""
        n = len(self.attached.knots)
        differences = np.eye(n)[1:] - np.eye(n)[:-1]
        return (differences[:, :, None] * self.paths[:, None]).reshape(n - 1, 3 * n)

    @cached_property
    def _influence_of_values(self) -> np.ndarray:
        """Whether each row may depend on each value, shape (n_rows, n_values)."""
        return (self._sums != 0.0) @ (self._means != 0.0)

    @cached_property
    def _influence_of_points(self) -> np.ndarray:
        """Whether each row may depend on each coordinate of the axis, shape (n_rows, 3 n_axis)."""
        return (self._sums != 0.0) @ (self._steps != 0.0)

    def _points_jacobian(self, rates) -> csr_array:
        """Derivative of the rows with respect to the rows, from that of the shifts with respect to the axis."""
        shifts = self._matrix(rates, self._influence_of_points).tocoo()
        columns = (3 * self.attached.axis_rows[:, None] + np.arange(3)).ravel()
        n = shifts.shape[0]
        data = np.concatenate([np.ones(n), shifts.data])
        rows, columns = np.append(np.arange(n), shifts.row), np.append(np.arange(n), columns[shifts.col])
        return csr_array((data, (rows, columns)), shape=(n, n))

    def _matrix(self, rates, influence) -> csr_array:
        """Displacements of shifts of rates (n_rows, n), with entries wherever there may be an influence."""
        coordinates = np.flatnonzero(self.direction)
        shifted, sources = np.nonzero(influence)
        data = rates[shifted, sources][:, None] * self.direction[coordinates]
        rows, columns = 3 * shifted[:, None] + coordinates, np.repeat(sources, len(coordinates))
        return csr_array((data.ravel(), (rows.ravel(), columns)), shape=(3 * len(rates), rates.shape[1]))
