"""What every solver of a sparse symmetric system gives back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .blocks import BlockMatrix

__all__ = ["Solution", "check_right", "product", "relative_residual", "residual_norm"]


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of a linear system and how it was found.

    Parameters
    ----------
    x : ndarray, shape (n, 3) or (n, 3, m)
        The solution, or those of m right-hand sides.
    iterations : int
        Iterations, or steps of refinement.
    residual : float
        Residual in the 2-norm, relative to the right-hand side (the largest, where there are several).
    seconds : float
        Time that it took by the wall clock (s).
    """

    x: np.ndarray
    iterations: int
    residual: float
    seconds: float


def check_right(right: np.ndarray, n: int) -> np.ndarray:
    """Right-hand side as floating-point numbers; `InputError` unless its shape is (n, 3) or (n, 3, m)."""
    if right.ndim not in (2, 3) or right.shape[:2] != (n, 3):
        raise InputError(f"right-hand side of shape {right.shape}; give shape ({n}, 3), or ({n}, 3, m) for several")
    return np.asarray(right, np.float64)


def relative_residual(residual: np.ndarray, right: np.ndarray) -> float:
    """Largest 2-norm of a residual relative to its right-hand side, shapes (n, 3) or (n, 3, m); 0 where both are 0."""
    norms, scales = (np.sqrt(np.einsum("ij...,ij...->...", v, v)) for v in (residual, right))
    return float(np.max(np.divide(norms, scales, out=np.where(norms > 0, np.inf, 0.0), where=scales > 0), initial=0.0))


def product(matrix: BlockMatrix, x: np.ndarray) -> np.ndarray:
    """Product of a matrix with one vector, shape (n, 3), or with several, shape (n, 3, m)."""
    if x.ndim == 2:
        return matrix.dot(x)
    sides = [matrix.dot(x[..., side]) for side in range(x.shape[2])]
    return np.stack(sides, axis=2) if sides else np.zeros_like(x)


def residual_norm(matrix: BlockMatrix, x: np.ndarray, right: np.ndarray) -> float:
    """Relative residual of a solution; see `relative_residual`."""
    return relative_residual(right - product(matrix, x), right)
