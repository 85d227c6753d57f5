"""Heights of the nodes next to walls of a mesh of mixed cells, and their ratios to the baseline.

The height at a node of a wall is the distance of its next node (`.mixed_cells.first_heights`) along the wall's unit
normal there::

    h = (x_next - x) . N / |N| ,    N: area vectors of the wall's faces around the node, summed.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from .mixed_cells import MixedMesh, faces_around, first_heights
from .quads import add_to_nodes, area_vectors, area_vectors_jvp, area_vectors_vjp

__all__ = ["NodeHeights"]


@dataclass(frozen=True, eq=False)
class NodeHeights(OneLine):
    """Wall nodes that have a next node; made by `of`."""

    faces: np.ndarray  # int (n_faces, 4), faces of the walls, around the normal into the mesh
    around: csr_array  # (n, n_faces), one for the faces around each node
    rows: np.ndarray  # int (n,), the nodes
    next_rows: np.ndarray  # int (n,), their next nodes
    baseline: np.ndarray  # (n,), heights on the baseline (m)

    @classmethod
    def of(cls, mesh: MixedMesh, faces: np.ndarray) -> NodeHeights:
        """Find them; all have a positive height on the baseline."""
        ids = np.unique(faces)
        at, next_rows = first_heights(mesh, faces, ids)
        found = cls(faces, csr_array(faces_around(ids, faces)[at]), ids[at], next_rows, np.ones(len(at)))
        return replace(found, baseline=found.heights(mesh.points))

    def among(self, nodes: np.ndarray) -> NodeHeights:
        """Those whose next node is among some of the mesh, ascending, with all of the walls; by their numbers there."""
        kept = np.flatnonzero(np.isin(self.next_rows, nodes))
        rows, next_rows, faces = (
            np.searchsorted(nodes, each) for each in (self.rows[kept], self.next_rows[kept], self.faces)
        )
        return NodeHeights(faces, csr_array(self.around[kept]), rows, next_rows, self.baseline[kept])

    def heights(self, nodes: np.ndarray) -> np.ndarray:
        """Heights (m), shape (n,), of nodes of the mesh, shape (n_points, 3)."""
        return np.sum(self._off(nodes) * self._normals(nodes)[0], axis=1)

    def part(self, rank: int, n_ranks: int) -> NodeHeights:
        """Take an equal share for one of several processes."""
        first, last = (len(self.rows) * k // n_ranks for k in (rank, rank + 1))
        here = slice(first, last)
        return NodeHeights(
            self.faces, csr_array(self.around[here]), self.rows[here], self.next_rows[here], self.baseline[here]
        )

    def ratios(self, nodes: np.ndarray) -> np.ndarray:
        """Heights relative to the baseline."""
        return self.heights(nodes) / self.baseline

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of the ratios with the nodes."""
        units, lengths = self._normals(nodes)
        d_sums = self.around @ area_vectors_jvp(nodes[self.faces], d_nodes[self.faces])
        d_units = (d_sums - np.sum(d_sums * units, axis=1)[:, None] * units) / lengths[:, None]
        return np.sum(self._off(d_nodes) * units + self._off(nodes) * d_units, axis=1) / self.baseline

    def vjp(self, nodes: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, from shape (n,) to shape (n_points, 3)."""
        units, lengths = self._normals(nodes)
        bar = (bar / self.baseline)[:, None]
        units_bar, off_bar = bar * self._off(nodes), bar * units
        sums_bar = (units_bar - np.sum(units_bar * units, axis=1)[:, None] * units) / lengths[:, None]
        corners_bar = area_vectors_vjp(nodes[self.faces], self.around.T @ sums_bar)
        nodes_bar = add_to_nodes(self.faces, corners_bar, len(nodes))
        np.add.at(nodes_bar, self.next_rows, off_bar)
        np.subtract.at(nodes_bar, self.rows, off_bar)
        return nodes_bar

    def _off(self, nodes: np.ndarray) -> np.ndarray:
        return nodes[self.next_rows] - nodes[self.rows]

    def _normals(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit normals, and the lengths of the sums from which they are made."""
        sums = self.around @ area_vectors(nodes[self.faces])
        lengths = np.linalg.norm(sums, axis=1)
        return sums / lengths[:, None], lengths
