"""Derivatives along rows of points from polynomials, as fixed combinations of the points."""

from __future__ import annotations

from math import factorial

import numpy as np
from scipy.sparse import csr_array

__all__ = ["arc_parameters", "polynomial_weights", "stencil_matrix"]


def arc_parameters(points: np.ndarray) -> np.ndarray:
    """Lengths along polylines from their first point, shape (n, k), of points, shape (n, k, d)."""
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    return np.concatenate([np.zeros((len(points), 1)), np.cumsum(lengths, axis=1)], axis=1)


def polynomial_weights(
    parameters: np.ndarray, degree: int, derivative: int, is_used: np.ndarray | None = None
) -> np.ndarray:
    """Weights of the values at k parameters in a derivative at parameter 0 of the polynomial that fits them best.

    Parameters
    ----------
    parameters : ndarray, shape (n, k)
        Different ones in each of n rows; 0 is where the derivative is taken.
    degree : int
        Degree of the polynomials, less than k; with k - 1 they interpolate.
    derivative : int
        Which; 0 is the value.
    is_used : ndarray of bool, shape (n, k), optional
        Which values count; more than ``degree`` of every row.

    Returns
    -------
    ndarray, shape (n, k)

    Examples
    --------
    >>> polynomial_weights(np.array([[-1.0, 0.0, 1.0]]), degree=2, derivative=2).round(12)
    array([[ 1., -2.,  1.]])
    """
    scale = np.abs(parameters).max(axis=1, keepdims=True)
    powers = (parameters / scale)[..., None] ** np.arange(degree + 1)
    if is_used is not None:
        powers *= is_used[..., None]
    return factorial(derivative) * np.linalg.pinv(powers)[:, derivative] / scale**derivative


def stencil_matrix(weights: np.ndarray) -> csr_array:
    """Matrix of shape (n, n k) that combines k successive values in every row, of weights of shape (n, k)."""
    n, k = weights.shape
    return csr_array((weights.ravel(), np.arange(n * k), k * np.arange(n + 1)), shape=(n, n * k))
