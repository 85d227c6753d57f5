"""Movement with a Delaunay graph of the surface and the held points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ..errors import MovementError
from ..mesh.moving_mesh import MovingMesh
from .centres import CentredInterpolation, Centres, find_centres
from .increments import IncrementalMover
from .interpolation import InterpolatedStep, interpolated_step
from .tetrahedra import signed_volumes, tetrahedra

__all__ = ["DelaunayGraph"]

OUTSIDE = 0.1
"""A point may be outside of the tetrahedron that carries it by this barycentric coordinate."""


@dataclass(frozen=True)
class DelaunayGraph(IncrementalMover):
    """Move every point with the tetrahedron of surface and held points that it is in.

    The graph connects the points as they are before each increment. With one increment the moved points are linear in
    the surface. With several, another surface may connect the graph differently, and derivatives jump: they are exact
    for the connections that were made.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    n_increments : int or "auto"
        Increments of the move.

    Notes
    -----
    A move raises `MovementError` if a tetrahedron that carries points inverts, or a point is in none, as on a boundary
    that is released.

    References
    ----------
    X. Liu, N. Qin and H. Xia, "Fast dynamic grid deformation based on Delaunay graph mapping", Journal of
    Computational Physics 211, 2006.
    """

    mesh: MovingMesh
    n_increments: int | str = 1

    name = "delaunay graph"

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        centres = self._centres
        targets, points = before[centres.target_ids], centres.position @ before
        displacement = centres.displacement(surface - before[self.mesh.surface_ids])
        graph, which = tetrahedra(points, targets)
        corners, coordinates = graph.corners[which], graph.coordinates(which, targets)
        self._refuse(
            coordinates.min(axis=1) < -OUTSIDE,
            "no tetrahedron carries {}; hold the boundary about it (fixed, --fix)",
        )
        is_inverted = signed_volumes(points + displacement, corners) <= 0.0
        self._refuse(is_inverted, "the tetrahedron that carries {} inverts; take more increments")
        rows = np.repeat(np.arange(len(targets)), 4)
        weights = sparse.csr_array((coordinates.ravel(), (rows, corners.ravel())), shape=(len(targets), len(points)))
        stretch = (displacement[corners[:, 1:]] - displacement[corners[:, :1]]).transpose(0, 2, 1)
        carried = _Carried(weights, stretch @ graph.inverses[which], weights @ displacement)
        return interpolated_step(self.mesh, before, surface, CentredInterpolation(centres, carried))

    def _refuse(self, is_bad: np.ndarray, what: str) -> None:
        """Name the first bad target."""
        if is_bad.any():
            place = self.mesh.place_of_point(self._centres.target_ids[np.argmax(is_bad)])
            raise MovementError(f"Delaunay graph: {what.format(place)}, or another mover")

    @cached_property
    def _centres(self) -> Centres:
        return find_centres(self.mesh)


@dataclass(frozen=True, eq=False)
class _Carried:
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
