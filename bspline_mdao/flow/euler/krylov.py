"""Linear systems with the Jacobian of the residual or its transpose: GMRES, preconditioned from the right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres
from threadpoolctl import threadpool_limits

__all__ = ["LinearSolution", "solve_system"]

RESTART = 50
"""Vectors after which GMRES starts again: more save few products and take 40 bytes per cell each."""


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Solution of a linear system.

    Parameters
    ----------
    x : ndarray, shape (n_cells, 5)
    n_products : int
        Products with the matrix.
    is_converged : bool
        Whether the tolerance was reached.
    """

    x: np.ndarray
    n_products: int
    is_converged: bool


def solve_system(
    product: Callable, precondition: Callable, right: np.ndarray, tolerance: float, max_products: int = 2000
) -> LinearSolution:
    """Solve a linear system in the states of all cells.

    Parameters
    ----------
    product, precondition : callable
        Product with the matrix and approximate solution with it, of arrays of the shape of ``right``.
    right : ndarray, shape (n_cells, 5)
        Right-hand side.
    tolerance : float
        Norm of the residual by that of the right-hand side.
    max_products : int
        Products with the matrix after which it is given up.
    """
    n_products = 0

    def preconditioned(y):
        nonlocal n_products
        n_products += 1
        return product(precondition(y.reshape(right.shape))).ravel()

    operator = LinearOperator((right.size, right.size), preconditioned, dtype=float)
    n_cycles = max(1, max_products // RESTART)
    with threadpool_limits(1, user_api="blas"):  # on a busy machine its threads only wait for each other
        y, info = gmres(operator, right.ravel(), rtol=tolerance, atol=0.0, restart=RESTART, maxiter=n_cycles)
    return LinearSolution(precondition(y.reshape(right.shape)), n_products, info == 0)
