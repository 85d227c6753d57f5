"""Rotations of the residual, smoothed over the residual's length.

T r turns the residual r of a fit by rotations that differ from corner to corner of the spans. If they change by dR over
a distance h, T r stretches or shears the cells there by |r| dR / h, and folds them if that exceeds one: next to a
viscous wall spans are 1e-5 of the chord high, and residuals a thousand times longer. So the rotations R0 of the corners
are replaced by the rotations that minimise

    sum_i |R_i - R0_i|^2 + sum_ij (l_ij / e_ij)^2 |R_i - R_j|^2,

where l_ij is the longer residual around the two ends of an edge, and e_ij the edge's length on the baseline. Nothing
changes where the residual is short compared with the spans. Where it is long, rotations vary over its length and not
over the spans' length. R is a mean of R0 with weights that are positive, sum to one and are fixed on the baseline: if
all corners turn as one, so does every vector, to round-off.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

__all__ = ["RotationFilter"]

LEAST_WEIGHT = 1e-6
"""Edges a thousand times longer than the residual join nothing: they would change turned vectors by 1e-6 of the change
of their rotation, and make walls depend on their neighbours."""

MOST_WEIGHT = 1e10
"""Ends of edges a hundred thousand times shorter than the residual turn alike to 1e-10; more costs digits."""

ROUND_OFF = 3e-15
"""Relative error of the rotations that the last correction may leave."""


@dataclass(frozen=True, eq=False)
class RotationFilter:
    """The filter for some corners, with the others given. Made by `RotationFilter.of`."""

    # free, given: of int, numbers of the corners that are smoothed, and of known corners that enter
    free: np.ndarray
    given: np.ndarray
    # of_free, of_given: (n_edges, n_free) and (n_edges, n_given), differences along the edges
    of_free: csr_array
    of_given: csr_array
    weights: np.ndarray  # (n_edges,), squared ratios of residual to edge

    @classmethod
    def of(
        cls,
        # starts, neighbours, scales: first neighbour of every corner, the neighbours, and 1 / squared lengths of these
        # edges
        starts: np.ndarray,
        neighbours: np.ndarray,
        scales: np.ndarray,
        lengths: np.ndarray,  # (n,), residual around every corner (m)
        free: np.ndarray,  # (n,) of bool, corners that are smoothed
    ) -> RotationFilter | None:
        """Choose the edges that are not long compared with the residual; None if there are none."""
        ends = np.repeat(np.arange(len(free)), np.diff(starts))
        weights = np.minimum(np.maximum(lengths[ends], lengths[neighbours]) ** 2 * scales, MOST_WEIGHT)
        is_first = free[ends] & ((ends < neighbours) | ~free[neighbours])  # an edge between free corners occurs twice
        chosen = np.flatnonzero(is_first & (weights >= LEAST_WEIGHT))
        if not len(chosen):
            return None
        pairs, n = np.stack([ends[chosen], neighbours[chosen]], axis=1), len(chosen)
        differences = csr_array(
            (np.tile([1.0, -1.0], n), pairs.ravel(), np.arange(0, 2 * n + 1, 2)), shape=(n, len(free))
        )
        used = np.unique(pairs)
        ids, given = used[free[used]], used[~free[used]]
        return cls(ids, given, csr_array(differences[:, ids]), csr_array(differences[:, given]), weights[chosen])

    def __reduce__(self) -> tuple:
        """Pickle without the factor: SuperLU cannot be pickled."""
        return RotationFilter, (self.free, self.given, self.of_free, self.of_given, self.weights)

    @cached_property
    def _matrix(self) -> csr_array:
        graph = self.of_free.T @ diags_array(self.weights) @ self.of_free
        return csr_array(eye_array(len(self.free)) + graph)

    @cached_property
    def _factor(self) -> SuperLU:
        options = {"SymmetricMode": True}
        return splu(self._matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    @cached_property
    def _n_steps(self) -> int:
        """Steps that restore the digits lost to large weights: each leaves the same fraction of the previous error."""
        lost = 10.0 * np.finfo(float).eps * max(float(self.weights.max()), 1.0)
        return int(np.ceil(np.log(ROUND_OFF) / np.log(lost)))

    def forward(
        self,
        rotations: np.ndarray,  # (n_free, 9), of the corners that are smoothed
        given: np.ndarray,  # (n_given, 9), of the known corners
    ) -> np.ndarray:  # (n_free, 9)
        """Smooth rotations less the identity, or changes of rotations."""
        jumps = self.of_given @ given
        return self._solved(rotations, rotations.copy(), lambda x: self.of_free @ x + jumps)

    def transpose(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `forward`: from derivatives of the result to derivatives of free and given rotations."""
        found = self._solved(bar, np.zeros_like(bar), lambda x: self.of_free @ x)
        return found, -(self.of_given.T @ (self.weights[:, None] * (self.of_free @ found)))

    def joined(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners, smoothed and given, that the rotations of the wanted ones, a mask, depend on."""
        _, part = connected_components(self._matrix, directed=False)
        is_joined = np.isin(part, part[wanted[self.free]])
        edges = np.flatnonzero(self.of_free @ is_joined.astype(float) != 0.0)
        return self.free[is_joined], self.given[np.unique(self.of_given[edges].indices)]

    def _solved(self, load: np.ndarray, start: np.ndarray, jumps: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Solve with corrections whose loads come from differences along edges, which keeps equal rotations equal."""
        found = start
        for _ in range(self._n_steps):
            pull = self.of_free.T @ (self.weights[:, None] * jumps(found))
            found = found + self._factor.solve(np.ascontiguousarray(load - found - pull))
        return found
