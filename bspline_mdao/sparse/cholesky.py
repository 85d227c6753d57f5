"""Sparse Cholesky factorisation: nested dissection, supernodes and multifrontal elimination."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError, MovementError
from . import multifrontal
from .blocks import BlockMatrix, BlockPattern
from .fronts import Fronts, lay_out
from .graph import graph_of
from .lapack import routines
from .ordering import nested_dissection
from .solution import Solution, check_right, relative_residual
from .supernodes import Supernodes, find_supernodes

__all__ = ["Cholesky", "CholeskyAnalysis", "CholeskyFactor"]

REFINE_ABOVE = 1e-13
"""A solution with a larger relative residual gets one step of refinement."""


@dataclass(frozen=True)
class Cholesky:
    """Direct solver that needs nothing beyond numba and SciPy.

    Parameters
    ----------
    single : bool, optional
        Factor in single precision, after a scaling to unit diagonal: half the time and memory, for preconditioning.
    """

    single: bool = False

    @property
    def name(self) -> str:
        """Name for reports."""
        return "Cholesky, single precision" if self.single else "Cholesky"

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> CholeskyAnalysis:
        """Find the order of elimination and the fronts of a pattern, whose points have coordinates of shape (n, 3)."""
        graph = graph_of(pattern)
        supernodes = find_supernodes(*graph, nested_dissection(*graph))
        return CholeskyAnalysis(self, pattern, supernodes, lay_out(supernodes, pattern.indptr, pattern.indices))


@dataclass(frozen=True, eq=False)
class CholeskyAnalysis:
    """What can be known of a factorisation from the pattern alone.

    Parameters
    ----------
    settings : Cholesky
    pattern : BlockPattern
    supernodes : Supernodes
    fronts : Fronts
    """

    settings: Cholesky
    pattern: BlockPattern
    supernodes: Supernodes
    fronts: Fronts

    @property
    def n_factor(self) -> int:
        """Numbers that the factor holds."""
        return int(self.fronts.panel_starts[-1])

    def factorize(self, matrix: BlockMatrix) -> CholeskyFactor:
        """Factor a matrix of the pattern; `MovementError` if it is not positive definite."""
        if matrix.pattern is not self.pattern:
            raise InputError("Cholesky: the matrix has another pattern; analyze its own")
        dtype = np.float32 if self.settings.single else np.float64
        panels, workspace = np.empty(self.n_factor, dtype), np.empty(self.fronts.n_workspace, dtype)
        with threadpool_limits(1, "blas"):
            failed = multifrontal.factorize(
                0,
                len(self.supernodes.parents),
                self.supernodes,
                self.fronts,
                routines(dtype),
                matrix.data,
                panels,
                workspace,
            )
        if failed >= 0:
            raise MovementError(
                f"Cholesky: the matrix is not positive definite at block row {self.supernodes.order[failed] + 1}; "
                "look for an inverted or collapsed element there, or for a point that nothing holds"
            )
        return CholeskyFactor(self, matrix, panels)


@dataclass(frozen=True, eq=False)
class CholeskyFactor:
    """Cholesky factor of a matrix.

    Parameters
    ----------
    analysis : CholeskyAnalysis
    matrix : BlockMatrix
        What was factored.
    panels : ndarray, shape (n_factor,)
        The factor.
    """

    analysis: CholeskyAnalysis
    matrix: BlockMatrix
    panels: np.ndarray

    @property
    def n_bytes(self) -> int:
        """Memory of the factor."""
        return self.panels.nbytes

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve with the factor as it is, shape (n, 3) or (n, 3, m): a preconditioner."""
        supernodes, dtype = self.analysis.supernodes, self.panels.dtype
        x = right.reshape(len(right), -1)[supernodes.order].reshape(3 * len(right), -1).astype(dtype)
        with threadpool_limits(1, "blas"):
            multifrontal.solve(supernodes, self.analysis.fronts, routines(dtype), self.panels, x)
        return x.reshape(right.shape)[supernodes.rank].astype(np.float64)

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> Solution:
        """Solve, with one step of refinement if the residual asks for it.

        Parameters
        ----------
        right : ndarray, shape (n, 3) or (n, 3, m)
            Right-hand side, or m of them.
        matrix : BlockMatrix, optional
            Matrix of the residual; by default the one that was factored.

        Returns
        -------
        Solution
        """
        start = time.perf_counter()
        matrix = self.matrix if matrix is None else matrix
        right = check_right(right, matrix.pattern.n)
        x = self.apply(right)
        rest = right - _product(matrix, x)
        residual = relative_residual(rest, right)
        if residual <= REFINE_ABOVE:
            return Solution(x, 0, residual, time.perf_counter() - start)
        x += self.apply(rest)
        residual = relative_residual(right - _product(matrix, x), right)
        return Solution(x, 1, residual, time.perf_counter() - start)


def _product(matrix: BlockMatrix, x: np.ndarray) -> np.ndarray:
    """Product with one vector or with several."""
    if x.ndim == 2:
        return matrix.dot(x)
    return np.stack([matrix.dot(x[..., side]) for side in range(x.shape[2])], axis=2)
