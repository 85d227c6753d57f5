"""The faces of the cells of one process, and the cells and nodes of other processes that they need.

The residual of a cell needs the fluxes through its faces, and a flux needs the two cells on each side along the grid
line through the face. So the halo is two cells deep, across the sides of the pieces only. It contains no faces except
the faces of own cells, and all nodes of these are nodes of own cells.

Neighbours along a line are found from the indices of cells and from the interfaces of nearby blocks, so no list is as
long as the grid.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.numerics.halo import Halo
from ...base.numerics.processes import summed
from ...errors import InputError
from ..topology.block_layout import BlockLayout
from ..topology.index_space import Interface, Window
from ..topology.node_numbering import node_copies, source_rows
from ..topology.ownership import Ownership
from ..topology.partition import Partition, Subdomain
from ..topology.topology import Topology
from .cell_faces import NONE, NUMBER, BoundaryFaces, CellFaces, _Block, _signed_volume

__all__ = ["faces_of_subdomain"]


def faces_of_subdomain(
    topology: Topology,  # how the blocks of the grid are joined
    partition: Partition,  # who has which cells
    comm: Any,  # communicator, the processes
    nodes: np.ndarray,  # (n_nodes of the subdomain, 3), baseline nodes (m), which give the handedness of blocks
) -> tuple[CellFaces, Halo, Halo]:
    """List the faces of the cells of one process: all processes call it together."""
    # `InputError` if a block has no cells, or the sum of its cell volumes is zero
    # returns faces: cell numbers are own cells first, then those of other processes; corner numbers are nodes, then
    # those of others
    # returns cells, corners: exchange of cells and of nodes
    subdomain = _SubdomainCells.of(topology, partition, comm, nodes)
    parts = [*subdomain.inside(), *subdomain.cut_planes(), *subdomain.interfaces()]
    empty = np.zeros((0, 4), int), *(np.zeros(0, int) for _ in range(4))
    quads, left, left_slot, right, right_slot = (np.concatenate(part) for part in zip(empty, *parts))
    edge, numbers, patches = subdomain.boundary(len(quads))
    lines = subdomain.lines
    beyond_right, _ = lines.across(right, right_slot)
    left, left_slot = np.append(left, edge[1]), np.append(left_slot, edge[2])
    beyond_left, entry = lines.across(left, left_slot)
    third, _ = lines.across(beyond_left[len(quads) :], entry[len(quads) :])
    cells, seen = _places(comm, subdomain.cells, subdomain.n_cells, (left, right, beyond_left, beyond_right, third))
    corners, (places,) = _places(comm, subdomain.nodes, len(nodes), (np.concatenate([quads, edge[0]]).ravel(),))
    left, right, beyond_left, beyond_right, third = seen
    pieces = partition.pieces[comm.rank]
    faces = CellFaces(
        layout=BlockLayout.of(piece.shape for piece in pieces).cells,
        corners=places.reshape(-1, 4).astype(NUMBER),
        left=left.astype(NUMBER),
        right=right.astype(NUMBER),
        beyond_left=beyond_left.astype(NUMBER),
        beyond_right=beyond_right.astype(NUMBER),
        third=third.astype(NUMBER),
        boundary=patches,
        n_ghosts=cells.n_ghosts,
        pieces=pieces,
        numbers_in_grid=numbers,
    )
    return faces, cells, corners


def _places(comm: Any, holders: Ownership, n_owned: int, lists: Sequence[np.ndarray]) -> tuple[Halo, list[np.ndarray]]:
    """Exchange of all entries of some lists of numbers of the grid, and the lists with local places in their stead."""
    layout = BlockLayout.of(map(np.shape, lists))
    numbers = layout.join(lists)
    wanted, which = np.unique(numbers, return_inverse=True)
    n_none = np.searchsorted(wanted, NONE, side="right")
    halo, found = Halo.of(comm, n_owned, *holders.find(wanted[n_none:]))
    places = np.concatenate([wanted[:n_none], found])[which.ravel()]
    return halo, layout.split(places)


@dataclass(frozen=True, eq=False)
class _SubdomainCells:
    """Cells of the pieces of one process, by their numbers in the grid."""

    topology: Topology
    local: tuple[Window, ...]
    rank: int
    cells: Ownership
    nodes: Ownership
    copies: np.ndarray
    is_right_handed: np.ndarray
    lines: _IndexLines

    @classmethod
    def of(cls, topology: Topology, partition: Partition, comm: Any, nodes: np.ndarray) -> _SubdomainCells:
        pieces = partition.pieces[comm.rank]
        right_handed = _handedness(topology, pieces, comm, nodes)
        return cls(
            topology,
            pieces,
            comm.rank,
            Ownership.of_cells(partition),
            Ownership.of_nodes(partition),
            node_copies(topology),
            right_handed,
            _IndexLines.of(topology, {piece.block for piece in pieces}),
        )

    @property
    def n_cells(self) -> int:
        return BlockLayout.of(piece.shape for piece in self.local).cells.size

    def inside(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Faces inside the pieces: corners, cells to the left and right and their slots."""
        for piece in self.local:
            yield from self._block(piece).inner()

    def cut_planes(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Faces on the sides of the pieces that lie within their blocks; faces between two own pieces once."""
        for piece in self.local:
            block, shape = self._block(piece), self.topology.shapes[piece.block]
            for d in range(3):
                stride = _strides(shape)[d]
                for side, at, step in ((0, piece.lo[d], -stride), (1, piece.hi[d], stride)):
                    if at in (0, shape[d] - 1):
                        continue
                    ends = [slice(None)] * 3
                    ends[d] = slice(-1, None) if side else slice(0, 1)
                    local, quads = block.cells[tuple(ends)].ravel(), block.quads(d)[tuple(ends)].reshape(-1, 4)
                    left, right = (local, local + step) if side else (local + step, local)
                    chosen = np.full(len(local), True) if side else ~self._is_local(left)
                    n = np.count_nonzero(chosen)
                    yield quads[chosen], left[chosen], np.full(n, 2 * d + 1), right[chosen], np.full(n, 2 * d)

    def interfaces(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Faces of interfaces that have an own cell on one of their sides."""
        blocks = {piece.block for piece in self.local}
        for interface in self.topology.interfaces:
            if {interface.a.block, interface.b.block} & blocks:
                quads, left, left_slot = self._side(interface.a)
                _, right, right_slot = self._side(interface.b)
                right = interface.orientation.apply(right).ravel()
                left, quads = left.ravel(), quads.reshape(-1, 4)
                chosen = self._is_local(left) | self._is_local(right)
                n = np.count_nonzero(chosen)
                yield quads[chosen], left[chosen], np.full(n, left_slot), right[chosen], np.full(n, right_slot)

    def boundary(self, start: int) -> tuple:
        """Corners, cells and slots of the boundary faces of own cells patch after patch, their numbers, the patches."""
        # Numbers are among the boundary faces of the grid, of all processes.
        blocks, windows = {piece.block for piece in self.local}, self.topology.boundary
        names = dict.fromkeys((face.patch or "unassigned", face.kind) for face in windows)
        parts, patches, n_before = [(np.zeros((0, 4), int), *(np.zeros(0, int) for _ in range(3)))], [], 0
        for name, kind in names:
            first = start
            for face in windows:
                if (face.patch or "unassigned", face.kind) != (name, kind):
                    continue
                if face.window.block in blocks:
                    quads, cells, slot = self._side(face.window)
                    chosen = np.flatnonzero(self._is_local(cells.ravel()))
                    slots = np.full(len(chosen), slot)
                    parts.append((quads.reshape(-1, 4)[chosen], cells.ravel()[chosen], slots, n_before + chosen))
                    start += len(chosen)
                n_before += math.prod(max(n - 1, 1) for n in face.window.shape)
            patches.append(BoundaryFaces(name, kind, first, start))
        *edge, numbers = (np.concatenate(part) for part in zip(*parts))
        return edge, numbers, tuple(patches)

    def _is_local(self, cells: np.ndarray) -> np.ndarray:
        return self.cells.find(cells)[0] == self.rank

    def _side(self, window: Window) -> tuple[np.ndarray, np.ndarray, int]:
        """Corners of the faces of a face window of a block, pointing outwards, the cells behind them, their slot."""
        layer = _layer(window)
        inside = Window(window.block, *(tuple(np.subtract(end, layer.lo).tolist()) for end in (window.lo, window.hi)))
        return self._block(layer).window(inside)

    def _block(self, window: Window) -> _Block:
        """Rows and cells of a window in the form of a block; shared nodes have one row."""
        subdomain = Subdomain.of_windows(self.topology.shapes, [window])
        (cells,) = BlockLayout.of(subdomain.shapes).cells.split(subdomain.cells)
        rows = source_rows(self.copies, subdomain.rows).reshape(window.shape)
        return _Block(rows, cells, bool(self.is_right_handed[window.block]))


def _layer(window: Window) -> Window:
    """One layer of cells behind a face window of a block."""
    d = next(d for d in range(3) if window.lo[d] == window.hi[d])
    lo, hi = list(window.lo), list(window.hi)
    lo[d], hi[d] = (0, 1) if not window.lo[d] else (window.lo[d] - 1, window.lo[d])
    return Window(window.block, tuple(lo), tuple(hi))


def _handedness(topology: Topology, pieces: Sequence[Window], comm: Any, nodes: np.ndarray) -> np.ndarray:
    """Whether the index space of each block is right-handed, from the sum over the pieces that processes hold."""
    volumes = np.zeros(len(topology.shapes))
    for number, shape in enumerate(topology.shapes, start=1):
        if min(shape) < 2:
            raise InputError(f"{topology.source}: block {number} is a surface; give blocks with cells")
    for piece, x in zip(pieces, BlockLayout.of(piece.shape for piece in pieces).split(nodes)):
        volumes[piece.block] += _signed_volume(x)
    volumes = summed(comm, volumes)
    if not volumes.all():
        raise InputError(f"{topology.source}: block {np.argmin(volumes != 0) + 1} has no volume; leave it out")
    return volumes > 0.0


def _strides(shape: Sequence[int]) -> tuple[int, int, int]:
    """Strides of the cell numbers of a block, with a given number of nodes, in each direction."""
    return (shape[1] - 1) * (shape[2] - 1), shape[2] - 1, 1


@dataclass(frozen=True, eq=False)
class _IndexLines:
    """Neighbours of cells by their indices, and through interfaces by a table that is sorted by cell and slot."""

    layout: BlockLayout
    keys: np.ndarray
    neighbours: np.ndarray
    entries: np.ndarray

    @classmethod
    def of(cls, topology: Topology, blocks: set[int]) -> _IndexLines:
        """Tabulate the interfaces of some blocks and of the two rings of blocks around them."""
        for _ in range(2):
            ends = [{interface.a.block, interface.b.block} for interface in topology.interfaces]
            blocks = blocks.union(*(pair for pair in ends if pair & blocks))
        parts = [np.zeros((4, 0), int)]
        for interface in topology.interfaces:
            if {interface.a.block, interface.b.block} & blocks:
                parts += _pairs(topology, interface)
        cells, slots, neighbours, entries = np.concatenate(parts, axis=1)
        keys = 6 * cells + slots
        order = np.argsort(keys)
        return cls(topology.layout.cells, keys[order], neighbours[order], entries[order])

    def across(self, cells: np.ndarray, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cells on the other side of cells that are entered through slots, and the slots that enter them."""
        neighbours, entries = np.full(len(cells), NONE), np.zeros(len(cells), int)
        there = np.flatnonzero(cells != NONE)
        cells, slots = cells[there], slots[there]
        block, index = self.layout.unravel(cells)
        d, step = slots // 2, np.where(slots % 2, -1, 1)
        sizes = np.array(self.layout.shapes)[block]
        moved = np.take_along_axis(index, d[:, None], axis=1)[:, 0] + step
        is_inside = (moved >= 0) & (moved < np.take_along_axis(sizes, d[:, None], axis=1)[:, 0])
        strides = np.stack([sizes[:, 1] * sizes[:, 2], sizes[:, 2], np.ones_like(block)], axis=1)
        stride = np.take_along_axis(strides, d[:, None], axis=1)[:, 0]
        found, through = cells + step * stride, slots.copy()
        outside = np.flatnonzero(~is_inside)
        keys = 6 * cells[outside] + (slots[outside] ^ 1)
        at = np.minimum(np.searchsorted(self.keys, keys), max(len(self.keys) - 1, 0))
        is_joined = self.keys[at] == keys if len(self.keys) else np.zeros(len(keys), bool)
        found[outside], through[outside] = NONE, 0
        found[outside[is_joined]] = self.neighbours[at[is_joined]]
        through[outside[is_joined]] = self.entries[at[is_joined]]
        neighbours[there], entries[there] = found, through
        return neighbours, entries


def _pairs(topology: Topology, interface: Interface) -> Iterator[np.ndarray]:
    """Cells on both sides of an interface and their slots, both ways: arrays of shape (4, n)."""
    sides = []
    for window in (interface.a, interface.b):
        layer = _layer(window)
        d = next(d for d in range(3) if window.lo[d] == window.hi[d])
        subdomain = Subdomain.of_windows(topology.shapes, [layer])
        (cells,) = BlockLayout.of(subdomain.shapes).cells.split(subdomain.cells)
        sides.append((cells, 2 * d + int(window.lo[d] > 0)))
    (left, left_slot), (right, right_slot) = sides
    ours, theirs = left.ravel(), interface.orientation.apply(right).ravel()
    slots, their_slots = np.full(len(ours), left_slot), np.full(len(ours), right_slot)
    yield np.stack([ours, slots, theirs, their_slots])
    yield np.stack([theirs, their_slots, ours, slots])
