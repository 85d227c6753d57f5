"""Plane sections of a wing of triangles and quads, and their derivatives at the leading edge.

Theory: ``docs/theory/geometry.rst``, "Radius of the leading edge".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...base.numerics.vectors import dots
from ...errors import InputError
from ..mesh.frame import Frame, surface_frame
from ..mesh.surface import SurfaceGrid
from .jets import SmoothCorners, jets, tangents
from .probes import Probes
from .section_thickness import Cut, cuts_along_span, section_edges

__all__ = ["CellSections", "nose_of_cells"]


@dataclass(frozen=True, eq=False)
class CellSections:
    """Plane sections of a wing of triangles and quads, on its baseline."""

    wing: SurfaceGrid
    cuts: tuple[Cut, ...]  # their planes
    frame: Frame  # directions of the wing
    leading: Probes  # their leading edges
    trailing: Probes  # their trailing edges, see `section_edges`
    what: str  # what they are for, for messages

    @classmethod
    def of(
        cls,
        surface: SurfaceGrid,
        stations: Sequence[float] | None,  # fractions of the span
        patches: str | Sequence[str] | None,  # patches of the wing; all by default
        frame: Frame | None,  # directions; found from the box of the wing by default
        what: str,  # what they are for, for messages
    ) -> CellSections:
        """Cut the wing."""
        if stations is None:
            raise InputError(f"{what}: {surface.names[0]} has triangles, through which no grid lines go; give stations")
        wing = surface if patches is None else surface.only(surface.part(patches))
        cuts = cuts_along_span(wing, np.atleast_1d(np.asarray(stations, dtype=float)).tolist(), frame)
        frame = frame or surface_frame(wing.points, wing.planes)
        return cls(wing, cuts, frame, *section_edges(wing, cuts, what), what)

    @cached_property
    def chord(self) -> csr_array:
        """Matrix of the chords, (n, n_points)."""
        return csr_array(self.trailing.matrix(self.wing.n_points) - self.leading.matrix(self.wing.n_points))

    @property
    def places(self) -> np.ndarray:
        """Positions along the span (m), (n,)."""
        return self.frame.to_local(np.array([cut.origin for cut in self.cuts]))[:, 2]


def nose_of_cells(sections: CellSections) -> tuple[csr_array, csr_array]:
    """Find the first and second derivative along sections at their leading edges, as combinations of nodes."""
    # returns matrices of p', from the lower to the upper side, and p'', each (n_sections, n_points)
    # 1. The leading edge of a section is a point between two nodes.
    # 2. At each of them the baseline curve in the plane parallel to the section has p' and p'', combinations of the
    #    derivatives of the surface, which are combinations of nodes.
    # 3. The section's derivatives are interpolated between them like the point.
    corners, leading = SmoothCorners(sections.wing.points, sections.wing.quads), sections.leading  # step 1
    nodes, inverse = np.unique(leading.nodes, return_inverse=True)
    inverse = inverse.reshape(leading.nodes.shape)
    n_places = np.bincount(corners.nodes, minlength=len(corners.points))
    order = np.argsort(corners.nodes, kind="stable")
    places = order[np.searchsorted(corners.nodes, nodes, sorter=order)]
    matrices, is_found = jets(corners, places)
    is_round = (is_found & (n_places[nodes] == 1))[inverse] | (leading.weights == 0.0)
    if not is_round.all():
        x, y, z = corners.points[leading.nodes[~is_round][0]]
        raise InputError(
            f"{sections.what}: the surface has a kink at its leading edge, near ({x:g}, {y:g}, {z:g}), or too few "
            f"nodes around it; take a finer mesh, or leave the section out"
        )
    axes, normals = tangents(corners.normals[places]), corners.normals[places]
    derivatives = np.stack([matrix @ corners.points for matrix in matrices])
    firsts, seconds = [], []
    _, up, across = sections.frame.axes
    for number in range(leading.nodes.shape[1]):  # step 2
        at, weights = inverse[:, number], leading.weights[:, number]
        along = np.cross(across, normals[at])
        along /= (np.sign(along @ up) * np.linalg.norm(along, axis=1))[:, None]
        a, b = dots(along, axes[at, 0]), dots(along, axes[at, 1])
        second = np.array([a * a, 2.0 * a * b, b * b])
        out = dots(np.einsum("kn,knx->nx", second, derivatives[2:][:, at]), across)
        tangent = dots(-b[:, None] * derivatives[0][at] + a[:, None] * derivatives[1][at], across)
        back = -out / tangent  # so that the curve does not leave the plane
        first = (a, b)
        whole = (-b * back, a * back, *second)
        firsts.append(sum(diags_array(weights * part) @ matrix[at] for part, matrix in zip(first, matrices)))
        seconds.append(sum(diags_array(weights * part) @ matrix[at] for part, matrix in zip(whole, matrices)))
    return csr_array(sum(firsts)), csr_array(sum(seconds))  # step 3
