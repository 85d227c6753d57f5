"""Positions of the surface on its sections: fraction of the chord, side, and normal to the chord line.

Positions are taken on the surface itself, at the Greville abscissae of its control points, on the baseline. The leading
edge of a section is its point furthest from the trailing edge, where the surface is perpendicular to the chord line:
there the normal changes from one side to the other, and the fraction of the chord is zero. Theory:
``docs/theory/parametrization.rst``, "Sections as one curve".
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...base.display import OneLine
from ...base.numerics.vectors import dots, lengths
from ..measures.edge_cuts import root_end
from ..mesh.control_net import surface_quads
from ..mesh.frame import mesh_frame
from ..mesh.greville_surface import GrevilleSurface
from .reference_axis import ReferenceAxis, chord_lines
from .variable import Layout

__all__ = ["SectionPlaces"]

_SECTIONS = 9
"""Number of places along the span where chord lines are found; they are joined by straight lines."""

_LAST = 1e-6
"""Fraction of the chord by which corners of a blunt trailing edge may differ along the stream, as in measured
sections."""

_NEAREST = 5
"""Number of points that define the parabola whose vertex is the leading edge."""


@dataclass(frozen=True, eq=False)
class SectionPlaces(OneLine):
    """Positions of the surface on its sections, one for each surface control point."""

    surface: GrevilleSurface
    stations: np.ndarray  # (n_surface,), stations on the axis, 0 at the root
    parts: np.ndarray  # (n_surface,), fractions of the chord, 0 at the leading edge
    sides: np.ndarray  # (n_surface,), 1 on the upper side and -1 on the lower one
    chords: np.ndarray  # (n_surface,), chords of the sections (m)
    up: np.ndarray  # (n_surface, 3), unit normals of the chord lines in the planes of the sections

    @classmethod
    def of(
        cls,
        layout: Layout,
        axis: ReferenceAxis | None = None,  # axis of the stations; the straight line along the span by default
    ) -> SectionPlaces:
        """Find the chord lines on the baseline."""
        mesh, surface = layout.mesh, GrevilleSurface.of(layout.mesh)
        frame = mesh_frame(mesh)
        if axis is None:
            along = np.linspace(0.0, frame.span, _SECTIONS)[:, None] * frame.axes[2]
            axis = ReferenceAxis(frame.origin + along, order=2)
        attached = axis.attach(_PointsOnSurface(mesh, (axis,), on_surface=surface.points))
        n, stations = len(surface.points), attached.stations
        sampled = axis.attach(_PointsOnSurface(mesh, (axis,), on_surface=surface.samples)).stations[
            : len(surface.samples)
        ]
        root = root_end(surface_quads(mesh), stations[:n])
        lines = chord_lines(
            surface.samples, surface.quads, sampled, attached.knots, frame.axes[0], root=root, ends_of=_edges
        )
        attached = replace(attached, lines=lines)
        up = attached.chord_axes[:n, 1]
        sides = np.where(dots(surface.normals, up) >= 0.0, 1.0, -1.0)
        parts = np.clip(attached.chord_parts[:n], 0.0, 1.0)
        return cls(surface, stations[:n], parts, sides, attached.chord_lengths[:n], up)


@dataclass(frozen=True, eq=False)
class _PointsOnSurface(Layout):
    """Rows that are points of the surface instead of control points."""

    on_surface: np.ndarray = field(kw_only=True)  # (n, 3)

    @property
    def n_surface(self) -> int:
        return len(self.on_surface)

    @property
    def points(self) -> np.ndarray:  # type: ignore[override]
        return np.concatenate([self.on_surface, *(item.points for item in self.auxiliary)])


def _edges(section: np.ndarray, stream: np.ndarray) -> np.ndarray:
    """Leading and trailing edge, shape (2, 3), of points (n, 3) of a section."""
    # 1. The trailing edge is the point furthest downstream, or midway between the outer two such points.
    # 2. The leading edge is the point furthest from it.
    # 3. Between points it is the vertex of the parabola through the nearest ones.
    along = section @ stream
    if not len(section) or not np.ptp(along):
        return np.zeros((2, 3))
    across = _across(section, stream)
    heights = section @ across
    last = np.flatnonzero(along >= along.max() - _LAST * np.ptp(along))
    ends = last[[np.argmin(heights[last]), np.argmax(heights[last])]]
    trailing = section[ends].mean(axis=0)  # step 1
    distances = lengths(section - trailing)
    leading = section[np.argmax(distances)]  # step 2
    chord = (trailing - leading) / distances.max()
    normal = across - (across @ chord) * chord
    normal /= np.linalg.norm(normal)
    places = np.stack([(section - leading) @ chord, (section - leading) @ normal], axis=1)
    near = np.unique(places, axis=0)
    near = near[np.argsort(lengths(near), kind="stable")][:_NEAREST]
    if len(near) == _NEAREST:  # step 3
        bend, slope, least = np.polyfit(near[:, 1], near[:, 0], 2)
        height = -0.5 * slope / bend if bend > 0.0 else np.inf
        if near[:, 1].min() < height < near[:, 1].max():
            depth = np.polyval([bend, slope, least], height)
            leading = leading + min(depth, 0.0) * chord + height * normal
    return np.array([leading, trailing])


def _across(section: np.ndarray, stream: np.ndarray) -> np.ndarray:
    """Direction perpendicular to the stream in which a section is largest."""
    flat = section - section.mean(axis=0)
    flat = flat - (flat @ stream)[:, None] * stream
    return np.linalg.svd(flat, full_matrices=False)[2][0]
