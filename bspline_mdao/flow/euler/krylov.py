"""Linear systems with the Jacobian of the residual or its transpose: GMRES, preconditioned from the right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres
from threadpoolctl import threadpool_limits

__all__ = ["LinearSolution", "solve_refined", "solve_system"]

RESTART = 50
"""Vectors after which GMRES starts again: more save few products and take 40 bytes per cell each."""


ROUNDED = 16.0 * np.finfo(float).eps
"""Residual by the norm of the solution, with a matrix of the size of one, that is left by rounding."""

LEAST = 1e-10
"""Tolerance that one run of GMRES can be asked for: its own residual drifts from the true one."""


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


def solve_refined(
    product: Callable, precondition: Callable, right: np.ndarray, tolerance: float, max_products: int = 2000
) -> LinearSolution:
    """Solve a linear system whose matrix is of the size of one, to a tolerance or to what rounding leaves.

    Corrections are solved for as long as they halve the true residual; parameters are those of `solve_system`.
    """
    x, rest, n_products, before = np.zeros_like(right), right, 0, np.inf
    while True:
        norm, asked = np.linalg.norm(rest), tolerance * np.linalg.norm(right)
        if norm <= asked or norm > 0.5 * before or n_products >= max_products:
            return LinearSolution(x, n_products, bool(norm <= max(asked, ROUNDED * np.linalg.norm(x))))
        share = max(0.5 * asked / norm, LEAST)
        correction = solve_system(product, precondition, rest, share, max_products - n_products)
        x, n_products, before = x + correction.x, n_products + correction.n_products, norm
        rest = right - product(x)
