"""Shape of the edges of wing sections: radius of the leading edge, included angle of the trailing edge.

Theory: ``docs/theory/geometry.rst``, "Radius of the leading edge" and "Angle of the trailing edge".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from ..mesh.frame import Frame
from ..mesh.surface import SurfaceGrid
from ..numerics.vectors import cross_2d, lengths, turned_left
from ..shown import OneLine
from .measure import Combinations
from .section_lines import SectionLines, arc_parameters, polynomial_weights, stencil_matrix

__all__ = ["LeadingEdgeRadius", "TrailingEdgeAngle"]

REFERENCES = ("metre", "chord", "baseline")
"""References that radii may be relative to."""

_SHARP = 1e-6
"""An edge of a radius less than this part of the chord is sharp: no grid resolves such a radius."""


@dataclass(frozen=True, eq=False)
class LeadingEdgeRadius(OneLine):
    r"""Radius of curvature of plane sections at their leading edge.

    The polynomial of degree 2 m through the leading edge of a section and m points on either side, in the arc length of
    the baseline, has there the derivatives p' and p'', fixed combinations of the nodes. The radius is
    :math:`|p'|^3 / (p' \times p'')` in the plane of the section, whatever the parameter. Make it by `at`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    plane : ndarray, shape (2, 3)
        Directions along the stream and normal to it.
    stations : ndarray, shape (n,)
        Places of the sections along the span on the baseline (m).
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
    >>> from bspline_mdao import LeadingEdgeRadius, SurfaceGrid, fit_grid, onera_m6_grid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> radius = LeadingEdgeRadius.at(surface, [0.3, 0.6], relative_to="baseline")
    >>> radius.evaluate(surface.points * [1.0, 1.1, 1.0]).round(2)
    array([1.21, 1.21])
    """

    surface: SurfaceGrid
    plane: np.ndarray
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
            default.
        relative_to : str
            ``"metre"``; ``"chord"``, the chord of the section as it is; or ``"baseline"``, the radius on the baseline.
        patches : str or sequence of str, optional
            Patches of the wing by name; all by default.
        n_nodes : int
            Points m on either side of the edge.
        frame : Frame, optional
            Directions along stream and span; see `SectionLines.of`.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If there is no leading edge or it is sharp, grid lines are too short, or an option cannot be used.
        """
        if relative_to not in REFERENCES or n_nodes < 1:
            raise InputError(
                f"leading-edge radius: relative_to '{relative_to}' and {n_nodes} nodes on either side; "
                f"choose from {', '.join(REFERENCES)}, and 1 node at least"
            )
        lines = SectionLines.of(surface, patches, frame)
        places, vectors = _vectors(lines, stations, n_nodes)
        units = "m" if relative_to == "metre" else None
        measure = cls(surface, lines.plane, places, vectors, np.ones(len(places)), relative_to == "chord", units, name)
        _require_blunt(measure)
        if relative_to != "baseline":
            return measure
        return replace(measure, scales=1.0 / measure.evaluate(surface.points))

    @property
    def shape(self) -> tuple[int]:
        """One radius for every section."""
        return self.stations.shape

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Radii, shape (n_stations,), of nodes, shape (n, 3); real or complex."""
        first, second, chord = self.derivatives(points)
        radii = self.scales * lengths(first) ** 3 / cross_2d(second, first)
        return radii / lengths(chord) if self.is_relative_to_chord else radii

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        first, second, chord = self.derivatives(points)
        # of the logarithm: 3 ln |p'| - ln (p'' x p') - ln |chord|
        bend = cross_2d(second, first)[:, None]
        d_first = 3.0 * first / lengths(first)[:, None] ** 2 - turned_left(second) / bend
        d_second = turned_left(first) / bend
        d_chord = -chord / lengths(chord)[:, None] ** 2 if self.is_relative_to_chord else np.zeros_like(chord)
        radii = self.evaluate(points)[:, None]
        return self.vectors.chain([(radii * part) @ self.plane for part in (d_first, d_second, d_chord)])

    def derivatives(self, points: np.ndarray) -> np.ndarray:
        """p', p'' and chord in the plane of the sections, shape (3, n_stations, 2)."""
        return self.vectors.vectors(points) @ self.plane.T


def _vectors(lines, stations, n_nodes):
    """Places of the sections along the span, and what makes p', p'' and the chord of each."""
    nose, tail = lines.leading(n_nodes), np.stack([lines.trailing(side, 1)[:, 0] for side in range(2)], axis=1)
    places = lines.stations(np.concatenate([nose, tail], axis=1), stations)
    cut = lines.cut(nose, places)
    section = (cut @ lines.points @ lines.plane.T).reshape(len(places), -1, 2)
    parameters = arc_parameters(section)
    parameters -= parameters[:, n_nodes, None]
    weights = [polynomial_weights(parameters, 2 * n_nodes, derivative) for derivative in (1, 2)]
    at_edge = np.tile(np.eye(2 * n_nodes + 1)[n_nodes], (len(places), 1))
    chord = stencil_matrix(np.full((len(places), 2), 0.5)) @ lines.cut(tail, places) - stencil_matrix(at_edge) @ cut
    return places, Combinations.of([*(stencil_matrix(part) @ cut for part in weights), chord])


def _require_blunt(measure):
    """Refuse edges without a radius on the baseline."""
    first, second, chord = measure.derivatives(measure.surface.points)
    bend = cross_2d(second, first)
    is_blunt = (bend > 0.0) & (lengths(first) ** 3 > _SHARP * lengths(chord) * bend)
    if not is_blunt.all():
        raise InputError(
            f"leading-edge radius: the section at {measure.stations[np.argmin(is_blunt)]:.4g} m along the span is not "
            f"round at its leading edge; leave it out, or take fewer nodes on either side"
        )


@dataclass(frozen=True, eq=False)
class TrailingEdgeAngle(OneLine):
    """Angles between the two sides of plane sections at their trailing edges.

    The tangent of a side is that of the polynomial, in the arc length of the baseline, that fits its last points best:
    a fixed combination of the nodes. The angle is positive where the upper side is above the lower one ahead of the
    edge, and between -180 and 180 degrees; a blunt edge has one too. Make it by `at`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    plane : ndarray, shape (2, 3)
        Directions along the stream and normal to it.
    stations : ndarray, shape (n,)
        Places of the sections along the span on the baseline (m).
    tangents : Combinations
        Tangents of the upper and of the lower side, forward.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import SurfaceGrid, TrailingEdgeAngle, fit_grid, onera_m6_grid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> TrailingEdgeAngle.at(surface, [0.3, 0.6]).evaluate(surface.points).shape
    (2,)
    """

    surface: SurfaceGrid
    plane: np.ndarray
    stations: np.ndarray
    tangents: Combinations
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
            default.
        n_nodes : int
            Points of each side, that at the edge included.
        degree : int, optional
            Degree of the polynomials; ``n_nodes - 1`` by default, through all points.
        between : tuple of float, optional
            Fit straight lines instead to the points between two fractions of the chord, such as (0.9, 0.98): the angle
            of the wedge, whether the edge itself is sharp, blunt or round.
        patches : str or sequence of str, optional
            Patches of the wing by name; all by default.
        frame : Frame, optional
            Directions along stream and span; see `SectionLines.of`.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If there is no leading edge, grid lines are too short, or an option cannot be used.
        """
        degree = n_nodes - 1 if degree is None else degree
        if not 1 <= degree < n_nodes or (between and not 0.0 < between[0] < between[1] <= 1.0):
            raise InputError(
                f"trailing-edge angle: degree {degree} through {n_nodes} nodes, between {between}; give a degree from "
                f"1 to n_nodes - 1, and two rising fractions of the chord"
            )
        lines = SectionLines.of(surface, patches, frame)
        sides = [lines.trailing(side, _reaching(lines, side, between) if between else n_nodes) for side in range(2)]
        places = lines.stations(np.concatenate(sides, axis=1), stations)
        tangents = Combinations.of([_tangents(lines, nodes, places, degree, between) for nodes in sides])
        return cls(surface, lines.plane, places, tangents, name)

    @property
    def shape(self) -> tuple[int]:
        """One angle for every section."""
        return self.stations.shape

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Angles (rad), shape (n_stations,), of nodes, shape (n, 3); real or complex."""
        upper, lower = self._in_plane(points)
        along = (upper * lower).sum(axis=1)
        return 2.0 * np.arctan(cross_2d(upper, lower) / (lengths(upper) * lengths(lower) + along))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        # the difference of the directions of the two tangents, each of which turns by (turned_left(t) . dt) / |t|^2
        turns = [turned_left(tangent) / lengths(tangent)[:, None] ** 2 for tangent in self._in_plane(points)]
        return self.tangents.chain([-turns[0] @ self.plane, turns[1] @ self.plane])

    def _in_plane(self, points):
        return self.tangents.vectors(points) @ self.plane.T


def _reaching(lines, side, between):
    """Number of nodes from the trailing edge forward that reach the first of two fractions of every chord."""
    nodes = lines.sides[side]
    reach = ((nodes >= 0) & (lines.fractions[nodes] >= between[0])).sum(axis=1).max() + 1
    return min(int(reach), int((nodes >= 0).sum(axis=1).min()))


def _tangents(lines, nodes, places, degree, between):
    """Matrix of the tangents of one side, from points that start at the trailing edge."""
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
