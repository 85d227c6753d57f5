"""Shape of the edges of wing sections: radius of the leading edge, included angle of the trailing edge.

Theory: ``docs/theory/geometry.rst``, "Radius of the leading edge" and "Angle of the trailing edge".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...base.numerics.vectors import cross_2d, dots, lengths
from ...errors import InputError
from ..mesh.frame import Frame
from ..mesh.surface import SurfaceGrid
from .measure import Combinations
from .nose_of_cells import CellSections, nose_of_cells
from .section_lines import SectionLines, arc_parameters, polynomial_weights, stencil_matrix
from .section_thickness import MIDDLE
from .tail_of_cells import tail_lines, tail_tangents

__all__ = ["LeadingEdgeRadius", "TrailingEdgeAngle"]

REFERENCES = ("metre", "chord", "baseline")
"""References for relative radii."""

_SHARP = 1e-6
"""An edge with a radius below this fraction of the chord is sharp: no grid resolves such a radius."""

NOSE = 2
"""Points on each side of the leading edge for its tangent, the default of `LeadingEdgeRadius`."""


@dataclass(frozen=True, eq=False)
class LeadingEdgeRadius(OneLine):
    r"""Radius of curvature of plane sections at their leading edge.

    The polynomial of degree 2 m through the leading edge of a section and m points on each side, in the arc length of
    the baseline, has the derivatives p' and p'' there, fixed combinations of the nodes. The radius is
    :math:`|p'|^3 / (p'' \times p' \cdot n)`, whatever the parameter; n is the normal of the plane through the current
    p' and chord, so sections may rotate in any direction. On triangles and quads without grid lines, p' and p'' come
    from polynomials that fit the nodes around the edge, see `bspline_mdao.core.measures.jets`. Make it by `at`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    senses : ndarray, shape (n,)
        1 if the chord rotates to p' as the stream rotates to the normal, -1 otherwise.
    stations : ndarray, shape (n,)
        Positions of the sections along the span on the baseline (m).
    vectors : Combinations
        p', p'' and the chord of every section.
    scales : ndarray, shape (n,)
        Factors on the radii.
    is_relative_to_chord : bool
        Whether the radii are also divided by the chords.
    units : str or None
        Units of the radii.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import LeadingEdgeRadius, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> radius = LeadingEdgeRadius.at(surface, [0.3, 0.6], relative_to="baseline")
    >>> radius.evaluate(surface.points * [1.0, 1.1, 1.0]).round(2)
    array([1.21, 1.21])
    """

    surface: SurfaceGrid
    senses: np.ndarray
    stations: np.ndarray
    vectors: Combinations
    scales: np.ndarray
    is_relative_to_chord: bool
    units: str | None
    name: str

    @classmethod
    def at(
        cls,
        surface: SurfaceGrid,
        stations: Sequence[float] | None = None,
        *,
        relative_to: str = "metre",
        patches: str | Sequence[str] | None = None,
        n_nodes: int = 2,
        frame: Frame | None = None,
        name: str = "leading_edge_radius",
    ) -> LeadingEdgeRadius:
        """Choose the sections on the baseline.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        stations : sequence of float, optional
            Fractions of the span from the first to the last grid line around the leading edge; every such line by
            default, and the middle of a grid about a section. For triangles, fractions of the span as for
            `SectionThickness.at`, which must be given.
        relative_to : str
            ``"metre"``; ``"chord"``, the current chord of the section; or ``"baseline"``, the radius on the baseline.
        patches : str or sequence of str, optional
            Patches of the wing by name; all by default.
        n_nodes : int
            Number m of points on each side of the edge, if there are grid lines.
        frame : Frame, optional
            Directions along stream and span; see `SectionLines.of`.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If there is no leading edge or it is sharp, grid lines are too short, or an option is invalid.
        """
        if relative_to not in REFERENCES or n_nodes < 1:
            raise InputError(
                f"leading-edge radius: relative_to '{relative_to}' and {n_nodes} nodes on either side; "
                f"choose from {', '.join(REFERENCES)}, and 1 node at least"
            )
        units = "m" if relative_to == "metre" else None
        stations = MIDDLE if stations is None and surface.is_section else stations
        if surface.has_triangles:
            sections = CellSections.of(surface, stations, patches, frame, "leading-edge radius")
            places, plane = sections.places, sections.frame.axes[:2]
            vectors = Combinations.of([*nose_of_cells(sections), sections.chord])
        else:
            lines = SectionLines.of(surface, patches, frame)
            nose = lines.leading(n_nodes)
            places = lines.stations(np.concatenate([nose, _tail(lines)], axis=1), stations)
            vectors, plane = Combinations.of(_vectors(lines, nose, places, n_nodes)), lines.plane
        senses = _senses(surface.points, plane, vectors)
        measure = cls(surface, senses, places, vectors, np.ones(len(places)), relative_to == "chord", units, name)
        _require_blunt(measure)
        if relative_to != "baseline":
            return measure
        return replace(measure, scales=1.0 / measure.evaluate(surface.points))

    @property
    def shape(self) -> tuple[int]:
        """One radius for every section."""
        return self.stations.shape

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Radii, shape (n_stations,), from nodes, shape (n, 3); real or complex."""
        first, second, chord = self.derivatives(points)
        radii = self.scales * lengths(first) ** 3 * lengths(np.cross(chord, first)) / self._bends(first, second, chord)
        return radii / lengths(chord) if self.is_relative_to_chord else radii

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        first, second, chord = self.derivatives(points)
        normal = np.cross(chord, first)
        # of the logarithm: 3 ln |p'| + ln |n| - ln (bend) - ln |chord|, with n = chord x p'
        of_normal = normal / dots(normal, normal)[:, None]
        bend = (self.senses * self._bends(first, second, chord))[:, None]
        squared, across, along = (dots(u, v)[:, None] for u, v in ((first, first), (second, chord), (first, chord)))
        tilt = dots(second, first)[:, None]
        d_first = 3.0 * first / squared + np.cross(of_normal, chord)
        d_first -= (2.0 * across * first - along * second - tilt * chord) / bend
        d_second = -(squared * chord - along * first) / bend
        d_chord = np.cross(first, of_normal) - (squared * second - tilt * first) / bend
        if self.is_relative_to_chord:
            d_chord -= chord / dots(chord, chord)[:, None]
        radii = self.evaluate(points)[:, None]
        return self.vectors.chain([radii * part for part in (d_first, d_second, d_chord)])

    def derivatives(self, points: np.ndarray) -> np.ndarray:
        """p', p'' and chord, shape (3, n_stations, 3)."""
        return self.vectors.vectors(points)

    def _bends(self, first: np.ndarray, second: np.ndarray, chord: np.ndarray) -> np.ndarray:
        """``(p'' x p') . (chord x p')``, positive if the edge is round."""
        return self.senses * (dots(second, chord) * dots(first, first) - dots(second, first) * dots(first, chord))


def _senses(points: np.ndarray, plane: np.ndarray, vectors: Combinations) -> np.ndarray:
    """Sense of rotation from the chord to p' in the planes of the sections on the baseline."""
    first, _, chord = vectors.vectors(points) @ plane.T
    return np.sign(cross_2d(chord, first))


def _tail(lines: SectionLines) -> np.ndarray:
    """Last nodes of both sides."""
    return np.stack([lines.trailing(side, 1)[:, 0] for side in range(2)], axis=1)


def _vectors(lines: SectionLines, nose: np.ndarray, places: np.ndarray, n_nodes: int) -> list[csr_array]:
    """Matrices for p', p'' and the chord of sections."""
    cut = lines.cut(nose, places)
    section = (cut @ lines.points @ lines.plane.T).reshape(len(places), -1, 2)
    parameters = arc_parameters(section)
    parameters -= parameters[:, n_nodes, None]
    weights = [polynomial_weights(parameters, 2 * n_nodes, derivative) for derivative in (1, 2)]
    at_edge = np.tile(np.eye(2 * n_nodes + 1)[n_nodes], (len(places), 1))
    tail = stencil_matrix(np.full((len(places), 2), 0.5)) @ lines.cut(_tail(lines), places)
    return [*(stencil_matrix(part) @ cut for part in weights), tail - stencil_matrix(at_edge) @ cut]


def _require_blunt(measure: LeadingEdgeRadius) -> None:
    """Refuse edges without a radius on the baseline."""
    first, second, chord = measure.derivatives(measure.surface.points)
    bend, normal = measure._bends(first, second, chord), lengths(np.cross(chord, first))
    is_blunt = (bend > 0.0) & (lengths(first) ** 3 * normal > _SHARP * lengths(chord) * bend)
    if not is_blunt.all():
        raise InputError(
            f"leading-edge radius: the section at {measure.stations[np.argmin(is_blunt)]:.4g} m along the span is not "
            f"round at its leading edge; leave it out, or take fewer nodes on either side"
        )


@dataclass(frozen=True, eq=False)
class TrailingEdgeAngle(OneLine):
    """Angles between the two sides of plane sections at their trailing edges.

    The tangent of a side comes from the polynomial, in the arc length of the baseline, that fits its last points: a
    fixed combination of the nodes. On triangles and quads without grid lines it comes from polynomials that fit the
    nodes of its side around the edge, see `bspline_mdao.core.measures.jets`. The angle is taken in the plane through
    the current chord and leading-edge tangent, so sections may rotate in any direction. It is positive if the upper
    side is above the lower one ahead of the edge, and between -180 and 180 degrees; a blunt edge has one too. Make it
    by `at`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    senses : ndarray, shape (n,)
        As for `LeadingEdgeRadius`.
    stations : ndarray, shape (n,)
        Positions of the sections along the span on the baseline (m).
    vectors : Combinations
        Forward tangents of the upper and lower side, the leading-edge tangent, and the chord.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import SurfaceGrid, TrailingEdgeAngle
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> TrailingEdgeAngle.at(surface, [0.3, 0.6]).evaluate(surface.points).shape
    (2,)
    """

    surface: SurfaceGrid
    senses: np.ndarray
    stations: np.ndarray
    vectors: Combinations
    name: str

    units = "rad"
    """Units of the angles."""

    @classmethod
    def at(
        cls,
        surface: SurfaceGrid,
        stations: Sequence[float] | None = None,
        *,
        n_nodes: int = 3,
        degree: int | None = None,
        between: tuple[float, float] | None = None,
        patches: str | Sequence[str] | None = None,
        frame: Frame | None = None,
        name: str = "trailing_edge_angle",
    ) -> TrailingEdgeAngle:
        """Choose the sections on the baseline.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        stations : sequence of float, optional
            Fractions of the span from the first to the last grid line around the leading edge; every such line by
            default, and the middle of a grid about a section. For triangles, fractions of the span as for
            `SectionThickness.at`, which must be given.
        n_nodes : int
            Number of points on each side, including the edge, if there are grid lines.
        degree : int, optional
            Degree of the polynomials; ``n_nodes - 1`` by default, through all points.
        between : tuple of float, optional
            Fit straight lines instead to the points between two fractions of the chord, such as (0.9, 0.98): the wedge
            angle, whether the edge itself is sharp, blunt or round.
        patches : str or sequence of str, optional
            Patches of the wing by name; all by default.
        frame : Frame, optional
            Directions along stream and span; see `SectionLines.of`.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If there is no leading edge, grid lines are too short, the edge of triangles is round and ``between`` is not
            given, or an option is invalid.
        """
        degree = n_nodes - 1 if degree is None else degree
        if not 1 <= degree < n_nodes or (between and not 0.0 < between[0] < between[1] <= 1.0):
            raise InputError(
                f"trailing-edge angle: degree {degree} through {n_nodes} nodes, between {between}; give a degree from "
                f"1 to n_nodes - 1, and two rising fractions of the chord"
            )
        stations = MIDDLE if stations is None and surface.is_section else stations
        if surface.has_triangles:
            sections = CellSections.of(surface, stations, patches, frame, "trailing-edge angle")
            at_edge = [*nose_of_cells(sections), sections.chord]
            tangents = tail_lines(sections, between) if between else tail_tangents(sections)
            places, plane = sections.places, sections.frame.axes[:2]
        else:
            lines = SectionLines.of(surface, patches, frame)
            sides = [lines.trailing(side, _reaching(lines, side, between) if between else n_nodes) for side in range(2)]
            nose = lines.leading(NOSE)
            places, plane = lines.stations(np.concatenate([nose, *sides], axis=1), stations), lines.plane
            at_edge = _vectors(lines, nose, places, NOSE)
            tangents = [_tangents(lines, nodes, places, degree, between) for nodes in sides]
        senses = _senses(surface.points, plane, Combinations.of(at_edge))
        return cls(surface, senses, places, Combinations.of([*tangents, at_edge[0], at_edge[2]]), name)

    @property
    def shape(self) -> tuple[int]:
        """One angle for every section."""
        return self.stations.shape

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Angles (rad), shape (n_stations,), from nodes, shape (n, 3); real or complex."""
        upper, lower, first, chord = self.vectors.vectors(points)
        upper, lower = (self._in_plane(side, first, chord) for side in (upper, lower))
        along = (upper * lower).sum(axis=1)
        return 2.0 * np.arctan(cross_2d(upper, lower) / (lengths(upper) * lengths(lower) + along))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        upper, lower, first, chord = self.vectors.vectors(points)
        d_upper, *by_upper = self._direction_partials(upper, first, chord)
        d_lower, *by_lower = self._direction_partials(lower, first, chord)
        return self.vectors.chain([-d_upper, d_lower, *(b - a for a, b in zip(by_upper, by_lower))])

    def _in_plane(self, tangent: np.ndarray, first: np.ndarray, chord: np.ndarray) -> np.ndarray:
        """Components of a tangent along the chord and normal to it in the section plane, times the chord length."""
        normal = np.cross(chord, first)
        across = self.senses * dots(tangent, np.cross(normal, chord)) / lengths(normal)
        return np.stack([dots(tangent, chord), across], axis=1)

    def _direction_partials(
        self, tangent: np.ndarray, first: np.ndarray, chord: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of the angle of a tangent in `_in_plane`, with respect to the tangent, p' and the chord."""
        normal = np.cross(chord, first)
        size = lengths(normal)[:, None]
        along, across = (component[:, None] for component in self._in_plane(tangent, first, chord).T)
        of_along, of_across = -across / (along**2 + across**2), along / (along**2 + across**2)
        weight = self.senses[:, None] / size * tangent
        by_normal = np.cross(chord, weight) - across / size**2 * normal
        by_chord = np.cross(weight, normal) + np.cross(first, by_normal)
        by_tangent = self.senses[:, None] / size * np.cross(normal, chord)
        return (
            of_along * chord + of_across * by_tangent,
            of_across * np.cross(by_normal, chord),
            of_along * tangent + of_across * by_chord,
        )


def _reaching(lines: SectionLines, side: int, between: Sequence[float]) -> int:
    """Number of nodes from the trailing edge forward that reach the first of two fractions on every chord."""
    nodes = lines.sides[side]
    reach = ((nodes >= 0) & (lines.fractions[nodes] >= between[0])).sum(axis=1).max() + 1
    return min(int(reach), int((nodes >= 0).sum(axis=1).min()))


def _tangents(
    lines: SectionLines, nodes: np.ndarray, places: np.ndarray, degree: int, between: Sequence[float] | None
) -> csr_array:
    """Matrix of the tangents of one side, from points starting at the trailing edge."""
    cut = lines.cut(nodes, places)
    parameters = arc_parameters((cut @ lines.points @ lines.plane.T).reshape(len(places), -1, 2))
    if between is None:
        return stencil_matrix(polynomial_weights(parameters, degree, derivative=1)) @ cut
    fractions = (cut @ lines.fractions).reshape(parameters.shape)
    is_used = (fractions >= between[0]) & (fractions <= between[1])
    if is_used.sum(axis=1).min() < 2:
        place = places[np.argmin(is_used.sum(axis=1))]
        raise InputError(
            f"trailing-edge angle: less than two nodes of a side are between {between[0]} and {between[1]} of the "
            f"chord at {place:.4g} m along the span; take fractions further apart"
        )
    return stencil_matrix(polynomial_weights(parameters, 1, derivative=1, is_used=is_used)) @ cut
