"""The cells of one block: what the baseline decides about them, and their measures and derivatives, chunk by chunk.

A chunk is some layers of cells along the first direction, few enough for the corner measures to fit the second-level
cache.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .cell_loops import as_points, block_jvp, block_measures, block_vjp
from .hexahedron import UPPER_CORNERS, cell_quality, collapsed_corners, flat_direction, mean_normal, stack_plane
from .orthogonality import orthogonality, orthogonality_jvp, orthogonality_vjp

__all__ = ["BlockCells", "Chunk", "Measures", "chunk_jvp", "chunk_measures", "chunk_vjp"]

CHUNK_CELLS = 8192
"""Cells of a chunk, at most, if it is more than one layer: their corner measures fit the second-level cache."""


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
    degenerate_corners : ndarray of uint8
        Bits of the degenerate corners, per cell; of a planar block with its flat direction moved last.
    inverse_volume : ndarray, shape (n_cells,)
        1 / volume, in absolute value (m^-3); 0 for cells that had none.
    was_invalid : ndarray of int, ascending
        Cells that were not valid.
    flat : int or None
        Direction with a single node.
    normal : ndarray, shape (3,), or None
        Unit normal of a planar block, which serves as its third edges.
    """

    name: str
    shape: tuple[int, int, int]
    first_node: int
    first_cell: int
    handedness: int
    degenerate_corners: np.ndarray
    inverse_volume: np.ndarray
    was_invalid: np.ndarray
    flat: int | None
    normal: np.ndarray | None

    @classmethod
    def of_baseline(cls, name: str, nodes: np.ndarray, first_node: int, first_cell: int) -> BlockCells:
        """Decide about the cells of a block of nodes (ni, nj, nk, 3) on the baseline."""
        degenerate_corners, flat = collapsed_corners(nodes), flat_direction(nodes.shape)
        quality = cell_quality(nodes, degenerate_corners)
        if flat is not None:
            degenerate_corners = np.moveaxis(degenerate_corners, flat, 2) | UPPER_CORNERS
        volume = np.abs(quality.volume).ravel()
        return cls(
            name=name,
            shape=nodes.shape[:3],
            first_node=first_node,
            first_cell=first_cell,
            handedness=quality.handedness,
            degenerate_corners=np.ascontiguousarray(degenerate_corners),
            inverse_volume=np.divide(1.0, volume, out=np.zeros_like(volume), where=volume > np.finfo(float).tiny),
            was_invalid=np.flatnonzero(~quality.is_valid),
            flat=flat,
            normal=None if flat is None else mean_normal(np.moveaxis(nodes, flat, 2)[:, :, 0]),
        )

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.degenerate_corners.size

    @property
    def degenerate_in_block(self) -> np.ndarray:
        """``degenerate_corners`` in the shape of the block's cells."""
        return self.degenerate_corners if self.flat is None else np.moveaxis(self.degenerate_corners, 2, self.flat)

    @property
    def n_bytes(self) -> int:
        """Memory that the state takes (B)."""
        return self.degenerate_corners.nbytes + self.inverse_volume.nbytes + self.was_invalid.nbytes

    @property
    def cells(self) -> slice:
        """Slice of the block's cells among those of the grid."""
        return slice(self.first_cell, self.first_cell + self.n_cells)

    def nodes_of(self, grid_nodes: np.ndarray) -> np.ndarray:
        """View the block's part of nodes (n, 3) of a grid as (ni, nj, nk, 3)."""
        size = int(np.prod(self.shape))
        return grid_nodes[self.first_node : self.first_node + size].reshape(*self.shape, 3)

    def chunks(self) -> Iterator[Chunk]:
        """Cut the block along its first direction, and return the chunks in order."""
        layer = int(np.prod(self.degenerate_corners.shape[1:]))
        n_layers = max(1, CHUNK_CELLS // layer)
        for start in range(0, len(self.degenerate_corners), n_layers):
            yield Chunk(self, start, min(start + n_layers, len(self.degenerate_corners)))


@dataclass(frozen=True, eq=False)
class Chunk:
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
    def degenerate_corners(self) -> np.ndarray:
        """Bits of the degenerate corners of the chunk's cells."""
        return self.block.degenerate_corners[self.start : self.stop]

    @property
    def in_block(self) -> slice:
        """Slice of the chunk's cells among those of the block."""
        layer = int(np.prod(self.block.degenerate_corners.shape[1:]))
        return slice(self.start * layer, self.stop * layer)

    @property
    def in_grid(self) -> slice:
        """Slice of the chunk's cells among those of the grid."""
        cells, first = self.in_block, self.block.first_cell
        return slice(first + cells.start, first + cells.stop)

    def solid(self, grid_nodes: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the chunk as (layers + 1, n, m, 3); a planar one is given depth along ``normal``, if any."""
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


@dataclass(frozen=True)
class Measures:
    """Measures of the cells of a chunk, or changes or adjoints of them.

    Parameters
    ----------
    q : ndarray, shape (n_cells,)
        Orthogonality, Eq. (9).
    triples : ndarray, shape (8, n_cells)
        Corner triple products; 1 at degenerate corners.
    jacobians : ndarray, shape (8, n_cells)
        Corner Jacobians divided by the volume of the cell on the baseline; infinite at degenerate corners.
    volume : ndarray, shape (n_cells,)
        Volumes divided by those of the baseline; infinite where there was none.
    """

    q: np.ndarray
    triples: np.ndarray
    jacobians: np.ndarray
    volume: np.ndarray

    @classmethod
    def zeros_like(cls, other: Measures) -> Measures:
        """Zeros of the shapes of another."""
        return cls(*(np.zeros_like(x) for x in (other.q, other.triples, other.jacobians, other.volume)))


def chunk_measures(chunk: Chunk, nodes: np.ndarray) -> Measures:
    """Measure the cells of a chunk of a grid with nodes (n_nodes, 3)."""
    triples, jacobians, volume = _empty(chunk)
    points = as_points(chunk.solid(nodes, chunk.block.normal))
    block_measures(points, chunk.degenerate_corners, chunk.block.handedness, triples, jacobians, volume)
    _scale(chunk, jacobians, volume, np.inf)
    return Measures(orthogonality(triples, axis=0), triples, jacobians, volume)


def chunk_jvp(chunk: Chunk, nodes: np.ndarray, d_nodes: np.ndarray, measures: Measures) -> Measures:
    """Change of the measures with the nodes."""
    d_triples, d_jacobians, d_volume = _empty(chunk)
    points, d_points = as_points(chunk.solid(nodes, chunk.block.normal)), as_points(chunk.solid(d_nodes))
    block_jvp(points, d_points, chunk.degenerate_corners, chunk.block.handedness, d_triples, d_jacobians, d_volume)
    _scale(chunk, d_jacobians, d_volume, 0.0)
    return Measures(orthogonality_jvp(measures.triples, d_triples, axis=0), d_triples, d_jacobians, d_volume)


def chunk_vjp(chunk: Chunk, nodes: np.ndarray, measures: Measures, bar: Measures, nodes_bar: np.ndarray) -> None:
    """Add the adjoint of the nodes, from that of the measures, to ``nodes_bar`` (n_nodes, 3)."""
    triples_bar = bar.triples + orthogonality_vjp(measures.triples, bar.q, axis=0)
    inverse = chunk.block.inverse_volume[chunk.in_block]
    solid = chunk.solid(nodes, chunk.block.normal)
    solid_bar = np.zeros(solid.shape)
    block_vjp(
        as_points(solid), chunk.degenerate_corners, chunk.block.handedness,
        triples_bar, bar.jacobians * inverse, bar.volume * inverse, as_points(solid_bar),
    )  # fmt: skip
    chunk.add(solid_bar, nodes_bar)


def _empty(chunk):
    n = chunk.degenerate_corners.size
    return np.empty((8, n)), np.empty((8, n)), np.empty(n)


def _scale(chunk, jacobians, volume, without):
    """Divide by the volumes of the baseline; cells that had none get the value ``without``."""
    inverse = chunk.block.inverse_volume[chunk.in_block]
    had_none = inverse == 0.0
    jacobians *= np.where(had_none, 1.0, inverse)
    volume *= inverse
    if had_none.any():
        jacobians[:, had_none] = volume[had_none] = without
