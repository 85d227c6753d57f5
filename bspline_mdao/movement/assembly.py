"""The unknowns of an elastic mesh: displacements of all points that have any freedom, as block rows of a matrix.

A point that may move in some directions only keeps its three rows, turned into its frame; those of the fixed directions
become rows of the identity, so that the matrix stays one of 3 x 3 blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..mesh.moving_mesh import MovingMesh
from ..sparse.blocks import BlockMatrix, BlockPattern, slots

__all__ = ["Unknowns"]


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Numbering of the points that may move.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    """

    mesh: MovingMesh

    @cached_property
    def point_ids(self) -> np.ndarray:
        """Point of each block row, ascending."""
        return np.flatnonzero(self.mesh.is_free.any(axis=1)).astype(np.int32)

    @cached_property
    def element_rows(self) -> np.ndarray:
        """Block row of every corner of every element, -1 where there is none, shape (n_elements, 8)."""
        rows = np.full(self.mesh.n_points, -1, dtype=np.int32)
        rows[self.point_ids] = np.arange(len(self.point_ids), dtype=np.int32)
        return rows[self.mesh.elements]

    @cached_property
    def pattern(self) -> BlockPattern:
        """Pattern of the stiffness."""
        return BlockPattern.of_elements(self.element_rows, len(self.point_ids))

    @cached_property
    def slots(self) -> np.ndarray:
        """Place of every pair of corners, see `bspline_mdao.sparse.blocks.slots`."""
        return slots(self.pattern, self.element_rows)

    def matrix(self, add_stiffness: Callable[[np.ndarray, np.ndarray, np.ndarray], None]) -> BlockMatrix:
        """Stiffness of the unknowns.

        Parameters
        ----------
        add_stiffness : callable
            ``add_stiffness(element_rows, slots, data)`` adds the stiffness of all elements to the blocks, shape
            (n_blocks, 3, 3).
        """
        data = np.zeros((self.pattern.n_blocks, 3, 3))
        add_stiffness(self.element_rows, self.slots, data)
        self._restrain(data)
        return BlockMatrix(self.pattern, data)

    def gather(self, force: np.ndarray) -> np.ndarray:
        """Components of a force, shape (n_points, 3), along the free directions: shape (n_rows, 3)."""
        return self._turned(force[self.point_ids]) * self._is_free

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Transpose of `gather`."""
        displacement = np.zeros((self.mesh.n_points, 3), dtype=unknowns.dtype)
        in_frames = unknowns * self._is_free
        if self._frames is not None:
            in_frames = np.einsum("nij,ni->nj", self._frames, in_frames)
        displacement[self.point_ids] = in_frames
        return displacement

    @cached_property
    def _is_free(self):
        return self.mesh.is_free[self.point_ids]

    @cached_property
    def _frames(self):
        return None if self.mesh.frames is None else self.mesh.frames[self.point_ids]

    def _turned(self, vectors):
        return vectors if self._frames is None else np.einsum("nij,nj->ni", self._frames, vectors)

    @cached_property
    def _restrained(self):
        """Entries, with rows and columns, that meet a point with a frame of its own or a fixed direction."""
        is_special = ~self._is_free.all(axis=1)
        if self._frames is not None:
            is_special |= (self._frames != np.eye(3)).any(axis=(1, 2))
        rows = np.repeat(np.arange(self.pattern.n, dtype=np.int32), np.diff(self.pattern.indptr))
        entries = np.flatnonzero(is_special[rows] | is_special[self.pattern.indices])
        return entries, rows[entries], self.pattern.indices[entries]

    def _restrain(self, data):
        """Turn blocks into the frames of their points, and put the identity where a direction is fixed."""
        entries, rows, columns = self._restrained
        blocks = data[entries]
        if self._frames is not None:
            blocks = self._frames[rows] @ blocks @ self._frames[columns].transpose(0, 2, 1)
        blocks *= self._is_free[rows][:, :, None] & self._is_free[columns][:, None, :]
        is_diagonal = rows == columns
        blocks[is_diagonal] += ~self._is_free[rows[is_diagonal]][:, :, None] * np.eye(3)
        data[entries] = blocks
