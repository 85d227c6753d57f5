"""Point inversion: which volume of a B-spline mesh holds a point, and at which parameters.

With them, points that were never fitted (an unstructured mesh, a denser grid, a cloud of probes) are embedded in the
control mesh: they move with it, exactly and differentiably, through the same evaluation as the grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..numerics.threads import thread_count
from ..splines.mesh import BSplineMesh
from .descent import descend
from .evaluator import Evaluator
from .search import VolumeSamples, nearest_samples, sample_mesh
from .shared_sections import section_codes, shared_with_lower

__all__ = ["PointInversion", "embed_points", "invert_points", "require_inside"]

INSIDE = 1e-9
"""Default tolerance: distance, relative to the diagonal of the control mesh, up to which a point counts as inside."""

FOUND = 1e-12
"""Distance, relative to the same, that is taken for none: volumes that both come so near hold the point alike."""

ROUND_OFF = 16 * np.finfo(float).eps
"""Distance, relative to the largest coordinate, at which a descent has reached round-off."""

CHUNK = 65536
"""Points at a time, so that memory stays bounded (about 300 bytes per point of a chunk)."""


@dataclass(frozen=True, eq=False)
class PointInversion:
    """Where points lie in a B-spline mesh.

    Parameters
    ----------
    volume : ndarray of int, shape (n,)
        Volume nearest to each point, from 0; the lowest of those that share the nearest point.
    parameters : ndarray, shape (n, 3)
        Parameters of the nearest point of that volume.
    distance : ndarray, shape (n,)
        Distance between the two points, in metres; round-off for a point inside.
    is_inside : ndarray of bool, shape (n,)
        Whether the distance is within the tolerance.
    """

    volume: np.ndarray
    parameters: np.ndarray
    distance: np.ndarray
    is_inside: np.ndarray

    @property
    def n_points(self) -> int:
        """Number of points."""
        return self.volume.size


def invert_points(
    mesh: BSplineMesh,
    control_points: np.ndarray,
    points: np.ndarray,
    tolerance: float | None = None,
    n_threads: int | None = None,
) -> PointInversion:
    """Find the parameters of points in the volumes of a mesh.

    Parameters
    ----------
    mesh : BSplineMesh
        The volumes.
    control_points : ndarray, shape (n_control_points, 3)
        Control points, in metres.
    points : ndarray, shape (n, 3)
        Points to look for, in metres.
    tolerance : float, optional
        Distance in metres up to which a point counts as inside. By default 1e-9 of the diagonal of the control mesh:
        nodes of a fitted grid that lie on its boundary are off by the fit error, and need more than that.
    n_threads : int, optional
        Number of threads; by default ``NUMBA_NUM_THREADS``.

    Returns
    -------
    PointInversion
        Points outside get the nearest point of the mesh. The result does not depend on the number of threads.

    Raises
    ------
    InputError
        If an array has the wrong shape or holds a number that is not finite.
    """
    control_points = _checked("control points", control_points, mesh.n_control_points)
    points = _checked("point inversion", points)
    diagonal = np.linalg.norm(np.ptp(control_points, axis=0))
    search = _Search(
        mesh=mesh,
        nets=tuple(mesh.nets(control_points)),
        samples=tuple(sample_mesh(mesh, control_points)),
        is_shared=shared_with_lower(mesh),
        target=ROUND_OFF * np.abs(control_points).max(),
        found=max(FOUND * diagonal, 4 * ROUND_OFF * np.abs(control_points).max()),
        n_threads=thread_count(n_threads),
    )
    nearest = nearest_samples(search.samples)
    chunks = [_invert_chunk(search, nearest, points[i : i + CHUNK]) for i in range(0, max(len(points), 1), CHUNK)]
    volume, parameters, distance = (np.concatenate(parts) for parts in zip(*chunks))
    return PointInversion(
        volume, parameters, distance, distance <= (INSIDE * diagonal if tolerance is None else tolerance)
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """What stays the same for all points."""

    mesh: BSplineMesh
    nets: tuple[np.ndarray, ...]
    samples: tuple[VolumeSamples, ...]
    is_shared: np.ndarray
    target: float
    found: float
    n_threads: int

    def descend(self, volume: int, points, starts):
        """Closest points of one volume."""
        return descend(self.mesh.volumes[volume], self.nets[volume], points, starts, self.target, self.n_threads)


def _invert_chunk(search: _Search, nearest, points: np.ndarray):
    """First the volume of the nearest sample alone, then all others that may hold a point or be nearer."""
    volume, starts = nearest(points)
    parameters, distance = np.empty_like(points), np.empty(len(points))
    for v in np.unique(volume):
        ids = np.flatnonzero(volume == v)
        parameters[ids], distance[ids] = search.descend(v, points[ids], starts[ids, None])
    for v in range(len(search.samples)):
        _try_volume(search, v, points, volume, parameters, distance)
    return volume, parameters, distance


def _try_volume(search: _Search, v: int, points, volume, parameters, distance):
    """Move the points that volume ``v`` holds, or comes nearer to, over to it; all arrays are updated in place."""
    ids = _candidates(search, v, points, volume, parameters, distance)
    xi, found = search.descend(v, points[ids], search.samples[v].starts(points[ids]))
    is_nearer = found < distance[ids] - search.found
    is_lower = (v < volume[ids]) & (found <= distance[ids] + search.found)
    ids, moved = ids[is_nearer | is_lower], is_nearer | is_lower
    volume[ids], parameters[ids], distance[ids] = v, xi[moved], found[moved]


def _candidates(search: _Search, v: int, points, volume, parameters, distance) -> np.ndarray:
    """Points not found so far that volume ``v`` may be nearer to, and those found in a higher one that it shares."""
    is_shared = search.is_shared[volume, section_codes(parameters), v]
    ids = np.flatnonzero(is_shared | (distance > search.found))
    return ids[search.samples[v].box_distance(points[ids]) <= distance[ids] + search.found]


def require_inside(inversion: PointInversion, source: str = "points") -> PointInversion:
    """Return the inversion where all points are inside.

    Parameters
    ----------
    inversion : PointInversion
        Result of `invert_points`.
    source : str
        What the points are, for the message.

    Raises
    ------
    InputError
        If points lie outside: how many, the first few (from 1) and their distance to the mesh.
    """
    outside = np.flatnonzero(~inversion.is_inside)
    if outside.size:
        first = ", ".join(f"point {q + 1} at distance {inversion.distance[q]:.3g}" for q in outside[:3])
        more = ", ..." if outside.size > 3 else ""
        raise InputError(
            f"{source}: {outside.size} of {inversion.n_points} points lie outside all volumes: {first}{more}; "
            f"remove them or raise the tolerance (largest distance {inversion.distance[outside].max():.3g})"
        )
    return inversion


def embed_points(mesh: BSplineMesh, inversion: PointInversion) -> Evaluator:
    """Embed points in a mesh: make the evaluation that moves them with the control points.

    Parameters
    ----------
    mesh : BSplineMesh
        The volumes.
    inversion : PointInversion
        Volumes and parameters of the points. A point outside moves as its nearest point in the mesh: call
        `require_inside` first, or add the difference afterwards.

    Returns
    -------
    Evaluator
        ``forward(control_points)`` gives the points, shape (n, 3), in the order of the inversion; ``adjoint`` is its
        transpose.
    """
    rows = [np.flatnonzero(inversion.volume == v) for v in range(len(mesh.volumes))]
    parameters = [np.ascontiguousarray(inversion.parameters[ids]) for ids in rows]
    return Evaluator.build(mesh, parameters, rows, inversion.n_points)


def _checked(what: str, points: np.ndarray, n: int | None = None) -> np.ndarray:
    """Points as a contiguous float array of shape (n, 3)."""
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or (n is not None and len(points) != n):
        raise InputError(f"{what}: an array of shape {points.shape}; give shape ({n or 'n'}, 3)")
    is_bad = ~np.isfinite(points).all(axis=1)
    if is_bad.any():
        q = int(np.argmax(is_bad))
        raise InputError(f"{what}: point {q + 1} of {len(points)} is not finite: {points[q]}; remove or repair it")
    return points
