"""Wings: planform, sections, the surface between them, and its surface grid.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from ...base.display import OneLine
from ...errors import InputError
from .kinked_planform import KinkedPlanform
from .stretching import stretch_lines
from .tips import tip_clustered, tip_rounding

_SAMPLES = 1000
"""Points at which the speed along a section is sampled; arc lengths are then accurate to 1e-9 chords."""

_EXTENDED = 1.0089304113651427
"""Chords at which the thickness of the four-digit equation is zero."""

_STATIONS = 120
"""Span stations at which the surface is sampled before its spanwise lines are divided."""


@dataclass(frozen=True)
class Planform(OneLine):
    """One half of a trapezoidal wing, with its root in the symmetry plane z = 0 and its leading edge there at x = 0.

    Parameters
    ----------
    root_chord : float
        Chord in the symmetry plane (m).
    semi_span : float
        Distance from the symmetry plane to the tip (m).
    taper : float
        Tip chord divided by root chord.
    leading_edge_sweep : float
        Sweep of the leading edge (deg), positive aft.

    Examples
    --------
    >>> from bspline_mdao.generators import Planform
    >>> planform = Planform(root_chord=1.0, semi_span=3.0, taper=0.5, leading_edge_sweep=20.0)
    >>> planform.tip_chord, round(planform.trailing_edge_sweep, 2)
    (0.5, 11.16)
    """

    root_chord: float = 1.0
    semi_span: float = 2.0
    taper: float = 1.0
    leading_edge_sweep: float = 0.0

    def __post_init__(self) -> None:
        is_positive = self.root_chord > 0.0 and self.semi_span > 0.0 and self.taper > 0.0
        if not (is_positive and abs(self.leading_edge_sweep) < 80.0):
            raise InputError(
                f"planform: root chord {self.root_chord:g}, semi-span {self.semi_span:g}, taper {self.taper:g} must be "
                f"positive and the sweep {self.leading_edge_sweep:g} deg below 80"
            )

    @classmethod
    def from_sweeps(cls, root_chord: float, semi_span: float, leading: float, trailing: float) -> Planform:
        """Make the planform from the sweeps (deg) of both edges, which determine the taper."""
        narrowing = semi_span * (np.tan(np.radians(leading)) - np.tan(np.radians(trailing)))
        return cls(root_chord, semi_span, 1.0 - narrowing / root_chord, leading)

    @property
    def tip_chord(self) -> float:
        """Chord at the tip (m)."""
        return self.taper * self.root_chord

    @property
    def aspect_ratio(self) -> float:
        """Aspect ratio of the whole wing."""
        return 4.0 * self.semi_span / (self.root_chord + self.tip_chord)

    @property
    def kinks(self) -> tuple[float, ...]:
        """Span positions of kinks (m): none."""
        return ()

    @property
    def trailing_edge_sweep(self) -> float:
        """Sweep of the trailing edge (deg)."""
        return float(np.degrees(np.arctan(self.slope_at_tip(1.0))))

    def x(self, fraction: np.ndarray | float, z: np.ndarray | float) -> Any:
        """Coordinate x (m) of a chord fraction, 0 the leading and 1 the trailing edge, at span position z."""
        return fraction * self.root_chord + self.slope_at_tip(fraction) * z

    def slope_at_tip(self, fraction: np.ndarray | float) -> Any:
        """dx/dz of a line of constant chord fraction, which is the same everywhere."""
        narrowing = (1.0 - self.taper) * self.root_chord / self.semi_span
        return np.tan(np.radians(self.leading_edge_sweep)) - fraction * narrowing


@dataclass(frozen=True)
class Section(OneLine):
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

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.generators import Section
    >>> x = np.linspace(0.0, 1.0, 51)
    >>> section = Section.symmetric(np.stack([x, 0.2 * x * (1.0 - x)], axis=1))
    >>> round(float(section.thickness), 3)
    0.1
    """

    upper: np.ndarray
    lower: np.ndarray
    nose_radius: float = 0.0

    def __post_init__(self) -> None:
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
        curve, (factors, of_curve) = self._curves[side], np.unique(thickness, return_inverse=True)
        places = self._places_of(side, factors)
        return np.stack([_at_arcs(curve, places[k], f, factors[k]) for k, f in zip(of_curve, fractions)])

    def length(self, side: int, thickness: np.ndarray) -> np.ndarray:
        """Arc length in chords of one side, scaled in thickness by each factor (m,)."""
        factors, of_curve = np.unique(thickness, return_inverse=True)
        return np.array([length for _, length in self._places_of(side, factors)])[of_curve]

    def _places_of(self, side: int, factors: np.ndarray) -> list[tuple[CubicSpline, float]]:
        """Parameters by arc length of one side scaled in thickness by each factor, cached for later surfaces."""
        known = self._known_places[side]
        new = np.array([factor for factor in factors if factor not in known])
        if new.size:
            known.update(zip(new.tolist(), (_places(*arcs) for arcs in zip(*_arcs(self._curves[side], new)))))
        return [known[factor] for factor in factors.tolist()]

    @cached_property
    def _curves(self) -> dict[int, CubicSpline]:
        return {1: _spline(self.upper, self.nose_radius, 1.0), -1: _spline(self.lower, self.nose_radius, -1.0)}

    @cached_property
    def _known_places(self) -> dict[int, dict[float, tuple[CubicSpline, float]]]:
        return {1: {}, -1: {}}


def flat_section() -> Section:
    """A section without thickness."""
    return Section.symmetric(np.array([[0.0, 0.0], [1.0, 0.0]]))


def naca_section(thickness: float = 0.12, extended: bool = False) -> Section:
    """Make a symmetric four-digit NACA section with its trailing edge closed.

    Parameters
    ----------
    thickness : float
        Thickness in chords; 0.12 for the NACA 0012.
    extended : bool
        Follow the equation to where it closes, at 1.0089 chords, and scale this length to one, as Vassberg and Jameson
        do (J. Aircraft 47, 2010).

    Returns
    -------
    Section
        Unless extended, the last coefficient, 0.1036 instead of 0.1015, closes the trailing edge.

    Examples
    --------
    >>> from bspline_mdao.generators import naca_section
    >>> naca_section(0.12).upper[:, 1].max().round(3).item()  # half of the thickness
    0.06
    """
    if extended:
        x = 0.5 * _EXTENDED * (1.0 - np.cos(np.linspace(0.0, np.pi, 401)))
        powers = -0.1015, 0.2843, -0.3516, -0.1260
        y = 5.0 * thickness * (0.2969 * np.sqrt(x) + x * np.polyval(powers, x))
        points = np.column_stack([x, y]) / _EXTENDED
        points[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
        return Section.symmetric(points, nose_radius=_naca_nose_radius(thickness) / _EXTENDED)
    x, y = _naca_upper(thickness)
    return Section.symmetric(np.column_stack([x, y]), nose_radius=_naca_nose_radius(thickness))


def cambered_section(thickness: float, camber: float, reflex: float = 0.0) -> Section:
    """Make a section with the thickness of a four-digit NACA section about a camber line.

    Parameters
    ----------
    thickness : float
        Thickness in chords.
    camber : float
        Factor of the camber line ``4 camber x (1 - x) (1 - reflex x)``; without reflex its largest height.
    reflex : float
        Above 1 the camber line turns up behind ``x = 1 / reflex``.

    Returns
    -------
    Section
        The thickness is added vertically, so the tangent at the nose is vertical.

    Examples
    --------
    >>> from bspline_mdao.generators import cambered_section
    >>> section = cambered_section(0.12, 0.02)
    >>> section.lower.shape == section.upper.shape
    True
    """
    x, y = _naca_upper(thickness)
    line = 4.0 * camber * x * (1.0 - x) * (1.0 - reflex * x)
    upper, lower = (np.column_stack([x, line + side * y]) for side in (1.0, -1.0))
    return Section(upper, lower, nose_radius=_naca_nose_radius(thickness))


def _naca_upper(thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Upper side of a symmetric four-digit NACA section with a closed trailing edge."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 201)))
    return x, naca_thickness(x, thickness, is_closed=True)


def naca_thickness(x: np.ndarray, thickness: float, *, is_closed: bool) -> np.ndarray:
    """Half-thickness of four-digit NACA sections at fractions x of the chord, from 0 to 1 (chords)."""
    last = 0.1036 if is_closed else 0.1015
    y = 5.0 * thickness * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - x * last))))
    y[[0, -1] if is_closed else [0]] = 0.0
    return y


def _naca_nose_radius(thickness: float) -> float:
    return 0.5 * (5.0 * thickness * 0.2969) ** 2


def _spline(points: np.ndarray, nose_radius: float, side: float) -> CubicSpline:
    """Cubic spline in chord length, with the vertical tangent at a blunt nose, which one side does not determine."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    start = (1, [0.0, side]) if nose_radius > 0.0 else (2, [0.0, 0.0])
    return CubicSpline(arc, points, bc_type=(start, (2, [0.0, 0.0])))


def _arcs(curve: CubicSpline, factors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and arc lengths, both of shape (m, n), along a curve scaled in y by each of the factors (m,)."""
    t = np.linspace(0.0, 1.0, _SAMPLES) ** 2 * curve.x[-1]
    x, y = curve(t, 1).T
    speed = np.hypot(x, np.multiply.outer(factors, y))
    return np.broadcast_to(t, speed.shape), CubicSpline(t, speed, axis=1).antiderivative()(t)


def _places(t: np.ndarray, arc: np.ndarray) -> tuple[CubicSpline, float]:
    """Parameter of a curve by its arc length, which is also returned."""
    # at a nose the parameter varies as the arc, or as its root without thickness: smooth in the root of the arc
    return CubicSpline(np.sqrt(arc), t), arc[-1]


def _at_arcs(curve: CubicSpline, places: tuple[CubicSpline, float], fractions: np.ndarray, factor: float) -> np.ndarray:
    """Points of a curve scaled in y at fractions of its arc length."""
    by_root, length = places
    points = curve(by_root(np.sqrt(fractions * length))) * [1.0, factor]
    points[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
    return points


@dataclass(frozen=True)
class Wing(OneLine):
    """A wing with its tip closed inside its planform.

    Parameters
    ----------
    planform : Planform or KinkedPlanform
        Chords, span and sweep.
    section : Section
        Section at the root, and everywhere if there is no other.
    tip_section : Section, optional
        Section at the tip; points at equal fractions of the arc are blended linearly along the span.
    tip_length : float, optional
        Length of span over which the tip is rounded (m); twice the thickness there by default.
    sections_between : sequence of (float, Section)
        Sections between root and tip, each with its span position (m), from the root outwards: at kinks of the
        planform, where blocks end. Between two of them points are blended in the same manner. Without a tip section the
        last one continues.

    Raises
    ------
    InputError
        If a section between is not at a kink of the planform, or they are not in order.

    Notes
    -----
    Over the last ``tip_length`` of the span, s from 0 to 1, the thickness is scaled by ``sqrt(1 - s^3)``: a blunt tip
    without a jump in curvature, closed to the chord line, so the tip is a line of the H-H topology.

    Examples
    --------
    >>> from bspline_mdao.generators import Planform, Wing, naca_section
    >>> wing = Wing(Planform(semi_span=3.0, taper=0.5, leading_edge_sweep=20.0), naca_section(0.12))
    >>> wing.planform.tip_chord
    0.5
    """

    planform: Planform | KinkedPlanform
    section: Section
    tip_section: Section | None = None
    tip_length: float | None = None
    sections_between: Sequence[tuple[float, Section]] = ()

    def __post_init__(self) -> None:
        places, kinks = [place for place, _ in self.sections_between], self.planform.kinks
        if not set(places) <= set(kinks) or sorted(set(places)) != places:
            raise InputError(
                f"wing: sections between root and tip at spans {places}; give each at one of the kinks of the "
                f"planform, {list(kinks)}, from the root on"
            )

    @property
    def outer_section(self) -> Section:
        """Section at the tip."""
        return self.tip_section or [self.section, *(section for _, section in self.sections_between)][-1]

    @property
    def rounded_length(self) -> float:
        """Length of span over which the tip is rounded (m); 0 for a wing without thickness."""
        if self.tip_length is not None:
            return self.tip_length
        return 2.0 * self.outer_section.thickness * self.planform.tip_chord

    @property
    def tip_radius(self) -> float:
        """Radius of the rounded tip at its greatest thickness (m): the limit of ``sqrt(1 - s^3)`` at s = 1."""
        half = 0.5 * self.outer_section.thickness * self.planform.tip_chord
        return 1.5 * half**2 / self.rounded_length if self.rounded_length > 0.0 else 0.0

    @property
    def nose_radius(self) -> float:
        """Radius of the leading edge at the root (m)."""
        return self.section.nose_radius * self.planform.root_chord

    @property
    def stations(self) -> np.ndarray:
        """Span positions (m), with kinks, dense towards the tip, as thickness varies as the root of distance."""
        places, kinks = self.planform.semi_span * tip_clustered(_STATIONS), np.array(self.planform.kinks)
        is_near = np.abs(places[:, None] - kinks).min(axis=1, initial=np.inf) < 1e-3 * self.planform.semi_span
        return np.sort(np.concatenate([places[~is_near], kinks]))

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
        given = [(0.0, self.section), *self.sections_between]
        given += [(planform.semi_span, self.tip_section)] if self.tip_section is not None else []
        weights = np.eye(len(given))
        spans = [place for place, _ in given]
        shape = sum(
            np.interp(stations, spans, weight)[:, None, None] * section.points(side, fractions, factor)
            for weight, (_, section) in zip(weights, given)
        )
        x, y = np.moveaxis(shape, 2, 0)
        chord = planform.x(1.0, stations) - planform.x(0.0, stations)
        return np.stack([planform.x(x, stations[:, None]), chord[:, None] * y], axis=-1)

    def place(self, sections: np.ndarray) -> np.ndarray:
        """Points in space, shape (n_stations, n, 3), from points of all sections, shape (n_stations, n, 2)."""
        x, height = np.moveaxis(sections, 2, 0)
        return np.stack([x, height, np.broadcast_to(self.stations[:, None], x.shape)], axis=-1)

    def thickness_factor(self, z: np.ndarray) -> np.ndarray:
        """Factor on the thickness at span positions z (m), shape (m,)."""
        return tip_rounding(self.planform.semi_span - z, self.rounded_length)


def surface_grid(
    wing: Wing,
    side: int,  # +1 upper, -1 lower
    counts: tuple[int, ...],  # nodes along the chord and along the span
    # spacings on the surface at the four edges, in arc length (m)
    leading: float,
    trailing: float,
    root: float,
    tip: float,
    kink_nodes: tuple[int, ...] = (),  # numbers along the span of the nodes at the kinks
) -> np.ndarray:
    """Divide one side of a wing into a surface grid."""
    # returns (n_chord, n_span, 3), nodes. Exactly y = 0 at the leading edge, the trailing edge and the tip, and z = 0
    # at the root
    n_chord, n_span = counts
    samples = _chordwise_lines(wing, side, n_chord, leading, trailing)
    panels = zip([0, *kink_nodes], [*kink_nodes, n_span - 1]) if kink_nodes else []
    ends = np.searchsorted(wing.stations, [0.0, *wing.planform.kinks, wing.planform.semi_span])
    cells = [last - first for first, last in panels]
    nodes = np.stack([_divide_panels(line, n_span, root, tip, ends, cells) for line in samples])
    nodes[:, 0, 2], nodes[:, -1, 2] = 0.0, wing.planform.semi_span
    nodes[[0, -1], :, 1] = 0.0
    if wing.rounded_length > 0.0:
        nodes[:, -1, 1] = 0.0
    return nodes


def _chordwise_lines(wing: Wing, side: int, n_chord: int, leading: float, trailing: float) -> np.ndarray:
    """Points of the surface at all stations, shape (n_chord, n_stations, 3)."""
    planform, stations = wing.planform, wing.stations
    chord = planform.x(1.0, stations) - planform.x(0.0, stations)
    length = chord * wing.section.length(side, wing.thickness_factor(stations))
    fractions = stretch_lines(length, n_chord, leading, trailing)
    return wing.place(wing.sections(side, fractions)).swapaxes(0, 1)


def _divide_panels(
    line: np.ndarray, n: int, root: float, tip: float, ends: np.ndarray, cells: Sequence[int]
) -> np.ndarray:
    """Divide a sampled line (m, 3) by arc length, given the samples at ends of panels and the cells of each."""
    if len(cells) < 2:
        return _divide(line, n, root, tip)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    whole = arc[-1] * stretch_lines(arc[-1:], n, root, tip)[0]
    middles = 0.5 * (whole[1:] + whole[:-1])
    # intervals on both sides of a kink are as they would be without it, and end intervals no wider than the mean
    means = np.diff(arc[ends]) / cells
    at_kinks = np.minimum(np.interp(arc[ends[1:-1]], middles, np.diff(whole)), np.minimum(means[1:], means[:-1]))
    first, last = [min(root, means[0]), *at_kinks], [*at_kinks, min(tip, means[-1])]
    parts = [
        _divide(line[start : stop + 1], count + 1, a, b)
        for start, stop, count, a, b in zip(ends[:-1], ends[1:], cells, first, last)
    ]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def _divide(line: np.ndarray, n: int, first: float, last: float) -> np.ndarray:
    """Divide a sampled line (m, 3) by arc length."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return CubicSpline(arc, line)(arc[-1] * stretch_lines(arc[-1:], n, first, last)[0])
