"""Spring analogy: the mesh as a network of lineal springs, with torsional springs at the corners of elements if asked.

The springs are those of `bspline_mdao.movement.spring_element`, stiffened anew at the start of every increment.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..mesh.moving_mesh import MovingMesh
from ..sparse.cholesky import Cholesky
from . import spring_element
from .equilibrium import EquilibriumMover
from .increments import AUTO

__all__ = ["LinealSprings", "TorsionalSprings"]


class _Springs(EquilibriumMover):
    """What both networks share."""

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> SpringElements:
        return SpringElements(self.mesh, *self._network, before)


@dataclass(frozen=True, eq=False)
class LinealSprings(_Springs):
    """Moves a mesh as springs along the edges and diagonals of its elements.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    n_increments : int or "auto"
        Number of increments; by default the first of 1, 2, 5 and 10 with which the mesh stays good, as for
        `bspline_mdao.movement.elasticity.LinearElasticity`.
    power : float
        A spring of length L has the stiffness L^-power.
    solver : object
        Settings of a sparse solver of `bspline_mdao.sparse`; the best that is installed by default.
    keep_factors : bool, optional
        As for `bspline_mdao.movement.elasticity.LinearElasticity`.
    """

    mesh: MovingMesh
    n_increments: int | str = AUTO
    power: float = 1.0
    solver: object = field(default_factory=Cholesky)
    keep_factors: bool | None = None

    @property
    def _network(self):
        return spring_element.N_LINEAL, (float(self.power), 0.0)


@dataclass(frozen=True, eq=False)
class TorsionalSprings(_Springs):
    """Moves a mesh as lineal springs of stiffness 1 / L^2 and torsional springs at the corners of its elements.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    n_increments : int or "auto"
        Number of increments; by default the first of 1, 2, 5 and 10 with which the mesh stays good, as for
        `bspline_mdao.movement.elasticity.LinearElasticity`.
    torsion : float
        Stiffness of the torsional springs relative to that of the lineal ones.
    solver : object
        Settings of a sparse solver of `bspline_mdao.sparse`; the best that is installed by default.
    keep_factors : bool, optional
        As for `bspline_mdao.movement.elasticity.LinearElasticity`.
    """

    mesh: MovingMesh
    n_increments: int | str = AUTO
    torsion: float = 0.01
    solver: object = field(default_factory=Cholesky)
    keep_factors: bool | None = None

    @property
    def _network(self):
        return spring_element.N_SPRINGS, (2.0, float(np.sqrt(self.torsion)))


@dataclass(frozen=True, eq=False)
class SpringElements:
    """Springs of all elements at given points, see `bspline_mdao.movement.equilibrium.Elements`."""

    mesh: MovingMesh
    n_springs: int
    settings: tuple[float, float]
    points: np.ndarray

    @property
    def _arguments(self):
        mesh = self.mesh
        return self.points, mesh.elements, mesh.handedness, mesh.degenerate_corners, self.n_springs, self.settings

    def add_stiffness(self, element_rows, slots, data):
        """Add the stiffness to blocks."""
        spring_element.add_stiffness(*self._arguments, element_rows, slots, data)

    def force(self, displacement):
        """Force on all points."""
        return spring_element.force(*self._arguments, displacement)

    def force_jvp(self, displacement, d_initial, d_points):
        """Change of the force of a given displacement."""
        return spring_element.force_jvp(*self._arguments, displacement, d_points)

    def force_vjp(self, displacement, bar):
        """Transpose of `force_jvp` and of `force`."""
        points_bar, displacement_bar = spring_element.force_vjp(*self._arguments, displacement, bar)
        return np.zeros_like(self.points), points_bar, displacement_bar
