"""Significant equations: from more equations than unknowns, the combinations that are not nearly empty.

Theory: ``docs/theory/linear_constraints.rst``.

References
----------
G. H. Golub and C. F. Van Loan, *Matrix Computations*, 4th edition, 2013, sections 5.4 and 5.5: rank by singular values,
and the choice of independent columns by a factor Q R with pivots.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr, solve_triangular, svd
from scipy.sparse import block_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components

__all__ = ["leading_equations"]

ZERO = 1e-14
"""Coefficients below this fraction of the largest are round-off."""


def leading_equations(
    matrix: csr_array,  # (m, n), equations
    # fraction of the largest singular value below which an equation is negligible; connected equations use their
    # largest
    least: np.ndarray,  # (m,)
    wish: np.ndarray,  # (n,), how much each unknown is preferred as dependent: its factor in the choice
) -> tuple[csr_array, np.ndarray]:
    """Replace many equations by the right singular vectors that are not small."""
    # Equations that share no unknown are treated separately. 1. Singular vectors whose singular values are above a
    # fraction of the largest are kept: for all unit vectors of unknowns that satisfy these, the error of the others is
    # at most that fraction of the largest. 2. As many unknowns become dependent: independent columns, preferred ones
    # first.
    # 3. The equations are solved for them.
    # returns matrix (rank, n): equations with one unknown of their own each, whose coefficient is one
    # returns own int (rank,): these unknowns
    n = matrix.shape[1]
    joint = block_array([[None, matrix], [matrix.T, None]], format="csr")
    labels = connected_components(joint, directed=False)[1]
    rows_of, columns_of = labels[: matrix.shape[0]], labels[matrix.shape[0] :]
    rows, leading = [csr_array((0, n))], [np.zeros(0, dtype=np.int64)]
    for label in np.unique(rows_of[np.diff(matrix.indptr) > 0]):
        members, columns = np.flatnonzero(rows_of == label), np.flatnonzero(columns_of == label)
        entries, pivots = _of_part(matrix[members][:, columns].toarray(), least[members].max(), wish[columns])
        line, column = entries.nonzero()
        rows.append(csr_array((entries[line, column], (line, columns[column])), shape=(len(entries), n)))
        leading.append(columns[pivots])
    return vstack(rows, format="csr"), np.concatenate(leading)


def _of_part(matrix: np.ndarray, least: float, wish: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Do steps 1 to 3 for connected equations."""
    _, singular, vectors = svd(matrix, full_matrices=False)
    kept = vectors[singular > least * singular[0]]  # step 1
    _, _, order = qr(kept * wish, mode="economic", pivoting=True)  # step 2
    pivots = order[: len(kept)]
    q, r = qr(kept[:, pivots])
    entries = solve_triangular(r, q.T @ kept)  # step 3
    entries[np.abs(entries) < ZERO * np.abs(entries).max(initial=0.0)] = 0.0
    entries[:, pivots] = np.eye(len(kept))
    return entries, pivots
