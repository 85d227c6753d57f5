"""Cholesky factors of Gram matrices, banded or dense, with a shift where the matrix is singular."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dpotrf, dpotrs

SMALLEST_PIVOT = 1e-11
"""A pivot below this fraction of the largest diagonal entry makes a Gram matrix singular."""

SHIFT = 1e-8
"""Shift of the diagonal of a singular Gram matrix, in nodes per control point."""


@dataclass(frozen=True, eq=False)
class Cholesky:
    """Factor of ``G + shift I``.

    Parameters
    ----------
    factor : ndarray
        As LAPACK left it.
    is_banded : bool
        Whether the storage is banded.
    shift : float
        What was added to the diagonal: 0 unless the matrix is singular.
    """

    factor: np.ndarray
    is_banded: bool
    shift: float

    @property
    def is_singular(self) -> bool:
        """Whether the matrix needed a shift."""
        return self.shift > 0.0

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution of ``(G + shift I) d = right``; both of shape (n, m)."""
        routine = dpbtrs if self.is_banded else dpotrs
        return routine(self.factor, right, lower=1)[0]


def factorize(gram: np.ndarray, is_banded: bool, unit: float) -> Cholesky:
    """Factor a Gram matrix.

    Parameters
    ----------
    gram : ndarray
        Lower half, stored as `bspline_mdao.fit.design_matrix.DesignMatrix.gram` returns it.
    is_banded : bool
        Whether it is stored by bands.
    unit : float
        Unit of the shift. It must not depend on the matrix, so that a shift has no derivative.

    Returns
    -------
    Cholesky
    """
    factor = _factor(gram, is_banded, 0.0)
    if factor is not None:
        return Cholesky(factor, is_banded, 0.0)
    shift = SHIFT * unit
    return Cholesky(_factor(gram, is_banded, shift, 0.0), is_banded, shift)


def _factor(gram: np.ndarray, is_banded: bool, shift: float, smallest=SMALLEST_PIVOT) -> np.ndarray | None:
    """Lower factor of the shifted matrix in LAPACK's column-major storage; None where it is singular."""
    lower = gram.T.copy(order="F")
    diagonal = lower[0] if is_banded else np.einsum("ii->i", lower)
    diagonal += shift
    largest = diagonal.max()
    if is_banded:
        factor, info = dpbtrf(lower, lower=1, overwrite_ab=1)
        pivots = factor[0]
    else:
        factor, info = dpotrf(lower, lower=1, clean=0, overwrite_a=1)
        pivots = factor.diagonal()
    is_singular = info != 0 or (pivots**2).min() <= smallest * largest
    return None if is_singular else factor
