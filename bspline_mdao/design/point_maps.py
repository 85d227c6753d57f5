"""Named deformations as maps from points to points.

Each is a frozen dataclass with an ``amount`` (an angle in radians, a factor or a height in metres) and one method
``apply``. A map moves every point by itself, by a formula that holds for complex numbers too, so that complex steps
give all derivatives exactly: with respect to the points and to the amount, `jvp`, `vjp` and `amount_jvp`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..mesh.frame import Frame
from .formulas import scaled, slope, turned

__all__ = [
    "Bend",
    "Dihedral",
    "Pitch",
    "PointMap",
    "ScaleChord",
    "ScaleThickness",
    "Stretch",
    "Sweep",
    "Translate",
    "Twist",
    "amount_jvp",
    "jvp",
    "vjp",
]

_STEP = 1e-40
"""Complex step, as small as one likes: nothing is subtracted."""

_SMALL = 1e-2
"""Angle (rad) below which sin(a) / a and (1 - cos(a)) / a are their series, good to round-off there."""


class PointMap(Protocol):
    """Moves points, each by itself."""

    amount: complex
    """How much: an angle (rad), a factor or a height (m)."""

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, shape (n, 3), of points, shape (n, 3), in metres."""


def jvp(point_map: PointMap, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
    """Differentiate a map along a direction in the points, shape (n, 3)."""
    return point_map.apply(points + 1j * _STEP * d_points).imag / _STEP


def vjp(point_map: PointMap, points: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transpose of `jvp`: cotangent of the points, shape (n, 3), of that of the moved points."""
    columns = [jvp(point_map, points, np.broadcast_to(axis, points.shape)) for axis in np.eye(3)]
    return np.stack([np.sum(column * bar, axis=1) for column in columns], axis=1)


def amount_jvp(point_map: PointMap, points: np.ndarray) -> np.ndarray:
    """Differentiate a map with respect to its amount; shape (n, 3)."""
    return replace(point_map, amount=point_map.amount + 1j * _STEP).apply(points).imag / _STEP


@dataclass(frozen=True)
class InFrame(ABC):
    """A map in coordinates along the stream, normal to it and along the span.

    Parameters
    ----------
    frame : Frame
        Directions of the surface.
    amount : float
        See each map.
    """

    frame: Frame
    amount: float

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, shape (n, 3), of points, shape (n, 3), in metres."""
        return self.frame.to_space(np.stack(self._moved(*self.frame.to_local(points).T), axis=1))

    @abstractmethod
    def _moved(self, stream, normal, span):
        """Moved coordinates."""


class Twist(InFrame):
    """Turn sections about the middle line, in proportion to the distance from the root.

    ``amount`` is the angle at the tip (rad), upstream end up positive.
    """

    def _moved(self, stream, normal, span):
        centre = self.frame.middle_at(span)
        return *_about(centre, turned(self.amount * span / self.frame.span), stream, normal), span


@dataclass(frozen=True)
class Pitch(InFrame):
    """Turn the whole surface about an axis along the span.

    ``amount`` is the angle (rad), upstream end up positive.

    Parameters
    ----------
    at : float
        Place of the axis between the upstream (0) and the downstream end (1) of the surface's box.
    """

    at: float = 0.25

    def _moved(self, stream, normal, span):
        centre = self.at * self.frame.chord, self.frame.middle_at(0.0)[1]
        return *_about(centre, turned(self.amount), stream, normal), span


@dataclass(frozen=True)
class Bend(InFrame):
    """Bend the span upwards along an arc of a circle, and go on straight.

    Sections stay at right angles to the bent span, lengths along the middle are kept. ``amount`` is the angle behind
    the arc (rad), upwards positive.

    Parameters
    ----------
    at : float
        Span fraction at which the arc begins.
    length : float
        Length of the arc as a fraction of the span.
    """

    at: float = 0.7
    length: float = 0.15

    def height(self, normal):
        """Height of normal coordinates (m) above the middle line where the arc begins."""
        return normal - self.frame.middle_at(self.at * self.frame.span)[1]

    def _moved(self, stream, normal, span):
        start, length, height = self.at * self.frame.span, self.length * self.frame.span, self.height(normal)
        on_arc, beyond = _clip(span - start, 0.0, length), _clip(span - start - length, 0.0, np.inf)
        angle = self.amount * on_arc / length
        up = on_arc * _versine_ratio(angle) + beyond * np.sin(angle) + height * (np.cos(angle) - 1.0)
        out = _clip(span, -np.inf, start) + on_arc * _sine_ratio(angle) + beyond * np.cos(angle)
        return stream, normal + up, out - height * np.sin(angle)


class Stretch(InFrame):
    """Scale the span from the root; ``amount`` is the factor."""

    def _moved(self, stream, normal, span):
        return stream, normal, self.amount * span


class ScaleChord(InFrame):
    """Scale lengths along the stream about the middle line; ``amount`` is the factor."""

    def _moved(self, stream, normal, span):
        return *_about(self.frame.middle_at(span), scaled(self.amount, 1.0), stream, normal), span


class ScaleThickness(InFrame):
    """Scale lengths normal to stream and span about the middle line; ``amount`` is the factor."""

    def _moved(self, stream, normal, span):
        return *_about(self.frame.middle_at(span), scaled(1.0, self.amount), stream, normal), span


class Sweep(InFrame):
    """Shear the surface downstream in proportion to the distance from the root; ``amount`` is the angle (rad)."""

    def _moved(self, stream, normal, span):
        return stream + slope(self.amount) * span, normal, span


class Dihedral(InFrame):
    """Shear the surface upwards in proportion to the distance from the root; ``amount`` is the angle (rad)."""

    def _moved(self, stream, normal, span):
        return stream, normal + slope(self.amount) * span, span


@dataclass(frozen=True, eq=False)
class Translate:
    """Move all points by ``amount`` times a vector, shape (3,), in metres."""

    vector: np.ndarray
    amount: float = 1.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return points + self.amount * self.vector


def _about(centre, matrix, stream, normal):
    """Apply matrices (..., 2, 2) to stream and normal coordinates about a centre."""
    along, above = centre
    x, y = stream - along, normal - above
    return (
        along + matrix[..., 0, 0] * x + matrix[..., 0, 1] * y,
        above + matrix[..., 1, 0] * x + matrix[..., 1, 1] * y,
    )


def _clip(x, low, high):
    """Clip by the real part."""
    return np.where(x.real < low, low, np.where(x.real > high, high, x))


def _sine_ratio(angle):
    """sin(a) / a."""
    return _ratio(angle, np.sin, lambda a: 1.0 - a**2 / 6.0 * (1.0 - a**2 / 20.0 * (1.0 - a**2 / 42.0)))


def _versine_ratio(angle):
    """(1 - cos(a)) / a."""
    series = lambda a: a / 2.0 * (1.0 - a**2 / 12.0 * (1.0 - a**2 / 30.0 * (1.0 - a**2 / 56.0)))  # noqa: E731
    return _ratio(angle, lambda a: 2.0 * np.sin(0.5 * a) ** 2, series)


def _ratio(angle, numerator, series):
    is_small = np.abs(angle) < _SMALL
    return np.where(is_small, series(angle), numerator(angle) / np.where(is_small, 1.0, angle))
