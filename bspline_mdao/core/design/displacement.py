"""Displacements of points as design variables: linear in the values, by a constant sparse matrix.

`Local` displaces single surface control points, `Translation` all of them equally; `FreeForm` and `Camber` use the same
map.

Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array, eye_array, kron

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.control_net import surface_normals
from ..mesh.moving_mesh import MovingMesh
from .selection import Where, rows_of
from .variable import AuxiliaryPoints, Layout, MapPartials, block_diagonal

__all__ = ["Direction", "Displacement", "Local", "Translation", "directions_of", "displacements", "selector"]

Direction = str | Sequence[float] | np.ndarray
"""Coordinate axes by name (``"z"``, ``"xyz"``), one vector, or one or more vectors for every point."""


@dataclass(frozen=True, eq=False)
class Displacement(OneLine):
    """The map ``points + matrix values``."""

    matrix: csr_array  # (3 n_rows, n_values), displacement of all rows, xyz interleaved, for a unit of each value

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves: zeros, shape (n_values,)."""
        return np.zeros(self.matrix.shape[1])

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""
        return points + (self.matrix @ values).reshape(-1, 3)

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`; the derivatives are constant."""
        return MapPartials(eye_array(points.size, format="csr"), self.matrix)


@dataclass(frozen=True, eq=False)
class Local(OneLine):
    """Move surface control points one by one.

    Every selected point has one value per direction, point by point in the order of ``mesh.surface_ids``. A value is a
    displacement, initially zero. In a section that is one layer of cells, both planes move equally, and only points of
    the first have values. Auxiliary points, such as points of axes and lattices, stay.

    Parameters
    ----------
    name : str
        Name of the variable.
    where : Selection or array_like of int, optional
        Which points; numbers are rows of ``mesh.surface_ids``. All by default.
    direction : str or array_like
        Coordinate axes by name, ``"z"`` or several as in ``"xyz"``; ``"normal"``, the unit normal of the baseline
        into the fluid (see `bspline_mdao.core.mesh.control_net`); a vector, shape (3,); vectors of the selected points,
        shape (n, 3); or m vectors for every point, shape (n, 3, m). Vectors are displacements per unit of the value, of
        any length.
    units : str, optional
        Units of the values: m by default, None if the vectors carry them.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> from bspline_mdao.core.design.parametrization import Parametrization
    >>> from bspline_mdao.core.design.selection import Nearest
    >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> parametrization = Parametrization(mesh, [Local("bump", Nearest((0.4, 0.05, 0.5)), "normal")])
    >>> parametrization.initial["bump"]
    array([0.])
    """

    name: str
    where: Where | None = None
    direction: Direction = "xyz"
    units: str | None = "m"
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    def bind(self, layout: Layout) -> Displacement:
        """Select the points and find their directions on the baseline.

        Raises
        ------
        InputError
            If nothing is selected, or the directions do not match the selection.
        """
        return Displacement(displacements(*self.directed(layout.mesh), len(layout.points)))

    def directed(self, mesh: MovingMesh) -> tuple[np.ndarray, np.ndarray]:
        """Return the points selected on a mesh, shape (n,), and their directions, shape (n, 3, m).

        Raises
        ------
        InputError
            As `bind`.
        """
        what = f"'{self.name}'"
        rows = np.arange(len(mesh.surface_ids)) if self.where is None else rows_of(self.where, mesh, what)
        rows = mesh.once(rows)
        return rows, directions_of(self.direction, len(rows), lambda: surface_normals(mesh)[rows], what)


@dataclass(frozen=True, eq=False)
class Translation(OneLine):
    """Translate the surface, or with `OfPart` a part of it, such as a wing along a fuselage or a store below a wing.

    Axes and lattices move with it. A value is a displacement, initially zero.

    Parameters
    ----------
    name : str
        Name of the variable.
    direction : str or array_like
        Coordinate axes by name, ``"z"`` or several as in ``"xyz"``, with one value each; or a vector, shape (3,), the
        displacement per unit of the single value, of any length.
    units : str, optional
        Units of the values: m by default, None if the vector carries them.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> from bspline_mdao.core.design.parametrization import Parametrization
    >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> Parametrization(mesh, [Translation("position", "xy")]).initial["position"]
    array([0., 0.])
    """

    name: str
    direction: Direction = "xyz"
    units: str | None = "m"
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    def bind(self, layout: Layout) -> Displacement:
        """Move all rows equally; `InputError` if there is no such direction."""
        (vectors,) = directions_of(self.direction, 1, None, f"'{self.name}'")
        matrix = kron(np.ones((len(layout.points), 1)), vectors, format="csr")
        return Displacement(csr_array(matrix))


def directions_of(
    # coordinate axes by name, ``"normal"``, a vector of shape (3,), or vectors of shape (n, 3) or (n, 3, m)
    direction: Direction,
    n: int,  # number of points
    normals: Callable[[], np.ndarray] | None,  # gives the normals, shape (n, 3); None if points have none
    what: str,  # name of the variable, for messages
) -> np.ndarray:
    """Return the directions of n points, shape (n, 3, m), in metres per unit of the m values of each point."""
    if isinstance(direction, str):
        if direction == "normal" and normals is not None:
            return normals()[:, :, None]
        return np.tile(np.eye(3)[:, _axes(direction, normals is not None, what)], (n, 1, 1))
    field = np.asarray(direction, dtype=float)
    field = np.broadcast_to(field, (n, 3)) if field.shape == (3,) else field
    field = field[:, :, None] if field.ndim == 2 else field
    if field.ndim != 3 or field.shape[:2] != (n, 3):
        raise InputError(f"{what}: directions of shape {np.shape(direction)} for {n} points; give (3,) or ({n}, 3)")
    is_bad = ~(np.isfinite(field).all(axis=1) & field.any(axis=1)).all(axis=1)
    if is_bad.any():
        raise InputError(f"{what}: the direction of point {np.argmax(is_bad) + 1} is zero or not finite; correct it")
    return field


def _axes(letters: str, has_normals: bool, what: str) -> list[int]:
    """Coordinate axes of ``"x"``, ``"yz"`` and the like."""
    if not letters or len(set(letters) & set("xyz")) < len(letters):
        names = "'x', 'y', 'z' or several of them" + ", 'normal'" * has_normals
        raise InputError(f"{what}: no direction is called '{letters}'; give {names}, or vectors")
    return ["xyz".index(letter) for letter in letters]


def displacements(rows: np.ndarray, directions: np.ndarray, n_rows: int) -> csr_array:
    """Return the displacements of all rows per value, (3 n_rows, m n), from directions (n, 3, m) of some of them."""
    return selector(rows, n_rows) @ block_diagonal(directions)


def selector(rows: np.ndarray, n_rows: int) -> csr_array:
    """Return the matrix, shape (3 n_rows, 3 n), that inserts the coordinates of some rows into all."""
    coordinates = (3 * np.asarray(rows)[:, None] + np.arange(3)).ravel()
    columns = np.arange(len(coordinates))
    return csr_array((np.ones(len(columns)), (coordinates, columns)), shape=(3 * n_rows, len(columns)))
