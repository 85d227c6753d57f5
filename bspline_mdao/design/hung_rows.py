"""Rows that hang on a reference axis: their stations, and the directions and chords of their sections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from ..mesh.frame import Frame
from .chord_lines import ChordLines, chord_lines
from .formulas import turned
from .stations import StationSpline
from .surface_net import surface_quads
from .variable import Layout

if TYPE_CHECKING:
    from .axis import ReferenceAxis

__all__ = ["HungRows"]


@dataclass(frozen=True, eq=False)
class HungRows:
    """Where all rows hang on an axis: all of it decided on the baseline.

    Parameters
    ----------
    axis : ReferenceAxis
        The axis.
    layout : Layout
        The rows.
    frame : Frame
        Stream, normal and span.
    knots : ndarray, shape (n_axis,)
        Stations of the axis' own points, from 0 to 1.
    directions : ndarray, shape (n_axis - 1, 3)
        Unit vectors between them, as the axis is seen.
    stations : ndarray, shape (n_rows,)
        Station of every row; above 1 beyond the end of the axis, and below 0 inboard of one that begins in a plane.
    begins_in_plane : bool
        Whether the axis begins in a plane of symmetry.
    """

    axis: ReferenceAxis
    layout: Layout
    frame: Frame
    knots: np.ndarray
    directions: np.ndarray
    stations: np.ndarray
    begins_in_plane: bool

    @property
    def axis_rows(self) -> np.ndarray:
        """Rows of the axis' own points, shape (n_axis,)."""
        rows = self.layout.rows(self.axis)
        return np.arange(rows.start, rows.stop)

    @cached_property
    def weights(self) -> csr_array:
        """Weights of the axis' points that give its point at the station of every row, shape (n_rows, n_axis)."""
        weights = self._inside.toarray()
        inboard = np.minimum(self.stations, 0.0) / self.knots[1]
        beyond = np.maximum(self.stations - 1.0, 0.0) / (1.0 - self.knots[-2])
        weights[:, :2] += inboard[:, None] * [-1.0, 1.0]
        weights[:, -2:] += beyond[:, None] * [-1.0, 1.0]
        return csr_array(weights)

    def centres(self, points: np.ndarray) -> np.ndarray:
        """Point of the axis at the station of every row, shape (n_rows, 3), where all rows are at ``points``."""
        return self.weights @ points[self.axis_rows]

    @cached_property
    def section_axes(self) -> np.ndarray:
        """Stream, and what is above it, in the plane of the section of every row; shape (n_rows, 2, 3)."""
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
        """`section_axes` turned so that the first is along the chord line, shape (n_rows, 2, 3)."""
        along, above = np.einsum("nij,nj->in", self.section_axes[self.axis_rows], self._chord_lines.chords)
        angle = self._inside @ np.arctan2(above, along)
        return turned(angle) @ self.section_axes

    @cached_property
    def chord_parts(self) -> np.ndarray:
        """Part of the chord at which every row is, 0 at the leading edge; shape (n_rows,)."""
        behind = self.layout.points - self.weights @ self._chord_lines.leading
        return np.sum(behind * self.chord_axes[:, 0], axis=1) / self.chord_lengths

    @cached_property
    def _inside(self) -> csr_array:
        """The same as `weights`, constant beyond the ends."""
        return StationSpline(tuple(self.knots), self.axis.order).matrix(self.stations)

    @cached_property
    def _chord_lines(self) -> ChordLines:
        """Chord lines of the surface at the axis' own points."""
        rows, quads = self.layout.rows(), surface_quads(self.layout.mesh)
        return chord_lines(self.layout.points[rows], quads, self.stations[rows], self.knots, self.frame.axes[0])


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]
