"""Between points and the corners of elements."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["add_at_corners", "add_element", "add_exactly", "contract"]


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


@njit(cache=True)
def add_exactly(parts, point, d, value):
    """Add a number to a component of a point, a sum of two parts: what rounding takes of the first goes to the second.

    Parts are of shape (2, n_points, 3). Compiled without leave to change the order of the sums.
    """
    before = parts[0, point, d]
    total = before + value
    of_value = total - before
    parts[0, point, d] = total
    parts[1, point, d] += (before - (total - of_value)) + (value - of_value)


@njit(cache=True)
def add_element(stiffness, rows, slots, data):
    """Add the stiffness of an element to the blocks of a symmetric matrix.

    Parameters
    ----------
    stiffness : ndarray, shape (8, 8, 3, 3)
        Blocks (a, b) of corners b <= a.
    rows : ndarray of int32, shape (8,)
        Block row of every corner, -1 where it has none.
    slots : ndarray of int32, shape (36,)
        Place of every pair of corners, see `bspline_mdao.sparse.blocks.slots`.
    data : ndarray, shape (n_blocks, 3, 3)
        Blocks of the lower triangle, added to.
    """
    for a in range(8):
        for b in range(a + 1):
            place = slots[a * (a + 1) // 2 + b]
            if place < 0:
                continue
            if rows[a] >= rows[b]:  # below the diagonal or on it
                for c in range(3):
                    for d in range(3):
                        data[place, c, d] += stiffness[a, b, c, d]
            if rows[a] < rows[b] or (rows[a] == rows[b] and a > b):  # above it, or two corners are one point
                for c in range(3):
                    for d in range(3):
                        data[place, c, d] += stiffness[a, b, d, c]
