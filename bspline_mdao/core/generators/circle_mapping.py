"""Conformal mapping of the exterior of a section to the exterior of a circle.

The mapping of Kármán and Trefftz removes the corner at the trailing edge and leaves a near-circle, which the iteration
of Theodorsen maps to a circle.

References
----------
T. Theodorsen and I. E. Garrick, "General potential theory of arbitrary wing sections", NACA Report 452 (1933).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.interpolate import CubicSpline

from ...errors import InputError
from .wing import Section

TRAILING_EDGE = 1.0
"""In chords."""

_SAMPLES = 1025
"""Points along each side of the section, dense at both ends."""

_MODES = 1024
"""Least number of points of the circle in the iteration, several for each node."""

_STEPS, _TOLERANCE = 500, 1e-13
"""Most steps of the iteration, and change of angles (rad) at which it ends."""


class CircleMapping:
    """The exterior of a section of unit chord mapped from the exterior of the unit circle, trailing edge at 1."""

    def __init__(self, section: Section, n_around: int):  # n_around: nodes of rings, at equal angles
        around, angle = _outline(section)
        self._corner = _Corner(0.5 * section.nose_radius, 2.0 - angle / np.pi)
        self._circle = _Circle(self._corner.flatten(around), n_around)

    @property
    def radius(self) -> float:
        """Radius of the circle (chords): the scale, far away, of points about the unit circle."""
        return self._circle.radius

    def ring(self, radius: float) -> np.ndarray:
        """Points (n_around,) about the section from points at equal angles on a circle."""
        return self._corner.restore(self._circle.ring(radius))

    def points(self, outside: np.ndarray) -> np.ndarray:
        """Points about the section from complex points outside the unit circle."""
        return self._corner.restore(self._circle.points(outside))


def _outline(section: Section) -> tuple[np.ndarray, float]:
    """Points from the trailing edge along the upper and back along the lower side, and the angle between both (rad)."""
    fractions = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SAMPLES)))
    upper, lower = (section.points(side, fractions[None], np.ones(1))[0] @ [1.0, 1.0j] for side in (1, -1))
    ends = _direction(lower[::-1]) / _direction(upper[::-1])
    angle = 0.5 * np.pi + np.angle(-1j * ends)  # from -pi/2, where sides would cross, to 3/2 pi
    return np.concatenate([upper[::-1], lower[1:]]), angle


def _direction(points: np.ndarray) -> complex:
    """Second-order tangent at the first of some points whose distances from it are as the squares of 0, 1, 2."""
    first, second = np.diff(points[:3])
    return first * (first * abs(second) / (second * abs(first))) ** 0.25


class _Corner:
    """Mapping of Kármán and Trefftz between the plane of the section and the plane of the near-circle."""

    def __init__(self, inside: float, power: float):
        middle, half = 0.5 * (TRAILING_EDGE + inside), 0.5 * (TRAILING_EDGE - inside)
        self.power, self.here = power, (TRAILING_EDGE, inside)
        self.there = (middle + half / power, middle - half / power)  # the identity at infinity, up to a shift

    def flatten(self, outline: np.ndarray) -> np.ndarray:
        """Points of the near-circle from points around the section."""
        ratio = (outline[1:-1] - self.here[0]) / (outline[1:-1] - self.here[1])
        turns = np.unwrap(np.angle(ratio))
        turns += 2.0 * np.pi * np.round(0.5 - 0.5 * turns[0] / np.pi)  # from pi, also if the upper side begins below
        root = np.exp((np.log(np.abs(ratio)) + 1j * turns) / self.power)
        root = np.concatenate([[0.0], root, [0.0]])
        return (self.there[0] - self.there[1] * root) / (1.0 - root)

    def restore(self, points: np.ndarray) -> np.ndarray:
        """Points about the section from points about the near-circle."""
        ratio = ((points - self.there[0]) / (points - self.there[1])) ** self.power
        return (self.here[0] - self.here[1] * ratio) / (1.0 - ratio)


class _Circle:
    """Mapping of Theodorsen between the exteriors of the near-circle, counterclockwise, and of a circle."""

    def __init__(self, outline: np.ndarray, n_around: int):
        self.stride = max(4, -(-_MODES // n_around))
        n = self.stride * n_around
        self.angles = 2.0 * np.pi * np.arange(n) / n
        self.centre = 0.5 * (outline.real.max() + outline.real.min()) + 0.5j * (outline.imag.max() + outline.imag.min())
        radii, turns = np.abs(outline - self.centre), np.unwrap(np.angle(outline - self.centre))
        if not np.all(np.diff(turns) > 0.0):
            raise InputError(
                "mapping of a section: its near-circle is not star-shaped; give less camber, or a trailing edge "
                "without steps and hooks"
            )
        radii[-1] = radii[0]
        turns[-1] = turns[0] + 2.0 * np.pi
        spline = CubicSpline(turns, np.log(radii), bc_type="periodic")
        at, change = self.angles + turns[0], np.inf
        for _ in range(_STEPS):
            self.modes = np.conj(np.fft.rfft(spline(at))) / n  # of exp(-i k angle): the part that is analytic outside
            self.modes[1:] *= 2.0
            turned = self._series(1.0).imag
            self.turn = turns[0] - turned[0]  # the trailing edge stays at the angle 0
            new = self.angles + turned + self.turn
            at, change = new, np.abs(new - at).max()
            if change < _TOLERANCE:
                break
        else:
            raise InputError(
                f"mapping of a section: the circle is off by {change:.1g} rad; give less camber, or a "
                f"trailing edge without steps and hooks"
            )
        self.radius = float(np.exp(self.modes[0].real))

    def _series(self, radius: float) -> np.ndarray:
        """Logarithm of the stretching and rotation of a circle at all angles."""
        n = self.angles.size
        terms = np.zeros(n, dtype=complex)
        terms[: self.modes.size] = self.modes * radius ** -np.arange(self.modes.size, dtype=np.float64)
        return np.fft.fft(terms)

    def ring(self, radius: float) -> np.ndarray:
        """Points about the near-circle from the circle of a radius, with a body of radius 1."""
        around = radius * np.exp(self._series(radius) + 1j * (self.angles + self.turn))
        return self.centre + around[:: self.stride]

    def points(self, outside: np.ndarray) -> np.ndarray:
        """Points about the near-circle from complex points outside the unit circle."""
        return self.centre + outside * np.exp(polyval(1.0 / outside, self.modes) + 1j * self.turn)
