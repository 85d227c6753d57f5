"""Displacement of points that nothing prescribes: a network of springs that joins them to given and held ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

__all__ = ["SpringNetwork"]


@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """Points between those that are given and those that are held, as a linear map of the given displacement.

    Parameters
    ----------
    ids : ndarray of int, shape (n_free,)
        The points that follow, ascending.
    pull : scipy.sparse.csr_array, shape (n_free, n_given)
        Force on each of them for a unit displacement of each given point.
    directions : scipy.sparse.csr_array, shape (3 n_free, n_directions)
        Orthonormal columns: what they may do.
    solve : callable
        Inverse of the network's stiffness in these directions, symmetric.
    """

    ids: np.ndarray
    pull: sparse.csr_array
    directions: sparse.csr_array
    solve: Callable[[np.ndarray], np.ndarray]

    @classmethod
    def of(
        cls,
        n_points: int,
        lengths: Mapping[tuple[int, int], float],
        given_ids: np.ndarray,
        fixed_ids: np.ndarray,
        directions: Callable[[np.ndarray], sparse.csr_array],
    ) -> SpringNetwork:
        """Join points by springs, as stiff as they are short.

        Each component of the displacement is in equilibrium by itself, but for points that slide. Points without a
        connection to given or held ones stay.

        Parameters
        ----------
        n_points : int
            Number of points; those without a spring take no part.
        lengths : mapping of (int, int) to float
            Length of the spring (m) between each pair of points; pairs of one point with itself are left out.
        given_ids, fixed_ids : ndarray of int
            Points with a given displacement, and points that stay.
        directions : callable
            Orthonormal columns, shape (3 n, n_directions), of what points, by their numbers of shape (n,), may do.

        Returns
        -------
        SpringNetwork
        """
        stiffness = {pair: 1.0 / length for pair, length in lengths.items() if pair[0] != pair[1]}
        pairs = np.array(list(stiffness), dtype=int).reshape(-1, 2).T
        graph = sparse.csr_array((list(stiffness.values()), tuple(pairs)), shape=(n_points, n_points))
        graph = graph + graph.T
        laplacian = sparse.diags_array(graph.sum(axis=1)).tocsr() - graph
        points, is_known = np.unique(pairs), np.zeros(n_points, dtype=bool)
        is_known[given_ids] = is_known[fixed_ids] = True
        _, labels = connected_components(graph, directed=False)
        is_anchored = np.isin(labels, labels[points[is_known[points]]])
        ids = points[(is_anchored & ~is_known)[points]]
        rows, freedoms = laplacian[ids], directions(ids)
        stiffness = freedoms.T @ sparse.kron(rows[:, ids], sparse.eye_array(3)) @ freedoms
        solve = splu(sparse.csc_array(stiffness)).solve if stiffness.size else np.zeros_like
        return cls(ids, -rows[:, given_ids], freedoms, solve)

    def dot(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements of the points that follow, (n_free, 3), for those of the given ones, (n_given, 3)."""
        return self._yield_to(self.pull @ displacement)

    def transpose_dot(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `dot`."""
        return self.pull.T @ self._yield_to(bar)

    def _yield_to(self, force: np.ndarray) -> np.ndarray:
        return (self.directions @ self.solve(self.directions.T @ force.ravel())).reshape(-1, 3)
