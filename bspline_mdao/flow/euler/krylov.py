"""Linear systems in the states of all cells: GMRES, preconditioned from the right, and refinement of its solutions.

Every process has the rows of its own cells. Each new basis vector is orthogonalised against all others at once, so a
step sums one short list of numbers over the processes, or two if the first pass leaves less than seven tenths of a
vector.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import solve_triangular

from ...base.numerics.processes import ONE, norm, summed
from ...base.numerics.threads import one_blas_thread
from .cell_sums import visit

__all__ = ["KrylovSolution", "solve_refined", "solve_roughly", "solve_system"]


RESTART = 30
"""Restart length of GMRES: more vectors save few products and take 20 bytes per cell each."""

LONG, SLOW = 60, 0.5
"""Restart length after a cycle that leaves more than this fraction of its residual: systems about cells with the
spacing of boundary layers need it, and others save the memory."""

PIECE = 2_048
"""Numbers of a vector per piece, which stay in the nearest cache while the basis is read."""


@dataclass(frozen=True, eq=False)
class KrylovSolution:
    """Solution of a linear system by GMRES."""

    x: np.ndarray  # (n_cells, 5)
    n_products: int  # products with the matrix
    is_converged: bool  # whether the tolerance was reached
    left: float  # norm of the residual relative to the right-hand side


def solve_system(
    product: Callable,
    precondition: Callable,
    right: np.ndarray,
    tolerance: float,
    max_products: int = 2000,
    comm: Any = ONE,
    most_left: float = np.inf,
) -> KrylovSolution:
    """Solve a linear system in the states of all cells by GMRES [1], restarted and preconditioned from the right.

    Preconditioning from the right makes the residual of the stopping test the true one. From the first vector of a
    cycle, the residual:

    1. Multiply the last vector by preconditioner and matrix, and subtract it: both products are nearly the vector, and
       small parts would be lost next to it. The space is the same, and so is the triangle but for a one.
    2. Subtract its components along all others by classical Gram-Schmidt, with a second pass for what rounding left
    [2]. 3. Rotate the new column of the triangle; the remaining residual is the smallest that these vectors allow. 4.
    Repeat until it is small enough or the cycle is full; solve for the weights of the vectors.

    All vectors have the rows of this process's cells and the precision of ``right``. The tolerance is for the norm of
    the residual relative to ``right``. Except for the first, no cycle starts that could exceed ``max_products`` in
    total. The solve is abandoned after a cycle that leaves more than the fraction ``most_left`` of the residual.

    References
    ----------
    - [1] Y. Saad, M. H. Schultz, "GMRES: a generalized minimal residual algorithm for solving nonsymmetric linear
      systems", SIAM J. Sci. Stat. Comput. 7 (1986), 856-869.
    - [2] J. W. Daniel, W. B. Gragg, L. Kaufman, G. W. Stewart, "Reorthogonalization and stable algorithms for updating
      the Gram-Schmidt QR factorization", Math. Comp. 30 (1976), 772-795.
    """

    def apply(vector: np.ndarray) -> np.ndarray:
        return product(precondition(vector.reshape(right.shape))).ravel()

    size, n_products = norm(right, comm), 0
    target = tolerance * size
    y, rest = np.zeros(right.size, right.dtype), right.ravel()
    basis = np.empty((RESTART + 1, right.size), right.dtype)
    with one_blas_thread:  # on a busy machine its threads would only wait for each other
        while not n_products or n_products + len(basis) <= max_products:
            if n_products:
                rest, n_products = right.ravel() - apply(y), n_products + 1
            before = left = norm(rest, comm)
            if not target < left < np.inf:
                break
            weights, left = _cycle(apply, basis, rest, left, target, comm)
            y += weights.astype(y.dtype) @ basis[: len(weights)]
            n_products += len(weights)
            if not len(weights) or left <= target or left > most_left * before:
                break
            if left > SLOW * before and len(basis) <= LONG:
                del basis  # free memory for the longer one
                basis = np.empty((LONG + 1, right.size), right.dtype)
    x, part = precondition(y.reshape(right.shape)), left / size if size else 0.0
    return KrylovSolution(x, n_products, left <= target, part)


def _cycle(
    apply: Callable[[np.ndarray], np.ndarray],
    basis: np.ndarray,
    rest: np.ndarray,
    beta: float,
    target: float,
    comm: Any,
) -> tuple[np.ndarray, float]:
    """Weights of the vectors that reduce the residual most, steps 1 to 4, and the residual that they leave."""
    most = len(basis) - 1
    triangle, rotations, reduced = np.zeros((most, most)), np.zeros((most, 2)), np.zeros(most + 1)
    basis[0], reduced[0], n = rest / beta, beta, 0
    while n < most and abs(reduced[n]) > target:
        column, length = _orthogonalize(basis[: n + 1], apply(basis[n]), comm, basis[n + 1])  # steps 1 and 2
        column[n] += 1.0
        if not np.isfinite(length):
            break
        for k, (cosine, sine) in enumerate(rotations[:n]):  # step 3
            column[k : k + 2] = cosine * column[k] + sine * column[k + 1], cosine * column[k + 1] - sine * column[k]
        pivot = np.hypot(column[n], length)
        if pivot == 0.0:
            break
        rotations[n] = cosine, sine = column[n] / pivot, length / pivot
        column[n], triangle[: n + 1, n] = pivot, column
        triangle[n, n] = pivot
        reduced[n : n + 2] = cosine * reduced[n], -sine * reduced[n]
        n += 1
        if length == 0.0:
            break
    return solve_triangular(triangle[:n, :n], reduced[:n]), abs(reduced[n])


def _orthogonalize(basis: np.ndarray, vector: np.ndarray, comm: Any, out: np.ndarray) -> tuple[np.ndarray, float]:
    """Subtract the last of orthonormal vectors from a product, then its components along all, and normalise it."""
    # Returns these components, and the length of the rest; the product is overwritten.
    last = np.zeros(len(basis), vector.dtype)
    last[-1] = 1.0
    parts, square, left = _parts(summed(comm, _subtract_and_multiply(basis, last, vector)))
    if left < 0.5 * square:  # cancellation shows, the criterion of [2] of `solve_system`
        rest, _, left = _parts(summed(comm, _subtract_and_multiply(basis, parts.astype(vector.dtype), vector)))
        parts, away = parts + rest, rest
    else:
        away = parts
    length = float(np.sqrt(max(left, 0.0)))
    inverse, away = vector.dtype.type(1.0 / length if 0.0 < length < np.inf else 0.0), away.astype(vector.dtype)
    _by_pieces(len(vector), lambda first, end: _subtract_and_scale(basis, away, vector, inverse, first, end, out))
    return parts, length


def _parts(products: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Components of a vector along others, its square, and the square of the rest without them."""
    parts, square = products[:-1], float(products[-1])
    return parts, square, square - float(parts @ parts)


def _subtract_and_multiply(basis: np.ndarray, parts: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Subtract components along others, in place: products of the rest with them and, last, with itself."""
    found = np.empty((-(-len(vector) // PIECE), len(basis) + 1), vector.dtype)
    _by_pieces(len(vector), lambda first, end: _multiply(basis, parts, vector, first, end, found))
    return found.sum(axis=0, dtype=float)  # in the order of the pieces: bitwise the same on any number of threads


def _by_pieces(n: int, work: Callable[[int, int], None]) -> None:
    """Have threads visit ranges of the pieces of a vector."""
    visit(-(-n // PIECE), lambda part: work(part.start, part.stop), 1)


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "nsz", "reassoc"})
def _multiply(basis, parts, vector, first, end, found):
    """Do the work of `_subtract_and_multiply` for a range of pieces, and write the sums of each."""
    n = len(basis)
    for piece in range(first, end):
        at = slice(piece * PIECE, min(len(vector), (piece + 1) * PIECE))
        left = vector[at]
        _subtract(basis, parts, at, left)
        for row in range(n):
            found[piece, row] = _product(basis[row, at], left)
        found[piece, n] = _product(left, left)


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "nsz", "reassoc"})
def _subtract_and_scale(basis, parts, vector, factor, first, end, out):
    """Subtract components along the vectors in a range of pieces, in place, and write the rest times a factor."""
    for piece in range(first, end):
        at = slice(piece * PIECE, min(len(vector), (piece + 1) * PIECE))
        left = vector[at]
        _subtract(basis, parts, at, left)
        for k in range(len(left)):
            out[at.start + k] = left[k] * factor


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "nsz", "reassoc"})
def _product(u, v):
    total = u.dtype.type(0.0)
    for k in range(len(u)):
        total += u[k] * v[k]
    return total


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "nsz", "reassoc"})
def _subtract(basis, parts, at, left):
    """Subtract components along the vectors in a piece, four vectors at a time, skipping zero components."""
    first = 0
    while first < len(parts) and parts[first] == 0.0:
        first += 1
    while first + 4 <= len(parts):
        a, b, c, d = parts[first], parts[first + 1], parts[first + 2], parts[first + 3]
        t, u, v, w = basis[first, at], basis[first + 1, at], basis[first + 2, at], basis[first + 3, at]
        for k in range(len(left)):
            left[k] -= a * t[k] + b * u[k] + c * v[k] + d * w[k]
        first += 4
    for row in range(first, len(parts)):
        a, t = parts[row], basis[row, at]
        for k in range(len(left)):
            left[k] -= a * t[k]


def solve_roughly(
    product: Callable,
    precondition: Callable,
    right: np.ndarray,
    tolerance: float,
    max_products: int = 2000,
    comm: Any = ONE,
    most_left: float = np.inf,
) -> KrylovSolution:
    """Solve a system in single precision at any scale, see `solve_system`; the solution is in double precision."""
    size = norm(right, comm)
    unit = (right / size).astype(np.float32)
    solution = solve_system(product, precondition, unit, tolerance, max_products, comm, most_left)
    return replace(solution, x=size * solution.x.astype(float))


def solve_refined(
    product: Callable,  # product with the matrix, in double precision
    # rough_product, precondition: product with a matrix that is the same up to rounding in single precision, and
    # approximate solution with it
    rough_product: Callable,
    precondition: Callable,
    right: np.ndarray,  # right, tolerance, max_products, comm: see `solve_system`; products count both kinds
    tolerance: float,
    max_products: int = 4000,
    comm: Any = ONE,
    scale: np.ndarray | float = 1.0,
) -> KrylovSolution:
    """Solve a linear system whose matrix is of order one, to a tolerance or to rounding.

    Iterative refinement, of solutions in single precision by residuals in double precision:

    1. Compute the true residual of the current solution.
    2. Stop if it is small enough, or if the last correction has not halved it.
    3. Solve for a correction in single precision, and add it.

    ``max_products`` limits the products of both kinds: the adjoint of the lift about a C-grid with the spacing of a
    boundary layer takes 2,450. If corrections have no effect it stops long before. ``scale``, shape (n_cells, 1) or a
    float, multiplies the unknowns in the system whose matrix is of order one.
    """
    x, rest, n_products, before = np.zeros_like(right), right, 0, np.inf
    size = norm(right, comm)
    asked = tolerance * size
    while True:
        left = norm(rest, comm)
        if left <= asked or left > 0.5 * before or n_products >= max_products:  # step 2
            rounding = 16.0 * float(np.finfo(float).eps) * norm(scale * x, comm)  # of a matrix of order one
            is_converged = bool(left <= max(asked, rounding))
            return KrylovSolution(x, n_products, is_converged, left / size if size else 0.0)
        part = max(0.5 * asked / left, 1e-4)  # the most that one solve in single precision can achieve
        correction = solve_roughly(rough_product, precondition, rest, part, max_products - n_products, comm)  # step 3
        x, n_products, before = x + correction.x, n_products + correction.n_products + 1, left
        rest = right - product(x)  # step 1
