"""Tetrahedra of a Delaunay graph: what is inside of them, and where points are in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial import Delaunay, QhullError
from threadpoolctl import threadpool_limits

from ..errors import MovementError
from ..numerics.vectors import dot, less, row

__all__ = ["Tetrahedra", "signed_volumes", "tetrahedra"]

FLAT = 1e-7
"""A tetrahedron is flat, and holds no point, whose least height is less than this part of its longest edge."""

STRAIGHT = 1e-9
"""A triangle counts as no smaller than this part of its longest edge squared."""


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Tetrahedra that are not flat.

    Parameters
    ----------
    corners : ndarray of int, shape (n, 4)
        Points at their corners, in the order of positive volume.
    origins : ndarray, shape (n, 3)
        First corners (m).
    inverses : ndarray, shape (n, 3, 3)
        Inverses of the matrices whose columns are the edges from the first corner to the others (1/m).
    """

    corners: np.ndarray
    origins: np.ndarray
    inverses: np.ndarray

    def coordinates(self, which: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Barycentric coordinates, shape (n_points, 4), of each point in the tetrahedron of its own."""
        others = np.einsum("nij,nj->ni", self.inverses[which], points - self.origins[which])
        return np.column_stack([1.0 - others.sum(axis=1), others])


def signed_volumes(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Six times the volume of tetrahedra, shape (n,)."""
    edges = points[corners[:, 1:]] - points[corners[:, :1]]
    return np.einsum("ni,ni->n", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])


def tetrahedra(points: np.ndarray, targets: np.ndarray) -> tuple[Tetrahedra, np.ndarray]:
    """Connect points by the Delaunay criterion, and find the tetrahedron that each target is in.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Points of the graph (m).
    targets : ndarray, shape (n_targets, 3)
        Points to be found (m).

    Returns
    -------
    tetrahedra : Tetrahedra
        Those that are not flat.
    which : ndarray of int, shape (n_targets,)
        For each target, the one that it is in, or nearest to being in.

    Raises
    ------
    MovementError
        If the points are all in one plane.
    """
    try:
        graph = Delaunay(points)
    except QhullError as error:
        raise MovementError("Delaunay graph: the surface and held points span no volume; hold a far field") from error
    corners = graph.simplices.copy()
    volumes = signed_volumes(points, corners)
    corners[volumes < 0.0, :2] = corners[volumes < 0.0, 1::-1]
    is_full = np.abs(volumes) > FLAT * _longest_by_largest(points[corners])
    ends = points[corners[is_full]]
    full = Tetrahedra(corners[is_full], ends[:, 0], np.linalg.inv((ends[:, 1:] - ends[:, :1]).transpose(0, 2, 1)))
    numbers = np.append(np.where(is_full, np.cumsum(is_full) - 1, -1), -1)  # the last one for points outside
    with threadpool_limits(1, user_api="blas"):  # one small system for each tetrahedron: threads only wait
        which = numbers[graph.find_simplex(targets)]
    lost = which < 0
    which[lost] = _best(targets[lost], full.origins, full.inverses)
    return full, which


def _longest_by_largest(ends: np.ndarray) -> np.ndarray:
    """Longest edge of tetrahedra, (n, 4, 3), times twice their largest face."""
    edges = ends[:, [1, 2, 3, 2, 3, 3]] - ends[:, [0, 0, 0, 1, 1, 2]]
    faces = np.cross(edges[:, [0, 0, 1, 3]], edges[:, [1, 2, 2, 4]])
    longest = np.linalg.norm(edges, axis=-1).max(axis=1)
    return longest * np.maximum(np.linalg.norm(faces, axis=-1).max(axis=1), STRAIGHT * longest**2)


@njit(cache=True, error_model="numpy")
def _best(targets, origins, inverses):
    """Tetrahedron of each target in which its least barycentric coordinate is greatest."""
    best = np.zeros(len(targets), np.int64)
    for j in range(len(targets)):
        greatest = -np.inf
        for t in range(len(origins)):
            along = less(row(targets, j), row(origins, t))
            b, c, d = dot(row(inverses[t], 0), along), dot(row(inverses[t], 1), along), dot(row(inverses[t], 2), along)
            least = min(min(b, c), min(d, 1.0 - b - c - d))
            if least > greatest:
                greatest, best[j] = least, t
    return best
