"""The cells of one block: what the baseline decides about them, and slabs of them to work through."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .hexahedron import UPPER_CORNERS, cell_quality, collapsed_corners, flat_direction, mean_normal, stack_plane

SLAB_CELLS = 8192
"""Cells of a slab, at most, if it is more than one layer: their corner measures fit the second-level cache."""


@dataclass(frozen=True, eq=False)
class BlockCells:
    """Cells of a block with what stays as it was on the baseline.

    Parameters
    ----------
    name : str
        Name of the block.
    shape : tuple of int
        Nodes of the block in each direction.
    first_node, first_cell : int
        Where the block starts in the grid vector and among the cells.
    handedness : int
        +1 or -1, the sign that most of its cells had.
    left_out : ndarray of uint8
        Bits of the corners that are left out, per cell; of a planar block with its flat direction moved last.
    inverse_volume : ndarray, shape (n_cells,)
        1 / volume, in absolute value (m^-3); 0 for cells that had none.
    was_invalid : ndarray of int, ascending
        Cells that were not valid.
    flat : int or None
        Direction with a single node.
    normal : ndarray, shape (3,), or None
        Unit normal of a planar block, which stands in for its third edges.
    """

    name: str
    shape: tuple[int, int, int]
    first_node: int
    first_cell: int
    handedness: int
    left_out: np.ndarray
    inverse_volume: np.ndarray
    was_invalid: np.ndarray
    flat: int | None
    normal: np.ndarray | None

    @classmethod
    def of_baseline(cls, name: str, nodes: np.ndarray, first_node: int, first_cell: int) -> BlockCells:
        """Look at the cells of a block of nodes (ni, nj, nk, 3) on the baseline."""
        left_out, flat = collapsed_corners(nodes), flat_direction(nodes.shape)
        quality = cell_quality(nodes, left_out)
        if flat is not None:
            left_out = np.moveaxis(left_out, flat, 2) | UPPER_CORNERS
        volume = np.abs(quality.volume).ravel()
        return cls(
            name=name,
            shape=nodes.shape[:3],
            first_node=first_node,
            first_cell=first_cell,
            handedness=quality.handedness,
            left_out=np.ascontiguousarray(left_out),
            inverse_volume=np.divide(1.0, volume, out=np.zeros_like(volume), where=volume > np.finfo(float).tiny),
            was_invalid=np.flatnonzero(~quality.is_valid),
            flat=flat,
            normal=None if flat is None else mean_normal(np.moveaxis(nodes, flat, 2)[:, :, 0]),
        )

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.left_out.size

    @property
    def left_out_of_block(self) -> np.ndarray:
        """``left_out`` in the shape of the block's cells."""
        return self.left_out if self.flat is None else np.moveaxis(self.left_out, 2, self.flat)

    @property
    def n_bytes(self) -> int:
        """Memory that the state takes."""
        return self.left_out.nbytes + self.inverse_volume.nbytes + self.was_invalid.nbytes

    @property
    def cells(self) -> slice:
        """Where the cells of the block are among those of the grid."""
        return slice(self.first_cell, self.first_cell + self.n_cells)

    def nodes_of(self, grid_nodes: np.ndarray) -> np.ndarray:
        """View the block's part of nodes (n, 3) of a grid as (ni, nj, nk, 3)."""
        size = int(np.prod(self.shape))
        return grid_nodes[self.first_node : self.first_node + size].reshape(*self.shape, 3)

    def slabs(self) -> Iterator[Slab]:
        """Cut the block along its first direction."""
        layer = int(np.prod(self.left_out.shape[1:]))
        n_layers = max(1, SLAB_CELLS // layer)
        for start in range(0, len(self.left_out), n_layers):
            yield Slab(self, start, min(start + n_layers, len(self.left_out)))


@dataclass(frozen=True, eq=False)
class Slab:
    """Layers ``start`` to ``stop`` of the cells of a block.

    Parameters
    ----------
    block : BlockCells
        The block.
    start, stop : int
        Layers along its first direction, the first that is not flat.
    """

    block: BlockCells
    start: int
    stop: int

    @property
    def left_out(self) -> np.ndarray:
        """Bits of the slab's cells."""
        return self.block.left_out[self.start : self.stop]

    @property
    def in_block(self) -> slice:
        """Where the slab's cells are among those of the block."""
        layer = int(np.prod(self.block.left_out.shape[1:]))
        return slice(self.start * layer, self.stop * layer)

    @property
    def in_grid(self) -> slice:
        """Where the slab's cells are among those of the grid."""
        cells, first = self.in_block, self.block.first_cell
        return slice(first + cells.start, first + cells.stop)

    def solid(self, grid_nodes: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the slab as (layers + 1, n, m, 3); a planar one is given depth along ``normal``, if any."""
        nodes = self._nodes(grid_nodes)
        return nodes if self.block.flat is None else stack_plane(nodes[:, :, 0], 0.0 if normal is None else normal)

    def add(self, solid_bar: np.ndarray, grid_bar: np.ndarray) -> None:
        """Add adjoints of what `solid` gives to those of the grid's nodes."""
        bar = self._nodes(grid_bar)
        bar += solid_bar if self.block.flat is None else solid_bar.sum(axis=2, keepdims=True)

    def _nodes(self, grid_nodes):
        nodes = self.block.nodes_of(grid_nodes)
        if self.block.flat is not None:
            nodes = np.moveaxis(nodes, self.block.flat, 2)
        return nodes[self.start : self.stop + 1]
