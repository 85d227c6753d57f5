"""Movement with a Delaunay graph of the surface and the fixed points. Theory: ``docs/theory/movers.rst``.

The graph is a set of tetrahedra, made by Qhull. This module finds the one that contains each point, and moves the point
with it. Step numbers refer to `DelaunayGraph`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy import sparse
from scipy.spatial import Delaunay, QhullError

from ...base.numerics.threads import one_blas_thread
from ...base.numerics.vectors import dot, less, row
from ...errors import MovementError
from ..mesh.moving_mesh import MovingMesh
from .increments import IncrementalMover
from .interpolation import CentredInterpolation, Centres, InterpolatedStep, find_centres, interpolated_step

__all__ = ["DelaunayGraph", "Tetrahedra", "signed_volumes", "tetrahedra"]

OUTSIDE = 0.1
"""A point may be outside of the tetrahedron that it moves with by this barycentric coordinate, as next to curved
boundaries, where the graph cuts corners."""

FLAT = 1e-7
"""A tetrahedron is flat, and contains no point, if its least height is below this fraction of its longest edge."""

STRAIGHT = 1e-9
"""Least area of a triangle, relative to its longest edge squared."""


@dataclass(frozen=True)
class DelaunayGraph(IncrementalMover):
    """Move every point with the tetrahedron of surface and fixed points that contains it.

    The graph connects the points as they are before each increment. Steps of an increment, after the reference:

    1. connect the surface and fixed points by tetrahedra;
    2. find the tetrahedron that contains each other point, and the point's barycentric coordinates there;
    3. displace the surface, which must not invert a tetrahedron that contains points;
    4. give each point its old coordinates in its displaced tetrahedron.

    With one increment the moved points are linear in the surface. With several, another surface may connect the graph
    differently, and derivatives jump: they are exact for the connections of this move.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    n_increments : int
        Increments of the move.

    Notes
    -----
    A move raises `MovementError` if a tetrahedron that contains points inverts, or a point is in none, as on a released
    boundary.

    References
    ----------
    X. Liu, N. Qin and H. Xia, "Fast dynamic grid deformation based on Delaunay graph mapping", Journal of
    Computational Physics 211, 2006.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import DelaunayGraph, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> movement = DelaunayGraph(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> mesh.tangled(movement.points).n_invalid
    0
    """

    mesh: MovingMesh
    n_increments: int = 1

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        centres = self._centres
        targets, points = before[centres.target_ids], centres.position @ before
        displacement = centres.displacement(surface - before[self.mesh.surface_ids])
        graph, which = tetrahedra(points, targets)  # steps 1 and 2
        corners, coordinates = graph.corners[which], graph.coordinates(which, targets)
        self._refuse(
            coordinates.min(axis=1) < -OUTSIDE,
            "no tetrahedron holds {}; fix the boundary about it (fixed, --fix)",
        )
        # step 3
        is_inverted = signed_volumes(points + displacement, corners) <= 0.0
        self._refuse(is_inverted, "the tetrahedron that holds {} inverts; take more increments")
        # step 4, as weights of the displacements of the corners
        rows = np.repeat(np.arange(len(targets)), 4)
        weights = sparse.csr_array((coordinates.ravel(), (rows, corners.ravel())), shape=(len(targets), len(points)))
        stretch = (displacement[corners[:, 1:]] - displacement[corners[:, :1]]).transpose(0, 2, 1)
        linear = _Linear(weights, stretch @ graph.inverses[which], weights @ displacement)
        return interpolated_step(self.mesh, before, surface, CentredInterpolation(centres, linear))

    def _refuse(self, is_bad: np.ndarray, what: str) -> None:
        """Name the first bad target."""
        if is_bad.any():
            place = self.mesh.place_of_point(self._centres.target_ids[np.argmax(is_bad)])
            raise MovementError(f"Delaunay graph: {what.format(place)}, or another mover")

    @cached_property
    def _centres(self) -> Centres:
        return find_centres(self.mesh)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Displacements that are linear in each tetrahedron: barycentric weights, and gradients (n_targets, 3, 3)."""

    weights: sparse.csr_array
    gradients: np.ndarray
    values: np.ndarray

    def jvp(self, d_targets: np.ndarray, d_centres: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        relative = d_targets - self.weights @ d_centres
        return np.einsum("nij,nj->ni", self.gradients, relative) + self.weights @ d_displacement

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        relative_bar = np.einsum("nij,ni->nj", self.gradients, bar)
        return relative_bar, -(self.weights.T @ relative_bar), self.weights.T @ bar


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Tetrahedra that are not flat."""

    corners: np.ndarray  # (n, 4) of int, points at their corners, in the order of positive volume
    origins: np.ndarray  # (n, 3), first corners (m)
    # (n, 3, 3), inverses of the matrices whose columns are the edges from the first corner to the others (1/m)
    inverses: np.ndarray

    def coordinates(self, which: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Barycentric coordinates, shape (n_points, 4), of each point in its tetrahedron."""
        others = np.einsum("nij,nj->ni", self.inverses[which], points - self.origins[which])
        return np.column_stack([1.0 - others.sum(axis=1), others])


def signed_volumes(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Six times the volume of tetrahedra, shape (n,)."""
    edges = points[corners[:, 1:]] - points[corners[:, :1]]
    return np.einsum("ni,ni->n", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])


def tetrahedra(
    points: np.ndarray,  # (n_points, 3), points of the graph (m)
    targets: np.ndarray,  # (n_targets, 3), points to find (m)
) -> tuple[Tetrahedra, np.ndarray]:
    """Connect points by the Delaunay criterion, and find the tetrahedron that contains each target."""
    # Returns tetrahedra: the ones that are not flat; which: (n_targets,) of int, for each target, the one that contains
    # it or nearly does.
    try:
        graph = Delaunay(points)
    except QhullError as error:
        raise MovementError("Delaunay graph: the surface and fixed points span no volume; fix a far field") from error
    corners = graph.simplices.copy()
    volumes = signed_volumes(points, corners)
    corners[volumes < 0.0, :2] = corners[volumes < 0.0, 1::-1]
    is_full = np.abs(volumes) > FLAT * _longest_by_largest(points[corners])
    ends = points[corners[is_full]]
    full = Tetrahedra(corners[is_full], ends[:, 0], np.linalg.inv((ends[:, 1:] - ends[:, :1]).transpose(0, 2, 1)))
    numbers = np.append(np.where(is_full, np.cumsum(is_full) - 1, -1), -1)  # the last one for points outside
    with one_blas_thread:  # one small system per tetrahedron: threads would only wait
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
    """Tetrahedron of each target in which the target's least barycentric coordinate is greatest."""
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
