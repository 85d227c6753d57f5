"""Free-form deformation: displacements of the points of a lattice as design variables.

Theory: ``docs/theory/free_form.rst``.

References
----------
T. W. Sederberg and S. R. Parry, Free-form deformation of solid geometric models, *Computer Graphics (SIGGRAPH)* 20(4),
1986.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.frame import mesh_planes
from .displacement import Direction, Displacement, directions_of
from .embedding import Embedding, FreeFormVolumes
from .variable import AuxiliaryPoints, Layout

__all__ = ["FreeForm"]

IDLE = 1e-9
"""A lattice point whose largest weight in any surface control point is below this gets no value: an optimizer could
move it by any amount without effect."""

ON_PLANE = 1e-9
"""Distance, relative to the size of the mesh, up to which a lattice point lies in a symmetry plane."""


ALIKE = 1e-12
"""Difference from one, in the cosine of the angle between the displacements by two values, up to which they are
multiples."""


@dataclass(frozen=True, eq=False)
class FreeForm(OneLine):
    """Move points of a lattice, and the control points embedded in it.

    Every point has one value per direction, point by point in C order. A value is a displacement, initially zero. Two
    kinds of points have no values: points fixed for continuity, see `Lattice`, and points so far from the surface that
    their weight in any of its points is at most 1e-9. Points in a symmetry plane stay in it: they have no value normal
    to it, so both sides of the plane meet smoothly. `point_ids` lists the remaining points, and `places` the meaning of
    each value. In a section that is one layer of cells, points behind each other along the span that move its curve
    equally share one value.

    Parameters
    ----------
    name : str
        Name of the variable.
    lattice : Lattice or LatticeBlocks
        The lattice.
    where : index expression or ndarray of bool, optional
        Which of its points, as numpy indexes an array of shape (n0, n1, n2): ``np.s_[:, :, 1:]``; or a mask of all,
        such as ``lattice.within(...)``. For several blocks, a mask, or index expressions by block: ``{0: np.s_[1:]}``.
        All by default.
    direction : str or array_like
        Coordinate axes by name, ``"y"`` or several as in ``"xyz"``; a vector, shape (3,); or vectors of the remaining
        points, shape (n, 3) or (n, 3, m).
    units : str, optional
        Units of the values: m by default, None if the vectors carry them.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import Lattice, Parametrization
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> shape = FreeForm("shape", Lattice.box(mesh, n=(4, 2, 3)), direction="y")
    >>> Parametrization(mesh, [shape]).initial["shape"].size
    24
    """

    name: str
    lattice: FreeFormVolumes
    where: Any = ...
    direction: Direction = "xyz"
    units: str | None = "m"

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The lattice, its parent, and so on."""
        return self.lattice.auxiliary

    def point_ids(self, layout: Layout) -> np.ndarray:
        """Numbers of the lattice points with values, in C order, ascending.

        Raises
        ------
        InputError
            If there are none, or ``where`` does not match the lattice.
        """
        return self._ids(Embedding.of(self.lattice, layout), layout)

    def bind(self, layout: Layout) -> Displacement:
        """Find the lattice coordinates of everything embedded, on the baseline.

        Raises
        ------
        InputError
            If nothing is embedded or no point is left.
        """
        return Displacement(self._columns(layout)[2])

    def places(self, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
        """Return the point that every value moves, and its displacement.

        Returns
        -------
        point_ids : ndarray of int, shape (n_values,)
            Numbers of the lattice points; the first of several that share a value.
        directions : ndarray, shape (n_values, 3)
            Their displacements by a unit of the value.

        Raises
        ------
        InputError
            As `point_ids`.
        """
        return self._columns(layout)[:2]

    def _columns(self, layout: Layout) -> tuple[np.ndarray, np.ndarray, csr_array]:
        """Result of `places`, and the displacements of all rows for a unit of each value."""
        embedding = Embedding.of(self.lattice, layout)
        ids = self._ids(embedding, layout)
        fields = directions_of(self.direction, len(ids), None, f"'{self.name}'")
        kept = fields.copy()
        for plane in mesh_planes(layout.mesh):
            is_on = np.abs(self.lattice.points[ids] @ plane.normal - plane.offset) <= ON_PLANE * layout.mesh.size
            kept[is_on] -= plane.normal[:, None] * (plane.normal @ kept[is_on])[:, None]
        is_left = np.linalg.norm(kept, axis=1) > IDLE * np.linalg.norm(fields, axis=1)
        if not is_left.any():
            raise InputError(
                f"'{self.name}': all of its lattice points lie in a plane of symmetry and would leave it; choose "
                f"others with 'where', or another direction"
            )
        ids, directions = np.repeat(ids, is_left.sum(axis=1)), kept.transpose(0, 2, 1)[is_left]
        entries, starts = (3 * ids[:, None] + np.arange(3)).ravel(), 3 * np.arange(len(ids) + 1)
        of_lattice = csc_array((directions.ravel(), entries, starts), shape=(3 * len(self.lattice.points), len(ids)))
        matrix = csr_array(embedding.transfer @ of_lattice)
        if not len(layout.mesh.copies):
            return ids, directions, matrix
        first, together = _alike(matrix[_coordinates(layout.mesh.once(np.arange(layout.n_surface)))].toarray())
        return ids[first], directions[first], csr_array(matrix @ together)

    def _ids(self, embedding: Embedding, layout: Layout) -> np.ndarray:
        rows = layout.mesh.once(np.arange(layout.n_surface))
        weights = embedding.weights[rows].max(axis=0).toarray().ravel()
        is_asked, is_fixed = self._is_asked(), embedding.is_fixed
        ids = np.flatnonzero(is_asked & ~is_fixed & (weights >= IDLE))
        if not len(ids):
            asked, fixed = np.count_nonzero(is_asked), np.count_nonzero(is_asked & is_fixed)
            raise InputError(
                f"'{self.name}': of {asked} lattice points asked for, {fixed} are fixed for continuity and "
                f"{asked - fixed} are too far from the surface to move it; choose others with 'where', or give the "
                f"lattice more points, less 'continuity' or another place"
            )
        return ids

    def _is_asked(self) -> np.ndarray:
        """Whether ``where`` chooses each point of the lattice."""
        try:
            return self.lattice.chosen(self.where)
        except IndexError as error:
            raise InputError(f"'{self.name}': where: {error}; the lattice has {self.lattice.counts} points") from None


def _coordinates(rows: np.ndarray) -> np.ndarray:
    """Coordinates of points, xyz interleaved."""
    return (3 * rows[:, None] + np.arange(3)).ravel()


def _alike(displacements: np.ndarray) -> tuple[np.ndarray, csr_array]:
    """Group columns (n, m) that are multiples of one another: the first of each, and the matrix that sums them."""
    units = displacements / np.linalg.norm(displacements, axis=0)
    _, group = connected_components(units.T @ units > 1.0 - ALIKE, directed=False)
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    m = len(group)
    return np.sort(first), csr_array((np.ones(m), (np.arange(m), rank[number])), shape=(m, len(first)))
