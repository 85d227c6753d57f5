"""Wing sections as smooth curves from the leading to the trailing edge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from ..errors import InputError

__all__ = ["Section", "cambered_section", "flat_section", "naca_section"]

_SAMPLES = 1000
"""Points at which the speed along a section is sampled; arc lengths are then good to 1e-9 chords."""


@dataclass(frozen=True)
class Section:
    """A wing section of unit chord with a closed trailing edge.

    Parameters
    ----------
    upper, lower : ndarray, shape (n, 2)
        Points (x, y) from the leading edge (0, 0) to the trailing edge (1, 0), in chords; a cubic spline in chord
        length joins them.
    nose_radius : float
        Radius of the leading edge in chords; 0 for a sharp one.

    Raises
    ------
    InputError
        If the ends are elsewhere or points repeat.
    """

    upper: np.ndarray
    lower: np.ndarray
    nose_radius: float = 0.0

    def __post_init__(self):
        for name in ("upper", "lower"):
            points = getattr(self, name)
            if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] != 2:
                raise InputError(f"section, {name} side: points of shape {points.shape}; give (n, 2), n at least 2")
            if np.abs(points[[0, -1]] - [[0.0, 0.0], [1.0, 0.0]]).max() > 1e-12:
                raise InputError(
                    f"section, {name} side: must run from (0, 0) to (1, 0); scale it and close its trailing edge"
                )
            if not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
                raise InputError(f"section, {name} side: two successive points coincide; leave one out")

    @classmethod
    def symmetric(cls, upper: np.ndarray, nose_radius: float = 0.0) -> Section:
        """Make a symmetric section from the points of its upper side."""
        return cls(upper, upper * [1.0, -1.0], nose_radius)

    @property
    def thickness(self) -> float:
        """Largest thickness in chords."""
        x = np.linspace(0.0, 1.0, 201)
        return float(np.max(np.interp(x, *self.upper.T) - np.interp(x, *self.lower.T)))

    def points(self, side: int, fractions: np.ndarray, thickness: np.ndarray) -> np.ndarray:
        """Points at fractions of the arc length of the section scaled in thickness.

        Parameters
        ----------
        side : int
            +1 upper, -1 lower.
        fractions : ndarray, shape (m, n)
            Fractions of the arc length from the leading to the trailing edge.
        thickness : ndarray, shape (m,)
            Factor on y of each of the m curves.

        Returns
        -------
        ndarray, shape (m, n, 2)
            Points in chords.
        """
        curve = self._curves[side]
        return np.stack([_at_arcs(curve, fraction, factor) for fraction, factor in zip(fractions, thickness)])

    def length(self, side: int, thickness: np.ndarray) -> np.ndarray:
        """Arc length in chords of one side, scaled in thickness by each factor (m,)."""
        return np.array([_arcs(self._curves[side], factor)[1][-1] for factor in thickness])

    @cached_property
    def _curves(self):
        return {1: _spline(self.upper, self.nose_radius, 1.0), -1: _spline(self.lower, self.nose_radius, -1.0)}


def flat_section() -> Section:
    """Make a section of no thickness."""
    return Section.symmetric(np.array([[0.0, 0.0], [1.0, 0.0]]))


def naca_section(thickness: float = 0.12) -> Section:
    """Make a symmetric four-digit NACA section with its trailing edge closed.

    Parameters
    ----------
    thickness : float
        Thickness in chords; 0.12 for the NACA 0012.

    Returns
    -------
    Section
        The last coefficient, 0.1036 instead of 0.1015, closes the trailing edge.
    """
    x, y = _naca_upper(thickness)
    return Section.symmetric(np.column_stack([x, y]), nose_radius=_naca_nose_radius(thickness))


def cambered_section(thickness: float, camber: float, reflex: float = 0.0) -> Section:
    """Make a section with the thickness of a four-digit NACA section about a camber line.

    Parameters
    ----------
    thickness : float
        Thickness in chords.
    camber : float
        Of the camber line ``4 camber x (1 - x) (1 - reflex x)``; without reflex its largest height.
    reflex : float
        Above 1 the camber line turns up behind ``x = 1 / reflex``.

    Returns
    -------
    Section
        The thickness is laid off vertically, so that the tangent at the nose is vertical.
    """
    x, y = _naca_upper(thickness)
    line = 4.0 * camber * x * (1.0 - x) * (1.0 - reflex * x)
    sides = (np.column_stack([x, line + side * y]) for side in (1.0, -1.0))
    return Section(*sides, nose_radius=_naca_nose_radius(thickness))


def _naca_upper(thickness):
    """Upper side of a symmetric four-digit NACA section with a closed trailing edge."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 201)))
    y = 5.0 * thickness * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - x * 0.1036))))
    y[[0, -1]] = 0.0
    return x, y


def _naca_nose_radius(thickness):
    return 0.5 * (5.0 * thickness * 0.2969) ** 2


def _spline(points, nose_radius, side):
    """Cubic spline in chord length, with the vertical tangent at a blunt nose that one side cannot know."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    start = (1, [0.0, side]) if nose_radius > 0.0 else (2, [0.0, 0.0])
    return CubicSpline(arc, points, bc_type=(start, (2, [0.0, 0.0])))


def _arcs(curve, factor):
    """Parameters and arc lengths along a curve scaled in y."""
    t = np.linspace(0.0, 1.0, _SAMPLES) ** 2 * curve.x[-1]
    speed = np.hypot(*(curve(t, 1) * [1.0, factor]).T)
    return t, CubicSpline(t, speed).antiderivative()(t)


def _at_arcs(curve, fractions, factor):
    """Points of a curve scaled in y at fractions of its arc length."""
    t, arc = _arcs(curve, factor)
    # at a nose the parameter goes as the arc, or as its root where there is no thickness: smooth in the root of the arc
    at = CubicSpline(np.sqrt(arc), t)(np.sqrt(fractions * arc[-1]))
    points = curve(at) * [1.0, factor]
    points[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
    return points
