"""PARDISO of Intel's Math Kernel Library, where pypardiso is installed: an optional engine in place of `Cholesky`.

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from ..errors import InputError, MovementError
from ..shown import OneLine
from .blocks import BlockMatrix, BlockPattern, LinearSolution
from .conjugate_gradient import solve_with_factor

__all__ = ["Pardiso", "PardisoAnalysis", "PardisoFactor"]

SYMMETRIC_POSITIVE_DEFINITE = 2
"""PARDISO's number of this kind of matrix."""

N_KILOBYTES = 17
"""Place, from 1, of the memory of a factor in PARDISO's list of integer parameters."""


@dataclass(frozen=True)
class Pardiso(OneLine):
    """Direct solver of Intel's MKL, with as many threads as that is set to; needs the package pypardiso.

    Examples
    --------
    >>> from bspline_mdao import LinearElasticity, Pardiso, brick_grid, fit_grid, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, solver=Pardiso()).solver.name  # needs pypardiso when it moves
    'PARDISO'
    """

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return "PARDISO"

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> PardisoAnalysis:
        """Check that pypardiso is installed; PARDISO itself analyses the pattern again with every matrix."""
        try:
            import pypardiso  # noqa: F401
        except ImportError:
            raise InputError("PARDISO: pypardiso is not installed; install it, or use Cholesky()") from None
        return PardisoAnalysis(pattern)


@dataclass(frozen=True, eq=False)
class PardisoAnalysis(OneLine):
    """A pattern, of which PARDISO keeps nothing.

    Parameters
    ----------
    pattern : BlockPattern
    """

    pattern: BlockPattern

    def factorize(self, matrix: BlockMatrix) -> PardisoFactor:
        """Factor a matrix of the pattern; `MovementError` if PARDISO cannot."""
        from pypardiso import PyPardisoSolver
        from pypardiso.pardiso_wrapper import PyPardisoError

        if matrix.pattern is not self.pattern:
            raise InputError("PARDISO: the matrix has another pattern; analyze its own")
        lower = matrix.to_scipy()
        upper = scipy.sparse.csr_matrix((lower.data, lower.indices, lower.indptr), shape=lower.shape)
        solver = PyPardisoSolver(mtype=SYMMETRIC_POSITIVE_DEFINITE)
        try:
            solver.factorize(upper)
        except PyPardisoError as error:
            solver.free_memory(everything=True)
            raise MovementError(
                f"PARDISO: the matrix is not positive definite ({error}); look for an inverted or collapsed element, "
                "or for a point that nothing holds"
            ) from None
        return PardisoFactor(matrix, upper, solver)


@dataclass(frozen=True, eq=False)
class PardisoFactor:
    """PARDISO's factor of a matrix, freed with this object.

    Parameters
    ----------
    matrix : BlockMatrix
    upper : scipy.sparse.csr_matrix
        Its upper triangle as PARDISO wants it.
    solver : pypardiso.PyPardisoSolver
    """

    matrix: BlockMatrix
    upper: scipy.sparse.csr_matrix
    solver: Any

    def __del__(self):
        self.solver.free_memory(everything=True)

    @property
    def n_bytes(self) -> int:
        """Memory of the factor in bytes."""
        return 1024 * int(self.solver.get_iparm(N_KILOBYTES))

    @property
    def cancellation(self) -> float:
        """Infinite: this engine does not tell; see `CholeskyFactor.cancellation`."""
        return np.inf

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve with the factor, shape (n, 3) or (n, 3, m)."""
        columns = np.asfortranarray(right.reshape(3 * len(right), -1))
        return np.asarray(self.solver.solve(self.upper, columns)).reshape(right.shape)

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve, or solve with another matrix preconditioned by this factor; see `CholeskyFactor.solve`."""
        return solve_with_factor(self, right, matrix)
