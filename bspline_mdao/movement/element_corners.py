"""Between points and the corners of elements."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["add_at_corners", "contract"]


@njit(cache=True)
def add_at_corners(elements, values, n_points):
    """Sum values at corners, shape (n_elements, 8, 3), over the corners of every point: shape (n_points, 3)."""
    total = np.zeros((n_points, 3), values.dtype)
    for element in range(len(elements)):
        for corner in range(8):
            point = elements[element, corner]
            for d in range(3):
                total[point, d] += values[element, corner, d]
    return total


def contract(gradients: np.ndarray, elements: np.ndarray, d_points: np.ndarray) -> np.ndarray:
    """Sum gradients by the corners, shape (n_elements, 8, 3), times the change of the points: shape (n_elements,)."""
    return np.einsum("ecd,ecd->e", gradients, d_points[elements])
