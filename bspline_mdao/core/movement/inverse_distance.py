"""Movement by inverse-distance weights of the prescribed displacements.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from ...base.numerics.vectors import add, add_to, dot, less, row, scaled
from ...errors import InputError
from ...grids.topology.boundary_surface import quads_in_turn
from ..mesh.moving_mesh import MovingMesh
from .increments import IncrementalMover
from .interpolation import CentredInterpolation, Centres, InterpolatedStep, find_centres, interpolated_step

TOUCHING = 1e-24
"""Added to squared distances in units of the mesh's size: a point at the place of a centre follows it."""


@dataclass(frozen=True)
class InverseDistance(IncrementalMover):
    r"""Move every point by a weighted mean of the prescribed displacements.

    A centre with the area :math:`A` at the distance :math:`r` has the weight :math:`A [(L / r)^a + (\alpha L / r)^b]`,
    where :math:`L` is the mesh's size. The second power makes points near the surface follow it closely.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    exponents : tuple of int
        The powers a and b; the smaller one dominates far away.
    reach : float
        :math:`\alpha`; 0 gives plain inverse-distance weights of the power a.
    n_increments : int
        Increments of the move.

    Notes
    -----
    The areas are the areas of the boundary faces on the baseline, shared among their points. The weights are those of
    the reference with a constant reach. The rotations of the surface's points are left out, since their contribution
    is not a function of the displacements alone.

    References
    ----------
    E. Luke, E. Collins and E. Blades, "A fast mesh deformation method using explicit interpolation", Journal of
    Computational Physics 231, 2012.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import InverseDistance, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> movement = InverseDistance(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> mesh.tangled(movement.points).n_invalid
    0
    """

    mesh: MovingMesh
    exponents: tuple[int, int] = (3, 5)
    reach: float = 0.1
    n_increments: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.exponents) < 1 or not all(isinstance(n, int) for n in self.exponents):
            raise InputError(f"inverse distance: exponents {self.exponents}; give two integers from 1")
        if not self.reach >= 0.0:
            raise InputError(f"inverse distance: reach {self.reach}; give 0 or more")

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        centres = self._centres
        displacement = centres.displacement(surface - before[self.mesh.surface_ids])
        weights = (self._areas, self.exponents, self.reach, self.mesh.size)
        scattered = _Means.of(before[centres.target_ids], centres.position @ before, displacement, weights)
        return interpolated_step(self.mesh, before, surface, CentredInterpolation(centres, scattered))

    @cached_property
    def _centres(self) -> Centres:
        return find_centres(self.mesh)

    @cached_property
    def _areas(self) -> np.ndarray:
        return _areas(self.mesh)[self._centres.ids]


@dataclass(frozen=True, eq=False)
class _Means:
    """Weighted means of displacements, with the sums of the weights."""

    targets: np.ndarray
    centres: np.ndarray
    displacement: np.ndarray
    weights: tuple
    values: np.ndarray
    sums: np.ndarray

    @classmethod
    def of(cls, targets: np.ndarray, centres: np.ndarray, displacement: np.ndarray, weights: tuple) -> _Means:
        return cls(targets, centres, displacement, weights, *_means(targets, centres, displacement, *weights))

    def jvp(self, d_targets: np.ndarray, d_centres: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        made = (self.targets, self.centres, self.displacement, *self.weights, self.values, self.sums)
        return _means_jvp(*made, d_targets, d_centres, d_displacement)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        made = (self.targets, self.centres, self.displacement, *self.weights, self.values, self.sums)
        return _means_vjp(*made, np.ascontiguousarray(bar))


def _areas(mesh: MovingMesh) -> np.ndarray:
    """Area of the prescribed boundary that belongs to each point, shape (n_points,); the mean if there is none."""
    is_prescribed = np.logical_not(mesh.is_free.any(axis=1))
    areas = np.zeros(mesh.n_points)
    for ids in mesh.blocks:
        for side in range(6):
            face = ids.take(-(side % 2), axis=side // 2)
            quads = quads_in_turn(face)
            quads = quads[is_prescribed[quads].all(axis=1)]
            corners = mesh.points[quads]
            normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
            np.add.at(areas, quads, 0.125 * np.linalg.norm(normals, axis=1)[:, None])
    return np.where(areas > 0.0, areas, areas[areas > 0.0].mean() if areas.any() else 1.0)


@njit(cache=True, error_model="numpy")
def _weight(area, near_to, far_from, reach, size, along):
    """Weight of a centre in the direction ``along``, and its derivative in half the squared distance."""
    inverse = 1.0 / (dot(along, along) + TOUCHING * size * size)
    ratio = size * np.sqrt(inverse)
    far, near = area * ratio**far_from, area * (reach * ratio) ** near_to
    return far + near, -(far_from * far + near_to * near) * inverse


@njit(cache=True, error_model="numpy")
def _means(targets, centres, displacement, areas, exponents, reach, size):
    values, sums = np.empty_like(targets), np.empty(len(targets))
    far_from, near_to = exponents
    for j in range(len(targets)):
        total, mean = 0.0, (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            weight, _ = _weight(areas[i], near_to, far_from, reach, size, along)
            total += weight
            mean = add(mean, scaled(weight, row(displacement, i)))
        sums[j] = total
        values[j, 0], values[j, 1], values[j, 2] = scaled(1.0 / total, mean)
    return values, sums


@njit(cache=True, error_model="numpy")
def _means_jvp(
    targets, centres, displacement, areas, exponents, reach, size, values, sums, d_targets, d_centres, d_displacement
):
    d_values = np.empty_like(targets)
    far_from, near_to = exponents
    for j in range(len(targets)):
        change = (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            weight, slope = _weight(areas[i], near_to, far_from, reach, size, along)
            d_weight = slope * dot(along, less(row(d_targets, j), row(d_centres, i)))
            off_mean = less(row(displacement, i), row(values, j))
            change = add(change, add(scaled(weight, row(d_displacement, i)), scaled(d_weight, off_mean)))
        d_values[j, 0], d_values[j, 1], d_values[j, 2] = scaled(1.0 / sums[j], change)
    return d_values


@njit(cache=True, error_model="numpy")
def _means_vjp(targets, centres, displacement, areas, exponents, reach, size, values, sums, bar):
    targets_bar = np.zeros_like(targets)
    centres_bar, displacement_bar = np.zeros_like(centres), np.zeros_like(centres)
    far_from, near_to = exponents
    for j in range(len(targets)):
        scaled_bar, total = scaled(1.0 / sums[j], row(bar, j)), (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            weight, slope = _weight(areas[i], near_to, far_from, reach, size, along)
            pull = scaled(slope * dot(less(row(displacement, i), row(values, j)), scaled_bar), along)
            add_to(displacement_bar, i, scaled(weight, scaled_bar))
            add_to(centres_bar, i, scaled(-1.0, pull))
            total = add(total, pull)
        add_to(targets_bar, j, total)
    return targets_bar, centres_bar, displacement_bar
