"""Interpolation of displacements by radial functions, with its exact derivative.

With the functions :math:`A` of all centres, the linear polynomials :math:`P` at them (if any) and the known
displacements d, strengths and coefficients solve ``A strengths + P coefficients = d``, ``P^T strengths = 0``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.linalg.lapack import dormqr
from threadpoolctl import threadpool_limits

from ..errors import MovementError
from .mover import SolveReport, digits_of
from .radial_functions import COMPACT, GLOBAL, radial_matrix, radial_sums, radial_sums_jvp, radial_sums_vjp

__all__ = ["RadialInterpolation", "RadialSystem", "radial_interpolation"]

SMALLEST_PIVOT = 1e-12
"""Centres nearer to a plane than this part of their distance from the origin are taken to lie in it."""

LARGEST_RESIDUAL = 1e-6
"""A system that leaves more of the displacements of the centres is taken for singular."""


@dataclass(frozen=True, eq=False)
class RadialInterpolation:
    """An interpolation that was made.

    Parameters
    ----------
    function : tuple
        Number of the radial function, and its radius (m).
    targets, centres : ndarray, shape (n_targets, 3) and (n_centres, 3)
        Where it is evaluated, and where displacements are given (m).
    strengths : ndarray, shape (n_centres, 3)
        Factors of the functions.
    coefficients : ndarray, shape (4, 3) or (0, 3)
        Those of the linear polynomial: constant, x, y, z.
    system : RadialSystem
        What was solved: strengths and coefficients below each other from displacements and zeros.
    values : ndarray, shape (n_targets, 3)
        Displacements of the targets (m).
    report : SolveReport
        How the system was solved.
    """

    function: tuple[int, float]
    targets: np.ndarray
    centres: np.ndarray
    strengths: np.ndarray
    coefficients: np.ndarray
    system: RadialSystem
    values: np.ndarray
    report: SolveReport

    def jvp(self, d_targets: np.ndarray, d_centres: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the targets, of the centres and of their displacements."""
        slopes = self.coefficients[1:]
        right = np.zeros((len(self.centres) + len(self.coefficients), 3))
        right[: len(self.centres)] = d_displacement - self._sums_jvp(self.centres, d_centres, d_centres)
        if len(slopes):
            right[: len(self.centres)] -= d_centres @ slopes
            right[-3:] = -d_centres.T @ self.strengths
        d_strengths, d_coefficients = self._parts(self.system.solve(right))
        d_values = self._sums_jvp(self.targets, d_targets, d_centres)
        d_values += radial_sums(*self.function, self.targets, self.centres, d_strengths)
        return d_values + d_targets[:, : len(slopes)] @ slopes + _polynomials(self.targets, d_coefficients)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        bar, slopes = np.ascontiguousarray(bar), self.coefficients[1:]
        right = np.zeros((len(self.centres) + len(self.coefficients), 3))
        right[: len(self.centres)] = radial_sums(*self.function, self.centres, self.targets, bar)
        right[len(self.centres) :] = _polynomials_transpose(self.targets, bar, len(self.coefficients))
        displacement_bar, constraint_bar = self._parts(self.system.solve(right))
        targets_bar, centres_bar = self._sums_vjp(self.targets, bar)
        centres_bar -= np.add(*self._sums_vjp(self.centres, displacement_bar))
        if len(slopes):
            targets_bar += bar @ slopes.T
            centres_bar -= displacement_bar @ slopes.T + self.strengths @ constraint_bar[1:].T
        return targets_bar, centres_bar, displacement_bar

    def _parts(self, solution: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(solution[: len(self.centres)]), solution[len(self.centres) :]

    def _sums_jvp(self, targets, d_targets, d_centres) -> np.ndarray:
        return radial_sums_jvp(*self.function, targets, self.centres, self.strengths, d_targets, d_centres)

    def _sums_vjp(self, targets, bar) -> tuple[np.ndarray, np.ndarray]:
        return radial_sums_vjp(*self.function, targets, self.centres, self.strengths, bar)


def radial_interpolation(
    kernel: str, radius: float, has_linear: bool, targets: np.ndarray, centres: np.ndarray, displacement: np.ndarray
) -> RadialInterpolation:
    """Interpolate displacements by radial functions.

    Parameters
    ----------
    kernel : str
        One of `COMPACT` and `GLOBAL`.
    radius : float
        Radius of the functions (m).
    has_linear : bool
        Whether a linear polynomial is added.
    targets, centres : ndarray, shape (n_targets, 3) and (n_centres, 3)
        Where it is evaluated, and where displacements are given (m).
    displacement : ndarray, shape (n_centres, 3)
        Displacements of the centres (m).

    Raises
    ------
    MovementError
        If the system is singular to round-off.
    """
    start = time.perf_counter()
    function = ((*COMPACT, *GLOBAL).index(kernel), radius)
    right = np.concatenate([displacement, np.zeros((4 if has_linear else 0, 3))])
    terms = np.column_stack([np.ones(len(centres)), centres])[:, : len(right) - len(centres)]
    system = _factorized(radial_matrix(*function, centres), terms, kernel)
    solution = system.solve(right)
    strengths, coefficients = np.ascontiguousarray(solution[: len(centres)]), solution[len(centres) :]
    matched = radial_sums(*function, centres, centres, strengths) + _polynomials(centres, coefficients)
    residual = float(np.linalg.norm(matched - displacement) / (np.linalg.norm(displacement) or 1.0))
    if not residual < LARGEST_RESIDUAL:
        raise MovementError(_singular(kernel, f"leaves a residual of {residual:.2g}"))
    values = radial_sums(*function, targets, centres, strengths) + _polynomials(targets, coefficients)
    report = SolveReport("dense Cholesky", 0, residual, time.perf_counter() - start, digits_of(residual))
    return RadialInterpolation(function, targets, centres, strengths, coefficients, system, values, report)


@dataclass(frozen=True, eq=False)
class RadialSystem:
    """The symmetric system ``[A P; P^T 0]``, factored; all functions are definite on the null space of ``P^T``.

    With ``P = Q [R; 0]``, which has t columns, ``Q^T A Q`` beyond its first t rows and columns is positive or negative
    definite, and takes half the arithmetic of an LU factor of the whole.

    Parameters
    ----------
    factor : ndarray, shape (n, n)
        Lower Cholesky factor of that part, bordered by an identity.
    sign : float
        -1 where the part is negative definite.
    border : ndarray, shape (n, t)
        First columns of ``Q^T A Q``.
    reflectors, scales : ndarray, shapes (n, t) and (t,)
        Q as LAPACK holds it, and R in the upper triangle.
    """

    factor: np.ndarray
    sign: float
    border: np.ndarray
    reflectors: np.ndarray
    scales: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Strengths, shape (n, m), above coefficients, shape (t, m), for a right-hand side of shape (n + t, m)."""
        n, t = self.border.shape
        with threadpool_limits(1, user_api="blas"):
            if not t:
                return linalg.cho_solve((self.factor, True), right)
            triangle = self.reflectors[:t]
            rest = _apply_q(self.reflectors, self.scales, right[:n], transposed=True)
            known = linalg.solve_triangular(triangle, right[n:], trans="T")
            rest -= self.border @ known
            inner = np.concatenate([np.zeros_like(known), self.sign * rest[t:]])
            inner = linalg.cho_solve((self.factor, True), inner)
            coefficients = linalg.solve_triangular(triangle, rest[:t] - self.border[t:].T @ inner[t:])
            inner[:t] = known
            return np.concatenate([_apply_q(self.reflectors, self.scales, inner), coefficients])


def _factorized(matrix: np.ndarray, terms: np.ndarray, kernel: str) -> RadialSystem:
    """Factor the symmetric system of functions, shape (n, n), and polynomials at the centres, shape (n, t)."""
    t, matrix = terms.shape[1], matrix.T  # symmetric; LAPACK overwrites it in Fortran's order
    reflectors, scales, sign = terms, np.zeros(0), 1.0
    try:
        with threadpool_limits(1, user_api="blas"):
            if t:
                (reflectors, scales), triangle = linalg.qr(terms, mode="raw")
                _check_polynomials(np.abs(np.diag(triangle)), kernel)
                matrix = _apply_q(reflectors, scales, matrix, transposed=True, overwrites=True)
                matrix = _apply_q(reflectors, scales, matrix, side="R", overwrites=True)
            border = matrix[:, :t].copy()
            matrix[:t], matrix[:, :t] = 0.0, 0.0
            if t and len(matrix) > t and matrix[t, t] < 0.0:
                sign = -1.0
                np.negative(matrix, out=matrix)
            matrix[range(t), range(t)] = 1.0
            factor, _ = linalg.cho_factor(matrix, lower=True, overwrite_a=True)
    except linalg.LinAlgError as error:
        raise MovementError(_singular(kernel, "is singular to round-off")) from error
    return RadialSystem(factor, sign, border, reflectors, scales)


def _apply_q(reflectors, scales, matrix, side="L", transposed=False, overwrites=False) -> np.ndarray:
    """Product of an orthogonal matrix, as LAPACK holds it, with another matrix on the side given."""
    work = 64 * max(matrix.shape)
    return dormqr(side, "T" if transposed else "N", reflectors, scales, matrix, work, overwrite_c=overwrites)[0]


def _check_polynomials(pivots: np.ndarray, kernel: str) -> None:
    """Refuse centres at which the polynomials, orthogonalised one after the other, depend on each other."""
    if len(pivots) < 4 or pivots.min() < SMALLEST_PIVOT * pivots.max():
        raise MovementError(
            f"radial basis: the centres lie in one plane, where the polynomial of kernel '{kernel}' is not unique; "
            "take a kernel without one, such as 'wendland c2'"
        )


def _singular(kernel: str, what: str) -> str:
    return f"radial basis: the system of kernel '{kernel}' {what}; take a smaller radius or another kernel"


def _polynomials(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Linear polynomials at points; zero without coefficients."""
    return coefficients[0] + points @ coefficients[1:] if len(coefficients) else np.zeros_like(points)


def _polynomials_transpose(points: np.ndarray, bar: np.ndarray, n_terms: int) -> np.ndarray:
    return np.vstack([bar.sum(axis=0), points.T @ bar])[:n_terms]
