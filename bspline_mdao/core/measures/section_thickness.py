"""Thickness of plane wing sections relative to their chord, t/c, bounded smoothly.

Theory: ``docs/theory/geometry.rst``, "Thickness of sections".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...base.numerics.vectors import lengths, unit_vectors
from ...errors import InputError
from ...grids.cells.aggregates import KreisselmeierSteinhauser
from ..mesh.frame import TOUCHED, Frame, surface_frame
from ..mesh.surface import SurfaceGrid
from .edge_cuts import EdgeCuts, cut_edges, edges_of_quads, root_end
from .measure import Combinations
from .probes import FLAT, ROUND_OFF, Probes, opposite_probes

__all__ = ["MIDDLE", "Cut", "SectionThickness", "cuts_along_span", "section_edges", "stations_or_middle"]

_LAST = 1e-6
"""Fraction of the chord by which the corners of a blunt trailing edge may differ along the stream: the accuracy of
fits."""

MIDDLE = (0.5,)
"""Station of a section that is the same all along the span."""

_THIN = 0.01
"""Smallest t/c that scales a bound: on a thinner baseline, such as a plate, the bound would be too sharp."""


@dataclass(frozen=True, eq=False)
class SectionThickness(OneLine):
    """Smooth bound of the largest or smallest t/c, thickness over chord, of sections. Made by `at`.

    Parameters
    ----------
    surface : SurfaceGrid
        The wing.
    vectors : Combinations
        Chord of every section, and n vectors from its lower to its upper side.
    across : ndarray, shape (n_sections, 3)
        Unit normals of the chords on the baseline, in the planes of the sections.
    scales : ndarray, shape (n_sections,)
        Largest t/c at the probes on the baseline, at least 0.01.
    rule : KreisselmeierSteinhauser
        Smooth bound of t/c divided by the scale.
    sign : float
        1 for the largest, -1 for the smallest.
    name : str
        Name of the output.

    Notes
    -----
    With n probes the largest t/c of a section lies between ``KS - scale ln(n) / rho`` and KS, the smallest between KS
    and ``KS + scale ln(n) / rho``. Sections are material: probes and edges stay fixed in the parameters of the surface.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import SectionThickness, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> thickness = SectionThickness.at(surface, [0.3, 0.6])  # largest thickness by chord, at two sections
    >>> thickness.evaluate(surface.points).shape
    (2,)
    """

    surface: SurfaceGrid
    vectors: Combinations
    across: np.ndarray
    scales: np.ndarray
    rule: KreisselmeierSteinhauser
    sign: float
    name: str
    units = None

    @classmethod
    def at(
        cls,
        surface: SurfaceGrid,
        stations: Sequence[float] | Sequence[Cut] | None = None,
        chordwise: Sequence[float] | int = 19,
        smallest: bool = False,
        rho: float = 200.0,
        name: str = "section_thickness",
    ) -> SectionThickness:
        """Return the measure of plane sections at stations along the span.

        Parameters
        ----------
        surface : SurfaceGrid
            The wing.
        stations : sequence of float or of Cut, optional
            Fractions of the span (`cuts_along_span`), or planes: a winglet is cut across its own span. The default for
            a grid about a section (`SurfaceGrid.is_section`) is its middle; for a wing they must be given.
        chordwise : sequence of float or int
            Fractions of the chord at which the thickness is measured, across the chord; for a number n, ``1 / (n + 1)``
            to ``n / (n + 1)``.
        smallest : bool
            Whether to bound the smallest t/c instead of the largest.
        rho : float
            Sharpness of the bound.
        name : str
            Name of the output.

        Returns
        -------
        SectionThickness
            Measure with one number for every station.

        Raises
        ------
        InputError
            If a plane does not cut the surface, or a probe misses it.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((17, 17, 13)), n_control=(9, 8, 7)))
        >>> SectionThickness.at(surface, [0.2, 0.5, 0.8]).evaluate(surface.points).round(3)
        array([0.096, 0.096, 0.096])
        """
        stations = stations_or_middle(surface, stations, name)
        cuts = [station if isinstance(station, Cut) else cuts_along_span(surface, [station])[0] for station in stations]
        if not cuts:
            raise InputError(f"{name}: no station is given; give fractions of the span, or cuts")
        vectors, across = _section_vectors(surface, cuts, _fractions(chordwise, name), name)
        scales = np.maximum(_ratios(vectors.vectors(surface.points)).max(axis=1), _THIN)
        rule = KreisselmeierSteinhauser(rho)
        return cls(surface, vectors, across, scales, rule, -1.0 if smallest else 1.0, name)

    @property
    def shape(self) -> tuple[int]:
        """Shape of the output."""
        return (len(self.scales),)

    def ratios(self, points: np.ndarray) -> np.ndarray:
        """Thickness divided by chord at all probes, shape (n_sections, n), from nodes, shape (n_points, 3)."""
        return _ratios(self.vectors.vectors(points))

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Bounds, shape (n_sections,), from nodes, shape (n_points, 3)."""
        return self._bounds(self._scaled(self.ratios(points))) * -self.sign * self.scales

    def partials(self, points: np.ndarray) -> csr_array:
        """Derivatives of the bounds, shape (n_sections, 3 n_points)."""
        vectors = self.vectors.vectors(points)
        ratios, chord = _ratios(vectors), lengths(vectors[0])[:, None]
        scaled = self._scaled(ratios)
        weights = np.stack([self.rule.weights(x, bound) for x, bound in zip(scaled, self._bounds(scaled))]) / chord
        along = unit_vectors(vectors[1:], self.across, ROUND_OFF * self.surface.size)
        of_chord = -(weights * ratios).sum(axis=1)[:, None] * vectors[0] / chord
        return self.vectors.chain([of_chord, *(weights.T[..., None] * along)])

    def _scaled(self, ratios: np.ndarray) -> np.ndarray:
        """Ratios in units of the scales, with the sign for which the rule bounds them from below."""
        return -self.sign * ratios / self.scales[:, None]

    def _bounds(self, scaled: np.ndarray) -> np.ndarray:
        return np.array([self.rule.value(self.rule.part(x)) for x in scaled])


def stations_or_middle(surface: SurfaceGrid, stations: Sequence[Any] | None, what: str) -> Sequence[Any]:
    """Return the given stations; by default, the middle of a section."""
    if stations is not None:
        return stations
    if not surface.is_section:
        raise InputError(f"{what}: no station is given; give fractions of the span, such as [0.1, 0.5, 0.9]")
    return MIDDLE


def _section_vectors(
    surface: SurfaceGrid, cuts: Sequence[Cut], fractions: np.ndarray, what: str
) -> tuple[Combinations, np.ndarray]:
    """Chords and vectors from the lower to the upper side, and unit normals of the chords."""
    leading, trailing = section_edges(surface, cuts, what)
    start, chord = leading.at(surface.points), trailing.at(surface.points) - leading.at(surface.points)
    across = np.cross([cut.normal for cut in cuts], chord)
    across /= lengths(across)[:, None]
    points = start[:, None] + fractions[:, None] * chord[:, None]
    directions = np.repeat(across, len(fractions), axis=0)
    lower, upper = opposite_probes(surface, points.reshape(-1, 3), directions, what)
    columns = [slice(n, None, len(fractions)) for n in range(len(fractions))]
    pairs = [(trailing, leading), *((upper.take(column), lower.take(column)) for column in columns)]
    matrices = [end.matrix(surface.n_points) - begin.matrix(surface.n_points) for end, begin in pairs]
    return Combinations.of(matrices), across


def _ratios(vectors: np.ndarray) -> np.ndarray:
    """Lengths of all vectors but the first, divided by the length of the first; shape (n_sections, n)."""
    return (lengths(vectors[1:]) / lengths(vectors[0])).T


def _fractions(chordwise: Any, name: str) -> np.ndarray:
    """Fractions of the chord, between its ends."""
    n = chordwise if np.ndim(chordwise) == 0 else None
    fractions = np.asarray(chordwise, dtype=float) if n is None else np.arange(1, n + 1) / (n + 1)
    if not (fractions.ndim == 1 and len(fractions) and (fractions > 0.0).all() and (fractions < 1.0).all()):
        raise InputError(f"{name}: fractions of the chord {chordwise}; give numbers between 0 and 1, or how many")
    return fractions


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane, and the direction of the stream in it."""

    origin: np.ndarray  # (3,), a point of the plane (m)
    normal: np.ndarray  # (3,), normal of the plane, of any length; along the span of the wing there
    stream: np.ndarray  # (3,), direction from the leading to the trailing edge, roughly

    def __post_init__(self) -> None:
        if not np.linalg.norm(np.cross(self.normal, self.stream)) > 0.0:
            raise InputError(f"cut: normal {self.normal} and stream {self.stream}; give two different directions")


def cuts_along_span(
    surface: SurfaceGrid,  # the wing
    # fractions of the span, from 0 to 1, measured from the symmetry plane at which the wing starts (`surface_frame`),
    # or from where sections are complete, if it starts at a fuselage (`root_end`)
    fractions: Sequence[float],
    frame: Frame | None = None,  # directions; found from the box of the wing by default
) -> tuple[Cut, ...]:
    """Cut a wing across its span."""
    frame = frame or surface_frame(surface.points, surface.planes)
    stream, _, span = frame.axes
    root = max(root_end(surface.quads, frame.to_local(surface.points)[:, 2]), 0.0)
    root = root if root > TOUCHED * frame.span else 0.0
    places = (root + fraction * (frame.span - root) for fraction in fractions)
    return tuple(Cut(frame.origin + place * span, span, stream) for place in places)


def section_edges(
    surface: SurfaceGrid,  # the wing, on its baseline
    cuts: Sequence[Cut],  # the planes
    what: str = "sections",  # purpose of the sections, for messages
) -> tuple[Probes, Probes]:
    """Find the leading and the trailing edge of plane sections."""
    # `InputError` if a plane does not cut the surface, or touches it in one point
    # returns leading, trailing: one probe of each for every cut. The trailing edge is the furthest point along the
    # stream, or midway between two that are equally far; the leading edge is the point furthest from it. Both are found
    # where the plane cuts the edges of quads
    edges = edges_of_quads(surface.quads)
    found = [_ends(surface, edges, cut, f"{what}: section {n} of {len(cuts)}") for n, cut in enumerate(cuts, start=1)]
    nodes, weights = (np.array(values) for values in zip(*found))
    return Probes(nodes[:, 0], weights[:, 0]), Probes(nodes[:, 1], weights[:, 1])


def _ends(surface: SurfaceGrid, edges: np.ndarray, cut: Cut, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights, each of shape (2, 4), of the leading and the trailing edge of one section."""
    section = _section(surface, edges, cut, what)
    places = section.at(surface.points)
    along = places @ cut.stream
    last = np.flatnonzero(along >= along.max() - _LAST * np.ptp(along))
    across = places[last] @ np.cross(cut.normal, cut.stream)
    trailing = last[[np.argmin(across), np.argmax(across)]]
    chord = np.linalg.norm(places - places[trailing].mean(axis=0), axis=1)
    leading = np.argmax(chord)
    if chord[leading] <= FLAT * surface.size:
        raise InputError(f"{what}: the plane only touches the surface, so that there is no chord; move it")
    ends = np.array([[leading, leading], trailing])
    return section.nodes[ends].reshape(2, 4), 0.5 * section.weights[ends].reshape(2, 4)


def _section(surface: SurfaceGrid, edges: np.ndarray, cut: Cut, what: str) -> EdgeCuts:
    """Points where a plane cuts edges, at least one."""
    heights = (surface.points - cut.origin) @ (cut.normal / np.linalg.norm(cut.normal))
    section = cut_edges(edges, heights, FLAT * surface.size)
    if not len(section.nodes):
        x, y, z = cut.origin
        raise InputError(f"{what}: the plane through ({x:g}, {y:g}, {z:g}) does not cut the surface; move it")
    return section
