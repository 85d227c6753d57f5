"""Included angle of the trailing edge at stations along the span."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from ..mesh.frame import Frame
from ..mesh.surface import SurfaceGrid
from ..numerics.vector_arrays import cross, lengths, turned
from .combinations import Combinations
from .section_lines import SectionLines
from .stencils import arc_parameters, polynomial_weights, stencil_matrix

__all__ = ["TrailingEdgeAngle"]


@dataclass(frozen=True, eq=False)
class TrailingEdgeAngle:
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
        return 2.0 * np.arctan(cross(upper, lower) / (lengths(upper) * lengths(lower) + along))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        # the difference of the directions of the two tangents, each of which turns by (turned(t) . dt) / |t|^2
        turns = [turned(tangent) / lengths(tangent)[:, None] ** 2 for tangent in self._in_plane(points)]
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
