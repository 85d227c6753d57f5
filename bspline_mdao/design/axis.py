"""Reference axes: lines along the span that planform variables work about, carried along when variables move them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..checks import as_numbers
from ..errors import InputError
from ..mesh.frame import Frame, Plane, surface_frame
from ..mesh.mesh import MovingMesh, require_mesh
from ..movement.mover import PLANE_TOLERANCE
from .chord_lines import chord_lines
from .deformation import planes_of
from .hung_rows import HungRows
from .surface_net import surface_quads
from .variable import Layout

if TYPE_CHECKING:
    from ..mesh.surface import SurfaceGrid

__all__ = ["ReferenceAxis"]


@dataclass(frozen=True, eq=False)
class ReferenceAxis:
    """A line through points from the root to the tip.

    Every row that variables move hangs on the axis: on the baseline, once and for all, it is given a *station*, the
    part of the axis between its first (0) and its last point (1). A straight axis is one along which the span
    increases; a row's station is that of its place along the span, and sections are normal to the span. Of a curved
    axis, such as one that goes up a winglet, it is that of the closest point, seen along the stream; sections are
    normal to the axis as seen that way, but those at a plane of symmetry in which the axis begins are in that plane.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Points on the baseline (m), the root first.
    is_curved : bool
        Whether stations are those of closest points.
    order : int
        What joins the points: 2 straight lines, 4 cubics, see `StationSpline`. Beyond the last point the axis goes on
        along the straight line through the last two; so it does inboard of the first if that is in a plane of symmetry.
        Otherwise, what is inboard of the first point, such as a body, hangs on that point.

    Raises
    ------
    InputError
        If the shape is wrong, or a coordinate is not finite.
    """

    points: np.ndarray
    is_curved: bool = field(default=False, kw_only=True)
    order: int = field(default=4, kw_only=True)

    def __post_init__(self):
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
        """Find a straight axis at one part of the chord of every section.

        Parameters
        ----------
        mesh : MovingMesh
            The control mesh. Its planes of symmetry and the box of its surface tell stream, normal and span, see
            `surface_frame`.
        at : float
            Part of the chord, 0 the leading edge and 1 the trailing edge.
        n : int
            Points of the axis.
        span : tuple of float
            Parts of the span where the axis begins and ends.
        surface : SurfaceGrid, optional
            The surface whose sections count, from their most upstream to their most downstream point. By default that
            is the control mesh itself, which sticks out of the surface at a blunt nose.

        Returns
        -------
        ReferenceAxis

        Raises
        ------
        InputError
            If the surface has no span, or a section no chord.

        Examples
        --------
        >>> from bspline_mdao import fit_grid, moving_mesh, onera_m6_grid
        >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 9)), n_control=(5, 5, 5)))
        >>> ReferenceAxis.of(mesh, at=0.25, n=2).points.round(3).tolist()
        [[0.25, 0.0, 0.0], [0.997, 0.0, 1.484]]
        """
        frame = _frame(require_mesh(mesh, "reference axis"))
        if not span[0] < span[1]:
            raise InputError(f"reference axis: span {span}; give two rising parts of it, such as (0.0, 1.0)")
        levels = np.linspace(*span, n) * frame.span
        points = mesh.points[mesh.surface_ids] if surface is None else surface.points
        quads = surface_quads(mesh) if surface is None else surface.quads
        lines = chord_lines(points, quads, frame.to_local(points)[:, 2], levels, frame.axes[0])
        local = frame.to_local(lines.leading + at * lines.chords)
        return cls(frame.to_space(np.column_stack([local[:, :2], levels])))

    def hang(self, layout: Layout) -> HungRows:
        """Give all rows their stations.

        Raises
        ------
        InputError
            If the axis does not go out along the span, misses the surface, or two of its points are one.
        """
        frame = _frame(layout.mesh)
        seen = frame.axes[1:] if self.is_curved else frame.axes[2:]
        steps = np.diff(self.points, axis=0) @ seen.T
        self._require_advance(steps)
        lengths = np.linalg.norm(steps, axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        planes = planes_of(layout.mesh)
        begins_in_plane = any(self._begins_in(plane, PLANE_TOLERANCE * layout.mesh.size) for plane in planes)
        segments, parts = _closest(self.points[:-1] @ seen.T, steps, layout.points @ seen.T, begins_in_plane)
        directions = (steps / lengths[:, None]) @ seen
        stations = (ends[segments] + parts * lengths[segments]) / ends[-1]
        self._require_beside(layout.points[layout.rows()] @ frame.axes[2], stations[layout.rows()], frame)
        return HungRows(self, layout, frame, ends / ends[-1], directions, stations, begins_in_plane)

    def _begins_in(self, plane: Plane, tolerance: float) -> bool:
        return abs(self.points[0] @ plane.normal - plane.offset) <= tolerance

    def _require_beside(self, places, stations, frame):
        """Refuse an axis that all of the surface is inboard or outboard of."""
        if not stations.max() > 0.0 or not stations.min() < 1.0:
            ends = self.points[[0, -1]] @ frame.axes[2]
            raise InputError(
                f"reference axis: it goes from {ends[0]:.4g} to {ends[1]:.4g} m along the span, the surface from "
                f"{places.min():.4g} to {places.max():.4g} m; lay it along the surface, in metres"
            )

    def _require_advance(self, steps):
        is_bad = ~steps.any(axis=1) if self.is_curved else steps[:, 0] <= 0.0
        if is_bad.any():
            raise InputError(
                f"reference axis: point {np.argmax(is_bad) + 2} is not further along than the one before; begin at "
                f"the root, and set is_curved=True for an axis that does not go out along the span everywhere"
            )


def _frame(mesh: MovingMesh) -> Frame:
    return surface_frame(mesh.points[mesh.surface_ids], planes_of(mesh))


def _closest(starts, steps, points, goes_on_inboard):
    """Segment closest to each point (n, m), and where on it; the last goes on beyond its end, the first if it may."""
    offsets = points[:, None] - starts
    low, high = np.zeros(len(steps)), np.ones(len(steps))
    low[0], high[-1] = -np.inf if goes_on_inboard else 0.0, np.inf
    parts = np.clip(np.sum(offsets * steps, axis=2) / np.sum(steps**2, axis=1), low, high)
    segments = np.argmin(np.sum((offsets - parts[:, :, None] * steps) ** 2, axis=2), axis=1)
    return segments, parts[np.arange(len(points)), segments]
