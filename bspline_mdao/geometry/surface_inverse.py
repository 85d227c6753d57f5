"""From surface nodes back to surface control points: least squares with a constant matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU, splu

from ..errors import InputError
from .surface_map import SurfaceMap

__all__ = ["SurfaceInverse"]

_SMALLEST_PIVOT = 1e-13
"""Pivot, relative to the largest, below which nodes do not determine the control points."""


@dataclass(frozen=True, eq=False)
class SurfaceInverse:
    """Control points ``s`` whose nodes ``A s + c`` are closest to the given ones.

    The normal equations are solved with one step of refinement, so that nodes of a B-spline surface give back its
    control points to round-off. All of it is linear: the products with the derivative repeat the same steps.

    Parameters
    ----------
    matrix : csr_array, shape (n, n_surface)
        A.
    constant : ndarray, shape (n, 3)
        c (m).
    factor : SuperLU
        Of the transpose of A times A.
    """

    matrix: csr_array
    constant: np.ndarray
    factor: SuperLU

    def __reduce__(self):
        """Take the factor along as the matrix that it is made of: SuperLU cannot be pickled."""
        return _inverse, (self.matrix, self.constant)

    @classmethod
    def of(cls, surface_map: SurfaceMap, numbers: np.ndarray | None = None) -> SurfaceInverse:
        """Invert the map of a surface.

        Parameters
        ----------
        surface_map : SurfaceMap
            From control points to nodes.
        numbers : ndarray of int, shape (n,), optional
            Which nodes are given, in which order; all of the surface in its own by default.

        Raises
        ------
        InputError
            If the nodes do not determine all surface control points.
        """
        numbers = slice(None) if numbers is None else numbers
        matrix = csr_array(surface_map.matrix[numbers])
        constant = (
            surface_map.constant if surface_map.turned is None else surface_map.constant + surface_map.turned.residual
        )
        return _inverse(matrix, constant[numbers])

    def apply(self, nodes: np.ndarray) -> np.ndarray:
        """Control points, shape (n_surface, 3), of nodes, shape (n, 3), in metres."""
        return self.jvp(nodes - self.constant)

    def nodes(self, control_points: np.ndarray) -> np.ndarray:
        """Nodes, shape (n, 3), of control points, shape (n_surface, 3), in metres."""
        return self.matrix @ control_points + self.constant

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), with that of the nodes, shape (n, 3)."""
        found = self._solve(change)
        return found + self._solve(change - self.matrix @ found)

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, shape (n, 3), of ``bar``, shape (n_surface, 3)."""
        found = self._solve_transposed(bar)
        return found + self._solve_transposed(bar - self.matrix.T @ found)

    def _solve(self, right):
        return self.factor.solve(self.matrix.T @ right)

    def _solve_transposed(self, right):
        return self.matrix @ self.factor.solve(right, "T")


def _inverse(matrix: csr_array, constant: np.ndarray) -> SurfaceInverse:
    """Factor the normal equations of a map."""
    return SurfaceInverse(matrix, constant, _factor(matrix))


def _factor(matrix: csr_array) -> SuperLU:
    """Factor of the normal equations."""
    undetermined = InputError(
        f"surface: its {matrix.shape[0]} nodes do not determine the {matrix.shape[1]} control points of the design "
        f"surface; give the nodes of all its patches"
    )
    try:
        factor = splu((matrix.T @ matrix).tocsc())
    except RuntimeError as error:  # SuperLU met a zero pivot
        raise undetermined from error
    pivots = np.abs(factor.U.diagonal())
    if pivots.min() < _SMALLEST_PIVOT * pivots.max():
        raise undetermined
    return factor
