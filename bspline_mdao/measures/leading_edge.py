"""Radius of the leading edge at stations along the span."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from ..mesh.frame import Frame
from ..mesh.surface import SurfaceGrid
from ..numerics.vector_arrays import cross, lengths, turned
from .combinations import Combinations
from .section_lines import SectionLines
from .stencils import arc_parameters, polynomial_weights, stencil_matrix

__all__ = ["LeadingEdgeRadius"]

REFERENCES = ("metre", "chord", "baseline")
"""What radii may be divided by."""

_SHARP = 1e-6
"""An edge of a radius less than this part of the chord is sharp."""


@dataclass(frozen=True, eq=False)
class LeadingEdgeRadius:
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
    is_by_chord : bool
        Whether the radii are also divided by the chords.
    units : str or None
        Units of the radii.
    name : str
        Name of the output.
    """

    surface: SurfaceGrid
    plane: np.ndarray
    stations: np.ndarray
    vectors: Combinations
    scales: np.ndarray
    is_by_chord: bool
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
        radii = self.scales * lengths(first) ** 3 / cross(second, first)
        return radii / lengths(chord) if self.is_by_chord else radii

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n_stations, 3 n)."""
        first, second, chord = self.derivatives(points)
        # of the logarithm: 3 ln |p'| - ln (p'' x p') - ln |chord|
        bend = cross(second, first)[:, None]
        by_first = 3.0 * first / lengths(first)[:, None] ** 2 - turned(second) / bend
        by_second = turned(first) / bend
        by_chord = -chord / lengths(chord)[:, None] ** 2 if self.is_by_chord else np.zeros_like(chord)
        radii = self.evaluate(points)[:, None]
        return self.vectors.chain([(radii * part) @ self.plane for part in (by_first, by_second, by_chord)])

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
    bend = cross(second, first)
    is_blunt = (bend > 0.0) & (lengths(first) ** 3 > _SHARP * lengths(chord) * bend)
    if not is_blunt.all():
        raise InputError(
            f"leading-edge radius: the section at {measure.stations[np.argmin(is_blunt)]:.4g} m along the span is not "
            f"round at its leading edge; leave it out, or take fewer nodes on either side"
        )
