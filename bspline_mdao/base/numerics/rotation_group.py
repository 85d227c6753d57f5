"""Rotations as vectors: w turns about its own direction by its length, with no bound on the angle but a full turn.

With W = [w]x, t = w . w and the angle theta = sqrt(t), Rodrigues' formula and the inverse of its derivative are

    R = exp(W) = I + a W + b W^2,        a = sin(theta) / theta,  b = (1 - cos(theta)) / t,
    dw = (I + W / 2 + c W^2) q  for  dR = R [q]x,        c = (1 - theta / 2 cot(theta / 2)) / t.

All of a, b, c are smooth functions of t, series where t is small. The vector of a rotation is determined up to whole
turns about its direction; along a surface it is continued, so that neighbours differ by less than half a turn.

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numba import njit

__all__ = [
    "NO_ROTATION",
    "nearest_to_any",
    "turns",
    "turns_jvp",
    "turns_vjp",
    "unwrapped",
    "vectors_jvp",
    "vectors_vjp",
]

NO_ROTATION = 1e-14
"""Angles below this are rounding: what is at rest does not turn."""

SERIES_BELOW = 0.25
"""Squares of angles below which series are summed; their last terms are below the unit round-off there."""

_A = np.array([(-1.0) ** k / factorial(2 * k + 1) for k in range(10)])
_B = np.array([(-1.0) ** k / factorial(2 * k + 2) for k in range(10)])
_C = 1.0 / np.array([12.0, 720.0, 30240.0, 1209600.0, 47900160.0, 1307674368000.0 / 691.0, 74724249600.0])


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
    # 1. Take the vector of at most half a turn of every point, by way of its quaternion.
    # 2. Start at the point that turns least, of all points that are joined with it.
    # 3. Go on from neighbour to neighbour, the nearest first, and take the whole turns that bring each vector next to
    #    that of the point that it is reached from.
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
    """The rotation nearest to matrices, shape (n, 3, 3), of any determinant."""
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
    """Unit vectors, or zero where nothing turns, and angles up to half a turn."""
    products = _attitudes(matrices) + np.eye(4)  # four times those of the components of the quaternion
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
