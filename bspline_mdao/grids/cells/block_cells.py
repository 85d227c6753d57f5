"""The cells of one block, or of a piece of it: what the baseline decides about them, their measures and derivatives.

A chunk is some layers of cells along the first direction, the unit of work of a thread.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import gathered, together
from ..topology.block_layout import has_cells
from ..topology.index_space import Window
from .cell_loops import as_points, block_bounds, block_jvp, block_vjp
from .hexahedron import COLLAPSE_TOLERANCE, UPPER_CORNERS, cell_quality, collapsed_corners, flat_direction, stack_plane
from .jacobian_bounds import N_COEFFICIENTS, block_coefficients, coefficients_jvp, coefficients_vjp
from .pieces import Frame, Pieces

__all__ = [
    "BlockCells",
    "Chunk",
    "block_cells",
    "chunk_bounds",
    "chunk_coefficients",
    "chunk_coefficients_jvp",
    "chunk_coefficients_vjp",
    "chunk_jvp",
    "chunk_vjp",
]

LOWER_CORNERS = np.uint8(0b00001111)
"""Corners 0 to 3, the corners of a planar block."""

CHUNK_CELLS = 32768
"""Largest number of cells of a chunk of more than one layer. Kernels hold two layers of nodes and read one layer more
than a chunk has of cells: in a block of 64 by 32 cells across, one in 17."""


@dataclass(frozen=True, eq=False)
class BlockCells(OneLine):
    """Cells of a block, or of a piece of it, with what the baseline has decided."""

    # If a process holds some pieces of a grid, "grid" stands for these below.

    name: str  # name of the block
    window: Window  # the piece of it, usually all of it
    # where the piece starts in the grid vector and among the cells
    first_node: int
    first_cell: int
    handedness: int  # +1 or -1, the sign of most of the block's cells
    # bits of the degenerate corners, per cell; of a planar block with its flat direction moved last
    degenerate_corners: np.ndarray
    inverse_volume: np.ndarray  # (n_cells,), 1 / volume, in absolute value (m^-3); 0 for cells without volume
    was_invalid: np.ndarray  # cells that were not valid
    flat: int | None  # direction with a single node
    normal: np.ndarray | None  # (3,), or None, unit normal of a planar block, used as its third edges
    shortest: float  # shorter edges at degenerate corners count as collapsed (m)

    @classmethod
    def of_baseline(
        cls,
        name: str,
        window: Window,
        nodes: np.ndarray,
        first_node: int,
        first_cell: int,
        frame: Frame,
        handedness: int | None = None,
    ) -> BlockCells:
        """Decide about the cells of a piece of a block with nodes (ni, nj, nk, 3) on the baseline."""
        # ``frame`` belongs to the block. ``handedness`` is by default the sign of most cells of the piece.
        degenerate_corners, flat = collapsed_corners(nodes, frame.size), flat_direction(nodes.shape)
        quality = cell_quality(nodes, degenerate_corners, handedness, frame.normal)
        if flat is not None:
            degenerate_corners = np.moveaxis(degenerate_corners, flat, 2) | UPPER_CORNERS
        volume = np.abs(quality.volume).ravel()
        return cls(
            name=name,
            window=window,
            first_node=first_node,
            first_cell=first_cell,
            handedness=quality.handedness,
            degenerate_corners=np.ascontiguousarray(degenerate_corners),
            inverse_volume=np.divide(1.0, volume, out=np.zeros_like(volume), where=volume > np.finfo(float).tiny),
            was_invalid=np.flatnonzero(~quality.is_valid),
            flat=flat,
            normal=frame.normal,
            shortest=COLLAPSE_TOLERANCE * frame.size,
        )

    def number(self, cell: int) -> tuple[int, ...]:
        """Number (i, j, k) in the whole block, from 1, of a cell."""
        index = np.unravel_index(cell, self.degenerate_in_block.shape)
        return tuple(int(n) + low + 1 for n, low in zip(index, self.window.lo))

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.degenerate_corners.size

    @property
    def sign(self) -> float:
        """``handedness`` in the type of kernels: with an integer they would be compiled again."""
        return float(self.handedness)

    @property
    def degenerate_in_block(self) -> np.ndarray:
        """``degenerate_corners`` in the shape of the block's cells."""
        return self.degenerate_corners if self.flat is None else np.moveaxis(self.degenerate_corners, 2, self.flat)

    @property
    def n_bytes(self) -> int:
        """Memory of the state (B)."""
        return self.degenerate_corners.nbytes + self.inverse_volume.nbytes + self.was_invalid.nbytes

    @property
    def cells(self) -> slice:
        """Slice of the block's cells among the grid's."""
        return slice(self.first_cell, self.first_cell + self.n_cells)

    def nodes_of(self, grid_nodes: np.ndarray) -> np.ndarray:
        """View the block's part of values (n, ...) of all nodes, such as their places, as (ni, nj, nk, ...)."""
        shape = self.window.shape
        return grid_nodes[self.first_node : self.first_node + math.prod(shape)].reshape(*shape, *grid_nodes.shape[1:])

    def chunks(self) -> Iterator[Chunk]:
        """Cut the block along its first direction, and return the chunks in order."""
        layer = int(np.prod(self.degenerate_corners.shape[1:]))
        n_layers = max(1, CHUNK_CELLS // layer)
        for start in range(0, len(self.degenerate_corners), n_layers):
            yield Chunk(self, start, min(start + n_layers, len(self.degenerate_corners)))


def block_cells(
    pieces: Pieces,
    nodes: np.ndarray,  # (n_nodes, 3), nodes of this process (m)
    frames: Sequence[Frame],  # frame of the block of each of its pieces, see `Pieces.frames`
) -> tuple[BlockCells, ...]:  # one for each piece of this process that has cells
    """Decide about the cells of all pieces of a process on the baseline; all processes call it."""
    blocks: list[BlockCells] = []
    first_nodes, first_cells = (layout.starts.tolist() for layout in (pieces.layout, pieces.layout.cells))
    signs = _handedness(pieces, nodes, frames) if pieces.split else {}
    with together(pieces.comm):
        parts = zip(pieces.local, pieces.nodes_of(nodes), first_nodes, first_cells, frames)
        for piece, x, first_node, first_cell, frame in parts:
            if has_cells(piece.shape):
                place, sign = (piece, x, first_node, first_cell), signs.get(piece.block)
                blocks.append(BlockCells.of_baseline(pieces.names[piece.block], *place, frame, sign))
    return tuple(blocks)


def _handedness(pieces: Pieces, nodes: np.ndarray, frames: Sequence[Frame]) -> dict[int, int]:
    """Sign of most cells of each split block; in case of a tie, the sign of its middle layer."""
    counts = []
    with together(pieces.comm):
        for piece, x, frame in zip(pieces.local, pieces.nodes_of(nodes), frames):
            if piece.block in pieces.split and has_cells(piece.shape):
                counts.append((piece.block, *_signs(piece, x, frame, pieces.shapes[piece.block])))
    every = gathered(pieces.comm, np.array(counts, dtype=int).reshape(-1, 3))
    totals = {block: every[every[:, 0] == block, 1:].sum(axis=0).tolist() for block in pieces.split}
    return {block: 1 if tuple(total) >= (0, 0) else -1 for block, total in totals.items()}


def _signs(piece: Window, nodes: np.ndarray, frame: Frame, shape: tuple[int, ...]) -> tuple[int, int]:
    """Positive minus negative volumes among the cells of a piece, and among the middle layer of its block."""
    volume = np.sign(cell_quality(nodes, collapsed_corners(nodes, frame.size), 1, frame.normal).volume)
    along = next(d for d in range(3) if shape[d] > 1)
    layer = (shape[along] - 1) // 2 - piece.lo[along]
    middle = volume.take(layer, axis=along) if 0 <= layer < volume.shape[along] else volume[:0]
    return int(np.nansum(volume)), int(np.nansum(middle))


@dataclass(frozen=True, eq=False)
class Chunk:
    """Layers ``start`` to ``stop`` of the cells of a block."""

    block: BlockCells
    # layers along its first direction, the first that is not flat
    start: int
    stop: int

    @property
    def degenerate_corners(self) -> np.ndarray:
        """Bits of the degenerate corners of the chunk's cells."""
        return self.block.degenerate_corners[self.start : self.stop]

    def was_invalid(self) -> np.ndarray:
        """Cells of the chunk that were not valid on the baseline."""
        first, last = self.in_block.start, self.in_block.stop
        were = self.block.was_invalid
        return were[np.searchsorted(were, first) : np.searchsorted(were, last)] - first

    @property
    def solid_bits(self) -> np.ndarray:
        """Degenerate corners of the cells of `solid`: the same on both sides of a planar block."""
        bits = self.degenerate_corners
        return bits if self.block.flat is None else (bits & LOWER_CORNERS) * np.uint8(17)

    @property
    def in_block(self) -> slice:
        """Slice of the chunk's cells among the block's."""
        layer = int(np.prod(self.block.degenerate_corners.shape[1:]))
        return slice(self.start * layer, self.stop * layer)

    @property
    def in_grid(self) -> slice:
        """Slice of the chunk's cells among the grid's."""
        cells, first = self.in_block, self.block.first_cell
        return slice(first + cells.start, first + cells.stop)

    def solid(self, grid_nodes: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the chunk as (layers + 1, n, m, 3); a planar chunk gets depth along ``normal``, if any."""
        nodes = self._nodes(grid_nodes)
        return nodes if self.block.flat is None else stack_plane(nodes[:, :, 0], 0.0 if normal is None else normal)

    @contextmanager
    def added(self, grid_bar: np.ndarray) -> Iterator[np.ndarray]:
        """Room for adjoints of `solid`, which are added to the adjoints of the grid's nodes."""
        bar = self._nodes(grid_bar)
        if self.block.flat is None:
            yield bar
        else:
            solid_bar = np.zeros((*bar.shape[:2], 2, 3))
            yield solid_bar
            bar += solid_bar.sum(axis=2, keepdims=True)

    def _nodes(self, grid_nodes: np.ndarray) -> np.ndarray:
        nodes = self.block.nodes_of(grid_nodes)
        if self.block.flat is not None:
            nodes = np.moveaxis(nodes, self.block.flat, 2)
        return nodes[self.start : self.stop + 1]


def chunk_bounds(
    chunk: Chunk,
    nodes: np.ndarray,  # (n_nodes, 3)
    bounds: np.ndarray,  # of `BOUND`, references and totals are set
    q: np.ndarray,  # (n_cells,) of the grid, receives Q of the cells of the chunk; or of no size
) -> None:
    """Bound the measures of the cells of a chunk of a grid."""
    block_bounds(*_cells_of(chunk, nodes), bounds, _part(chunk, q))


def chunk_jvp(chunk: Chunk, nodes: np.ndarray, d_nodes: np.ndarray, bounds: np.ndarray, d_q: np.ndarray) -> None:
    """Change of `chunk_bounds` with the nodes: the totals of the bounds."""
    x, *cells = _cells_of(chunk, nodes)
    block_jvp(x, as_points(chunk.solid(d_nodes)), *cells, bounds, _part(chunk, d_q))


def chunk_vjp(
    chunk: Chunk,
    nodes: np.ndarray,  # (n_nodes, 3)
    bounds: np.ndarray,  # with seeds
    q_bar: np.ndarray,  # (n_cells,) of the grid, or of no size
    nodes_bar: np.ndarray,  # (n_nodes, 3), added to
) -> None:
    """Add the adjoint of the nodes from the adjoint of `chunk_bounds`."""
    with chunk.added(nodes_bar) as solid_bar:
        block_vjp(*_cells_of(chunk, nodes), bounds, _part(chunk, q_bar), as_points(solid_bar))


def chunk_coefficients(chunk: Chunk, nodes: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (27, n_cells) of the Jacobian, divided by the volume of the cell on the baseline."""
    # infinite if they are zero because of a collapsed edge
    x, _, sign, inverse = _cells_of(chunk, nodes)
    coefficients = np.empty((N_COEFFICIENTS, inverse.size))
    block_coefficients(x, chunk.solid_bits, sign, chunk.block.shortest, coefficients)
    coefficients *= np.where(inverse == 0.0, 1.0, inverse)
    coefficients[:, inverse == 0.0] = np.inf
    return coefficients


def chunk_coefficients_jvp(chunk: Chunk, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Change of the coefficients with the nodes."""
    x, bits, sign, inverse = _cells_of(chunk, nodes)
    d_coefficients = np.empty((N_COEFFICIENTS, inverse.size))
    coefficients_jvp(x, as_points(chunk.solid(d_nodes)), bits, sign, d_coefficients)
    d_coefficients *= inverse
    return d_coefficients


def chunk_coefficients_vjp(chunk: Chunk, nodes: np.ndarray, bar: np.ndarray, nodes_bar: np.ndarray) -> None:
    """Add the adjoint of the nodes from the adjoint of the coefficients."""
    x, bits, sign, inverse = _cells_of(chunk, nodes)
    with chunk.added(nodes_bar) as solid_bar:
        coefficients_vjp(x, bits, sign, bar * inverse, as_points(solid_bar))


def _cells_of(chunk: Chunk, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Nodes, degenerate corners, handedness and inverse volumes, as arguments of kernels."""
    block = chunk.block
    points = as_points(chunk.solid(nodes, block.normal))
    return points, chunk.degenerate_corners, block.sign, block.inverse_volume[chunk.in_block]


def _part(chunk: Chunk, of_cells: np.ndarray) -> np.ndarray:
    """View of a chunk's part of an array over all cells, which may have no size."""
    return of_cells[chunk.in_grid]
