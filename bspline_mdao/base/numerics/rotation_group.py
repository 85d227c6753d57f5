"""The group of rotations in space: the rotation nearest to a matrix, rotations as vectors, and their derivatives.

*Nearest to a matrix.* The orthogonal factor R of the polar decomposition M = R S. With w the rotation vector of a
change, dR = R [w]x, the equation M = R S gives (tr(S) I - S) w = the axial vector of R^T dM - dM^T R: a symmetric
system of three, and the map from dM to dR is its own transpose. Kernels find it by Newton's iteration where it is
smooth; `nearest_to_any` finds it by the largest eigenvector of Davenport's matrix, whatever the determinant.

*As vectors.* w rotates about its own direction by its length, for any angle below a full turn. With W = [w]x, t = w . w
and the angle theta = sqrt(t), Rodrigues' formula and the inverse of its derivative are

    R = exp(W) = I + a W + b W^2,        a = sin(theta) / theta,  b = (1 - cos(theta)) / t,
    dw = (I + W / 2 + c W^2) q  for  dR = R [q]x,        c = (1 - theta / 2 cot(theta / 2)) / t.

All of a, b, c are smooth functions of t, computed as series for small t. The vector of a rotation is determined up to
whole turns about its direction; along a surface it is continued, so that neighbours differ by less than half a turn.

N. J. Higham, "Computing the polar decomposition - with applications", SIAM Journal on Scientific and Statistical
Computing 7(4), 1986, pp. 1160-1174. P. B. Davenport, "A vector approach to the algebra of rotations with
applications", NASA TN D-4696, 1968.

Theory: ``docs/theory/rotations.rst``, ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numba import njit

__all__ = [
    "NO_ROTATION",
    "cofactors",
    "nearest_rotations",
    "nearest_to_any",
    "rotation_changes",
    "turns",
    "turns_jvp",
    "turns_vjp",
    "unwrapped",
    "vectors_jvp",
    "vectors_vjp",
]

NO_ROTATION = 1e-14
"""Angles below this are rounding error: points at rest do not rotate."""

SERIES_BELOW = 0.25
"""Squared angles below which series are summed; their last terms are then below the unit round-off."""

_A = np.array([(-1.0) ** k / factorial(2 * k + 1) for k in range(10)])
_B = np.array([(-1.0) ** k / factorial(2 * k + 2) for k in range(10)])
_C = 1.0 / np.array([12.0, 720.0, 30240.0, 1209600.0, 47900160.0, 1307674368000.0 / 691.0, 74724249600.0])


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_rotations(matrices, stiffness, is_fine, piece):
    """Replace every matrix by the nearest rotation, and compute ``tr(S) I - S``."""
    # M + cof(M) / norm(M) has the same rotation: cof(M) = R cof(S) has the same factor R. But it has full rank if all
    # edges lie in a plane, and a positive determinant somewhat beyond. Newton's iteration X <- (X + X^-T) / 2 then
    # converges to the rotation, finally quadratically (Higham 1986), for complex parts a step later.
    #
    # 1. Start from M + cof(M) / norm(M), divided by norm(M).
    # 2. Take the cofactors of X, which are det(X) X^-T. If the determinant is not positive, there is no rotation.
    # 3. Scale X so that it and X^-T are of the same size (the scaling in the Frobenius norm of Higham 1986).
    # 4. Replace X by the mean of both. After a step below 1e-5 one more is exact to round-off.
    r, c = np.empty_like(matrices[0]), np.empty_like(matrices[0])
    for i in range(piece[0], piece[1]):
        m = matrices[i]
        size = np.sqrt(_size_square(m))  # step 1
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
            # step 3: while they differ much; near the end scaling would only add round-off
            scale = np.sqrt(np.sqrt(_size_square(c) / (det * det * _size_square(r))))
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
    """Convert changes of M to changes of R, or derivatives with respect to R to derivatives by M, in place."""
    c = np.empty_like(stiffness[0])
    for i in range(piece[0], piece[1]):
        w = _solve(stiffness[i], c, _axial_part(matrices[i], change[i]))
        _set_product(matrices[i], w, change[i])


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
def _size_square(m):
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
def _axial_part(r, m):
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
def _set_product(r, w, out):
    """``out = r [w]x``."""
    for d in range(3):
        a, b, c = r[d, 0], r[d, 1], r[d, 2]
        out[d, 0] = b * w[2] - c * w[1]
        out[d, 1] = c * w[0] - a * w[2]
        out[d, 2] = a * w[1] - b * w[0]


def turns(vectors: np.ndarray) -> np.ndarray:
    """R - I of every vector, shape (n, 3) to (n, 3, 3), without the cancellation of a difference."""
    w = _crossing(vectors)
    (a, b), _ = _factors(_squares(vectors))
    return a * w + b * (w @ w)


def turns_jvp(vectors: np.ndarray, d_vectors: np.ndarray) -> np.ndarray:
    """Change of `turns`."""
    w, dw = _crossing(vectors), _crossing(d_vectors)
    (a, b), (a_slope, b_slope) = _factors(_squares(vectors))
    dt = 2.0 * (vectors * d_vectors).sum(axis=1)[:, None, None]
    return (a_slope * dt) * w + a * dw + (b_slope * dt) * (w @ w) + b * (dw @ w + w @ dw)


def turns_vjp(vectors: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transpose of `turns_jvp`."""
    w = _crossing(vectors)
    (a, b), (a_slope, b_slope) = _factors(_squares(vectors))
    turned = w.transpose(0, 2, 1)
    t_bar = ((a_slope * w + b_slope * (w @ w)) * bar).sum(axis=(1, 2))
    return _axial(a * bar + b * (bar @ turned + turned @ bar)) + 2.0 * t_bar[:, None] * vectors


def unwrapped(
    matrices: np.ndarray,  # (n, 3, 3), the rotations
    # starts, neighbours: (n + 1,) and (n_sides,) of int, first neighbour of every point, and the neighbours
    starts: np.ndarray,
    neighbours: np.ndarray,
) -> np.ndarray:
    """Vectors, shape (n, 3), of rotation matrices, shape (n, 3, 3), continued from each point to its neighbours."""
    # 1. Take the vector of at most half a turn of every point, from its quaternion.
    # 2. In each connected set of points, start at the one that rotates least.
    # 3. Continue from neighbour to neighbour, nearest first, with the whole turns that bring each vector next to the
    #    vector of the point from which it is reached.
    directions, angles = _directions_and_angles(matrices)  # step 1
    wholes = _whole_turns(directions, angles, np.argsort(angles, kind="stable"), starts, neighbours)
    return directions * (angles + 2.0 * np.pi * wholes)[:, None]


def vectors_jvp(vectors: np.ndarray, matrices: np.ndarray, d_matrices: np.ndarray) -> np.ndarray:
    """Change of the vectors with the matrices, shape (n, 3), whatever their whole turns."""
    q = 0.5 * _axial(matrices.transpose(0, 2, 1) @ d_matrices)
    return _followed(vectors, q, 0.5)


def vectors_vjp(vectors: np.ndarray, matrices: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transpose of `vectors_jvp`, shape (n, 3, 3)."""
    return matrices @ (0.5 * _crossing(_followed(vectors, bar, -0.5)))


def nearest_to_any(matrices: np.ndarray) -> np.ndarray:
    """The rotations nearest to matrices, shape (n, 3, 3), of any determinant."""
    q = np.linalg.eigh(_attitudes(matrices))[1][:, :, -1]
    w = _crossing(q[:, 1:])
    return np.eye(3) + 2.0 * (q[:, :1, None] * w + w @ w)


def _followed(vectors: np.ndarray, q: np.ndarray, half: float) -> np.ndarray:
    """``(I + half W + c W^2) q``."""
    t = _squares(vectors)[:, 0, 0]
    x = 0.5 * np.sqrt(np.maximum(t, SERIES_BELOW))
    c = np.where(t < SERIES_BELOW, np.polynomial.polynomial.polyval(t, _C), (1.0 - x / np.tan(x)) / (4.0 * x * x))
    once = np.cross(vectors, q)
    return q + half * once + c[:, None] * np.cross(vectors, once)


def _factors(t: np.ndarray) -> tuple:
    """Numbers a and b of squared angles t, and their derivatives with respect to these."""
    values, slopes = [], []
    large = np.maximum(t, SERIES_BELOW)
    theta = np.sqrt(large)
    a, b = np.sin(theta) / theta, (1.0 - np.cos(theta)) / large
    closed = ((a, 0.5 * (np.cos(theta) - a) / large), (b, 0.5 * (a - 2.0 * b) / large))
    for series, (value, slope) in zip((_A, _B), closed):
        polynomial = np.polynomial.Polynomial(series)
        values.append(np.where(t < SERIES_BELOW, polynomial(t), value))
        slopes.append(np.where(t < SERIES_BELOW, polynomial.deriv()(t), slope))
    return values, slopes


def _squares(vectors: np.ndarray) -> np.ndarray:
    """Squared lengths, shape (n, 1, 1)."""
    return (vectors * vectors).sum(axis=1)[:, None, None]


def _crossing(vectors: np.ndarray) -> np.ndarray:
    """Matrices [w]x of vectors."""
    matrices = np.zeros((*vectors.shape, 3), dtype=vectors.dtype)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[:, k, j], matrices[:, j, k] = vectors[:, i], -vectors[:, i]
    return matrices


def _axial(matrices: np.ndarray) -> np.ndarray:
    """Transpose of `_crossing`; of [w]x it is 2 w."""
    return np.stack([matrices[:, k, j] - matrices[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)


def _directions_and_angles(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors, or zero without rotation, and angles up to half a turn."""
    products = _attitudes(matrices) + np.eye(4)  # four times the products of the quaternion's components
    largest = np.argmax(np.einsum("nii->ni", products), axis=1)
    quaternions = products[np.arange(len(products)), largest]
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    quaternions *= np.where(quaternions[:, :1] < 0.0, -1.0, 1.0)
    sines = np.linalg.norm(quaternions[:, 1:], axis=1)
    angles = 2.0 * np.arctan2(sines, quaternions[:, 0])
    is_turned = angles > NO_ROTATION
    return quaternions[:, 1:] / np.where(is_turned, sines, np.inf)[:, None], np.where(is_turned, angles, 0.0)


def _attitudes(matrices: np.ndarray) -> np.ndarray:
    """Davenport's matrix, shape (n, 4, 4), whose largest eigenvector is the quaternion of the nearest rotation."""
    trace = np.einsum("nii->n", matrices)
    attitudes = np.empty((len(matrices), 4, 4))
    attitudes[:, 0, 0] = trace
    attitudes[:, 0, 1:] = attitudes[:, 1:, 0] = _axial(matrices)
    attitudes[:, 1:, 1:] = matrices + matrices.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    return attitudes


@njit(cache=True)
def _whole_turns(directions, angles, order, starts, neighbours):
    """Whole turns of every point, steps 2 and 3 of `unwrapped`; ``order`` has the points by their angles."""
    n = len(angles)
    wholes, is_known, queue = np.zeros(n), np.zeros(n, np.bool_), np.empty(n, np.int64)
    for seed in order:  # step 2
        if is_known[seed]:
            continue
        is_known[seed], queue[0], first, last = True, seed, 0, 1
        while first < last:  # step 3
            i = queue[first]
            first += 1
            full = angles[i] + 2.0 * np.pi * wholes[i]
            for side in range(starts[i], starts[i + 1]):
                j = neighbours[side]
                if is_known[j]:
                    continue
                is_known[j], queue[last] = True, j
                last += 1
                along = 0.0
                for d in range(3):
                    along += directions[i, d] * directions[j, d]
                if angles[j] > 0.0:
                    wholes[j] = np.round((full * along - angles[j]) / (2.0 * np.pi))
    return wholes
