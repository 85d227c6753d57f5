"""Algebraic movement of blocks: transfinite interpolation of the displacement of corners, edges and faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ..mesh.moving_mesh import MovingMesh
from ..sparse.spring_network import SpringNetwork
from .corners import free_corners
from .increments import IncrementalMover
from .interpolation import InterpolatedStep, interpolated_step
from .section_weights import arc_lengths, transfinite_weights

__all__ = ["Transfinite"]


@dataclass(frozen=True)
class Transfinite(IncrementalMover):
    """Move corners, then edges, faces and insides of the blocks, each between what is known of its boundary.

    Block corners that are neither on the surface nor held follow a network of springs along the edges of the blocks.
    The displacement of all points is a linear function of that of the surface, with weights that the baseline decides.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved. A control mesh is interpolated in its parameters, other meshes by the arc length of their lines.
    n_increments : int or "auto"
        Increments of the move; as the weights are constant, they change nothing but the report.

    References
    ----------
    B. K. Soni, "Two- and three-dimensional grid generation for internal flow applications of computational fluid
    dynamics", AIAA Paper 85-1526, 1985.
    """

    mesh: MovingMesh
    n_increments: int | str = 1

    name = "transfinite"

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        displacement = surface - before[self.mesh.surface_ids]
        values = self._weights.dot(displacement)
        return interpolated_step(self.mesh, before, surface, _Constant(self._weights, values))

    @cached_property
    def _weights(self) -> _Weights:
        mesh, corners = self.mesh, free_corners(self.mesh)
        places = mesh.parameters or [arc_lengths(mesh.points[ids]) for ids in mesh.blocks]
        known_ids = np.concatenate([mesh.surface_ids, corners.ids, mesh.fixed_ids])
        weights = transfinite_weights(mesh.blocks, places, known_ids, mesh.n_points)
        n_surface, n_moving = len(mesh.surface_ids), len(mesh.surface_ids) + len(corners.ids)
        return _Weights(weights[:, :n_surface], weights[:, n_surface:n_moving], corners)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Displacements of all points from those of the surface and, with them, of the free corners."""

    of_surface: sparse.csr_array
    of_corners: sparse.csr_array
    corners: SpringNetwork

    def dot(self, displacement: np.ndarray) -> np.ndarray:
        return self.of_surface @ displacement + self.of_corners @ self.corners.dot(displacement)

    def transpose_dot(self, bar: np.ndarray) -> np.ndarray:
        return self.of_surface.T @ bar + self.corners.transpose_dot(self.of_corners.T @ bar)


@dataclass(frozen=True, eq=False)
class _Constant:
    """Interpolation with weights that do not depend on the points."""

    weights: _Weights
    values: np.ndarray

    def jvp(self, d_points: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        return self.weights.dot(d_displacement)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(bar), self.weights.transpose_dot(bar)
