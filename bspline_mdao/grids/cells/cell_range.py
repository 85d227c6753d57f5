"""Cells of a mesh that one of several processes judges: as many each, in the order of the mesh, and their faces.

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
    """Cells one after the other; made by `of`."""

    first: int  # number of the first of them in the mesh
    n: int  # how many they are
    faces: np.ndarray  # int (n_faces, 4), their faces, around the normals out of them
    cells: np.ndarray  # int (n_faces,), cell that each is of, from 0 here
    sides: np.ndarray | None  # int (n_faces,), side of a cell that each is a piece of; None where all are whole
    side_cells: np.ndarray  # int (n_sides,), cell that each side is of

    @classmethod
    def of(cls, mesh: MixedMesh, rank: int = 0, n_ranks: int = 1) -> CellRange:
        """Take those of one of several processes; of one all."""
        (faces, cells), (sides, side_cells) = mesh.cell_faces, mesh.sides
        if n_ranks == 1:
            return cls(0, mesh.n_cells, faces, cells, sides, side_cells)
        first, last = (mesh.n_cells * k // n_ranks for k in (rank, rank + 1))
        rows = np.flatnonzero((cells >= first) & (cells < last))
        is_here = (side_cells >= first) & (side_cells < last)
        renumbered = None if sides is None else np.unique(sides[rows], return_inverse=True)[1].ravel()
        return cls(first, last - first, faces[rows], cells[rows] - first, renumbered, side_cells[is_here] - first)

    def pyramids(self, points: np.ndarray) -> Pyramids:
        """Pyramids to their sides, with the nodes of the mesh somewhere, shape (n_points, 3)."""
        return Pyramids.of(points, self.faces, self.cells, self.n, self.sides)

    def quality(self, points: np.ndarray) -> CellQuality:
        """Volumes, and which are inverted."""
        return quality_of(self.pyramids(points))
