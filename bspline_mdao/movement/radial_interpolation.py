"""Interpolation of displacements by radial functions, with its exact derivative.

With the functions :math:`A` of all centres, the linear polynomials :math:`P` at them (if any) and the known
displacements d, strengths and coefficients solve ``A strengths + P coefficients = d``, ``P^T strengths = 0``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from threadpoolctl import threadpool_limits

from ..errors import MovementError
from .mover import SolveReport
from .radial_functions import COMPACT, GLOBAL, radial_matrix, radial_sums, radial_sums_jvp, radial_sums_vjp

__all__ = ["RadialInterpolation", "radial_interpolation"]

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
    solve : callable
        Inverse of the symmetric system: strengths and coefficients below each other from displacements and zeros.
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
    solve: Callable[[np.ndarray], np.ndarray]
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
        d_strengths, d_coefficients = self._parts(self.solve(right))
        d_values = self._sums_jvp(self.targets, d_targets, d_centres)
        d_values += radial_sums(*self.function, self.targets, self.centres, d_strengths)
        return d_values + d_targets[:, : len(slopes)] @ slopes + _polynomials(self.targets, d_coefficients)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        bar, slopes = np.ascontiguousarray(bar), self.coefficients[1:]
        right = np.zeros((len(self.centres) + len(self.coefficients), 3))
        right[: len(self.centres)] = radial_sums(*self.function, self.centres, self.targets, bar)
        right[len(self.centres) :] = _polynomials_transpose(self.targets, bar, len(self.coefficients))
        displacement_bar, constraint_bar = self._parts(self.solve(right))
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
    matrix = radial_matrix(*function, centres, len(right) - len(centres))
    solve = _factorized(matrix.T, kernel, has_linear)  # symmetric; LAPACK overwrites it in Fortran's order
    solution = solve(right)
    strengths, coefficients = np.ascontiguousarray(solution[: len(centres)]), solution[len(centres) :]
    matched = radial_sums(*function, centres, centres, strengths) + _polynomials(centres, coefficients)
    residual = float(np.linalg.norm(matched - displacement) / (np.linalg.norm(displacement) or 1.0))
    if not residual < LARGEST_RESIDUAL:
        raise MovementError(_singular(kernel, f"leaves a residual of {residual:.2g}"))
    values = radial_sums(*function, targets, centres, strengths) + _polynomials(targets, coefficients)
    report = SolveReport("dense LU" if has_linear else "dense Cholesky", 0, residual, time.perf_counter() - start)
    return RadialInterpolation(function, targets, centres, strengths, coefficients, solve, values, report)


def _factorized(matrix: np.ndarray, kernel: str, is_bordered: bool) -> Callable[[np.ndarray], np.ndarray]:
    """Inverse of a symmetric matrix, which is overwritten."""
    try:
        with threadpool_limits(1, user_api="blas"):
            factor, solve = (
                (linalg.lu_factor(matrix, overwrite_a=True), linalg.lu_solve)
                if is_bordered
                else (linalg.cho_factor(matrix, lower=True, overwrite_a=True), linalg.cho_solve)
            )
    except linalg.LinAlgError as error:
        raise MovementError(_singular(kernel, "is singular to round-off")) from error
    return lambda right: _on_one_thread(solve, factor, right)


def _on_one_thread(solve, factor, right: np.ndarray) -> np.ndarray:
    with threadpool_limits(1, user_api="blas"):
        return solve(factor, right)


def _singular(kernel: str, what: str) -> str:
    return f"radial basis: the system of kernel '{kernel}' {what}; take a smaller radius or another kernel"


def _polynomials(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Linear polynomials at points; zero without coefficients."""
    return coefficients[0] + points @ coefficients[1:] if len(coefficients) else np.zeros_like(points)


def _polynomials_transpose(points: np.ndarray, bar: np.ndarray, n_terms: int) -> np.ndarray:
    return np.vstack([bar.sum(axis=0), points.T @ bar])[:n_terms]
