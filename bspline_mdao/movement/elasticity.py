"""Linear elasticity in increments (section III.B, Eqs. 6 to 8)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..mesh.moving_mesh import MovingMesh
from ..sparse.cholesky import Cholesky
from . import element, element_stiffness
from .equilibrium import EquilibriumMover
from .increments import AUTO
from .young_modulus import OrthogonalityLaw, StiffnessLaw

__all__ = ["LinearElasticity"]


@dataclass(frozen=True, eq=False)
class LinearElasticity(EquilibriumMover):
    """Moves a mesh as a linear elastic solid, one linear system per increment.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    poisson_ratio : float
        Between -1 and 0.5.
    n_increments : int or "auto"
        The paper's m, which is 5 there. By default a move takes the first of 1, 2, 5 and 10 with which the mesh stays
        good, see `bspline_mdao.movement.increments.in_increments`.
    stiffness : StiffnessLaw
        Young's modulus of the elements at the start of every increment; the paper's by default.
    solver : object
        Settings of a sparse solver of `bspline_mdao.sparse`; the best that is installed by default.
    keep_factors : bool, optional
        Keep the factor of every increment as long as the movement lives, which makes a product with its derivative
        cost a fraction of the move. Otherwise only that of the first increment is kept, and each product factorises
        the others again. Where nothing is said, `ControlMeshMove` keeps them in problems with derivatives, and a
        ``move`` by itself does not.

    Raises
    ------
    InputError
        If Poisson's ratio is out of range, or the number of increments is none.
    """

    mesh: MovingMesh
    poisson_ratio: float = -0.2
    n_increments: int | str = AUTO
    stiffness: StiffnessLaw = field(default_factory=OrthogonalityLaw)
    solver: object = field(default_factory=Cholesky)
    keep_factors: bool | None = None

    def __post_init__(self):
        super().__post_init__()
        if not -1.0 < self.poisson_ratio < 0.5:
            raise InputError(f"elasticity: Poisson's ratio {self.poisson_ratio}; give a number between -1 and 0.5")

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> ElasticElements:
        modulus = self.stiffness.modulus(self.mesh, initial, before)
        lame = element.lame_constants(self.poisson_ratio)
        return ElasticElements(self.mesh, self.stiffness, lame, initial, before, modulus)


@dataclass(frozen=True, eq=False)
class ElasticElements:
    """Elastic elements at given points, see `bspline_mdao.movement.equilibrium.Elements`."""

    mesh: MovingMesh
    law: StiffnessLaw
    lame: tuple[float, float]
    initial: np.ndarray
    points: np.ndarray
    modulus: np.ndarray

    @property
    def _arguments(self):
        return self.points, self.mesh.elements, self.mesh.handedness, self.modulus, self.lame

    def add_stiffness(self, element_rows, slots, data):
        """Add the stiffness to blocks."""
        element_stiffness.add_stiffness(*self._arguments, element_rows, slots, data)

    def force(self, displacement):
        """Force on all points."""
        return element.force(*self._arguments, displacement)

    def force_jvp(self, displacement, d_initial, d_points):
        """Change of the force of a given displacement."""
        d_modulus = self.law.modulus_jvp(self.mesh, self.initial, self.points, d_initial, d_points)
        return element.force_jvp(*self._arguments, displacement, d_points, d_modulus)

    def force_vjp(self, displacement, bar):
        """Transpose of `force_jvp` and of `force`."""
        points_bar, modulus_bar, displacement_bar = element.force_vjp(*self._arguments, displacement, bar)
        initial_bar, by_modulus = self.law.modulus_vjp(self.mesh, self.initial, self.points, modulus_bar)
        return initial_bar, points_bar + by_modulus, displacement_bar
