"""Checks that points are the outline of an airfoil, from the trailing edge along the upper side and back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...errors import InputError

__all__ = ["check_outline"]

_FEWEST = 10
"""Least number of points of an outline: with fewer the spline invents the nose."""

_OPEN = 0.25
"""Height of the trailing edge in chords from which it is not an edge."""

_SHORT = 1e-2
"""Distance between the ends in chords up to which one may be behind the other: two files of 2,171 end so, 0.001 and
0.009 chords apart, and have valid grids."""

_FRONT = 0.05
"""Fraction of the chord in which sides may go back, as at the nose of a cambered section."""

_ROUND_OFF, _CROSSED = 1e-9, 1e-6
"""Fractions of the chord within which points coincide, and by which sides may cross: files have five digits."""

_SHARP, _THICKER = 0.01, 2.0
"""Height of a trailing edge in chords that is no base, and how much thicker the rear has to be to be a nose."""


def check_outline(
    points: np.ndarray,  # (n, 2)
    name: str,  # name for messages
    place: Callable[[int], str] = lambda number: f"point {number}",  # name of a point, numbered from 0
) -> None:
    """Refuse points that are not an outline; the message says which one is wrong, and how."""
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"{name}: points of shape {points.shape}; give (n, 2)")
    if len(points) < _FEWEST:
        raise InputError(f"{name}: {len(points)} points are too few for an outline; give {_FEWEST} or more")
    is_bad = ~np.isfinite(points).all(axis=1)
    if is_bad.any():
        number = int(np.argmax(is_bad))
        raise InputError(f"{name}: {place(number)}: {_text(points[number])} is not finite; correct it")
    tail = 0.5 * (points[0] + points[-1])
    distances = np.linalg.norm(points - tail, axis=1)
    at_nose, chord = int(np.argmax(distances)), float(distances.max())
    is_repeated = np.linalg.norm(np.diff(points, axis=0), axis=1) <= _ROUND_OFF * chord
    if is_repeated.any():
        number = int(np.argmax(is_repeated)) + 1
        raise InputError(f"{name}: {place(number)}: {_text(points[number])} repeats {place(number - 1)}; leave one out")
    if distances[0] > 0.5 * _OPEN * chord:
        raise InputError(
            f"{name}: open: it begins at {_text(points[0])}, {place(0)}, and ends at {_text(points[-1])}, "
            f"{place(len(points) - 1)}; give both sides, from the trailing edge around the nose "
            f"and back; one side of a symmetric section is mirrored by symmetric=True, --symmetric"
        )
    along = (tail - points) @ (tail - points[at_nose]) / chord**2  # 0 at the trailing edge, 1 at the nose
    steps = np.diff(along) * np.where(np.arange(len(points) - 1) < at_nose, 1.0, -1.0)
    is_back = (steps < -_ROUND_OFF) & (np.minimum(along[1:], along[:-1]) < 1.0 - _FRONT)
    if is_back.any():
        number = int(np.argmax(is_back)) + 1
        raise InputError(
            f"{name}: {place(number)}: {_text(points[number])} goes back towards {place(max(number - 2, 0))}; points "
            f"have to be in order, from the trailing edge around the nose and back"
        )
    _check_ends(points, tail - points[at_nose], name, place)
    _check_sides(points, along, at_nose, name, place)


def _check_ends(points: np.ndarray, chord: np.ndarray, name: str, place: Callable[[int], str]) -> None:
    """Refuse ends one behind the other; a base is across the mean line or the chord, however it is cut."""
    ends = np.array([points[0] - points[1], points[-1] - points[-2]])
    mean = (ends / np.linalg.norm(ends, axis=1, keepdims=True)).sum(axis=0)
    gap = points[0] - points[-1]
    is_along = all(abs(gap @ way) > abs(gap[0] * way[1] - gap[1] * way[0]) for way in (mean, chord))
    if not is_along or np.linalg.norm(gap) <= _SHORT * np.linalg.norm(chord):
        return
    behind, short = (0, len(points) - 1) if gap @ chord > 0.0 else (len(points) - 1, 0)
    raise InputError(
        f"{name}: the points end at {_text(points[behind])}, {place(behind)}, and ahead of it at "
        f"{_text(points[short])}, {place(short)}: the last point of a side is missing; add it there, "
        f"{_text(points[behind])} for a sharp trailing edge"
    )


def _check_sides(points: np.ndarray, along: np.ndarray, at_nose: int, name: str, place: Callable[[int], str]) -> None:
    """Refuse sides that cross, have no thickness between them, or are the wrong way round."""
    tail = 0.5 * (points[0] + points[-1])
    across = np.array([-1.0, 1.0]) * (tail - points[at_nose])[::-1]
    heights = (points - tail) @ across / (across @ across)
    first, second = np.arange(at_nose + 1), np.arange(at_nose, len(points))
    lower = np.interp(along[first], along[second[::-1]], heights[second[::-1]])
    upper = np.interp(along[second], *_rising(along[first], heights[first]))
    between = np.concatenate([heights[first] - lower, (upper - heights[second])[1:]])
    between[np.abs(along - 1.0) < 1e-3] = 0.0  # the nose may be blunt, and ``along`` has no digits there
    if np.abs(between).max() < 1e-4:
        raise InputError(f"{name}: its sides coincide; give a section with thickness")
    if between.max() < _CROSSED:
        raise InputError(f"{name}: runs along the lower side first; reverse the points")
    if between.min() < -_CROSSED:
        number = int(np.argmin(between))
        raise InputError(
            f"{name}: {place(number)}: {_text(points[number])} is {-between[number]:.1g} chords beyond the other side: "
            f"the sides cross; correct it"
        )
    sides = [_rising(along[side], heights[side]) for side in (first, second)]
    rear, front = (np.interp(at, *sides[0]) - np.interp(at, *sides[1]) for at in (0.1, 0.9))
    gap = np.linalg.norm(points[0] - points[-1]) / np.linalg.norm(across)
    if gap < _SHARP and rear > _THICKER * front:
        raise InputError(
            f"{name}: its sharp end is at {_text(points[at_nose])} and its blunt one at {_text(tail)}; turn it, so "
            f"that the nose has the smaller x"
        )


def _rising(along: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both in ascending order of the first."""
    order = np.argsort(along)
    return along[order], heights[order]


def _text(point: np.ndarray) -> str:
    """A point as text."""
    return f"({point[0] + 0.0:.6g}, {point[1] + 0.0:.6g})"  # without the sign of zero
