"""Displacements of single surface control points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .displacement import Direction, Displacement, directions_of, displacements
from .pairing import Where, rows_of
from .surface_net import surface_normals
from .variable import Carried, Layout

__all__ = ["Local"]


@dataclass(frozen=True, eq=False)
class Local:
    """Move surface control points one by one.

    Every selected point has one value per direction, point by point in the order of ``mesh.surface_ids``. A value is a
    displacement, and initially zero. Carried points, such as those of axes and lattices, stay.

    Parameters
    ----------
    name : str
        Name of the variable.
    where : Selection or array_like of int, optional
        Which points; numbers are rows of ``mesh.surface_ids``. All by default.
    direction : str or array_like
        Coordinate axes by name, ``"z"`` or several as in ``"xyz"``; ``"normal"``, the unit normal of the baseline
        into the fluid (see `bspline_mdao.design.surface_net`); a vector, shape (3,); vectors of the selected
        points, shape (n, 3); or m of them for every point, shape (n, 3, m). Vectors are displacements per unit of
        the value, of any length.
    units : str, optional
        Units of the values: m by default, None where the vectors carry them.

    Examples
    --------
    >>> from bspline_mdao import fit_grid, moving_mesh, onera_m6_grid
    >>> from bspline_mdao.design.composition import Parametrization
    >>> from bspline_mdao.design.selection import Nearest
    >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> parametrization = Parametrization(mesh, [Local("bump", Nearest((0.4, 0.05, 0.5)), "normal")])
    >>> parametrization.initial["bump"]
    array([0.])
    """

    name: str
    where: Where | None = None
    direction: Direction = "xyz"
    units: str | None = "m"
    carried: ClassVar[tuple[Carried, ...]] = ()

    def bind(self, layout: Layout) -> Displacement:
        """Select the points and find their directions on the baseline.

        Raises
        ------
        InputError
            If nothing is selected, or the directions do not fit what is.
        """
        mesh = layout.mesh
        rows = np.arange(layout.n_surface) if self.where is None else rows_of(self.where, mesh, f"'{self.name}'")
        directions = directions_of(self.direction, len(rows), lambda: surface_normals(mesh)[rows], f"'{self.name}'")
        return Displacement(displacements(rows, directions, len(layout.points)))
