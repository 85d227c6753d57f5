"""The cells of a mesh that one of several processes judges: equal shares, in the order of the mesh, and their faces.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .mixed_cells import CellQuality, MixedMesh, quality_of
from .pyramids import Pyramids

__all__ = ["CellRange"]


@dataclass(frozen=True, eq=False)
class CellRange(OneLine):
    """Consecutive cells; made by `of`."""

    first: int  # number of the first of them in the mesh
    n: int  # their number
    faces: np.ndarray  # int (n_faces, 4), their faces, around the normals out of them
    cells: np.ndarray  # int (n_faces,), cell of each face, from 0 here
    sides: np.ndarray | None  # int (n_sides,), side of a cell that each face is a piece of; None if all are whole
    side_cells: np.ndarray  # int (n_sides,), cell of each side

    @classmethod
    def of(cls, mesh: MixedMesh, rank: int = 0, n_ranks: int = 1) -> CellRange:
        """Take the share of one of several processes; of one process, all."""
        (faces, cells), (sides, side_cells) = mesh.cell_faces, mesh.sides
        if n_ranks == 1:
            return cls(0, mesh.n_cells, faces, cells, sides, side_cells)
        first, last = (mesh.n_cells * k // n_ranks for k in (rank, rank + 1))
        rows = np.flatnonzero((cells >= first) & (cells < last))
        is_here = (side_cells >= first) & (side_cells < last)
        renumbered = None if sides is None else np.unique(sides[rows], return_inverse=True)[1].ravel()
        return cls(first, last - first, faces[rows], cells[rows] - first, renumbered, side_cells[is_here] - first)

    def pyramids(self, points: np.ndarray) -> Pyramids:
        """Pyramids to their sides, with moved nodes of the mesh, shape (n_points, 3)."""
        return Pyramids.of(points, self.faces, self.cells, self.n, self.sides)

    def quality(self, points: np.ndarray) -> CellQuality:
        """Volumes, and which cells are inverted."""
        return quality_of(self.pyramids(points))
