"""Point inversion: the volume of a B-spline mesh that contains a point, and the parameters there.

With these, points that were never fitted (an unstructured mesh, a denser grid, a cloud of probes) are embedded in the
control mesh: they move with it, exactly and differentiably, through the same evaluation as the grid.

1. Each volume is sampled on a lattice that follows its spans, so the samples are as clustered as the control mesh.
   The volume of the nearest sample is searched first, from that sample (`.closest_point`).
2. All other volumes that may contain a point or be nearer follow. The convex hull property gives a rigorous bound: no
   point of a volume lies outside the box of its control points.
3. A point of a face, edge or corner that volumes share is assigned to the lowest of them.

Theory: ``docs/theory/inversion.rst``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...base.numerics.threads import thread_count
from ...errors import InputError
from ..splines.knots import Knots
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume, evaluate
from .closest_point import descend
from .evaluator import Evaluator

INSIDE = 1e-9
"""Default tolerance: distance, relative to the diagonal of the control mesh, up to which a point counts as inside."""

FOUND = 1e-12
"""Distance, relative to the same, that counts as zero: all volumes this near contain the point."""

ROUND_OFF = 16 * np.finfo(float).eps
"""Distance, relative to the largest coordinate, at which a descent has reached round-off."""

CHUNK = 65536
"""Points at a time, which bounds memory (about 300 bytes per point of a chunk)."""

SAMPLES_PER_SPAN = 4
"""Samples per span and direction."""

MIN_SAMPLES = 6
"""Least number of samples in a direction that is not degenerate."""

START_RANKS = (0, 7, 63, 1, 20, 200)
"""Which of the nearest samples to start from. If samples are stretched, the nearest ones all lie in one column."""

N_OTHERS = 3
"""Volumes with the next nearest samples that are tried from one start each, before all are tried from several."""

ON_FACE = 1e-6
"""Parameters this close to 0 or 1 count as on the face: more than round-off, to miss no shared point."""

_SECTIONS = tuple(itertools.product((slice(None), slice(0, 1), slice(-1, None)), repeat=3))


@dataclass(frozen=True, eq=False)
class PointInversion(OneLine):
    """Volumes and parameters of points in a B-spline mesh."""

    # volume nearest to each point, from 0; the lowest one if several share the nearest point
    volume: np.ndarray  # int (n,)
    parameters: np.ndarray  # (n, 3), parameters of the nearest point of that volume
    distance: np.ndarray  # (n,), distance between the two points, in metres; round-off for a point inside
    is_inside: np.ndarray  # bool (n,), whether the distance is within the tolerance

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
        Points to find, in metres.
    tolerance : float, optional
        Distance in metres up to which a point counts as inside. By default 1e-9 of the diagonal of the control mesh.
        Nodes of a fitted grid on its boundary are off by the fit error and need a larger tolerance.
    n_threads : int, optional
        Number of threads; by default ``NUMBA_NUM_THREADS``.

    Returns
    -------
    PointInversion
        Points outside get the nearest point of the mesh. The result does not depend on the number of threads.

    Raises
    ------
    InputError
        If an array has the wrong shape or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import invert_points
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> inversion = invert_points(model.mesh, model.control_points, np.array([[2.0, 0.1, 0.2]]))
    >>> bool(inversion.distance.max() < 1e-9)
    True
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
    """The mesh, its samples and the tolerances of a search: the same for all points."""

    mesh: BSplineMesh
    nets: tuple[np.ndarray, ...]
    samples: tuple[VolumeSamples, ...]
    is_shared: np.ndarray
    target: float
    found: float
    n_threads: int

    def descend(self, volume: int, points: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Closest points of one volume."""
        return descend(self.mesh.volumes[volume], self.nets[volume], points, starts, self.target, self.n_threads)


def _invert_chunk(search: _Search, nearest: Callable, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Search the volume of the nearest sample, then all others that may contain a point or be nearer."""
    volume, starts = nearest(points)  # step 1
    parameters, distance = np.empty_like(points), np.empty(len(points))
    for v in np.unique(volume):
        ids = np.flatnonzero(volume == v)
        parameters[ids], distance[ids] = search.descend(v, points[ids], starts[ids, None])
    _try_nearest_others(search, points, volume, parameters, distance)
    for v in range(len(search.samples)):  # step 2
        _try_volume(search, v, points, volume, parameters, distance)
    return volume, parameters, distance


def _try_nearest_others(
    search: _Search, points: np.ndarray, volume: np.ndarray, parameters: np.ndarray, distance: np.ndarray
) -> None:
    """Search the volumes of the nearest samples except the first; arrays are updated in place."""
    # Most points that are not in the first volume are in one of these, which saves searching all volumes for them.
    ids = np.flatnonzero(distance > search.found)
    away, samples = (np.stack(x) for x in zip(*(s.tree.query(points[ids]) for s in search.samples)))
    away[volume[ids], np.arange(len(ids))] = np.inf
    order = np.argsort(away, axis=0)[: min(N_OTHERS, len(away) - 1)]
    for nearest in order:
        for v in np.unique(nearest):
            at = np.flatnonzero((nearest == v) & (distance[ids] > search.found))
            rows = ids[at]
            xi, found = search.descend(v, points[rows], search.samples[v].parameters[samples[v, at], None])
            is_nearer = found < distance[rows] - search.found
            rows = rows[is_nearer]
            volume[rows], parameters[rows], distance[rows] = v, xi[is_nearer], found[is_nearer]


def _try_volume(
    search: _Search, v: int, points: np.ndarray, volume: np.ndarray, parameters: np.ndarray, distance: np.ndarray
) -> None:
    """Assign to volume ``v`` the points that it contains or is nearer to; all arrays are updated in place."""
    ids = _candidates(search, v, points, volume, parameters, distance)
    xi, found = search.descend(v, points[ids], search.samples[v].starts(points[ids]))
    is_nearer = found < distance[ids] - search.found
    is_lower = (v < volume[ids]) & (found <= distance[ids] + search.found)  # step 3
    ids, moved = ids[is_nearer | is_lower], is_nearer | is_lower
    volume[ids], parameters[ids], distance[ids] = v, xi[moved], found[moved]


def _candidates(
    search: _Search, v: int, points: np.ndarray, volume: np.ndarray, parameters: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Points not yet found that volume ``v`` may be nearer to, and points of a higher volume that it shares."""
    is_shared = search.is_shared[volume, section_codes(parameters), v]
    ids = np.flatnonzero(is_shared | (distance > search.found))
    return ids[search.samples[v].box_distance(points[ids]) <= distance[ids] + search.found]


def require_inside(inversion: PointInversion, source: str = "points") -> PointInversion:
    """Return the inversion if all points are inside.

    Parameters
    ----------
    inversion : PointInversion
        Result of `invert_points`.
    source : str
        What the points are, for the message.

    Raises
    ------
    InputError
        If points lie outside; it names how many, the first few (from 1) and their distance to the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import invert_points, require_inside
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> inside = require_inside(invert_points(model.mesh, model.control_points, np.array([[2.0, 0.1, 0.2]])))
    >>> inside.parameters.shape
    (1, 3)
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
    """Embed points in a mesh: the evaluation that moves them with the control points.

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

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import embed_points, invert_points
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> inversion = invert_points(model.mesh, model.control_points, np.array([[2.0, 0.1, 0.2]]))
    >>> embed_points(model.mesh, inversion).forward(1.1 * model.control_points).round(6)  # the points follow
    array([[2.2 , 0.11, 0.22]])
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


@dataclass(frozen=True, eq=False)
class VolumeSamples:
    """Samples of one volume."""

    parameters: np.ndarray  # (m, 3), parameters of the samples, all inside the volume, none on its boundary
    tree: cKDTree  # the samples in space
    # box of the control points
    lower: np.ndarray  # (3,)
    upper: np.ndarray  # (3,)

    def box_distance(self, points: np.ndarray) -> np.ndarray:
        """Lower bound of the distance of points, shape (n, 3), to the volume, shape (n,)."""
        outside = np.maximum(np.maximum(self.lower - points, points - self.upper), 0.0)
        return np.sqrt(np.einsum("qx,qx->q", outside, outside))

    def starts(self, points: np.ndarray) -> np.ndarray:
        """Starting parameters, shape (n, n_starts, 3), for points of shape (n, 3); the most promising first."""
        ranks = [rank for rank in START_RANKS if rank < len(self.parameters)]
        _, ids = self.tree.query(points, k=[rank + 1 for rank in ranks])
        return self.parameters[ids]


def sample_mesh(mesh: BSplineMesh, control_points: np.ndarray) -> list[VolumeSamples]:
    """Sample every volume of a mesh with control points of shape (n_control_points, 3)."""
    return [_sample_volume(volume, net) for volume, net in zip(mesh.volumes, mesh.nets(control_points))]


def nearest_samples(samples: Sequence[VolumeSamples]) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Make a search over the samples of all volumes: points, shape (n, 3), to volumes (n,) and parameters (n, 3)."""
    tree = cKDTree(np.concatenate([s.tree.data for s in samples]))
    parameters = np.concatenate([s.parameters for s in samples])
    volumes = np.repeat(np.arange(len(samples)), [len(s.parameters) for s in samples])

    def search(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, ids = tree.query(points)
        return volumes[ids], parameters[ids]

    return search


def span_lattice(volume: Volume) -> np.ndarray:  # (m0, m1, m2, 3), inside (0, 1); 0 in a degenerate direction
    """Parameters of a lattice that follows the spans of a volume."""
    # With curved knots the spans in one direction depend on the other two parameters; a few substitutions place the
    # lattice well enough.
    stations = [_stations(knots) for knots in volume.knots]
    at = np.stack([a.ravel() for a in np.meshgrid(*stations, indexing="ij")], axis=1)
    parameters = at / [k.n_control - k.order + 1 for k in volume.knots]
    for _ in range(3):
        parameters = np.stack([_place(volume.knots[d], at[:, d], parameters, d) for d in range(3)], axis=1)
    return parameters.reshape(*(s.size for s in stations), 3)


def _stations(knots: Knots) -> np.ndarray:
    """Places of the samples of one direction, counted in spans."""
    if knots.order == 1 and knots.n_control == 1:
        return np.zeros(1)
    n_spans = knots.n_control - knots.order + 1
    n_samples = max(SAMPLES_PER_SPAN * n_spans, MIN_SAMPLES)
    return (np.arange(n_samples) + 0.5) * n_spans / n_samples


def _place(knots: Knots, at: np.ndarray, parameters: np.ndarray, d: int) -> np.ndarray:
    """Parameters of stations ``at`` in direction ``d``, at the other two of ``parameters``."""
    breaks = knots.values(parameters[:, (d + 1) % 3].copy(), parameters[:, (d + 2) % 3].copy())
    rows, span = np.arange(at.size), np.floor(at).astype(int)
    low, high = breaks[rows, knots.order - 1 + span], breaks[rows, knots.order + span]
    return low + (at - span) * (high - low)


def _sample_volume(volume: Volume, net: np.ndarray) -> VolumeSamples:
    parameters = span_lattice(volume).reshape(-1, 3)
    tree = cKDTree(evaluate(volume, net, parameters))
    return VolumeSamples(parameters, tree, net.min(axis=(0, 1, 2)), net.max(axis=(0, 1, 2)))


def section_codes(
    parameters: np.ndarray,  # (n, 3), parameters of points of any volume
) -> np.ndarray:
    """Find the section of a volume that each point lies on: 0 inside, else a face, an edge or a corner."""
    # returns int (n,), ``9 a + 3 b + c``, where a, b and c are 0 inside, 1 at the low and 2 at the high end of xi, eta
    # and zeta
    ends = (parameters <= ON_FACE) + 2 * (parameters >= 1 - ON_FACE)
    return ends @ np.array([9, 3, 1])


def shared_with_lower(mesh: BSplineMesh) -> np.ndarray:
    """Find the sections of each volume whose control points all belong to a lower volume too."""
    # returns bool (n_volumes, 27, n_volumes), entry ``[w, code, v]``: whether the section of volume w lies in volume
    # ``v < w``, see `section_codes`
    n = len(mesh.volumes)
    ids = np.concatenate([control_ids.ravel() for control_ids in mesh.control_ids])
    owners = np.repeat(np.arange(n), [control_ids.size for control_ids in mesh.control_ids])
    ownership = csr_array((np.ones(ids.size), (ids, owners)), shape=(mesh.n_control_points, n)) > 0
    is_shared = np.zeros((n, 27, n), dtype=bool)
    for w, control_ids in enumerate(mesh.control_ids):
        for code, section in enumerate(_SECTIONS):
            section_ids = control_ids[section].ravel()
            is_shared[w, code, :w] = ownership[section_ids].sum(axis=0)[:w] == section_ids.size
    return is_shared
