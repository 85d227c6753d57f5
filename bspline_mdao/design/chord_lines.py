"""Chord lines of a surface: its sections where something has a given value, such as the place along the span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..measures.edge_cuts import cut_edges, edges_of_quads

__all__ = ["ChordLines", "chord_lines"]

_INSIDE = 2e-2
"""Sections are cut this part of the whole extent inside the ends, which may have no chord: at a fitted tip, single
control points stick out."""

_NEAR = 0.02
"""Points up to this part of the chord from its end tell how high the end is: control points of a blunt nose stick out
above and below it."""

_NO_CHORD = 1e-6
"""A chord that is shorter than this part of the surface's box is none."""


@dataclass(frozen=True, eq=False)
class ChordLines:
    """Ends of the chord of sections.

    Parameters
    ----------
    leading, trailing : ndarray, shape (n, 3)
        Upstream and downstream ends (m).
    """

    leading: np.ndarray
    trailing: np.ndarray

    @property
    def chords(self) -> np.ndarray:
        """Vectors from the leading to the trailing end (m), shape (n, 3)."""
        return self.trailing - self.leading


def chord_lines(
    points: np.ndarray, quads: np.ndarray, places: np.ndarray, at: np.ndarray, stream: np.ndarray
) -> ChordLines:
    """Find the chord lines of a surface of quads.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Points of the surface (m).
    quads : ndarray of int, shape (n_quads, 4)
        Points at the corners of its quads.
    places : ndarray, shape (n_points,)
        Of every point, along the span or an axis; linear on the edges between.
    at : ndarray, shape (n,)
        Places of the sections.
    stream : ndarray, shape (3,)
        Unit vector downstream.

    Returns
    -------
    ChordLines
        From the most upstream to the most downstream place of every section, at the mean height of the points near it.
        Both go on along straight lines over the last fiftieth before the ends of the surface, and beyond.

    Raises
    ------
    InputError
        If a section has no chord.
    """
    margin = _INSIDE * np.ptp(places)
    low, high = places.min() + margin, places.max() - margin
    cut_at = np.clip(at, low, high)
    further = cut_at + np.where(cut_at < 0.5 * (low + high), margin, -margin)
    edges = edges_of_quads(quads)
    ends, inner = (_cut(points, edges, places, levels, stream) for levels in (cut_at, further))
    ends = ends + ((at - cut_at) / (further - cut_at))[:, None, None] * (inner - ends)
    lines = ChordLines(ends[:, 0], ends[:, 1])
    is_short = ~(np.linalg.norm(lines.chords, axis=1) > _NO_CHORD * np.ptp(points, axis=0).max())
    if is_short.any():
        place = at[np.argmax(is_short)]
        raise InputError(f"reference axis: the section at {place:g} of the span has no chord; end the axis short of it")
    return lines


def _cut(points, edges, places, levels, stream):
    """Ends of the chord lines of sections at several places, shape (n_levels, 2, 3)."""
    return np.array([_ends(cut_edges(edges, places - level).at(points), stream) for level in levels])


def _ends(section, stream):
    """Most upstream and most downstream place of a section, points (n, 3), in the middle of both sides."""
    along = section @ stream
    if not len(section) or not np.ptp(along):
        return np.zeros((2, 3))
    behind = (along - along.min()) / np.ptp(along)
    return [_end(section, along, part, stream) for part in (behind, 1.0 - behind)]


def _end(section, along, distance, stream):
    """Mean of the points near an end of a chord, by their distances from it in chords, shifted to that end."""
    weights = np.maximum(_NEAR - distance, 0.0)
    middle = weights @ section / weights.sum()
    return middle + (along[np.argmin(distance)] - middle @ stream) * stream
