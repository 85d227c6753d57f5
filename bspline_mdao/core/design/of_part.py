"""A design variable that moves only a part of the design surface: a flap, a nacelle, one of several wings.

Theory: ``docs/theory/parametrization.rst``, "Parts".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh, require_mesh
from .variable import AuxiliaryPoints, DesignMap, Layout, MapPartials, Variable

__all__ = ["OfPart"]


@dataclass(frozen=True, eq=False)
class OfPart(OneLine):
    """A design variable for a part of the design surface; the rest stays, except for shared points.

    The variable uses sections, chords and box of the part, as if it were the whole surface: give it an axis or a
    lattice of the part. Both move with the part and with the variables of the whole surface.

    Parameters
    ----------
    variable : Variable
        A design variable such as `Twist`, with the axis or the lattice of the part.
    part : MovingMesh
        The control mesh with only the part as its design surface: ``wing.part("flap*").mesh``, or
        ``moving_mesh(model, "flap*")``.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import OfPart, Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> plate = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> upper = plate.part("*upper")
    >>> shape = plate.parametrization([OfPart(Twist("twist", upper.axis), upper.mesh)])
    >>> moved = shape.apply(plate.mesh.points[plate.mesh.surface_ids], {"twist": [10.0]})
    >>> bool((moved != plate.mesh.points[plate.mesh.surface_ids]).any())
    True
    """

    variable: Variable
    part: MovingMesh

    def __post_init__(self) -> None:
        require_mesh(self.part, f"part of variable '{self.variable.name}'")

    @property
    def name(self) -> str:
        """Name of the input of `SurfaceControl`."""
        return self.variable.name

    @property
    def units(self) -> str | None:
        """Units of its values."""
        return self.variable.units

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The axes and lattices used by the variable."""
        return self.variable.auxiliary

    def bind(self, layout: Layout) -> DesignMap:
        """Compute what depends only on the baseline. `InputError` if the part is not on the surface."""
        # what a part's own mesh fixes does not matter: the elimination covers the whole surface
        if self.part.n_points != layout.mesh.n_points:
            raise InputError(
                f"part of variable '{self.name}': its mesh has {self.part.n_points} points and the design surface's "
                f"mesh {layout.mesh.n_points}; make both of one model"
            )
        rows = layout.mesh.surface_rows[self.part.surface_ids]
        if (rows < 0).any():
            where = self.part.place_of_surface_point(int(np.argmax(rows < 0)))
            raise InputError(
                f"part of variable '{self.name}': {where} is not on the design surface; take a part of what is designed"
            )
        alone = Layout(self.part, self.auxiliary)
        others = [np.arange(len(layout.points))[layout.rows(item)] for item in self.auxiliary]
        return _PartMap(self.variable.bind(alone), np.concatenate([rows, *others]))


@dataclass(frozen=True, eq=False)
class _PartMap:
    """A variable bound to some of the rows, see `bspline_mdao.core.design.variable.DesignMap`."""

    part: DesignMap
    rows: np.ndarray  # int, rows of the part among all rows, in the part's order

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return self.part.initial

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move the rows of the part, given all rows, shape (n_rows, 3), in metres."""
        moved = self.part.apply(points[self.rows], values)
        all_rows = points.astype(moved.dtype)
        all_rows[self.rows] = moved
        return all_rows

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        n, found = 3 * len(points), self.part.partials(points[self.rows], values)
        at = (3 * self.rows[:, None] + np.arange(3)).ravel()
        stay = np.setdiff1d(np.arange(n), at)
        of_points, of_values = found.points.tocoo(), found.values.tocoo()
        rows, columns = np.append(at[of_points.row], stay), np.append(at[of_points.col], stay)
        data = np.append(of_points.data, np.ones(len(stay)))
        by_values = coo_array((of_values.data, (at[of_values.row], of_values.col)), shape=(n, found.values.shape[1]))
        return MapPartials(csr_array(coo_array((data, (rows, columns)), shape=(n, n))), csr_array(by_values))
