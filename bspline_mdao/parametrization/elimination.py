"""Linear constraints among surface control points, handled by elimination."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, identity

from ..movement.mesh import MovingMesh
from .variable import block_diagonal

__all__ = ["Elimination", "eliminate"]


@dataclass(frozen=True, eq=False)
class Elimination:
    """Displacements that satisfy the constraints.

    Parameters
    ----------
    matrix : csr_array, shape (3 n_surface, 3 n_surface)
        Gives the displacements that satisfy the constraints from any displacements.
    """

    matrix: csr_array


def eliminate(mesh: MovingMesh, points: np.ndarray, constraints: Sequence = ()) -> Elimination:
    """Keep points in the symmetry planes of a mesh."""
    blocks = np.tile(np.eye(3), (len(points), 1, 1))
    for row, normal in zip(mesh.rail_rows, mesh.rail_normals):
        blocks[row] -= np.outer(normal, normal)
    matrix = identity(3 * len(points), format="csr") @ block_diagonal(blocks)
    matrix.eliminate_zeros()
    return Elimination(matrix)
