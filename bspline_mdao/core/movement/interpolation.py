"""One increment of a mover that interpolates the displacement of its surface. Theory: ``docs/theory/movers.rst``.

Such movers have in common that an interpolation extends the displacement of the surface to all points, each point
follows it in the directions in which it may move, and the surface itself is put at its given place.

Scattered interpolation has centres: the points with prescribed displacement. The two sides of a flat plate have
different points at one place, which may have to part, while such interpolation knows a point only by its place. Twins
are therefore moved apart, only for the weights, into the side of the mesh that each belongs to: by `APART` of the
distance to free neighbours. Points that still coincide count once. The surface itself always ends at its given place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from ...base.display import OneLine
from ..mesh.moving_mesh import MovingMesh
from .mover import SolveReport

__all__ = [
    "APART",
    "COINCIDENT",
    "CentredInterpolation",
    "Centres",
    "InterpolatedStep",
    "Interpolation",
    "Scattered",
    "find_centres",
    "interpolated_step",
]


class Interpolation(Protocol):
    """Displacements of all points from the surface's; fixed points count as not displaced."""

    # The values at surface and fixed points do not matter: their displacement is prescribed.

    @property
    def values(self) -> np.ndarray:
        """Displacements, shape (n_points, 3), in metres."""

    def jvp(self, d_points: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the points, (n_points, 3), and of the surface's displacement."""

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""


@dataclass(frozen=True, eq=False)
class InterpolatedStep(OneLine):
    """A completed increment."""

    mesh: MovingMesh  # what was moved
    points: np.ndarray  # (n_points, 3), points after the increment (m)
    interpolation: Interpolation  # displacements that the points took
    report: SolveReport | None = None  # solution of the interpolation's system, if it has one

    def jvp(self, d_initial: np.ndarray, d_before: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points after the increment, shape (n_points, 3); ``d_initial`` has no effect."""
        surface_ids = self.mesh.surface_ids
        change = self.interpolation.jvp(d_before, d_surface - d_before[surface_ids])
        d_points = d_before + self.mesh.slide(change)
        d_points[surface_ids] = d_surface
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives with respect to initial points, points before and surface."""
        surface_ids = self.mesh.surface_ids
        points_bar, displacement_bar = self.interpolation.vjp(self.mesh.slide(bar))
        before_bar = bar + points_bar
        before_bar[surface_ids] = points_bar[surface_ids] - displacement_bar
        return np.zeros_like(bar), before_bar, bar[surface_ids] + displacement_bar


def interpolated_step(
    mesh: MovingMesh,  # what is moved
    before: np.ndarray,  # (n_points, 3), points before the increment (m)
    surface: np.ndarray,  # (n_surface, 3), surface points after it (m)
    interpolation: Interpolation,  # displacements of all points
    report: SolveReport | None = None,  # solution of its system
) -> InterpolatedStep:
    """Project an interpolated displacement onto the admissible motion of every point.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    before : ndarray, shape (n_points, 3)
        Points before the increment (m).
    surface : ndarray, shape (n_surface, 3)
        Surface points after it (m).
    interpolation : Interpolation
        Displacements of all points.
    report : SolveReport, optional
        Solution of its system.

    Returns
    -------
    InterpolatedStep

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import in_increments, interpolated_step, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> class Still:  # of which all inner points stay where they are
    ...     values = np.zeros_like(mesh.points)
    >>> def step(initial, before, surface):
    ...     return interpolated_step(mesh, before, surface, Still())
    >>> moved = in_increments(mesh, step, mesh.points, 1.01 * mesh.points[mesh.surface_ids], 2).points
    >>> bool(np.isclose(moved[mesh.surface_ids], 1.01 * mesh.points[mesh.surface_ids]).all())
    True
    """
    points = before + mesh.slide(interpolation.values)
    points[mesh.surface_ids] = surface
    return InterpolatedStep(mesh, points, interpolation, report)


COINCIDENT = 1e-9
"""Prescribed points nearer than this fraction of the mesh's size are at one place: round-off of coordinates."""

APART = 0.5
"""Fraction of the distance to free neighbours by which coincident centres are moved apart."""


@dataclass(frozen=True, eq=False)
class Centres:
    """Centres, those on the surface first."""

    ids: np.ndarray  # (n_centres,) of int, the prescribed points that are centres
    surface_rows: np.ndarray  # (n_moving,) of int, rows of the surface's points; the centres after these are fixed
    target_ids: np.ndarray  # (n_targets,) of int, points that may move in any direction
    # (n_centres, n_points), place of the centres, as weights of the mesh's points
    position: sparse.csr_array
    # n_surface, n_points: numbers of points on the surface and of the mesh
    n_surface: int
    n_points: int

    def displacement(self, of_surface: np.ndarray) -> np.ndarray:
        """Displacement of the centres, (n_centres, 3), from the surface's, (n_surface, 3)."""
        displacement = np.zeros((len(self.ids), 3), dtype=of_surface.dtype)
        displacement[: len(self.surface_rows)] = of_surface[self.surface_rows]
        return displacement

    def displacement_transpose(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `displacement`."""
        of_surface = np.zeros((self.n_surface, 3), dtype=bar.dtype)
        of_surface[self.surface_rows] = bar[: len(self.surface_rows)]
        return of_surface

    def at_all_points(self, at_targets: np.ndarray) -> np.ndarray:
        """Values at all points, (n_points, 3), from values at targets, (n_targets, 3); zero elsewhere."""
        values = np.zeros((self.n_points, 3), dtype=at_targets.dtype)
        values[self.target_ids] = at_targets
        return values


class Scattered(Protocol):
    """Interpolation of displacements from centres to targets."""

    @property
    def values(self) -> np.ndarray:
        """Displacements of the targets, shape (n_targets, 3), in metres."""

    def jvp(self, d_targets: np.ndarray, d_centres: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the targets, of the centres and of their displacements."""

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""


@dataclass(frozen=True, eq=False)
class CentredInterpolation:
    """Interpolation of the surface's displacement from centres."""

    centres: Centres  # where the displacement is prescribed
    scattered: Scattered  # interpolation between them

    @property
    def values(self) -> np.ndarray:
        """Displacements, shape (n_points, 3), in metres."""
        return self.centres.at_all_points(self.scattered.values)

    def jvp(self, d_points: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the points and of the surface's displacement."""
        centres = self.centres
        d_centres, d_prescribed = centres.position @ d_points, centres.displacement(d_displacement)
        return centres.at_all_points(self.scattered.jvp(d_points[centres.target_ids], d_centres, d_prescribed))

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        centres = self.centres
        targets_bar, centres_bar, prescribed_bar = self.scattered.vjp(bar[centres.target_ids])
        points_bar = centres.position.T @ centres_bar
        points_bar[centres.target_ids] += targets_bar
        return points_bar, centres.displacement_transpose(prescribed_bar)


def find_centres(
    mesh: MovingMesh,  # the mesh
) -> Centres:
    """Make centres of all surface and all fixed points, as they are on the baseline."""
    prescribed_ids = np.concatenate([mesh.surface_ids, mesh.fixed_ids])
    position = _selection(prescribed_ids, mesh.n_points) + APART * _aside(mesh, prescribed_ids)
    is_kept = np.ones(len(prescribed_ids), dtype=bool)
    is_kept[_twins(position @ mesh.points, mesh.size)[1]] = False
    kept = np.flatnonzero(is_kept)
    surface_rows = kept[kept < len(mesh.surface_ids)]
    target_ids = np.flatnonzero(mesh.is_free.any(axis=1))
    return Centres(prescribed_ids[kept], surface_rows, target_ids, position[kept], len(mesh.surface_ids), mesh.n_points)


def _selection(ids: np.ndarray, n_points: int) -> sparse.csr_array:
    return sparse.csr_array((np.ones(len(ids)), (np.arange(len(ids)), ids)), shape=(len(ids), n_points))


def _twins(points: np.ndarray, size: float) -> np.ndarray:
    """Pairs of points at one place, shape (2, n_pairs), the first of a pair before the second."""
    return KDTree(points).query_pairs(COINCIDENT * size, output_type="ndarray").T


def _aside(mesh: MovingMesh, prescribed_ids: np.ndarray) -> sparse.csr_array:
    """Vector from each twin to the mean of its neighbours that are free, or at least not on the surface."""
    twins = np.unique(_twins(mesh.points[prescribed_ids], mesh.size))
    adjacent = _neighbours(mesh)[prescribed_ids[twins]]
    is_surface = np.zeros(mesh.n_points)
    is_surface[mesh.surface_ids] = 1.0
    chosen = adjacent @ sparse.diags_array(mesh.is_free.any(axis=1).astype(float))
    has_none = (chosen.sum(axis=1) == 0.0).astype(float)
    chosen = chosen + sparse.diags_array(has_none) @ adjacent @ sparse.diags_array(1.0 - is_surface)
    counts = chosen.sum(axis=1)
    mean = sparse.diags_array(1.0 / np.maximum(counts, 1.0)) @ chosen
    way = mean - sparse.diags_array((counts > 0.0).astype(float)) @ _selection(prescribed_ids[twins], mesh.n_points)
    return _selection(twins, len(prescribed_ids)).T @ way


def _neighbours(mesh: MovingMesh) -> sparse.csr_array:
    """1 where two points are neighbours along a line of a block, shape (n_points, n_points)."""
    pairs = [
        (ids.take(range(n - 1), d).ravel(), ids.take(range(1, n), d).ravel())
        for ids in mesh.blocks
        for d, n in enumerate(ids.shape)
    ]
    first, second = (np.concatenate(ends) for ends in zip(*pairs))
    graph = sparse.csr_array((np.ones(len(first)), (first, second)), shape=(mesh.n_points, mesh.n_points))
    return ((graph + graph.T) > 0.0).astype(float)
