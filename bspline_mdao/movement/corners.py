"""Displacement of block corners that nothing prescribes: a network of springs along the edges of the blocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..grids.sections import sections_of, whole_slices
from .mesh import MovingMesh

__all__ = ["FreeCorners", "free_corners"]


@dataclass(frozen=True, eq=False)
class FreeCorners:
    """Block corners between those that are known, as a linear map of the surface's displacement.

    Parameters
    ----------
    ids : ndarray of int, shape (n_corners,)
        Their points, ascending.
    pull : scipy.sparse.csr_array, shape (n_corners, n_surface)
        Force on each corner for a unit displacement of each surface point.
    directions : scipy.sparse.csr_array, shape (3 n_corners, n_free)
        Orthonormal columns: what the corners may do.
    solve : callable
        Inverse of the network's stiffness in these directions, symmetric.
    """

    ids: np.ndarray
    pull: sparse.csr_array
    directions: sparse.csr_array
    solve: Callable[[np.ndarray], np.ndarray]

    def dot(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements of the corners, (n_corners, 3), for those of the surface, (n_surface, 3)."""
        return self._yield_to(self.pull @ displacement)

    def transpose_dot(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `dot`."""
        return self.pull.T @ self._yield_to(bar)

    def _yield_to(self, force: np.ndarray) -> np.ndarray:
        return (self.directions @ self.solve(self.directions.T @ force.ravel())).reshape(-1, 3)


def free_corners(mesh: MovingMesh) -> FreeCorners:
    """Connect the corners along the edges of all blocks by springs, as stiff as the edges are short on the baseline.

    Each component of the displacement is in equilibrium by itself, but for corners that slide. Corners without a
    connection to the surface or to held points stay.

    Parameters
    ----------
    mesh : MovingMesh
        The blocks.

    Returns
    -------
    FreeCorners
    """
    laplacian, corners = _network(mesh)
    is_known = np.zeros(mesh.n_points, dtype=bool)
    is_known[mesh.surface_ids] = is_known[mesh.held_ids] = True
    _, labels = connected_components(laplacian, directed=False)
    is_anchored = np.isin(labels, labels[corners[is_known[corners]]])
    ids = corners[(is_anchored & ~is_known)[corners]]
    rows = laplacian[ids]
    directions = _directions(mesh, ids)
    stiffness = directions.T @ sparse.kron(rows[:, ids], sparse.eye_array(3)) @ directions
    solve = splu(sparse.csc_array(stiffness)).solve if stiffness.size else np.zeros_like
    return FreeCorners(ids, -rows[:, mesh.surface_ids], directions, solve)


def _network(mesh: MovingMesh) -> tuple[sparse.csr_array, np.ndarray]:
    """Graph Laplacian of the edges of all blocks, shape (n_points, n_points), and the points that are corners."""
    links: dict[tuple[int, int], float] = {}
    for ids in mesh.blocks:
        for section in sections_of(ids.shape, n_free=1):
            edge = ids[whole_slices(section)].ravel()
            ends = (int(min(edge[0], edge[-1])), int(max(edge[0], edge[-1])))
            length = np.linalg.norm(np.diff(mesh.points[edge], axis=0), axis=1).sum()
            if ends[0] != ends[1]:  # neither collapsed nor closed
                links[ends] = 1.0 / length
    pairs = np.array(list(links), dtype=int).reshape(-1, 2).T
    graph = sparse.csr_array((list(links.values()), tuple(pairs)), shape=(mesh.n_points, mesh.n_points))
    graph = graph + graph.T
    corners = np.unique([ids[np.ix_(*[(0, -1)] * 3)] for ids in mesh.blocks])
    return sparse.diags_array(graph.sum(axis=1)).tocsr() - graph, corners


def _directions(mesh: MovingMesh, ids: np.ndarray) -> sparse.csr_array:
    """Directions in which points may move as orthonormal columns, shape (3 n, n_free)."""
    frames = np.broadcast_to(np.eye(3), (len(ids), 3, 3)) if mesh.frames is None else mesh.frames[ids]
    blocks = sparse.block_diag(list(frames.transpose(0, 2, 1)), format="csc") if len(ids) else sparse.csc_array((0, 0))
    return sparse.csr_array(blocks[:, np.flatnonzero(mesh.is_free[ids])])
