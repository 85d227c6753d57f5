"""The surface as a net of control points: its quads, and a normal at every point.

The normal at a point is the mean of the unit normals at the corners of the quads around it, weighted by their angles,
so it does not depend on how the surface is cut into quads. At a sharp edge it bisects the angle between the two sides.
If the sides lie on one another, as around a plate, their normals cancel. The normal then takes its limit for ever
thinner sides, which is in the plane of the quads and bisects the angle that they leave open. On a plane of symmetry the
normal is that of the surface with its mirror image, so it lies in the plane. Theory: ``docs/theory/free_form.rst``.

References
----------
J. A. Baerentzen and H. Aanaes, Signed distance computation using the angle weighted pseudonormal, *IEEE Transactions on
Visualization and Computer Graphics* 11, 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.numerics.vectors import dots, lengths, unit_vectors
from ...errors import InputError
from ...grids.topology.boundary_surface import facing, quads_in_turn
from .moving_mesh import MovingMesh

__all__ = ["surface_normals", "surface_quads"]

CANCELLED = 1e-6
"""Fraction of the sum of all angles below which the weighted normals around a point count as cancelling: the sides of a
plate lie on one another up to the error of the fit."""

COLLAPSED = 1e-12
"""Length of an edge, relative to the mesh, that is round-off: the edge has collapsed."""


def surface_quads(
    mesh: MovingMesh,  # the mesh
) -> np.ndarray:
    """Quads of surface control points between the surface and the fluid."""
    # Returns (n_quads, 4) of int, rows of ``mesh.surface_ids`` of the corners, around the normal into the fluid. A
    # collapsed quad has equal corners.
    if mesh.surface_faces is not None:
        return mesh.surface_faces
    quads = np.concatenate([_side_quads(mesh.points, ids, side) for ids in mesh.blocks for side in range(6)])
    quads = mesh.surface_rows[quads]
    quads = quads[(quads >= 0).all(axis=1)]
    _, first, counts = np.unique(np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True)
    return quads[np.sort(first[counts == 1])]  # quads between two blocks occur twice


def _side_quads(points: np.ndarray, ids: np.ndarray, side: int) -> np.ndarray:
    """Quads of one side of a block, around the normal into it."""
    layer = np.take(ids, -(side % 2), axis=side // 2)
    inner = np.take(ids, -2 if side % 2 else 1, axis=side // 2)
    return quads_in_turn(facing(layer, inner, points))


def surface_normals(
    mesh: MovingMesh,  # the mesh
) -> np.ndarray:  # (n_surface, 3), in the order of ``mesh.surface_ids``
    """Unit normals of the surface's net of control points on the baseline, into the fluid."""
    points, quads = mesh.points[mesh.surface_ids], surface_quads(mesh)
    corners = _Corners.of(points[quads], COLLAPSED * mesh.size)
    sums, outward = (_sum_at(quads, part, len(points)) for part in (corners.normals, corners.outward))
    angles = np.bincount(quads.ravel(), corners.angles.ravel(), len(points))
    has_cancelled = lengths(sums) <= CANCELLED * angles
    sums[has_cancelled] = outward[has_cancelled]
    rows, normals = mesh.in_plane_rows, mesh.in_plane_normals
    np.subtract.at(sums, rows, dots(sums[rows], normals)[:, None] * normals)
    sizes = lengths(sums)
    if sizes.min() <= CANCELLED:
        place = mesh.place_of_surface_point(np.argmin(sizes))
        raise InputError(f"surface: {place} has no normal, its quads have no extent; give a vector as the direction")
    return sums / sizes[:, None]


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners of quads: angles, shape (n, 4), and vectors weighted by them, shape (n, 4, 3)."""

    angles: np.ndarray
    normals: np.ndarray
    outward: np.ndarray
    """Integral of the unit directions away from the quad over the angle."""

    @classmethod
    def of(cls, x: np.ndarray, smallest: float) -> _Corners:
        """Corners of quads, shape (n, 4, 3); the diagonal replaces an edge of negligible length."""
        ahead, across, behind = (np.roll(x, -step, axis=1) - x for step in (1, 2, 3))
        ahead = _unit(np.where(lengths(ahead)[..., None] > smallest, ahead, across))
        behind = _unit(np.where(lengths(behind)[..., None] > smallest, behind, across))
        area = np.cross(ahead, behind)
        angles = np.arctan2(lengths(area), dots(ahead, behind))
        outward = -2.0 * np.sin(0.5 * angles)[..., None] * _unit(ahead + behind)
        return cls(angles, angles[..., None] * _unit(area), outward)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1; negligible ones become zero."""
    return unit_vectors(vectors, np.zeros(3), COLLAPSED)


def _sum_at(quads: np.ndarray, vectors: np.ndarray, n: int) -> np.ndarray:
    """Sum vectors of corners, shape (n_quads, 4, 3), at the points of the corners, shape (n, 3)."""
    return np.stack([np.bincount(quads.ravel(), vectors[..., d].ravel(), n) for d in range(3)], axis=1)
