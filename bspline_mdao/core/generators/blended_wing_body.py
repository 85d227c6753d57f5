"""Blended-wing bodies from ribs: a thick centre body, outer wings and winglets in one surface.

A rib is a section at a distance along the developed span, the *spine*. The spine starts at right angles to the symmetry
plane z = 0 and turns upwards by the cant of the ribs, so a winglet is a continuation of the outer wing::

      y
      |                                  /   <- winglet, cant 75 deg
      |                                 /
      |______________________________.-'
      +--- rib --------- rib ------------- z      each rib is at right angles to the spine

Between ribs leading edge, chord, twist, cant and section change linearly along the spine, with rounded corners.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from ...base.display import OneLine
from ...errors import InputError
from .tips import tip_clustered, tip_rounding
from .wing import Section, cambered_section

_STATIONS = 160
"""Places along the spine at which the surface is sampled before nodes are placed on it."""

_SPINE_SAMPLES = 2001
"""Places at which the cant is sampled to integrate the spine; its ends are then accurate to 1e-9 of its length."""


@dataclass(frozen=True)
class Rib(OneLine):
    """A section of a blended-wing body and its place.

    Parameters
    ----------
    span : float
        Distance from the symmetry plane along the spine (m).
    leading_edge : float
        Coordinate x of the leading edge (m).
    chord : float
        Chord (m).
    section : Section
        Shape of the section in chords.
    twist : float
        Rotation about the leading edge (deg), nose up positive.
    cant : float
        Angle of the spine to the horizontal (deg), upwards positive.

    Examples
    --------
    >>> from bspline_mdao.generators import Rib, naca_section
    >>> Rib(span=2.0, leading_edge=0.5, chord=1.0, section=naca_section(0.12), twist=-2.0).chord
    1.0
    """

    span: float
    leading_edge: float
    chord: float
    section: Section
    twist: float = 0.0
    cant: float = 0.0


@dataclass(frozen=True)
class BlendedWingBody(OneLine):
    """One half of a blended-wing body with a closed trailing edge and tip.

    Parameters
    ----------
    ribs : tuple of Rib
        From the symmetry plane outwards, at least two; the first has no cant.
    blend : float
        Half-width within which a corner between two spans is rounded, as a fraction of the shorter of them, up to 1.
        The leading and trailing edge also have a corner in the symmetry plane.
    tip_length : float, optional
        Length of spine over which the tip is rounded (m), as for a `Wing`; twice the thickness there by default.

    Raises
    ------
    InputError
        If the ribs are out of order, or one is impossible.

    Examples
    --------
    >>> from bspline_mdao.generators import BlendedWingBody, Rib, naca_section
    >>> ribs = [Rib(span, span / 2, 2.0 - span / 2, naca_section(0.12)) for span in (0.0, 1.0, 3.0)]
    >>> round(float(BlendedWingBody(tuple(ribs)).developed_span), 3)
    3.0
    """

    ribs: tuple[Rib, ...]
    blend: float = 0.9
    tip_length: float | None = None

    def __post_init__(self) -> None:
        spans = [rib.span for rib in self.ribs]
        if len(spans) < 2 or spans[0] != 0.0 or not all(a < b for a, b in zip(spans, spans[1:])):
            raise InputError(f"blended-wing body: ribs at spans {spans}; give two or more, ascending from 0")
        for number, rib in enumerate(self.ribs, start=1):
            if not (rib.chord > 0.0 and abs(rib.cant) <= 90.0 and abs(rib.twist) <= 45.0):
                raise InputError(
                    f"blended-wing body: rib {number} has chord {rib.chord:g}, cant {rib.cant:g} deg, twist "
                    f"{rib.twist:g} deg; give a positive chord, a cant up to 90 deg and a twist up to 45 deg"
                )
        if self.ribs[0].cant != 0.0 or not 0.0 <= self.blend <= 1.0:
            raise InputError(
                f"blended-wing body: cant {self.ribs[0].cant:g} deg at the symmetry plane, blend {self.blend:g}; "
                f"give no cant there and a blend from 0 to 1"
            )

    @property
    def developed_span(self) -> float:
        """Length of the spine (m)."""
        return self.ribs[-1].span

    @cached_property
    def stations(self) -> np.ndarray:
        """Places along the spine (m), dense towards the tip."""
        return self.developed_span * tip_clustered(_STATIONS)

    @property
    def rounded_length(self) -> float:
        """Length of spine over which the tip is rounded (m)."""
        tip = self.ribs[-1]
        return 2.0 * tip.section.thickness * tip.chord if self.tip_length is None else self.tip_length

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
            Coordinate x and height above the spine (m).
        """
        weights = self._weights(self.stations, is_mirrored=True)
        factor = tip_rounding(self.developed_span - self.stations, self.rounded_length)
        shape = np.zeros((*fractions.shape, 2))
        for rib, weight in zip(self.ribs, weights.T):
            near = weight != 0.0
            shape[near] += weight[near, None, None] * rib.section.points(side, fractions[near], factor[near])
        chord, twist = weights @ self._values("chord"), np.radians(weights @ self._values("twist"))
        x, y = np.moveaxis(chord[:, None, None] * shape, 2, 0)
        cos, sin = np.cos(twist)[:, None], np.sin(twist)[:, None]
        leading_edge = (weights @ self._values("leading_edge"))[:, None]
        return np.stack([leading_edge + x * cos + y * sin, y * cos - x * sin], axis=-1)

    def place(self, sections: np.ndarray) -> np.ndarray:
        """Points in space, shape (n_stations, n, 3), from points of all sections, shape (n_stations, n, 2)."""
        x, height = np.moveaxis(sections, 2, 0)
        spine, cant = self._spine, self._cant(self.stations)[:, None]
        return np.stack([x, spine[:, :1] + height * np.cos(cant), spine[:, 1:] - height * np.sin(cant)], axis=-1)

    @cached_property
    def _spine(self) -> np.ndarray:
        """Coordinates y and z of the spine at the stations."""
        at = np.linspace(0.0, self.developed_span, _SPINE_SAMPLES)
        cant = self._cant(at)
        return CubicSpline(at, np.stack([np.sin(cant), np.cos(cant)], axis=1)).antiderivative()(self.stations)

    def _cant(self, at: np.ndarray) -> np.ndarray:
        """Cant (rad); the other half has the opposite cant, which leaves no corner in the symmetry plane."""
        return np.radians(self._weights(at, is_mirrored=False) @ self._values("cant"))

    def _weights(self, at: np.ndarray, is_mirrored: bool) -> np.ndarray:
        spans = self._values("span")
        return rounded_weights(at, spans, corner_widths(spans, self.blend, is_mirrored))

    def _values(self, name: str) -> np.ndarray:
        return np.array([getattr(rib, name) for rib in self.ribs])


def generic_blended_wing_body() -> BlendedWingBody:
    """Make a blended-wing body with winglets, a target shape for the flat plate of chord 1 and semi-span 2.

    Returns
    -------
    BlendedWingBody
        Centre body 1.5 long and 17 % thick with a reflexed section, an outer wing swept by 35 deg, and winglets that
        turn up through 75 deg; semi-span 1.86, 2.16 along the spine.

    Examples
    --------
    >>> from bspline_mdao.generators import generic_blended_wing_body
    >>> len(generic_blended_wing_body().ribs)
    6
    """
    body, wing, winglet = (cambered_section(*shape) for shape in ((0.17, 0.02, 1.6), (0.11, 0.015, 0.5), (0.09, 0.0)))
    middle = cambered_section(0.15, 0.02, 1.2)
    return BlendedWingBody(
        (
            Rib(0.00, -0.50, 1.50, body, twist=1.0),
            Rib(0.42, 0.00, 1.03, middle, twist=1.0, cant=1.5),
            Rib(0.78, 0.40, 0.56, wing, twist=0.5, cant=3.0),
            Rib(1.52, 0.92, 0.33, wing, twist=-2.0, cant=5.0),
            Rib(1.86, 1.12, 0.27, winglet, cant=75.0),
            Rib(2.16, 1.25, 0.22, winglet, cant=75.0),
        )
    )


def corner_widths(
    stations: np.ndarray,  # (n,), ascending from 0
    fraction: float,  # half-width of a corner as a fraction of the shorter of the two lines that meet there, up to 1
    is_mirrored: bool,  # whether the values continue beyond 0 as in a mirror, with a corner there
) -> np.ndarray:
    """Half-widths, shape (n,), within which the corners at stations (n,) are rounded."""
    lines = np.diff(stations)
    before = np.concatenate([lines[:1] if is_mirrored else [0.0], lines])
    return fraction * np.minimum(before, np.concatenate([lines, [0.0]]))


def rounded_weights(
    at: np.ndarray,  # (m,), places of the result, within the stations
    # places of the given values and half-widths of the corners there, the first of which is mirrored
    stations: np.ndarray,  # (n,)
    widths: np.ndarray,  # (n,)
) -> np.ndarray:  # (m, n), rows sum to one; outside the corners values change exactly linearly
    """Weights of the values at stations in the rounded polygon through them.

    Examples
    --------
    >>> stations = np.array([0.0, 1.0, 2.0])
    >>> rounded_weights(np.array([0.5]), stations, np.array([0.0, 0.4, 0.0]))
    array([[0.5, 0.5, 0. ]])
    """
    # Each line from one station to the next is a difference of two ramps; a ramp rounded within w of its foot, ``(x +
    # w)^3 (3 w - x) / (16 w^3)``, has a continuous curvature.
    ramps = np.stack([_ramp(at - s, w) for s, w in zip(stations, widths)], axis=1)
    ramps[:, 0] += _ramp(-at, widths[0])
    slopes = np.diff(np.eye(len(stations)), axis=0) / np.diff(stations)[:, None]
    weights = (ramps[:, :-1] - ramps[:, 1:]) @ slopes
    weights[:, 0] += 1.0
    return weights


def _ramp(x: np.ndarray, width: float) -> np.ndarray:
    """The larger of x and 0, rounded within ``width`` of 0."""
    if width == 0.0:
        return np.maximum(x, 0.0)
    rounded = (x + width) ** 3 * (3.0 * width - x) / (16.0 * width**3)
    return np.where(np.abs(x) < width, rounded, np.maximum(x, 0.0))
