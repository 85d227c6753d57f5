"""PARDISO of Intel's Math Kernel Library as a peer of our sparse Cholesky; wheels have it: ``pip install pypardiso``.

CHOLMOD has no wheel to compare with: scikit-sparse has none, and that of kvxopt and of cvxopt runs on the reference
kernels of ATLAS, 28 times slower than ours.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import scipy.sparse
from threadpoolctl import threadpool_limits

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern, LinearSolution, residual_norm

IS_INSTALLED = find_spec("pypardiso") is not None

SYMMETRIC_POSITIVE_DEFINITE = 2
"""PARDISO's number of this kind of matrix."""

ANALYSE, FACTORISE, SOLVE = 11, 22, 33
"""PARDISO's numbers of its phases."""

N_KILOBYTES = 17
"""Place, from 1, of the memory of a factor in PARDISO's list of integer parameters."""


@dataclass(frozen=True)
class Pardiso:
    """Supernodal solver of Intel, one thread, with the order of METIS."""

    name = "PARDISO"

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> PardisoAnalysis:
        """Order and analyse; the points are not used."""
        from pypardiso import PyPardisoSolver

        solver = PyPardisoSolver(mtype=SYMMETRIC_POSITIVE_DEFINITE)
        threadpool_limits(1)  # again, for the library that has just been loaded
        _run(solver, ANALYSE, upper_triangle(BlockMatrix(pattern, np.ones((pattern.n_blocks, 3, 3)))))
        return PardisoAnalysis(solver)


@dataclass(frozen=True, eq=False)
class PardisoAnalysis:
    """Analysis of a pattern; PARDISO keeps one factor with it, that of the last matrix."""

    solver: Any

    def factorize(self, matrix: BlockMatrix) -> PardisoFactor:
        """Factor."""
        upper = upper_triangle(matrix)
        _run(self.solver, FACTORISE, upper)
        return PardisoFactor(matrix, upper, self.solver)


@dataclass(frozen=True, eq=False)
class PardisoFactor:
    """Factor of a matrix, and its upper triangle, which PARDISO asks for with every right-hand side."""

    matrix: BlockMatrix
    upper: scipy.sparse.csr_matrix
    solver: Any

    @property
    def n_bytes(self) -> int:
        """Memory of the factor."""
        return 1024 * int(self.solver.get_iparm(N_KILOBYTES))

    def solve(self, right: np.ndarray) -> LinearSolution:
        """Solve."""
        start = time.perf_counter()
        x = _run(self.solver, SOLVE, self.upper, right.ravel()).reshape(right.shape)
        return LinearSolution(x, 0, residual_norm(self.matrix, x, right), time.perf_counter() - start)


def upper_triangle(matrix: BlockMatrix) -> scipy.sparse.csr_matrix:
    """Rows of the upper triangle: the columns of the lower one."""
    lower = matrix.to_scipy()
    return scipy.sparse.csr_matrix((lower.data, lower.indices, lower.indptr), shape=lower.shape)


def _run(solver: Any, phase: int, upper: scipy.sparse.csr_matrix, right: np.ndarray | None = None) -> np.ndarray:
    """Run one phase, which pypardiso's own methods do not offer one by one."""
    solver.set_phase(phase)
    return solver._call_pardiso(upper, np.zeros(upper.shape[0]) if right is None else right)
