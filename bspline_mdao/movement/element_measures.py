"""Orthogonality and volume of elements as the stiffness sees them: with floors, always positive.

Both are given as logarithms, with their gradients by the corners, from which follow the derivatives in both directions.
"""

from __future__ import annotations

import numpy as np

from ..grids.hexahedron_elements import element_measures, element_measures_vjp
from .floors import FLAT, floored_array
from .mesh import MovingMesh

__all__ = ["log_orthogonality", "log_orthogonality_gradient", "log_volume", "log_volume_gradient"]

LEAST_ORTHOGONALITY = 1e-4
"""Q is floored here, which keeps Phi = 1 / Q^2 below 4e8."""

_STARTS = np.array([[0, 2, 4, 6], [0, 1, 4, 5], [0, 1, 2, 3]])
_ENDS = _STARTS + np.array([[1], [2], [4]])


def log_orthogonality(mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
    """Logarithm of Q, Eq. (9), with each factor and the product floored.

    Parameters
    ----------
    mesh : MovingMesh
        Its baseline decides which corners are left out.
    points : ndarray, shape (n_points, 3)
        Points (m).

    Returns
    -------
    ndarray, shape (n_elements,)
    """
    triples = element_measures(points[mesh.elements], mesh.handedness, mesh.left_out).triples
    factors, _ = floored_array(triples, FLAT)
    return np.log(floored_array(factors.prod(axis=1), LEAST_ORTHOGONALITY)[0])


def log_orthogonality_gradient(mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
    """Gradient of `log_orthogonality` by the corners, shape (n_elements, 8, 3)."""
    corners = points[mesh.elements]
    triples = element_measures(corners, mesh.handedness, mesh.left_out).triples
    factors, by_triples = floored_array(triples, FLAT)
    product = factors.prod(axis=1)
    floor, by_product = floored_array(product, LEAST_ORTHOGONALITY)
    triples_bar = (product * by_product / floor)[:, None] * by_triples / factors
    return element_measures_vjp(corners, mesh.handedness, mesh.left_out, triples_bar, np.zeros(len(corners)))


def log_volume(mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
    """Logarithm of the volume, floored relative to the product of the three root-mean-square edge lengths.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh.
    points : ndarray, shape (n_points, 3)
        Points (m).

    Returns
    -------
    ndarray, shape (n_elements,)
    """
    fullness, squares, _ = _fullness(mesh, points[mesh.elements])
    return np.log(floored_array(fullness, FLAT)[0]) + 0.5 * np.log(squares).sum(axis=1)


def log_volume_gradient(mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
    """Gradient of `log_volume` by the corners, shape (n_elements, 8, 3)."""
    corners = points[mesh.elements]
    fullness, squares, edges = _fullness(mesh, corners)
    floor, slope = floored_array(fullness, FLAT)
    by_volume = slope / floor / np.sqrt(squares.prod(axis=1))
    gradient = element_measures_vjp(corners, mesh.handedness, mesh.left_out, np.zeros((len(corners), 8)), by_volume)
    by_edges = (1.0 - fullness * slope / floor)[:, None, None, None] * edges / (4.0 * squares[:, :, None, None])
    for starts, ends, by_edge in zip(_STARTS, _ENDS, by_edges.transpose(1, 0, 2, 3)):
        gradient[:, ends] += by_edge
        gradient[:, starts] -= by_edge
    return gradient


def _fullness(mesh, corners):
    """Volume by the product of the three lengths, the squares of these (n_e, 3), and the edges (n_e, 3, 4, 3)."""
    edges = corners[:, _ENDS] - corners[:, _STARTS]
    squares = (edges * edges).sum(axis=(2, 3)) / 4.0
    volume = element_measures(corners, mesh.handedness, mesh.left_out).volume
    return volume / np.sqrt(squares.prod(axis=1)), squares, edges
