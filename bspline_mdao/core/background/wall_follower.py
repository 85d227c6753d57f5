"""Given wall nodes, which are themselves the surface control points of an unstructured mesh.

For block-structured grids `bspline_mdao.core.fit.surface_fit.SurfaceFollower` takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh

__all__ = ["GivenWalls", "WallFollower"]


@dataclass(frozen=True, eq=False)
class WallFollower(OneLine):
    """Surface control points from given nodes, averaged over nodes given more than once."""

    means: csr_array  # (n_surface, n), from the given nodes
    baseline: np.ndarray  # (n, 3), the given nodes on the baseline (m)

    @classmethod
    def of(
        cls,
        mesh: MovingMesh,
        ids: np.ndarray,  # int (n,), mesh point number of each given node; -1 for others
        baseline: np.ndarray,  # (n, 3), the given nodes on the baseline (m)
    ) -> WallFollower:
        """Sort given nodes; `InputError` if a surface node is not among them."""
        rows = np.where(ids >= 0, mesh.surface_rows[ids], -1)
        at = np.flatnonzero(rows >= 0)
        counts = np.bincount(rows[at], minlength=len(mesh.surface_ids))
        if not counts.all():
            raise InputError(
                f"surface: {mesh.place_of_surface_point(int(np.argmin(counts)))} is not given, nor are "
                f"{np.count_nonzero(counts == 0) - 1} others; give all nodes of the design surface, or make the "
                f"mover's mesh with fewer walls"
            )
        shape = (len(counts), len(ids))
        return cls(csr_array((1.0 / counts[rows[at]], (rows[at], at)), shape=shape), baseline)

    def at(self, nodes: np.ndarray) -> GivenWalls:
        """Control points at given nodes, shape (n, 3), in metres."""
        return GivenWalls(self, self.means @ nodes)

    def miss(self, nodes: np.ndarray, target: np.ndarray) -> None:
        """None: control points are at the prescribed positions of nodes."""


@dataclass(frozen=True, eq=False)
class GivenWalls(OneLine):
    """Control points at given nodes, and their derivative."""

    of: WallFollower
    control_points: np.ndarray  # (n_surface, 3), the surface control points (m)

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), from a change of the nodes, shape (n, 3)."""
        return self.of.means @ change

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`."""
        return self.of.means.T @ bar
