"""CHOLMOD of SuiteSparse, where scikit-sparse is installed: an optional engine in place of `Cholesky`.

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, MovementError
from ..numerics.threads import one_blas_thread
from ..shown import OneLine
from .blocks import BlockMatrix, BlockPattern, LinearSolution
from .conjugate_gradient import solve_with_factor

__all__ = ["Cholmod", "CholmodAnalysis", "CholmodFactor"]


@dataclass(frozen=True)
class Cholmod(OneLine):
    """Direct solver of SuiteSparse (GPL), supernodal, with the METIS order; needs the package scikit-sparse.

    Examples
    --------
    >>> from bspline_mdao import Cholmod, LinearElasticity, brick_grid, fit_grid, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, solver=Cholmod()).solver.name
    'CHOLMOD'
    """

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return "CHOLMOD"

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> CholmodAnalysis:
        """Analyse a pattern; the points are not used. `InputError` where scikit-sparse is not installed."""
        try:
            from sksparse import cholmod
        except ImportError:
            raise InputError("CHOLMOD: scikit-sparse is not installed; install it, or use Cholesky()") from None
        ones = BlockMatrix(pattern, np.ones((pattern.n_blocks, 3, 3))).to_scipy()
        return CholmodAnalysis(pattern, cholmod.analyze(ones, mode="supernodal", ordering_method="metis"))


@dataclass(frozen=True, eq=False)
class CholmodAnalysis(OneLine):
    """Symbolic factor of a pattern.

    Parameters
    ----------
    pattern : BlockPattern
    symbolic : sksparse.cholmod.Factor
    """

    pattern: BlockPattern
    symbolic: Any

    def factorize(self, matrix: BlockMatrix) -> CholmodFactor:
        """Factor a matrix of the pattern; `MovementError` if it is not positive definite."""
        from sksparse.cholmod import CholmodNotPositiveDefiniteError

        if matrix.pattern is not self.pattern:
            raise InputError("CHOLMOD: the matrix has another pattern; analyze its own")
        try:
            with one_blas_thread:
                return CholmodFactor(matrix, self.symbolic.cholesky(matrix.to_scipy()))
        except CholmodNotPositiveDefiniteError as error:
            row = self.symbolic.P()[error.column] // 3 + 1
            raise MovementError(
                f"CHOLMOD: the matrix is not positive definite near block row {row}; "
                "look for an inverted or collapsed element there, or for a point that nothing holds"
            ) from None


@dataclass(frozen=True, eq=False)
class CholmodFactor:
    """CHOLMOD's factor of a matrix.

    Parameters
    ----------
    matrix : BlockMatrix
    factor : sksparse.cholmod.Factor
    """

    matrix: BlockMatrix
    factor: Any

    @property
    def n_bytes(self) -> int:
        """Memory of the factor; counts a copy of it, so that asking takes time."""
        return self.factor.L().data.nbytes

    @property
    def cancellation(self) -> float:
        """Infinite: this engine does not tell; see `CholeskyFactor.cancellation`."""
        return np.inf

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve with the factor, shape (n, 3) or (n, 3, m)."""
        columns = np.asfortranarray(right.reshape(3 * len(right), -1))
        with one_blas_thread:
            return self.factor(columns).reshape(right.shape)

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve, or solve with another matrix preconditioned by this factor; see `CholeskyFactor.solve`."""
        return solve_with_factor(self, right, matrix)
