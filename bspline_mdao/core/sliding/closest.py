"""Closest points on fixed surfaces, and on curves in which several of them meet, with exact derivatives.

The point q nearest to p with F_k(q) = h_k for the function of every surface k, where h_k is its value for the point at
rest, solves

    q - p + sum_k l_k grad F_k(q) = 0,    F_k(q) = h_k .

Newton's method finds q and the multipliers l from q = p. For one surface whose function is the distance it converges in
one step, and at rest it takes none. By the implicit function theorem dq/dp is the first block of the inverse of the
matrix

    [ I + sum_k l_k H_k   J^T ]
    [ J                    0  ] ,

with the Hessians H_k and the gradients J. It is symmetric. The block next to it is dq/dh.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.checks import as_array
from ...base.display import OneLine
from ...errors import InputError, MovementError
from .fixed_surface import FixedSurface

__all__ = ["Closest", "closest_on"]

MAX_STEPS = 30
"""Most steps of Newton's method: from within a radius of curvature it takes fewer than ten."""

ROUND_OFF = 1e-14
"""Steps below this fraction of the largest coordinate are rounding; one more gives the derivatives their digits."""


INDEFINITE = 1e-9
"""The derivative at a nearest point has no negative eigenvalue; one below minus this is more than rounding."""


@dataclass(frozen=True, eq=False)
class Closest(OneLine):
    """Closest points and their derivative."""

    points: np.ndarray  # (n, 3), in metres
    jacobians: np.ndarray  # (n, 3, 3), symmetric
    by_heights: np.ndarray  # (n, 3, n_surfaces), derivative in the heights

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the closest points with a change of the points, both of shape (n, 3)."""
        return np.einsum("nij,nj->ni", self.jacobians, change)

    vjp = jvp


def closest_on(
    surfaces: Sequence[FixedSurface], points: np.ndarray, heights: np.ndarray | None = None, what: str = "sliding"
) -> Closest:
    """Find the points nearest to given ones on surfaces.

    Parameters
    ----------
    surfaces : sequence of FixedSurface
        One surface, or several: then points go to the curve, or the point, in which these meet.
    points : ndarray, shape (n, 3)
        The points (m), real or complex.
    heights : ndarray, shape (n_surfaces, n), optional
        Values of the surfaces' functions at the closest points, heights above them (m); zero by default.
    what : str
        What the points are, for messages.

    Returns
    -------
    Closest
        ``points``, ``jvp`` and ``vjp``.

    Raises
    ------
    InputError
        If a shape is wrong.
    MovementError
        If a point has no closest one nearby: it is as far from a surface as its centre of curvature, or the
        surfaces do not meet.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import Cylinder, closest_on
    >>> tunnel = Cylinder(origin=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=2.0)
    >>> closest_on([tunnel], np.array([[5.0, 3.0, 4.0]])).points.round(12)
    array([[5. , 1.2, 1.6]])
    """
    points = as_array(points, f"{what}: points")
    n, k = len(points), len(surfaces)
    heights = np.zeros((k, n)) if heights is None else heights
    if points.shape != (n, 3) or np.shape(heights) != (k, n):
        raise InputError(f"{what}: points of shape {points.shape}; give shape (n, 3), and a height for each")
    found, multipliers = surfaces[0].near(points), np.zeros((n, k), dtype=points.dtype)
    tolerance = ROUND_OFF * np.abs(points).max(initial=0.0)
    for _ in range(MAX_STEPS):
        step = _solved(*_system(surfaces, points, heights, found, multipliers), what)
        found, multipliers = found + step[:, :3], multipliers + step[:, 3:]
        if not np.abs(step[:, :3]).max(initial=0.0) > tolerance:
            break
    else:
        raise _lost(what, points[np.argmax(np.abs(step[:, :3]).max(axis=1))])
    matrix, right = _system(surfaces, points, heights, found, multipliers)
    inverse = _solved(matrix, np.broadcast_to(np.eye(k + 3), matrix.shape), what)[:, :3]
    jacobians, by_heights = inverse[:, :, :3], inverse[:, :, 3:]
    least = np.linalg.eigvalsh(jacobians.real).min(axis=1, initial=0.0)
    if least.min(initial=0.0) < -INDEFINITE:  # another point of the surface is nearer
        raise _lost(what, points[np.argmin(least)])
    return Closest(found + _solved(matrix, right, what)[:, :3], jacobians, by_heights)


def _system(
    surfaces: Sequence[FixedSurface],
    points: np.ndarray,
    heights: np.ndarray,
    found: np.ndarray,
    multipliers: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Matrices, (n, 3 + k, 3 + k), and right-hand sides, (n, 3 + k), of a step."""
    n, k = multipliers.shape
    matrix = np.zeros((n, 3 + k, 3 + k), dtype=found.dtype)
    matrix[:, :3, :3] = np.eye(3)
    right = np.concatenate([points - found, np.zeros((n, k))], axis=1)
    for number, surface in enumerate(surfaces):
        values, gradients, hessians = surface.levels(found)
        factor = multipliers[:, number]
        matrix[:, :3, :3] += factor[:, None, None] * hessians
        matrix[:, :3, 3 + number] = matrix[:, 3 + number, :3] = gradients
        right[:, :3] -= factor[:, None] * gradients
        right[:, 3 + number] = heights[number] - values
    return matrix, right


def _solved(matrix: np.ndarray, right: np.ndarray, what: str) -> np.ndarray:
    """Solve for each point; right-hand sides of shape (n, m) or (n, m, p)."""
    try:
        solution = np.linalg.solve(matrix, right if right.ndim == 3 else right[:, :, None])
    except np.linalg.LinAlgError:
        raise MovementError(f"{what}: surfaces touch at a node, or it is at their centre of curvature") from None
    return solution if right.ndim == 3 else solution[:, :, 0]


def _lost(what: str, point: np.ndarray) -> MovementError:
    place = point.real.round(6).tolist()
    return MovementError(f"{what}: the node taken to {place} has no closest point nearby; take a smaller step")
