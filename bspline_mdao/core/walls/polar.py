"""The rotation nearest to a matrix, the orthogonal factor of its polar decomposition M = R S, and its derivative.

With w the rotation vector of a change, dR = R [w]x, equation M = R S gives (tr(S) I - S) w = the axial vector of
R^T dM - dM^T R: a symmetric system of three, and the map from dM to dR is its own transpose.

N. J. Higham, "Computing the polar decomposition - with applications", SIAM Journal on Scientific and Statistical
Computing 7(4), 1986, pp. 1160-1174.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["cofactors", "nearest_rotations", "rotation_changes"]


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_rotations(matrices, stiffness, is_fine, piece):
    """Put the nearest rotation in the place of every matrix, and ``tr(S) I - S`` beside it."""
    # M + cof(M) / norm(M) has the same rotation: both factors of cof(M) = R cof(S) belong to those of M. But it has
    # full rank where all edges lie in a plane, and a positive determinant somewhat beyond. Newton's iteration X <- (X +
    # X^-T) / 2 then converges to the rotation, in the end quadratically (Higham 1986), for complex parts a step later.
    #
    # 1. Start from M + cof(M) / norm(M), divided by norm(M).
    # 2. Take the cofactors of X, which are det(X) X^-T. Where the determinant is not positive, there is no rotation.
    # 3. Scale X so that it and X^-T are of the same size (the scaling in the Frobenius norm of Higham 1986).
    # 4. Replace X by the mean of both. After a step of less than 1e-5 one more is exact to round-off.
    r, c = np.empty_like(matrices[0]), np.empty_like(matrices[0])
    for i in range(piece[0], piece[1]):
        m = matrices[i]
        size = np.sqrt(_square(m))  # step 1
        cofactors(m, c)
        for d in range(3):
            for e in range(3):
                r[d, e] = (m[d, e] + c[d, e] / size) / size
        is_fine[i] = False
        n_left = 60  # more than any matrix with a positive determinant needs; a bound against NaN
        while n_left > 0:
            det = cofactors(r, c)  # step 2
            if not det.real > 1e-12:  # of a matrix of size 1: round-off decides its sign
                break
            # step 3: while they differ much; near the end the scale would only add round-off
            scale = np.sqrt(np.sqrt(_square(c) / (det * det * _square(r))))
            if abs(scale.real - 1.0) < 1e-2:
                scale = 1.0
            step = 0.0  # step 4
            for d in range(3):
                for e in range(3):
                    new = 0.5 * (scale * r[d, e] + c[d, e] / (det * scale))
                    step = max(step, abs(new - r[d, e]))
                    r[d, e] = new
            n_left -= 1
            if step < 1e-5 and n_left > 1:
                is_fine[i] = True
                n_left = 1
        _set_stiffness(r, m, stiffness[i])
        for d in range(9):
            m[d // 3, d % 3] = r[d // 3, d % 3]


@njit(cache=True, nogil=True, error_model="numpy")
def rotation_changes(matrices, stiffness, change, piece):
    """Turn changes of M into changes of R, or derivatives with respect to R into those with respect to M, in place."""
    c = np.empty_like(stiffness[0])
    for i in range(piece[0], piece[1]):
        w = _solve(stiffness[i], c, _axial(matrices[i], change[i]))
        _set_turned(matrices[i], w, change[i])


@njit(cache=True, nogil=True, error_model="numpy")
def cofactors(m, c):
    """Write the cofactors of a matrix of three rows to ``c`` and return its determinant."""
    c[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c[0, 1] = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c[0, 2] = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    c[1, 0] = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]
    c[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]
    c[1, 2] = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]
    c[2, 0] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    c[2, 1] = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    c[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return m[0, 0] * c[0, 0] + m[0, 1] * c[0, 1] + m[0, 2] * c[0, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _square(m):
    """Sum of the squares of all entries."""
    total = m[0, 0] * m[0, 0]
    for k in range(1, 9):
        total += m[k // 3, k % 3] * m[k // 3, k % 3]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _set_stiffness(r, m, k):
    """Write ``tr(S) I - S`` with S the symmetric part of ``R^T M``."""
    for d in range(3):
        for e in range(3):
            k[d, e] = -0.5 * (
                r[0, d] * m[0, e] + r[1, d] * m[1, e] + r[2, d] * m[2, e]
                + r[0, e] * m[0, d] + r[1, e] * m[1, d] + r[2, e] * m[2, d]
            )  # fmt: skip
    trace = k[0, 0] + k[1, 1] + k[2, 2]
    for d in range(3):
        k[d, d] -= trace


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(k, c, b):
    """Solve a symmetric system of three; ``c`` is room for its cofactors."""
    det = cofactors(k, c)
    return (
        (c[0, 0] * b[0] + c[0, 1] * b[1] + c[0, 2] * b[2]) / det,
        (c[1, 0] * b[0] + c[1, 1] * b[1] + c[1, 2] * b[2]) / det,
        (c[2, 0] * b[0] + c[2, 1] * b[1] + c[2, 2] * b[2]) / det,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _axial(r, m):
    """Axial vector of r^T m - m^T r."""
    return (
        r[0, 2] * m[0, 1] + r[1, 2] * m[1, 1] + r[2, 2] * m[2, 1]
        - r[0, 1] * m[0, 2] - r[1, 1] * m[1, 2] - r[2, 1] * m[2, 2],
        r[0, 0] * m[0, 2] + r[1, 0] * m[1, 2] + r[2, 0] * m[2, 2]
        - r[0, 2] * m[0, 0] - r[1, 2] * m[1, 0] - r[2, 2] * m[2, 0],
        r[0, 1] * m[0, 0] + r[1, 1] * m[1, 0] + r[2, 1] * m[2, 0]
        - r[0, 0] * m[0, 1] - r[1, 0] * m[1, 1] - r[2, 0] * m[2, 1],
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _set_turned(r, w, out):
    """``out = r [w]x``."""
    for d in range(3):
        a, b, c = r[d, 0], r[d, 1], r[d, 2]
        out[d, 0] = b * w[2] - c * w[1]
        out[d, 1] = c * w[0] - a * w[2]
        out[d, 2] = a * w[1] - b * w[0]
