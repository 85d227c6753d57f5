"""Factors of sparse symmetric positive definite matrices of scalars, by SuperLU.

They are for fields with uncoupled components: a ninth of the numbers of 3 x 3 blocks for the same points. Rows must be
in the order of elimination.

X. S. Li, "An overview of SuperLU: algorithms, implementation, and user interface", ACM Transactions on Mathematical
Software 31, 2005, pp. 302-325.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from ...errors import MovementError
from ..numerics.stopwatch import working_seconds
from .blocks import LinearSolution, relative_residual

__all__ = ["ScalarCholesky", "ScalarFactor"]

EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class ScalarCholesky:
    """Maker of the factors; no stage depends on the pattern only."""

    def factorize(self, matrix: csc_array) -> ScalarFactor:
        """Factor a matrix."""
        factor = ScalarFactor(matrix)
        if not np.isfinite(matrix.data).all() or not np.isfinite(factor.cancellation):
            raise MovementError("SuperLU: the matrix is not finite; look for points that are not")
        return factor


@dataclass(frozen=True, eq=False)
class ScalarFactor:
    """Factors of the uncoupled pieces of a scalar matrix; equal pieces share one."""

    matrix: csc_array  # (n, n), the factored matrix

    def __reduce__(self) -> tuple[type[ScalarFactor], tuple[csc_array]]:
        """Drop the factors: SuperLU cannot be pickled."""
        return ScalarFactor, (self.matrix,)

    @cached_property
    def _pieces(self) -> tuple[tuple[np.ndarray, SuperLU], ...]:
        """Rows of equal pieces, shape (n_rows, n_pieces), and their factor: a definite matrix needs no pivots."""
        n_pieces, piece = connected_components(self.matrix, directed=False)
        found: dict[bytes, tuple[csc_array, list[np.ndarray]]] = {}
        for rows in np.split(np.argsort(piece, kind="stable"), np.cumsum(np.bincount(piece, minlength=n_pieces))[:-1]):
            part = csc_array(self.matrix[:, rows][rows])
            key = part.indptr.tobytes() + part.indices.tobytes() + part.data.tobytes()
            found.setdefault(key, (part, []))[1].append(rows)
        return tuple((np.stack(equal, axis=1), _factored(part)) for part, equal in found.values())

    @cached_property
    def cancellation(self) -> float:
        """Relative error of a solution, in units of the unit round-off."""
        # It is measured on a known solution: SuperLU exposes its pivots only in copies of the whole factor.
        known = np.random.default_rng(0).standard_normal(self.matrix.shape[0])
        error = np.abs(self._solved(self.matrix @ known) - known).max(initial=0.0)
        return float(error / np.abs(known).max(initial=EPSILON) / EPSILON)

    def _solved(self, right: np.ndarray) -> np.ndarray:
        """Solution of a right-hand side, shape (n,), or of several, shape (n, m)."""
        x = np.empty_like(right)
        for rows, factor in self._pieces:
            sides = right[rows]
            x[rows] = factor.solve(sides.reshape(len(rows), math.prod(sides.shape[1:]))).reshape(sides.shape)
        return x

    def solve(self, right: np.ndarray) -> LinearSolution:
        """Solve for a right-hand side, shape (n,), or for several, shape (n, m)."""
        start = working_seconds()
        x = self._solved(right)
        rest = (right - self.matrix @ x)[:, None]
        return LinearSolution(x, 0, relative_residual(rest, right[:, None]), working_seconds() - start)


def _factored(matrix: csc_array) -> SuperLU:
    """Factor of a matrix in its given order."""
    try:
        return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise MovementError(
            f"SuperLU: {error}; look for a collapsed element, or for a point that nothing holds"
        ) from error
