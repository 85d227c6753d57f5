"""The adjoint of the flow, and its tangent: linear systems with the Jacobian of the residual and its transpose.

Products with the Jacobian are in `.linearization`, the preconditioner is in `.preconditioner`.

Theory: ``docs/theory/euler.rst``, "Derivatives".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .factor_pattern import FactorPattern
from .gas import N_STATES
from .krylov import KrylovSolution, solve_refined
from .linearization import Linearization
from .preconditioner import Factor, by_surface, compact_factor
from .residual import Discretization

__all__ = ["FlowTangent"]


@dataclass(frozen=True, eq=False)
class FlowTangent:
    """Derivatives of the residual with respect to the states, and solutions with them and with their transpose."""

    # The flux out of a cell scales with its surface, 290 m^2 at the far field of a wing and 3 cm^2 at its tip, and the
    # sensitivity of a force to a row of the residual with the inverse. So linear systems are solved for rows divided by
    # the surfaces of their cells, and the error of a total is the system's error relative to its right-hand side,
    # without a large factor.

    linearization: Linearization  # jacobians of all fluxes
    sizes: np.ndarray  # (n_cells, 1), surfaces of the cells (m^2), see `Discretization.sizes`
    pattern: FactorPattern  # pattern of the preconditioner

    @classmethod
    def of(
        cls,
        discretization: Discretization,
        states: np.ndarray,
        areas: np.ndarray,
        stream: np.ndarray,
        pattern: FactorPattern,
    ) -> FlowTangent:
        """Linearise at states, shape (n_cells, 5), for area vectors, shape (n_faces, 3), and a stream, shape (5,)."""
        linearization = discretization.linearize(states, areas, stream)
        return cls(linearization, discretization.sizes(areas), pattern)

    @cached_property
    def factor(self) -> Factor:
        """Factor of a compact approximation of the Jacobian with respect to the states: the preconditioner."""
        # It and the factor of the transpose are converted into each other, and only one of them is kept.
        other = self.__dict__.pop("transposed_factor", None)
        if other is not None:
            return other.into_transposed()
        still = np.zeros((self.linearization.discretization.faces.n_cells, N_STATES, N_STATES), np.float32)
        return compact_factor(self.linearization, self.pattern, still)

    @cached_property
    def transposed_factor(self) -> Factor:
        """Factor of the transpose."""
        other = self.factor
        del self.__dict__["factor"]
        return other.into_transposed()

    @property
    def comm(self) -> Any:
        """The processes."""
        return self.linearization.discretization.halo.comm

    def solve(self, right: np.ndarray, tolerance: float) -> KrylovSolution:
        """Solve with the Jacobian with respect to the states."""
        return solve_refined(
            lambda x: self.linearization.state_jvp(x) / self.sizes,
            *by_surface(self.linearization.jacobians.product, self.factor.solve, self.sizes),
            right / self.sizes,
            tolerance,
            comm=self.comm,
        )

    def solve_transposed(self, right: np.ndarray, tolerance: float) -> KrylovSolution:
        """Solve with the transpose of the Jacobian with respect to the states."""
        # Its unknowns are scaled by the surfaces of their cells. Between preconditioner and product these cancel.
        return solve_refined(
            self.linearization.state_vjp,
            self.linearization.jacobians.transposed_product,
            self.transposed_factor.solve,
            right,
            tolerance,
            comm=self.comm,
            scale=self.sizes,
        )
