"""Control points of a section curve as design variables, moving equally in all planes along the span.

Theory: ``docs/theory/parametrization.rst``, "Sections as one curve".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.quads import edges_of
from ..mesh.control_net import surface_normals, surface_quads
from ..mesh.span_lines import span_lines
from .displacement import Direction, Displacement, directions_of, displacements
from .section_places import SectionPlaces
from .selection import Where, rows_of
from .variable import AuxiliaryPoints, Layout

__all__ = ["CurvePoints"]

_AT_EDGE = 1e-9
"""Distance from the trailing edge, as a fraction of the chord, up to which a point is at it: round-off."""


@dataclass(frozen=True, eq=False)
class CurvePoints(OneLine):
    """Move the control points of a section curve, equally in all planes along the span.

    The surface ends on two symmetry planes and is the same everywhere between them, with one layer of cells or several.
    Every point has one value per direction, in the ``mesh.surface_ids`` order of the control points in one plane. A
    value is a displacement, initially zero. Auxiliary points, such as points of axes and lattices, stay.

    Parameters
    ----------
    name : str
        Name of the variable.
    where : Selection or array_like of int, optional
        Which points, in any of their planes; numbers are rows of ``mesh.surface_ids``. All by default.
    direction : str or array_like
        As for `Local`: coordinate axes by name, ``"normal"``, a vector, or vectors of the remaining points.
    edges : bool
        Whether the points nearest to the leading edge and at the trailing edge have values, too.
    units : str, optional
        Units of the values: m by default, None if the vectors carry them.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import CurvePoints
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> grid = section_o_grid(naca_section(0.12), 32, far=20.0)
    >>> section = DesignSurface.of(fit_grid(grid, n_control=[(13, 8, 2)]))
    >>> section.mesh.surface_ids.size  # in both planes
    24
    >>> section.parametrization([CurvePoints("points", direction="y")]).initial["points"].size
    10
    """

    name: str
    where: Where | None = None
    direction: Direction = "normal"
    edges: bool = False
    units: str | None = "m"
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    def bind(self, layout: Layout) -> Displacement:
        """Find the points of the curve and their directions on the baseline.

        Raises
        ------
        InputError
            If the surface is not a section, nothing is selected, or the directions do not match the selection.
        """
        lines, directions = self.directed(layout)
        rows, vectors = lines.ravel(), np.repeat(directions, lines.shape[1], axis=0)
        each = displacements(rows, vectors, len(layout.points))  # one value for each control point
        n_values, n_directions = len(lines) * directions.shape[2], directions.shape[2]
        numbers = np.arange(n_values).reshape(len(lines), 1, n_directions)
        columns = np.broadcast_to(numbers, (*lines.shape, n_directions)).ravel()
        alike = csr_array((np.ones(len(columns)), (np.arange(len(columns)), columns)), shape=(len(columns), n_values))
        return Displacement(csr_array(each @ alike))

    def directed(self, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
        """Return the points: rows of ``mesh.surface_ids``, shape (n, n_planes), and directions, shape (n, 3, m).

        Raises
        ------
        InputError
            As `bind`.
        """
        mesh, what = layout.mesh, f"'{self.name}'"
        points, quads = mesh.points[mesh.surface_ids], surface_quads(mesh)
        lines = span_lines(points, edges_of(quads), mesh.in_plane_rows, mesh.in_plane_normals)
        if lines is None:
            raise InputError(
                f"{what}: the surface is no section, the same from one plane of symmetry to another one; take Local "
                f"or FreeForm"
            )
        if not self.edges:
            parts = SectionPlaces.of(layout).parts[lines[:, 0]]
            lines = lines[(parts < 1.0 - _AT_EDGE) & (parts > parts.min())]
        if self.where is not None:
            lines = lines[np.isin(lines, rows_of(self.where, mesh, what)).any(axis=1)]
        if not len(lines):
            raise InputError(f"{what}: no point but those at the edges is selected; take others, or edges=True")
        return lines, directions_of(self.direction, len(lines), lambda: surface_normals(mesh)[lines[:, 0]], what)
