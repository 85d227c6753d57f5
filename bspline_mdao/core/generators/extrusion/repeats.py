"""Nodes of periodic edges: each is a translated copy of another one, and marches with it.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ....base.numerics.vectors import lengths
from ....errors import InputError
from .surface import SurfaceMesh

REPEATED = 1e-5
"""Distance between nodes and translated ones, relative to the translation, within which they are the same."""


@dataclass(frozen=True, eq=False)
class Repeats:
    """Which nodes march, and by how many of which translations the others are off them."""

    unknown: np.ndarray  # int (n,), number of the marching node that represents each
    first: np.ndarray  # int (n_unknowns,), the node that marches
    times: np.ndarray  # int (n, n_translations), how often each is translated from it
    translations: np.ndarray  # (n_translations, 3) (m)

    @classmethod
    def none(cls, n: int) -> Repeats:
        """All nodes march."""
        return cls(np.arange(n), np.arange(n), np.zeros((n, 0), np.int64), np.zeros((0, 3)))

    def joined(self, mesh: SurfaceMesh, nodes: np.ndarray, normal: np.ndarray) -> Repeats:
        """The same with nodes at both ends along a normal, (n_nodes,) of the mesh, identified."""
        heights = mesh.points[nodes] @ normal
        is_high = heights > 0.5 * (heights.min() + heights.max())
        low, high = nodes[~is_high], nodes[is_high]
        shift = mesh.points[high].mean(axis=0) - mesh.points[low].mean(axis=0)
        distance, nearest = cKDTree(mesh.points[low]).query(mesh.points[high] - shift)
        if len(low) != len(high) or distance.max() > REPEATED * lengths(shift):
            raise InputError(
                f"{mesh.source}: periodic edges with {len(low)} and {len(high)} nodes are not equal up to a "
                f"translation; give them the same nodes"
            )
        times = np.concatenate([self.times, np.zeros((len(self.times), 1), np.int64)], axis=1)
        unknown, partner = self.first[self.unknown], low[nearest]
        times[high] = times[partner]
        times[high, -1] += 1
        unknown[high] = unknown[partner]
        first, unknown = np.unique(unknown, return_inverse=True)
        return replace(
            self, unknown=unknown, first=first, times=times, translations=np.vstack([self.translations, shift])
        )

    @property
    def n_shifts(self) -> int:
        """Number of translations between neighbours: each forwards, backwards or absent."""
        return int(3 ** len(self.translations))

    @property
    def shifts(self) -> np.ndarray:
        """These translations, (n_shifts, 3); the first is none (m)."""
        places = np.array(np.unravel_index(np.arange(self.n_shifts), (3,) * len(self.translations) or (1,)))
        times = np.where(places == 2, -1, places)[: len(self.translations)]
        return times.T.reshape(self.n_shifts, -1) @ self.translations

    def keys(self, of: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
        """Numbers of neighbours relative to nodes: the marching node times ``n_shifts``, plus the translation."""
        between = (self.times[neighbours] - self.times[of]) % 3
        powers = 3 ** np.arange(len(self.translations))[::-1]
        return self.unknown[neighbours] * self.n_shifts + between @ powers

    def directed(self, of: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
        """Numbers of edges from nodes to neighbours."""
        return self.unknown[of] * (len(self.first) * self.n_shifts) + self.keys(of, neighbours)

    def all(self, front: np.ndarray) -> np.ndarray:
        """All nodes, (n, 3), from the marching ones, (n_unknowns, 3)."""
        return front[self.unknown] + self.times @ self.translations
