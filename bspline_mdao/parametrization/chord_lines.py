"""Chord lines of a surface: its sections where something has a given value, such as the place along the span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..movement.mesh import MovingMesh
from .surface_net import surface_quads

__all__ = ["ChordLines", "chord_lines"]

_INSIDE = 1e-9
"""Sections at the ends are cut this part of the whole extent inside, where edges still cross."""

_NO_CHORD = 1e-6
"""A chord that is shorter than this part of the mesh is none."""


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


def chord_lines(mesh: MovingMesh, places: np.ndarray, at: np.ndarray, stream: np.ndarray) -> ChordLines:
    """Find the chord lines of the surface control mesh of the baseline.

    Parameters
    ----------
    mesh : MovingMesh
        The control mesh.
    places : ndarray, shape (n_surface,)
        Of every surface point, along the span or an axis; linear on the edges between.
    at : ndarray, shape (n,)
        Places of the sections.
    stream : ndarray, shape (3,)
        Unit vector downstream.

    Returns
    -------
    ChordLines
        From the most upstream to the most downstream point of the control mesh in every section.

    Raises
    ------
    InputError
        If a section has no chord.
    """
    points, edges = mesh.points[mesh.surface_ids], _surface_edges(mesh)
    margin = _INSIDE * np.ptp(places)
    levels = np.clip(at, places.min() + margin, places.max() - margin)
    ends = np.array([_ends(_crossings(points[edges], places[edges], level), stream) for level in levels])
    lines = ChordLines(ends[:, 0], ends[:, 1])
    is_short = ~(np.linalg.norm(lines.chords, axis=1) > _NO_CHORD * mesh.size)
    if is_short.any():
        place = at[np.argmax(is_short)]
        raise InputError(f"reference axis: the section at {place:g} of the span has no chord; end the axis short of it")
    return lines


def _ends(section, stream):
    """Most upstream and most downstream of points (n, 3), both shape (3,)."""
    if not len(section):
        return np.zeros((2, 3))
    along = section @ stream
    return section[[np.argmin(along), np.argmax(along)]]


def _crossings(ends, values, level):
    """Points where edges, shape (n, 2, 3), have a value that they take between those of their ends, shape (n, 2)."""
    is_below = values <= level
    crosses = is_below[:, 0] != is_below[:, 1]
    (start, stop), (low, high) = ends[crosses].swapaxes(0, 1), values[crosses].T
    return start + ((level - low) / (high - low))[:, None] * (stop - start)


def _surface_edges(mesh: MovingMesh) -> np.ndarray:
    """Edges of the quads of the surface, as rows of ``mesh.surface_ids``, shape (n, 2)."""
    quads = surface_quads(mesh)
    edges = np.concatenate([quads[:, [n, (n + 1) % 4]] for n in range(4)])
    return np.unique(np.sort(edges, axis=1), axis=0)
