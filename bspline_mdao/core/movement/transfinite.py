"""Algebraic movement of blocks: transfinite interpolation of the displacement of corners, edges and faces.

Theory: ``docs/theory/movers.rst``. Block corners that are not prescribed follow a network of springs along the edges of
the blocks. The weights of all other points are made section by section: from corners to edges, faces and interiors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ...base.numerics.transfinite import boolean_sum
from ...base.sparse.spring_network import SpringNetwork
from ...grids.topology.index_space import inner_slices, sections_of, whole_slices
from ..mesh.moving_mesh import MovingMesh
from .increments import IncrementalMover
from .interpolation import InterpolatedStep, interpolated_step

__all__ = ["Transfinite", "arc_lengths", "free_corners", "transfinite_weights"]


@dataclass(frozen=True)
class Transfinite(IncrementalMover):
    """Move corners, then edges, faces and interiors of blocks, each interpolated from its boundary.

    Block corners that are neither on the surface nor fixed follow a network of springs along the edges of the blocks.
    The displacement of all points is linear in the surface's, with weights from the baseline.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move. A control mesh is interpolated in its parameters, other meshes by the arc length of their lines.
    n_increments : int
        Increments of the move; since the weights are constant, they only change the report.

    References
    ----------
    B. K. Soni, "Two- and three-dimensional grid generation for internal flow applications of computational fluid
    dynamics", AIAA Paper 85-1526, 1985.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import Transfinite, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> movement = Transfinite(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> mesh.tangled(movement.points).n_invalid
    0
    """

    mesh: MovingMesh
    n_increments: int = 1

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        displacement = surface - before[self.mesh.surface_ids]
        values = self._weights.dot(displacement)
        return interpolated_step(self.mesh, before, surface, _Constant(self._weights, values))

    @cached_property
    def _weights(self) -> _Weights:
        mesh, corners = self.mesh, free_corners(self.mesh)
        places = mesh.parameters or [arc_lengths(mesh.points[ids]) for ids in mesh.blocks]
        prescribed_ids = np.concatenate([mesh.surface_ids, corners.ids, mesh.fixed_ids])
        weights = transfinite_weights(mesh.blocks, places, prescribed_ids, mesh.n_points)
        n_surface, n_moving = len(mesh.surface_ids), len(mesh.surface_ids) + len(corners.ids)
        return _Weights(weights[:, :n_surface], weights[:, n_surface:n_moving], corners)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Displacements of all points from the surface's and, through these, the free corners'."""

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


def free_corners(
    mesh: MovingMesh,  # the blocks
) -> SpringNetwork:  # its given points are the surface's
    """Connect the corners along the edges of all blocks by springs, stiffer the shorter the edges on the baseline."""
    lengths = {}
    for ids in mesh.blocks:
        for section in sections_of(ids.shape, n_free=1):
            edge = ids[whole_slices(section)].ravel()
            ends = (int(min(edge[0], edge[-1])), int(max(edge[0], edge[-1])))
            if ends[0] != ends[1]:  # neither collapsed nor closed
                lengths[ends] = np.linalg.norm(np.diff(mesh.points[edge], axis=0), axis=1).sum()
    return SpringNetwork.of(
        mesh.n_points, lengths, mesh.surface_ids, mesh.fixed_ids, lambda ids: _directions(mesh, ids)
    )


def _directions(mesh: MovingMesh, ids: np.ndarray) -> sparse.csr_array:
    """Directions in which points may move, as orthonormal columns, shape (3 n, n_free)."""
    frames = np.broadcast_to(np.eye(3), (len(ids), 3, 3)) if mesh.frames is None else mesh.frames[ids]
    n, columns = len(ids), frames.transpose(0, 2, 1)
    blocks = sparse.bsr_array((columns, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n), blocksize=(3, 3))
    return sparse.csr_array(blocks.tocsc()[:, np.flatnonzero(mesh.is_free[ids])])


def arc_lengths(
    points: np.ndarray,  # (N0, N1, N2, 3), points of a block (m)
) -> np.ndarray:  # (N0, N1, N2, 3), by direction; uniform along lines without length
    """Place of every point on the three grid lines through it, from 0 to 1 by arc length."""
    places = np.empty_like(points)
    for d in range(3):
        lengths = np.linalg.norm(np.diff(points, axis=d), axis=-1)
        lengths = np.where(lengths.sum(axis=d, keepdims=True) > 0.0, lengths, 1.0)
        sums = np.insert(np.cumsum(lengths, axis=d), 0, 0.0, axis=d)
        places[..., d] = sums / sums.take([-1], axis=d)
    return places


def transfinite_weights(
    # each int (N0, N1, N2), points of every block
    blocks: Sequence[np.ndarray],
    # each (N0, N1, N2, 3), place of each point between the two ends of every direction, from 0 to 1
    places: Sequence[np.ndarray],
    prescribed_ids: np.ndarray,  # (n_prescribed,) of int, known points; all corners of all blocks are among them
    n_points: int,  # number of points
) -> sparse.csr_array:  # (n_points, n_prescribed)
    """Weights with which all points follow the prescribed ones."""
    # Inside a section whose boundary is done, the interpolant is `bspline_mdao.base.numerics.transfinite`. Points that
    # are prescribed, or belong to an earlier section, keep their values: shared sections are interpolated once, and all
    # blocks agree.
    shape = (n_points, len(prescribed_ids))
    weights = sparse.csr_array(
        (np.ones(len(prescribed_ids)), (prescribed_ids, np.arange(len(prescribed_ids)))), shape=shape
    )
    is_done = np.zeros(n_points, dtype=bool)
    is_done[prescribed_ids] = True
    for n_free in (1, 2, 3):
        parts = [(rows, section @ weights) for rows, section in _sections(blocks, places, is_done, n_free)]
        weights = weights + _in_rows(parts, shape)
    return weights


def _in_rows(parts: Sequence[tuple[np.ndarray, sparse.csr_array]], shape: tuple[int, int]) -> sparse.csr_array:
    """Matrix of the given rows, zero in the others."""
    rows = np.concatenate([np.zeros(0, dtype=int), *(rows for rows, _ in parts)])
    stacked = sparse.vstack([sparse.csr_array((0, shape[1])), *(part for _, part in parts)], format="csr")
    spread = sparse.csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(shape[0], len(rows)))
    return spread @ stacked


def _sections(
    blocks: Sequence[np.ndarray], places: Sequence[np.ndarray], is_done: np.ndarray, n_free: int
) -> Iterator[tuple[np.ndarray, sparse.csr_array]]:
    """Points of every section that are not done yet, with their weights; marks them as done."""
    for ids, place in zip(blocks, places):
        for section in sections_of(ids.shape, n_free):
            inner = ids[inner_slices(section)].ravel()
            rows, first = np.unique(inner, return_index=True)  # a folded section has points twice
            first, rows = first[~is_done[rows]], rows[~is_done[rows]]
            is_done[rows] = True
            if len(rows):
                whole = whole_slices(section)
                columns, values = boolean_sum(place[whole], first)
                numbers = np.tile(np.arange(len(rows)), len(columns))
                entries = values.ravel(), (numbers, ids[whole].ravel()[columns.ravel()])
                yield rows, sparse.csr_array(entries, shape=(len(rows), len(is_done)))
