"""Rotations of the surface from its points at rest to their new places, and how they fade out into the volume.

1. Every surface point takes the rotation that best fits the motion of the quads around it
   (`bspline_mdao.core.walls.rotations.LocalRotations`), as a vector that is continued along the surface.
2. The vectors are extended by the harmonic field of `bspline_mdao.core.movement.target_gradients`. It is zero at fixed
   points, and along the normal where points slide in a plane, which then turn in the plane. Its components are
   uncoupled, except for planes at an angle to each other, so its matrix is scalar (`RotationUnknowns`).

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, csc_array, csr_array, eye_array, kron, tril

from ...base.numerics.processes import ONE
from ...base.numerics.rotation_group import unwrapped, vectors_jvp, vectors_vjp
from ...base.sparse.blocks import graph_of
from ...base.sparse.ordering import fill_reducing_order
from ...grids.topology.periodic_ties import Ties
from ..mesh.control_net import surface_quads
from ..mesh.moving_mesh import MovingMesh
from ..walls.rotations import LocalRotations, Rotations
from .equilibrium import Unknowns

__all__ = ["RotationUnknowns", "SurfaceVectors", "surface_rotations"]

SAME_PLANE = 6
"""Decimals to which the normals of one plane agree."""

ROUND_OFF = 1e-14
"""Largest component of a unit vector that is rounding."""


def surface_rotations(mesh: MovingMesh) -> LocalRotations:
    """The map from surface points to the rotation of each."""
    # A point on two planes of symmetry never turns. A point on the axis of a sector stays on it, and turns about it.
    ids, normals = mesh.in_plane_rows, mesh.in_plane_normals
    if mesh.surface_ties is not None:
        is_across = _is_across(mesh.surface_ties, ids, normals)
        ids, normals = ids[~is_across], normals[~is_across]
    planes, number = np.unique(np.round(normals * _sign(normals), SAME_PLANE), axis=0, return_inverse=True)
    number = number.ravel()
    rows, n_planes = np.unique(ids, return_counts=True)
    return LocalRotations.of(
        mesh.points[mesh.surface_ids],
        quads=surface_quads(mesh),
        planes=[(ids[number == k], normals[number == k][0]) for k in range(len(planes))],
        fixed=rows[n_planes > 1],
        ties=mesh.surface_ties,
    )


def _is_across(ties: Ties, ids: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Whether normals at points are directions across an axis on which the points lie."""
    across = np.zeros((1 + max(ids.max(initial=0), ties.on_axis.max(initial=0)), 3, 3))
    np.add.at(across, ties.on_axis, np.einsum("ni,nj->nij", ties.across, ties.across))
    off = normals - np.einsum("nij,nj->ni", across[ids], normals)
    return np.abs(off).max(axis=1, initial=0.0) < 10.0**-SAME_PLANE


def _sign(normals: np.ndarray) -> np.ndarray:
    """Sign of the largest component of each normal, shape (n, 1)."""
    largest = np.argmax(np.abs(normals), axis=1)[:, None]
    return np.sign(np.take_along_axis(normals, largest, axis=1))


@dataclass(frozen=True, eq=False)
class RotationUnknowns:
    """Numbering of the rotations of the points that may move, and the matrix of their extension."""

    # An unknown is the component along a direction that a point may turn about: a free point turns about three, a point
    # that slides in a plane about its normal, a point on the axis of a sector about the axis. All others do not turn.

    points: Unknowns  # the points that may move, with the pattern of their stiffness, all on this process
    comm: Any = ONE

    @cached_property
    def _directions(self) -> csr_array:
        """Directions of the unknowns, in the order of their elimination, shape (3 n, n_unknowns) for n points."""
        # Copies have the turned rotations of their originals. This couples components, so a point's come together.
        mesh, ids, ties = self.points.mesh, self.points.row_ids, self.points.ties
        rank = np.argsort(fill_reducing_order(*graph_of(self.points.pattern)))
        is_free = mesh.is_free[ids]
        rotating, sliding = (np.flatnonzero(is_free.sum(axis=1) == n) for n in (3, 2))
        fixed = np.argmin(is_free[sliding], axis=1)
        if mesh.ties is not None:  # points on an axis turn about it
            on_axis = np.flatnonzero((is_free.sum(axis=1) == 1) & np.isin(ids, mesh.ties.on_axis))
            sliding, fixed = np.append(sliding, on_axis), np.append(fixed, np.argmax(is_free[on_axis], axis=1))
        normals = np.eye(3)[fixed] if mesh.frames is None else mesh.frames[ids[sliding], fixed]
        # directions that free points turn about: normals first, so planes at right angles couple no components
        axes = np.linalg.qr(np.concatenate([mesh.plane_normals, np.eye(3)]).T)[0].T
        slots = np.concatenate([np.repeat([0, 1, 2], len(rotating)), np.argmax(np.abs(normals @ axes.T), axis=1)])
        rows = np.concatenate([np.tile(rotating, 3), sliding])
        vectors = np.concatenate([np.repeat(axes, len(rotating), axis=0), normals])
        vectors[np.abs(vectors) < ROUND_OFF] = 0.0
        order = np.lexsort((rank[rows], slots) if ties is None else (slots, rank[rows]))
        entries = (
            vectors[order].ravel(),
            (3 * rows[order, None] + [0, 1, 2]).ravel(),
            np.arange(0, 3 * len(rows) + 1, 3),
        )
        directions = csc_array(entries, shape=(3 * len(ids), len(rows)))
        directions.eliminate_zeros()
        return directions.tocsr() if ties is None else csr_array(self._turned @ directions)

    @property
    def _turned(self) -> csr_array:
        """Matrix to vectors of all points from those that are not copies, shape (3 n, 3 n_rows)."""
        of_points, n = self.points, len(self.points.point_ids)
        ties: Any = of_points.ties
        rows = np.searchsorted(of_points.row_ids, of_points.point_ids)
        rows[ties.copies] = rows[ties.originals]
        turns = np.tile(np.eye(3), (n, 1, 1))
        turns[ties.copies] = ties.turns
        return bsr_array((turns, rows, np.arange(n + 1)), shape=(3 * n, 3 * len(of_points.row_ids))).tocsr()

    def matrix(self, add_stiffness: Callable[..., None]) -> csc_array:
        """Stiffness of the unknowns, of a Laplacian of each component; see `Unknowns.matrix`."""
        whole = self.points.assembled(add_stiffness)
        pattern, data = whole.pattern, whole.data
        lower = csr_array((data[:, 0, 0], pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n))
        of_points = lower + tril(lower, -1).T
        return csc_array(self._directions.T @ kron(of_points, eye_array(3), format="csr") @ self._directions)

    def gather(self, force: np.ndarray) -> np.ndarray:
        """Components of a force, shape (n_points, 3), along the directions: shape (n_unknowns,)."""
        return self._directions.T @ force[self.points.point_ids].ravel()

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Transpose of `gather`."""
        vectors = np.zeros((self.points.mesh.n_points, 3))
        vectors[self.points.point_ids] = (self._directions @ unknowns).reshape(-1, 3)
        return vectors


@dataclass(frozen=True, eq=False)
class SurfaceVectors:
    """Rotation vectors of the surface points in one move, shape (n_surface, 3), and their derivative."""

    rotations: Rotations
    found: np.ndarray  # as found from the faces around each point
    ties: Ties | None = None  # surface points of periodic sides, whose faces are on either side: the mean counts

    @classmethod
    def of(
        cls, local: LocalRotations, initial: np.ndarray, surface: np.ndarray, ties: Ties | None = None
    ) -> SurfaceVectors:
        """Vectors of a move of surface points, both of shape (n_surface, 3)."""
        rotations = local.at(initial, surface)
        return cls(rotations, unwrapped(rotations.matrices, local.starts, local.neighbours), ties)

    @property
    def values(self) -> np.ndarray:
        """The vectors."""
        return self._alike(self.found)

    def _alike(self, vectors: np.ndarray) -> np.ndarray:
        return vectors if self.ties is None else self.ties.alike(vectors.copy())

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the vectors."""
        change = vectors_jvp(self.found, self.rotations.matrices, self.rotations.jvp(d_initial, d_surface))
        return self._alike(change)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        bar = vectors_vjp(self.found, self.rotations.matrices, self._alike(bar))
        bars = self.rotations.vjp(bar, ("initial", "moved"))
        return bars["initial"], bars["moved"]
