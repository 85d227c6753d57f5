"""The rim of a surface: where it is open, and the planes of symmetry that close it."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..mesh.frame import Plane
from ..mesh.surface import SurfaceGrid

__all__ = ["apexes_of_caps", "open_edges", "planes_of_edges"]

_IN_PLANE = 1e-6
"""Distance from a plane, relative to the diagonal of the surface's box, at which an edge still lies in it."""


def open_edges(surface: SurfaceGrid) -> np.ndarray:
    """Edges that bound one quad only, shape (n, 2): their nodes, in the direction in which the quad has them."""
    start, end = surface.quads.ravel(), np.roll(surface.quads, -1, axis=1).ravel()
    start, end = start[start != end].astype(np.int64), end[start != end].astype(np.int64)
    there, back = start * surface.n_points + end, end * surface.n_points + start
    is_open = ~np.isin(there, back)
    return np.stack([start, end], axis=1)[is_open]


def planes_of_edges(surface: SurfaceGrid, edges: np.ndarray, what: str) -> tuple[tuple[Plane, ...], np.ndarray]:
    """Find the plane of symmetry in which each open edge lies.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    edges : ndarray of int, shape (n, 2)
        Its open edges.
    what : str
        What is measured, for the message.

    Returns
    -------
    planes : tuple of Plane
        Those in which there are edges.
    numbers : ndarray of int, shape (n,)
        Plane of each edge.

    Raises
    ------
    InputError
        If an edge lies in none.
    """
    ends = surface.points[edges]
    distance = [np.abs(ends @ plane.normal - plane.offset).max(axis=1) for plane in surface.planes]
    is_far = np.reshape(distance, (len(surface.planes), len(edges))) > _IN_PLANE * surface.size
    if is_far.all(axis=0).any():
        raise InputError(_complaint(surface, edges[np.argmax(is_far.all(axis=0))], what))
    used, numbers = np.unique(np.argmin(is_far, axis=0) if len(edges) else [], return_inverse=True)
    return tuple(surface.planes[int(number)] for number in used), numbers


def apexes_of_caps(planes: tuple[Plane, ...], middle: np.ndarray, size: float, what: str) -> np.ndarray:
    """Give each plane the point from which the opening in it is closed by triangles, one for all where they meet.

    Parameters
    ----------
    planes : tuple of Plane
        Planes that a body ends on.
    middle : ndarray, shape (3,)
        Point near which the points are wanted (m).
    size : float
        Size of the body (m).
    what : str
        What is measured, for the message.

    Returns
    -------
    ndarray, shape (n_planes, 3)

    Raises
    ------
    InputError
        If the planes neither have a point in common nor are parallel.
    """
    normals, offsets = np.array([plane.normal for plane in planes]), np.array([plane.offset for plane in planes])
    common = middle + np.linalg.pinv(normals, rcond=1e-5) @ (offsets - normals @ middle)
    beside = offsets - normals @ common
    if (np.abs(beside) > _IN_PLANE * size).any() and np.linalg.matrix_rank(normals, tol=1e-5) > 1:
        raise InputError(f"{what}: the planes of symmetry neither have a point in common nor are parallel")
    return common + beside[:, None] * normals


def _complaint(surface, edge, what):
    """Name an open edge."""
    holders = [name for name, ids in zip(surface.names, surface.faces) if np.isin(edge, ids).all()]
    a, b = ("({:g}, {:g}, {:g})".format(*point) for point in surface.points[edge])
    return (
        f"{what}: the surface is open at the edge from {a} to {b} of {holders[0]}, and no plane of symmetry closes it; "
        f"add the patch that does"
    )
