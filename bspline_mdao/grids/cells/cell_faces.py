"""Cells and faces of all blocks in one list, for unstructured flow solvers.

Cells are numbered block after block, each block in C order. Every face has a cell to its left; inner faces, of blocks
and of interfaces in any orientation, have one to their right. Corners of a face are ordered such that half the cross
product of its diagonals points out of the left cell, whatever the handedness of the block. A node that blocks share is
always taken from the same row of the grid vector, so the faces of every cell close to the last bit.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ..topology.block_layout import BlockLayout
from ..topology.boundary_surface import corners_in_turn
from ..topology.index_space import Interface, Window
from ..topology.sharing import node_sharing
from ..topology.topology import BoundaryFace, Topology
from .quads import area_vectors

__all__ = ["BoundaryFaces", "CellFaces"]

_ROUNDED = np.finfo(float).eps
"""Volume of a cell, relative to its surface and the coordinates, below which it counts as zero."""

NONE = -1
"""Entry of lists of cells for no cell."""

NUMBER = np.int32
"""Type of numbers of cells and nodes in lists of faces, which are a tenth of a flow's storage for its grid."""


@dataclass(frozen=True)
class BoundaryFaces:
    """The faces of one patch."""

    name: str  # name of the patch; ``unassigned`` for faces of no patch
    kind: str | None  # kind of the patch
    # range of its faces in the list of all
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class CellFaces:
    """Faces between the cells of a multi-block grid, the inner ones first, then patch after patch."""

    layout: BlockLayout  # of the cells
    corners: np.ndarray  # int (n_faces, 4), rows of a face's corners in the grid vector, see the module docstring
    left: np.ndarray  # int (n_faces,), cell on the left of each face
    right: np.ndarray  # int (n_inner,), cell on the right of each inner face
    # cell behind the left cell as seen from the face, along the grid line through it, and behind the right cell; -1
    # if there is none
    beyond_left: np.ndarray  # int (n_faces,)
    beyond_right: np.ndarray  # int (n_inner,)
    # third cell of the grid line from each boundary face inwards; -1 if there is none
    third: np.ndarray  # int (n_faces - n_inner,)
    boundary: tuple[BoundaryFaces, ...]  # the patches
    n_ghosts: int = 0  # cells of other processes; numbered after the cells
    # windows of the blocks of the layout; None if they are whole blocks
    pieces: tuple[Window, ...] | None = None
    # numbers of the boundary faces among the faces of all pieces, patch after patch; None if they are all
    numbers_in_grid: np.ndarray | None = None  # int (n_faces - n_inner,), or None

    @classmethod
    def of(
        cls,
        topology: Topology,  # how its blocks are joined
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m), which determine the handedness of each block
    ) -> CellFaces:
        """List the faces of a grid. `InputError` if a block has no cells, or the sum of its cell volumes is zero."""
        blocks = _blocks(topology, nodes)
        inner = [faces for block in blocks for faces in block.inner()]
        inner += [_interface(blocks, interface) for interface in topology.interfaces]
        quads, left, left_slot, right, right_slot = (np.concatenate(parts) for parts in zip(*inner))
        lines = _Lines.of(sum(block.cells.size for block in blocks), left, left_slot, right, right_slot)
        edge, patches = _boundary(blocks, topology.boundary, len(quads))
        beyond_right, _ = lines.across(right, right_slot)
        left, left_slot = np.append(left, edge[1]), np.append(left_slot, edge[2])
        beyond_left, entry = lines.across(left, left_slot)
        return cls(
            layout=topology.layout.cells,
            corners=np.concatenate([quads, edge[0]]).astype(NUMBER),
            left=left.astype(NUMBER),
            right=right.astype(NUMBER),
            beyond_left=beyond_left.astype(NUMBER),
            beyond_right=beyond_right.astype(NUMBER),
            third=lines.across(beyond_left[len(quads) :], entry[len(quads) :])[0].astype(NUMBER),
            boundary=patches,
        )

    @property
    def n_cells(self) -> int:
        """Cells of all blocks."""
        return self.layout.size

    @property
    def n_inner(self) -> int:
        """Faces between two cells."""
        return len(self.right)

    @property
    def n_faces(self) -> int:
        """All faces."""
        return len(self.left)

    def faces_of(self, kind: str) -> np.ndarray:
        """Numbers of the faces of all patches of a kind."""
        ranges = [np.arange(patch.start, patch.stop) for patch in self.boundary if patch.kind == kind]
        return np.concatenate(ranges) if ranges else np.zeros(0, dtype=int)

    def corners_of(self, kind: str) -> np.ndarray:
        """Rows of the corners, shape (n, 4), of the faces of all patches of a kind; ``Cp`` has the order of walls."""
        return self.corners[self.faces_of(kind)]

    def sum_over_cells(self, values: np.ndarray, sign: float = -1.0) -> np.ndarray:
        """Sum numbers of the faces, shape (n_faces,), over the faces of every cell."""
        # The number of a face counts for the cell on its left, and times ``sign`` for the cell on its right.
        n = self.n_cells + self.n_ghosts
        left = np.bincount(self.left, values, n)
        return (left + sign * np.bincount(self.right, values[: self.n_inner], n))[: self.n_cells]

    def sizes(self, nodes: np.ndarray) -> np.ndarray:
        """Areas (m^2) of the surfaces of all cells, shape (n_cells,), from nodes, shape (n_nodes, 3)."""
        return self.sum_over_cells(np.linalg.norm(area_vectors(nodes[self.corners]), axis=1), 1.0)

    def volumes(self, nodes: np.ndarray) -> np.ndarray:
        """Volumes (m^3) of all cells, shape (n_cells,), negative if a cell is inside out."""
        corners = nodes[self.corners]
        return self.sum_over_cells(np.sum(area_vectors(corners) * corners.mean(axis=1), axis=1)) / 3.0

    def require_volumes(self, nodes: np.ndarray) -> None:
        """Refuse cells with negative volumes."""
        volumes = self.volumes(nodes)
        n_negative = np.count_nonzero(volumes < -_ROUNDED * np.abs(nodes).max(initial=0.0) * self.sizes(nodes))
        if n_negative:
            worst = int(np.argmin(volumes))
            raise InputError(
                f"{n_negative} of {self.n_cells} cells have negative volumes, the worst {volumes[worst]:.2g} m^3 in "
                f"{self.place(worst)}"
            )

    def place(self, cell: int) -> str:
        """Name a cell for messages: block and indices, from 1."""
        (number,), (index,) = self.layout.unravel(np.array([cell]))
        block, lo = (number, (0, 0, 0)) if self.pieces is None else (self.pieces[number].block, self.pieces[number].lo)
        i, j, k = index + lo
        return f"block {block + 1}, cell ({i + 1}, {j + 1}, {k + 1})"


@dataclass(frozen=True, eq=False)
class _Block:
    """Rows of the nodes of a block, numbers of its cells, and whether its index space is right-handed."""

    rows: np.ndarray
    cells: np.ndarray
    is_right_handed: bool

    def quads(self, d: int) -> np.ndarray:
        """Corners of the faces across direction ``d``, which point towards its high end: (*shape, 4)."""
        rows = np.moveaxis(self.rows, ((d + 1) % 3, (d + 2) % 3, d), (0, 1, 2))
        quads = corners_in_turn(rows)
        quads = quads if self.is_right_handed else quads[..., ::-1]
        return np.moveaxis(quads, (0, 1, 2), ((d + 1) % 3, (d + 2) % 3, d))

    def inner(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Yield the faces inside the block by direction: corners, cells to the left and right and their slots."""
        for d in range(3):
            low, high, middle = ([slice(None)] * 3 for _ in range(3))
            low[d], high[d], middle[d] = slice(0, -1), slice(1, None), slice(1, -1)
            left, right = self.cells[tuple(low)].ravel(), self.cells[tuple(high)].ravel()
            quads = self.quads(d)[tuple(middle)].reshape(-1, 4)
            yield quads, left, np.full(left.shape, 2 * d + 1), right, np.full(right.shape, 2 * d)

    def window(self, window: Window) -> tuple[np.ndarray, np.ndarray, int]:
        """Return corners of the faces of a face window, pointing outwards, the cells behind them, and their slot."""
        d = next(d for d in range(3) if window.lo[d] == window.hi[d])
        side = int(window.lo[d] > 0)
        parts = [slice(lo, hi) for lo, hi in zip(window.lo, window.hi)]
        parts[d] = slice(window.lo[d], window.lo[d] + 1)
        quads = self.quads(d)[tuple(parts)]
        parts[d] = slice(-1, None) if side else slice(0, 1)
        return (quads if side else quads[..., ::-1]), self.cells[tuple(parts)], 2 * d + side


@dataclass(frozen=True, eq=False)
class _Lines:
    """Neighbour of every cell in every slot and the slot there that leads back; the last cell stands for none."""

    neighbours: np.ndarray
    entries: np.ndarray

    @classmethod
    def of(
        cls, n_cells: int, left: np.ndarray, left_slot: np.ndarray, right: np.ndarray, right_slot: np.ndarray
    ) -> _Lines:
        neighbours, entries = np.full((n_cells + 1, 6), NONE), np.zeros((n_cells + 1, 6), dtype=int)
        neighbours[left, left_slot], entries[left, left_slot] = right, right_slot
        neighbours[right, right_slot], entries[right, right_slot] = left, left_slot
        return cls(neighbours, entries)

    def across(self, cells: np.ndarray, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cells on the other side of cells that are entered through slots, and the slots that enter them."""
        return self.neighbours[cells, slots ^ 1], self.entries[cells, slots ^ 1]


def _blocks(topology: Topology, nodes: np.ndarray) -> list[_Block]:
    """Index the blocks, with shared nodes in one row."""
    sources = node_sharing(topology).source_rows()
    layout, blocks = topology.layout, []
    for number, (rows, in_block) in enumerate(zip(layout.numbers, layout.cells.numbers), start=1):
        if min(rows.shape) < 2:
            raise InputError(f"{topology.source}: block {number} is a surface; give blocks with cells")
        volume = _signed_volume(nodes[rows])
        if volume == 0.0:
            raise InputError(f"{topology.source}: block {number} has no volume; leave it out")
        blocks.append(_Block(sources[rows], in_block, bool(volume > 0.0)))
    return blocks


def _signed_volume(x: np.ndarray) -> float:
    """Sum of the triple products of the cells' edges at their first corners."""
    a, b, c = (
        np.diff(x, axis=d)[: -1 if d else None, : -1 if d != 1 else None, : -1 if d != 2 else None] for d in range(3)
    )
    return float(np.sum(np.cross(a, b) * c))


def _interface(
    blocks: Sequence[_Block], interface: Interface
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Faces of an interface, in the form of `_Block.inner`."""
    quads, left, left_slot = blocks[interface.a.block].window(interface.a)
    _, right, right_slot = blocks[interface.b.block].window(interface.b)
    right = interface.orientation.apply(right).ravel()
    slots = np.full(right.shape, left_slot), np.full(right.shape, right_slot)
    return quads.reshape(-1, 4), left.ravel(), slots[0], right, slots[1]


def _boundary(
    blocks: Sequence[_Block], windows: Sequence[BoundaryFace], start: int
) -> tuple[list[np.ndarray], tuple[BoundaryFaces, ...]]:
    """Corners, cells and slots of the boundary faces patch after patch, and the patches."""
    names = dict.fromkeys((window.patch or "unassigned", window.kind) for window in windows)
    parts, patches = [(np.zeros((0, 4), int), np.zeros(0, int), np.zeros(0, int))], []
    for name, kind in names:
        first = start
        for face in windows:
            if (face.patch or "unassigned", face.kind) == (name, kind):
                quads, cells, slot = blocks[face.window.block].window(face.window)
                parts.append((quads.reshape(-1, 4), cells.ravel(), np.full(cells.size, slot)))
                start += cells.size
        patches.append(BoundaryFaces(name, kind, first, start))
    return [np.concatenate(part) for part in zip(*parts)], tuple(patches)
