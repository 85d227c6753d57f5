"""Displacement of free points: a network of springs joins them to prescribed and fixed ones.

Each component of the displacement solves a discrete Laplace equation on the graph of the springs, with inverse lengths
as weights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from ..display import OneLine

__all__ = ["SpringNetwork"]


@dataclass(frozen=True, eq=False)
class SpringNetwork(OneLine):
    """Displacement of points between prescribed and fixed ones, as a linear map of the prescribed displacement."""

    ids: np.ndarray  # int (n_free,), the displaced points, ascending
    # force on each of them for a unit displacement of each prescribed point
    pull: sparse.csr_array  # (n_free, n_prescribed)
    directions: sparse.csr_array  # (3 n_free, n_directions), orthonormal columns: their allowed directions
    stiffness: sparse.csc_array  # (n_directions, n_directions), stiffness of the network in these directions, symmetric

    @classmethod
    def of(
        cls,
        n_points: int,  # number of points; points without a spring are ignored
        # length of the spring (m) between each pair of points; springs from a point to itself are ignored
        lengths: Mapping[tuple[int, int], float],
        # points with a prescribed displacement, and fixed points
        prescribed_ids: np.ndarray,  # int
        fixed_ids: np.ndarray,  # int
        # orthonormal columns, shape (3 n, n_directions), of the allowed directions of points by numbers, shape (n,)
        directions: Callable[[np.ndarray], sparse.csr_array],
    ) -> SpringNetwork:
        """Join points by springs with stiffness inverse to their length."""
        # Each component of the displacement is in equilibrium separately, except at sliding points. Points not
        # connected to prescribed or fixed ones stay.
        stiffness = {pair: 1.0 / length for pair, length in lengths.items() if pair[0] != pair[1]}
        pairs = np.array(list(stiffness), dtype=int).reshape(-1, 2).T
        graph = sparse.csr_array((list(stiffness.values()), tuple(pairs)), shape=(n_points, n_points))
        graph = graph + graph.T
        laplacian = sparse.diags_array(graph.sum(axis=1)).tocsr() - graph
        points, is_prescribed = np.unique(pairs), np.zeros(n_points, dtype=bool)
        is_prescribed[prescribed_ids] = is_prescribed[fixed_ids] = True
        _, labels = connected_components(graph, directed=False)
        is_anchored = np.isin(labels, labels[points[is_prescribed[points]]])
        ids = points[(is_anchored & ~is_prescribed)[points]]
        rows, allowed = laplacian[ids], directions(ids)
        of_directions = allowed.T @ sparse.kron(rows[:, ids], sparse.eye_array(3)) @ allowed
        return cls(ids, -rows[:, prescribed_ids], allowed, sparse.csc_array(of_directions))

    @cached_property
    def _factor(self) -> SuperLU:
        return splu(self.stiffness)

    def __getstate__(self) -> dict:
        """Drop the factor: SuperLU cannot be pickled."""
        return {name: value for name, value in self.__dict__.items() if name != "_factor"}

    def dot(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements of the points, (n_free, 3), from prescribed displacements, (n_prescribed, 3)."""
        return self._displacement_under(self.pull @ displacement)

    def transpose_dot(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `dot`."""
        return self.pull.T @ self._displacement_under(bar)

    def _displacement_under(self, force: np.ndarray) -> np.ndarray:
        """Equilibrium displacement under forces on the points, both of shape (n_free, 3)."""
        if not self.stiffness.size:
            return np.zeros_like(force)
        return (self.directions @ self._factor.solve(self.directions.T @ force.ravel())).reshape(-1, 3)
