"""Orthogonality and volume of elements as the stiffness sees them: with floors, always positive.

Both are given as logarithms, with the gradient of any combination of them by the corners, from which follow the
derivatives in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from ..cells.hexahedron import ElementMeasures, element_measures, element_measures_vjp
from ..mesh.moving_mesh import MovingMesh
from .regularization import FLAT_CORNER, FLAT_ELEMENT, floored_array

__all__ = ["FlooredMeasures"]

LEAST_ORTHOGONALITY = 1e-5
"""Q is floored here, which keeps Phi = 1 / Q^2 below 4e10."""


@dataclass(frozen=True, eq=False)
class FlooredMeasures:
    """Orthogonality and volume of all elements.

    Parameters
    ----------
    mesh : MovingMesh
        Its baseline decides which corners are degenerate.
    points : ndarray, shape (n_points, 3)
        Points (m).
    """

    mesh: MovingMesh
    points: np.ndarray

    @property
    def log_orthogonality(self) -> np.ndarray:
        """Logarithm of Q, Eq. (9), with each factor and the product floored, shape (n_elements,)."""
        factors, _ = floored_array(self._measures.triples, FLAT_CORNER)
        return np.log(floored_array(factors.prod(axis=1), LEAST_ORTHOGONALITY)[0])

    @property
    def log_volume(self) -> np.ndarray:
        """Logarithm of the volume, floored relative to the product of the root-mean-square edge lengths."""
        return np.log(floored_array(self._fullness, FLAT_ELEMENT)[0]) + 0.5 * np.log(self._squares).sum(axis=1)

    def gradient(self, of_orthogonality: float, of_volume: float) -> np.ndarray:
        """Gradient by the corners of a combination of the two logarithms, shape (n_elements, 8, 3).

        Parameters
        ----------
        of_orthogonality, of_volume : float
            What each of them is multiplied with.
        """
        floor, slope = floored_array(self._fullness, FLAT_ELEMENT)
        by_volume = of_volume * slope / (floor * np.sqrt(self._squares.prod(axis=1)))
        by_triples = of_orthogonality * self._orthogonality_by_triples()
        mesh = self.mesh
        total = element_measures_vjp(self._corners, mesh.handedness, mesh.degenerate_corners, by_triples, by_volume)
        by_lengths = of_volume * (1.0 - self._fullness * slope / floor)
        if by_lengths.any():
            _add_length_gradients(self._corners, by_lengths[:, None] / (4.0 * self._squares), total)
        return total

    def _orthogonality_by_triples(self):
        """Derivatives of the logarithm of Q by the corner triple products."""
        factors, by_triples = floored_array(self._measures.triples, FLAT_CORNER)
        product = factors.prod(axis=1)
        floor, by_product = floored_array(product, LEAST_ORTHOGONALITY)
        return (product * by_product / floor)[:, None] * by_triples / factors

    @cached_property
    def _corners(self) -> np.ndarray:
        return self.points[self.mesh.elements]

    @cached_property
    def _measures(self) -> ElementMeasures:
        return element_measures(self._corners, self.mesh.handedness, self.mesh.degenerate_corners)

    @cached_property
    def _squares(self) -> np.ndarray:
        return _mean_squares(self._corners)

    @cached_property
    def _fullness(self) -> np.ndarray:
        """Volume by the product of the three lengths: 1 in a box, less in any other element."""
        return self._measures.volume / np.sqrt(self._squares.prod(axis=1))


@njit(cache=True)
def _mean_squares(corners):
    """Mean squares of the four edges along each direction, shape (n_elements, 3)."""
    squares = np.zeros((len(corners), 3))
    for element in range(len(corners)):
        for direction in range(3):
            for start in range(8):
                end = start | 1 << direction
                for d in range(3):
                    squares[element, direction] += 0.25 * (corners[element, end, d] - corners[element, start, d]) ** 2
    return squares


@njit(cache=True)
def _add_length_gradients(corners, factors, gradient):
    """Add factors, shape (n_elements, 3), times the edges along each direction to the ends of these."""
    for element in range(len(corners)):
        for direction in range(3):
            for start in range(8):
                end = start | 1 << direction
                for d in range(3):
                    pull = factors[element, direction] * (corners[element, end, d] - corners[element, start, d])
                    gradient[element, end, d] += pull
                    gradient[element, start, d] -= pull
