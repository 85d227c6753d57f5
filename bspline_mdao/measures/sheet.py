"""Points of the sheet between two polylines, and its normals."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from .probes import checked_points

__all__ = ["sheet_normals", "sheet_points"]


def sheet_points(leading: np.ndarray, trailing: np.ndarray, n_chord: int, n_span: int, what: str) -> np.ndarray:
    """Divide the sheet evenly, along the arcs of the polylines and straight between them.

    Parameters
    ----------
    leading, trailing : ndarray, shape (m, 3)
        Polylines (m).
    n_chord, n_span : int
        Points from one polyline to the other and along them, at least 2.
    what : str
        What the points are for, for messages.

    Returns
    -------
    ndarray, shape (n_span, n_chord, 3)

    Raises
    ------
    InputError
        If a polyline has fewer than two points, or a count is too small.
    """
    if min(n_chord, n_span) < 2:
        raise InputError(f"{what}: {n_chord} probes along the chord, {n_span} along the span; give at least 2")
    start = _divided(leading, n_span, f"{what}, leading")
    end = _divided(trailing, n_span, f"{what}, trailing")
    share = np.linspace(0.0, 1.0, n_chord)[:, None]
    return start[:, None] + share * (end - start)[:, None]


def sheet_normals(points: np.ndarray) -> np.ndarray:
    """Normals of a sheet, across its chords and spanwise lines, at its points, shape (n_span, n_chord, 3); the same."""
    return np.cross(np.gradient(points, axis=0), points[:, -1:] - points[:, :1])


def _divided(line, n, what):
    """Points at equal distances along a polyline."""
    line = checked_points(line, what)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if not arc[-1] > 0.0:
        raise InputError(f"{what}: a polyline without length; give two or more points")
    at = np.linspace(0.0, arc[-1], n)
    return np.stack([np.interp(at, arc, x) for x in line.T], axis=-1)
