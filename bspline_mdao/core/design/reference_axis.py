"""Reference axes: lines along the span about which planform variables act, and which move with the surface.

On the baseline every row of points is attached to the axis at a station. A spline of local support interpolates between
the points of an axis, and between the values of a variable at stations. Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.sparse import csr_array

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...errors import InputError
from ..measures.edge_cuts import cut_edges, edges_of_quads, root_end
from ..mesh.control_net import surface_quads
from ..mesh.frame import Frame, Plane, mesh_frame, mesh_planes
from ..mesh.moving_mesh import MovingMesh, require_mesh
from ..mesh.surface import SurfaceGrid
from ..movement.mover import PLANE_TOLERANCE
from .section_maps import rotation
from .variable import Layout

__all__ = ["AttachedRows", "ChordLines", "ReferenceAxis", "StationSpline", "chord_lines"]

_INSIDE = 2e-2
"""Sections are cut at least this fraction of the whole extent inside the ends, which may have no chord: at a fitted
tip, single control points stick out."""

_NEAR = 0.02
"""The mean of points within this fraction of the chord from its end gives the height of the end: control points of a
blunt nose stick out above and below it."""

_NO_CHORD = 1e-6
"""A chord shorter than this fraction of the surface's box counts as zero: its section has no direction."""


@dataclass(frozen=True, eq=False)
class ReferenceAxis(OneLine):
    """A line through points from the root to the tip.

    Every row moved by variables is attached to the axis: on the baseline, once and for all, it gets a *station*, its
    position on the axis between the first (0) and last point (1). Along a straight axis the span increases; a row's
    station follows from its position along the span, and sections are normal to the span. On a curved axis, such as one
    that goes up a winglet, it is the station of the closest point, seen along the stream. Sections are normal to the
    axis in that view, except at a symmetry plane in which the axis begins, where they lie in that plane.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Points on the baseline (m), the root first.
    is_curved : bool
        Whether stations are taken from closest points.
    order : int
        Order of the curve through the points: 2 straight lines, 4 cubics, see `StationSpline`. Beyond the last point
        the axis continues along the straight line through the last two, and likewise inboard of the first point if that
        is in a symmetry plane. Otherwise, everything inboard of the first point, such as a body, is attached to that
        point.

    Raises
    ------
    InputError
        If the shape is wrong, or a coordinate is not finite.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import ReferenceAxis
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> axis = ReferenceAxis.of(mesh, at=0.25, n=3)  # or ReferenceAxis(points)
    >>> axis.points.round(3).tolist()
    [[0.25, 0.0, 0.0], [0.25, 0.0, 1.0], [0.25, 0.0, 2.0]]
    """

    points: np.ndarray
    is_curved: bool = field(default=False, kw_only=True)
    order: int = field(default=4, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", as_numbers(self.points, "reference axis"))
        if self.points.ndim != 2 or self.points.shape[1] != 3 or len(self.points) < 2:
            raise InputError(f"reference axis: points of shape {self.points.shape}; give (n, 3), n at least 2")
        if not np.isfinite(self.points).all():
            bad = int(np.argmin(np.isfinite(self.points).all(axis=1)))
            raise InputError(f"reference axis: point {bad + 1} is {self.points[bad].tolist()}; give finite numbers")

    @classmethod
    def of(
        cls,
        mesh: MovingMesh,
        at: float = 0.25,
        n: int = 9,
        span: tuple[float, float] = (0.0, 1.0),
        surface: SurfaceGrid | None = None,
    ) -> ReferenceAxis:
        """Find a straight axis at one fraction of the chord of every section.

        Parameters
        ----------
        mesh : MovingMesh
            The control mesh. Its symmetry planes and the box of its surface define stream, normal and span, see
            `surface_frame`.
        at : float
            Fraction of the chord, 0 at the leading edge and 1 at the trailing edge.
        n : int
            Number of points of the axis.
        span : tuple of float
            Fractions of the span where the axis begins and ends.
        surface : SurfaceGrid, optional
            The surface whose sections are used, from their most upstream to their most downstream point. By default the
            control mesh itself, which sticks out of the surface at a blunt nose.

        Returns
        -------
        ReferenceAxis

        Raises
        ------
        InputError
            If the surface has no span, or a section no chord.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> from bspline_mdao.movers import moving_mesh
        >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 9)), n_control=(5, 5, 5)))
        >>> ReferenceAxis.of(mesh, at=0.25, n=2).points.round(3).tolist()
        [[0.25, 0.0, 0.0], [0.997, 0.0, 1.484]]
        """
        frame = mesh_frame(require_mesh(mesh, "reference axis"))
        if not span[0] < span[1]:
            raise InputError(f"reference axis: span {span}; give two rising parts of it, such as (0.0, 1.0)")
        levels = np.linspace(*span, n) * frame.span
        points = mesh.points[mesh.surface_ids] if surface is None else surface.points
        quads = surface_quads(mesh) if surface is None else surface.quads
        lines = chord_lines(points, quads, frame.to_local(points)[:, 2], levels, frame.axes[0])
        local = frame.to_local(lines.leading + at * lines.chords)
        return cls(frame.to_space(np.column_stack([local[:, :2], levels])))

    def attach(self, layout: Layout) -> AttachedRows:
        """Attach all rows to the axis: return their stations and sections.

        Raises
        ------
        InputError
            If the axis does not advance along the span, misses the surface, or has two coincident points.
        """
        frame = mesh_frame(layout.mesh)
        seen = frame.axes[1:] if self.is_curved else frame.axes[2:]
        steps = np.diff(self.points, axis=0) @ seen.T
        self._require_advance(steps)
        sizes = lengths(steps)
        ends = np.concatenate([[0.0], np.cumsum(sizes)])
        planes = mesh_planes(layout.mesh)
        begins_in_plane = any(self._begins_in(plane, PLANE_TOLERANCE * layout.mesh.size) for plane in planes)
        segments, parts = _closest(self.points[:-1] @ seen.T, steps, layout.points @ seen.T, begins_in_plane)
        directions = (steps / sizes[:, None]) @ seen
        stations = (ends[segments] + parts * sizes[segments]) / ends[-1]
        self._require_overlap(layout.points[layout.rows()] @ frame.axes[2], stations[layout.rows()], frame)
        return AttachedRows(self, layout, frame, ends / ends[-1], directions, stations, begins_in_plane)

    def _begins_in(self, plane: Plane, tolerance: float) -> bool:
        return abs(self.points[0] @ plane.normal - plane.offset) <= tolerance

    def _require_overlap(self, places: np.ndarray, stations: np.ndarray, frame: Frame) -> None:
        """Refuse an axis with the whole surface inboard or outboard of it."""
        if not stations.max() > 0.0 or not stations.min() < 1.0:
            ends = self.points[[0, -1]] @ frame.axes[2]
            raise InputError(
                f"reference axis: it goes from {ends[0]:.4g} to {ends[1]:.4g} m along the span, the surface from "
                f"{places.min():.4g} to {places.max():.4g} m; lay it along the surface, in metres"
            )

    def _require_advance(self, steps: np.ndarray) -> None:
        """Refuse points that do not advance along the span, or that coincide on a curved axis."""
        is_bad = ~steps.any(axis=1) if self.is_curved else steps[:, 0] <= 0.0
        if is_bad.any():
            raise InputError(
                f"reference axis: point {np.argmax(is_bad) + 2} is not further along than the one before; begin at "
                f"the root, and set is_curved=True for an axis that does not go out along the span everywhere"
            )


def _closest(
    starts: np.ndarray, steps: np.ndarray, points: np.ndarray, goes_on_inboard: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the segment closest to each point (n, m) and the position on it from 0 to 1."""
    # 1. Every point is projected onto the line of every segment.
    # 2. Positions are clipped to the segment; the last continues outboard, the first inboard if it may.
    # 3. The segment at the smallest distance is taken, the first of equals.
    offsets = points[:, None] - starts
    low, high = np.zeros(len(steps)), np.ones(len(steps))
    low[0], high[-1] = -np.inf if goes_on_inboard else 0.0, np.inf
    parts = np.clip(np.sum(offsets * steps, axis=2) / np.sum(steps**2, axis=1), low, high)  # steps 1 and 2
    # step 3
    segments = np.argmin(np.sum((offsets - parts[:, :, None] * steps) ** 2, axis=2), axis=1)
    return segments, parts[np.arange(len(points)), segments]


@dataclass(frozen=True, eq=False)
class AttachedRows(OneLine):
    """Rows attached to a reference axis: their stations and section planes, computed on the baseline."""

    axis: ReferenceAxis
    layout: Layout  # the rows
    frame: Frame  # stream, normal and span
    knots: np.ndarray  # (n_axis,), stations of the axis' own points, from 0 to 1
    directions: np.ndarray  # (n_axis - 1, 3), unit vectors between them, as seen
    # station of every row; above 1 outboard of the axis, and below 0 inboard of an axis that begins in a plane
    stations: np.ndarray  # (n_rows,)
    begins_in_plane: bool  # whether the axis begins in a symmetry plane
    # chord lines at the axis' own points; of the control mesh by default
    lines: ChordLines | None = None

    @cached_property
    def axis_rows(self) -> np.ndarray:
        """Rows of the axis' own points, shape (n_axis,)."""
        rows = self.layout.rows(self.axis)
        return np.arange(rows.start, rows.stop)

    @cached_property
    def weights(self) -> csr_array:
        """Weights of the axis' points for its point at the station of every row, shape (n_rows, n_axis)."""
        weights = self._inside.toarray()
        inboard = np.minimum(self.stations, 0.0) / self.knots[1]
        outboard = np.maximum(self.stations - 1.0, 0.0) / (1.0 - self.knots[-2])
        weights[:, :2] += inboard[:, None] * [-1.0, 1.0]
        weights[:, -2:] += outboard[:, None] * [-1.0, 1.0]
        return csr_array(weights)

    @cached_property
    def section_axes(self) -> np.ndarray:
        """Stream and upward directions in the plane of the section of every row; shape (n_rows, 2, 3)."""
        stream, normal, span = self.frame.axes
        out = np.concatenate([self.directions[:1], self.directions, self.directions[-1:]])
        out = _unit(out[:-1] + out[1:])
        if self.begins_in_plane:
            out[0] = span
        out = _unit(self._inside @ out)
        above = (out @ span)[:, None] * normal - (out @ normal)[:, None] * span
        return np.stack([np.broadcast_to(stream, above.shape), above], axis=1)

    @cached_property
    def chord_lengths(self) -> np.ndarray:
        """Chord of the section of every row (m), shape (n_rows,)."""
        return self._inside @ np.linalg.norm(self._chord_lines.chords, axis=1)

    @cached_property
    def chord_axes(self) -> np.ndarray:
        """`section_axes` rotated with the first along the chord line, shape (n_rows, 2, 3)."""
        along, above = np.einsum("nij,nj->in", self.section_axes[self.axis_rows], self._chord_lines.chords)
        angle = self._inside @ np.arctan2(above, along)
        return rotation(angle) @ self.section_axes

    @cached_property
    def chord_parts(self) -> np.ndarray:
        """Chordwise position of every row, 0 at the leading edge; shape (n_rows,)."""
        behind = self.layout.points - self.weights @ self._chord_lines.leading
        return np.sum(behind * self.chord_axes[:, 0], axis=1) / self.chord_lengths

    @cached_property
    def _inside(self) -> csr_array:
        """Weights of the axis' points between its ends, constant beyond them."""
        return StationSpline(tuple(self.knots), self.axis.order).matrix(self.stations)

    @cached_property
    def _chord_lines(self) -> ChordLines:
        """Chord lines of the surface at the axis' own points."""
        if self.lines is not None:
            return self.lines
        rows, quads = self.layout.rows(), surface_quads(self.layout.mesh)
        return chord_lines(self.layout.points[rows], quads, self.stations[rows], self.knots, self.frame.axes[0])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / lengths(vectors)[:, None]


@dataclass(frozen=True)
class StationSpline(OneLine):
    """Interpolation of values at stations along an axis, with local support, constant beyond the ends."""

    stations: tuple[float, ...]  # ascending positions on the axis, 0 at its first point and 1 at its last
    # 2: straight lines, on which a value has an influence one interval to either side of its station. 4: cubics with
    # the slope of the parabola through each station and its neighbours; two intervals to either side
    order: int = 4

    def __post_init__(self) -> None:
        if self.order not in (2, 4):
            raise InputError(f"stations: order {self.order}; give 2 for straight lines or 4 for cubics")
        places = np.asarray(self.stations)
        if not (len(places) and np.all(np.diff(places) > 0.0) and places[0] >= 0.0 and places[-1] <= 1.0):
            raise InputError(f"stations: {list(self.stations)} do not ascend within 0 (root) to 1 (end of the axis)")

    @classmethod
    def of(cls, stations: int | Sequence[float], order: int = 4) -> StationSpline:
        """Make the spline for a number of stations, evenly from 0 to 1, or for given stations.

        Examples
        --------
        >>> StationSpline.of(3).stations
        (0.0, 0.5, 1.0)
        """
        if isinstance(stations, (int, np.integer)):
            if stations < 1:
                raise InputError(f"stations: {stations} of them; give at least one")
            return cls(tuple(np.linspace(0.0, 1.0, stations).tolist()), order)
        if np.ndim(stations) != 1:
            raise InputError(f"stations: {stations}; give how many, or a list of places from 0 to 1")
        return cls(tuple(float(station) for station in stations), order)

    @property
    def n_values(self) -> int:
        """Number of stations."""
        return len(self.stations)

    def matrix(self, at: np.ndarray) -> csr_array:
        """Sparse matrix, shape (n, n_values), for the values at positions on the axis, shape (n,)."""
        return csr_array(self.basis(at))

    def basis(self, at: np.ndarray) -> np.ndarray:
        """Influence of every value at positions on the axis of any shape; shape (..., n_values)."""
        return self._pieces(np.clip(at, self._ends[0], self._ends[1]))

    def slopes(self, at: np.ndarray) -> np.ndarray:
        """Slopes of `basis` at positions on the axis of any shape, zero beyond the ends; shape (..., n_values)."""
        is_inside = (at >= self._ends[0]) & (at <= self._ends[1])
        inside = np.clip(at, self._ends[0], self._ends[1])
        return np.where(is_inside[..., None], self._pieces.derivative()(inside), 0.0)

    def integral(self, at: np.ndarray) -> np.ndarray:
        """Integrals of `basis` from one common position to positions on the axis; shape (..., n_values)."""
        inside = np.clip(at, self._ends[0], self._ends[1])
        return self._antiderivative(inside) + (at - inside)[..., None] * self._pieces(inside)

    @property
    def _ends(self) -> tuple:
        return self.stations[0], self.stations[-1]

    @cached_property
    def _pieces(self) -> PPoly:
        values, places = np.eye(self.n_values), np.array(self.stations)
        if self.n_values == 1:
            return PPoly(np.ones((1, 1, 1)), [places[0], places[0] + 1.0])
        if self.order == 2:
            return PPoly(np.stack([np.diff(values, axis=0) / np.diff(places)[:, None], values[:-1]]), places)
        # second-order differences are the slopes of parabolas, one-sided at the ends
        slopes = np.gradient(values, places, axis=0, edge_order=2 if self.n_values > 2 else 1)
        return CubicHermiteSpline(places, values, slopes)

    @cached_property
    def _antiderivative(self) -> PPoly:
        return self._pieces.antiderivative()


@dataclass(frozen=True, eq=False)
class ChordLines:
    """Ends of the chord lines of sections of a surface."""

    # upstream and downstream ends (m)
    leading: np.ndarray  # (n, 3)
    trailing: np.ndarray  # (n, 3)

    @property
    def chords(self) -> np.ndarray:
        """Vectors from the leading to the trailing end (m), shape (n, 3)."""
        return self.trailing - self.leading


def chord_lines(
    points: np.ndarray,  # (n_points, 3), points of the surface (m)
    quads: np.ndarray,  # int (n_quads, 4), points at the corners of its quads
    places: np.ndarray,  # (n_points,), position of every point along the span or an axis; linear on the edges between
    at: np.ndarray,  # (n,), positions of the sections
    stream: np.ndarray,  # (3,), unit vector downstream
    root: float | None = None,  # position from which on sections are complete, if the quads do not show it
    # finds both ends of a section's chord from its points (n, 3) and the direction downstream
    ends_of: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray] | np.ndarray] | None = None,
) -> ChordLines:
    """Find the chord lines of a surface of quads."""
    # returns from the most upstream to the most downstream point of every section, at the mean height of the nearby
    # points. Over the last fiftieth before the ends of the surface and outside it, and at a root with incomplete
    # sections (`root_end`), both continue along straight lines
    margin = _INSIDE * np.ptp(places)
    low, high = max(places.min(), root_end(quads, places) if root is None else root) + margin, places.max() - margin
    cut_at = np.clip(at, low, high)
    further = cut_at + np.where(cut_at < 0.5 * (low + high), margin, -margin)
    edges = edges_of_quads(quads)
    ends_of = ends_of or _ends
    ends, inner = (_cut(points, edges, places, levels, stream, ends_of) for levels in (cut_at, further))
    ends = ends + ((at - cut_at) / (further - cut_at))[:, None, None] * (inner - ends)
    lines = ChordLines(ends[:, 0], ends[:, 1])
    is_short = ~(np.linalg.norm(lines.chords, axis=1) > _NO_CHORD * np.ptp(points, axis=0).max())
    if is_short.any():
        place = at[np.argmax(is_short)]
        raise InputError(f"reference axis: the section at {place:g} of the span has no chord; end the axis short of it")
    return lines


def _cut(
    points: np.ndarray,
    edges: np.ndarray,
    places: np.ndarray,
    levels: Sequence[float] | np.ndarray,
    stream: np.ndarray,
    ends_of: Callable,
) -> np.ndarray:
    """Ends of the chord lines of sections at several places, shape (n_levels, 2, 3)."""
    return np.array([ends_of(cut_edges(edges, places - level).at(points), stream) for level in levels])


def _ends(section: np.ndarray, stream: np.ndarray) -> Sequence[np.ndarray] | np.ndarray:
    """Most upstream and most downstream position of a section, points (n, 3), midway between both sides."""
    along = section @ stream
    if not len(section) or not np.ptp(along):
        return np.zeros((2, 3))
    behind = (along - along.min()) / np.ptp(along)
    return [_end(section, along, part, stream) for part in (behind, 1.0 - behind)]


def _end(section: np.ndarray, along: np.ndarray, distance: np.ndarray, stream: np.ndarray) -> np.ndarray:
    """Mean of the points near an end of a chord, by their distances from it in chords, shifted to that end."""
    weights = np.maximum(_NEAR - distance, 0.0)
    middle = weights @ section / weights.sum()
    return middle + (along[np.argmin(distance)] - middle @ stream) * stream
