"""Surface grid of a wing: lines from the leading to the trailing edge, and from the root to the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from .planform import Planform
from .section import Section
from .stretching import stretch_lines

__all__ = ["Wing", "surface_grid", "tip_clustered"]

_STATIONS = 120
"""Span stations at which the surface is sampled before its spanwise lines are divided."""


@dataclass(frozen=True)
class Wing:
    """A wing whose tip is closed inside its planform.

    Parameters
    ----------
    planform : Planform
        Chords, span and sweep.
    section : Section
        Section at the root, and everywhere if there is no other.
    tip_section : Section, optional
        Section at the tip; points at equal fractions of the arc are blended linearly along the span.
    tip_length : float, optional
        Length of span over which the tip is rounded (m); twice the thickness there by default.

    Notes
    -----
    Over the last ``tip_length`` of the span, s from 0 to 1, the thickness is scaled by ``sqrt(1 - s^3)``: a blunt tip
    without a jump in curvature, closed to the chord line, so that the tip is a line of the H-H topology.
    """

    planform: Planform
    section: Section
    tip_section: Section | None = None
    tip_length: float | None = None

    @property
    def rounded_length(self) -> float:
        """Length of span over which the tip is rounded (m); 0 for a wing without thickness."""
        if self.tip_length is not None:
            return self.tip_length
        return 2.0 * (self.tip_section or self.section).thickness * self.planform.tip_chord

    @property
    def tip_radius(self) -> float:
        """Radius of the rounded tip where the wing is thickest there (m): the limit of ``sqrt(1 - s^3)`` at s = 1."""
        half = 0.5 * (self.tip_section or self.section).thickness * self.planform.tip_chord
        return 1.5 * half**2 / self.rounded_length if self.rounded_length > 0.0 else 0.0

    @property
    def nose_radius(self) -> float:
        """Radius of the leading edge at the root (m)."""
        return self.section.nose_radius * self.planform.root_chord

    @property
    def stations(self) -> np.ndarray:
        """Span positions (m), dense towards the tip, where the thickness goes as the root of the distance."""
        return self.planform.semi_span * tip_clustered(_STATIONS)

    def sections(self, side: int, fractions: np.ndarray) -> np.ndarray:
        """Points of all sections in their planes.

        Parameters
        ----------
        side : int
            +1 upper, -1 lower.
        fractions : ndarray, shape (n_stations, n)
            Fractions of the arc length of each section from the leading to the trailing edge.

        Returns
        -------
        ndarray, shape (n_stations, n, 2)
            Coordinate x and height (m).
        """
        planform, stations, factor = self.planform, self.stations, self.thickness_factor(self.stations)
        shape = self.section.points(side, fractions, factor)
        if self.tip_section is not None:
            weight = (stations / planform.semi_span)[:, None, None]
            shape = (1.0 - weight) * shape + weight * self.tip_section.points(side, fractions, factor)
        x, y = np.moveaxis(shape, 2, 0)
        chord = planform.x(1.0, stations) - planform.x(0.0, stations)
        return np.stack([planform.x(x, stations[:, None]), chord[:, None] * y], axis=-1)

    def place(self, sections: np.ndarray) -> np.ndarray:
        """Points in space, shape (n_stations, n, 3), of points of all sections, shape (n_stations, n, 2)."""
        x, height = np.moveaxis(sections, 2, 0)
        return np.stack([x, height, np.broadcast_to(self.stations[:, None], x.shape)], axis=-1)

    def thickness_factor(self, z):
        """Factor on the thickness at span positions z, shape (m,)."""
        if self.rounded_length == 0.0:
            return np.ones_like(z)
        s = np.clip(1.0 - (self.planform.semi_span - z) / self.rounded_length, 0.0, 1.0)
        return np.sqrt((1.0 - s) * (1.0 + s + s * s))


def surface_grid(wing: Wing, side: int, counts: tuple[int, int], leading, trailing, root, tip) -> np.ndarray:
    """Divide one side of a wing into a surface grid.

    Parameters
    ----------
    wing : Wing
        The wing.
    side : int
        +1 upper, -1 lower.
    counts : tuple of int
        Nodes along the chord and along the span.
    leading, trailing, root, tip : float
        Spacings on the surface at the four edges, in arc length (m).

    Returns
    -------
    ndarray, shape (n_chord, n_span, 3)
        Nodes. Those of the leading edge, the trailing edge and the tip have y = 0, those of the root z = 0, exactly.
    """
    n_chord, n_span = counts
    samples = _chordwise_lines(wing, side, n_chord, leading, trailing)
    nodes = np.stack([_divide(line, n_span, root, tip) for line in samples])
    nodes[:, 0, 2], nodes[:, -1, 2] = 0.0, wing.planform.semi_span
    nodes[[0, -1], :, 1] = 0.0
    if wing.rounded_length > 0.0:
        nodes[:, -1, 1] = 0.0
    return nodes


def tip_clustered(n: int) -> np.ndarray:
    """Distribute n points over [0, 1], the closer the nearer to 1."""
    return 1.0 - np.linspace(1.0, 0.0, n) ** 4


def _chordwise_lines(wing, side, n_chord, leading, trailing):
    """Points of the surface at all stations, shape (n_chord, n_stations, 3)."""
    planform, stations = wing.planform, wing.stations
    chord = planform.x(1.0, stations) - planform.x(0.0, stations)
    length = chord * wing.section.length(side, wing.thickness_factor(stations))
    fractions = stretch_lines(length, n_chord, leading, trailing)
    return wing.place(wing.sections(side, fractions)).swapaxes(0, 1)


def _divide(line, n, first, last):
    """Divide a sampled line (m, 3) by arc length."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return CubicSpline(arc, line)(arc[-1] * stretch_lines(arc[-1:], n, first, last)[0])
