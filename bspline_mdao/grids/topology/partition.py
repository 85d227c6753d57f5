"""The part of a grid on each of several processes: whole blocks, and pieces of blocks where the balance needs them.

A piece is a window of a block. Neighbouring pieces of a block share the nodes of the plane between them; a cell belongs
to one piece only. The nodes of a subdomain are ordered piece by piece, each in C order, so the subdomain of a single
process is the grid.

A solver with its own distribution gives the nodes of each process instead: `Subdomain.of_rows`.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heapreplace

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .block_layout import BlockLayout
from .edge_cut import with_short_cuts
from .index_space import Window, window_rows
from .topology import Topology

__all__ = ["Partition", "Subdomain"]


@dataclass(frozen=True, eq=False)
class Subdomain(OneLine):
    """The nodes of a grid on one process, by `Partition.subdomain`, `Subdomain.of_grid` or `Subdomain.of_rows`.

    Parameters
    ----------
    n_nodes_of_grid : int
        Nodes of all blocks of the grid.
    rows : ndarray of int, shape (n_nodes,)
        Row in the grid vector of every node of the subdomain: pieces in order, each in C order.
    windows : tuple of Window, or None
        Its pieces; None if it was made of rows.
    shapes_of_grid : tuple of tuple of int
        Number of nodes of each block of the grid in each direction; empty if the subdomain was made of rows.

    Examples
    --------
    >>> from bspline_mdao.parallel import Subdomain
    >>> subdomain = Subdomain.of_rows([0, 1, 2], n_nodes_of_grid=100)
    >>> subdomain.n_nodes, subdomain.is_grid
    (3, False)
    """

    n_nodes_of_grid: int
    rows: np.ndarray
    windows: tuple[Window, ...] | None = None
    shapes_of_grid: tuple[tuple[int, ...], ...] = ()

    @classmethod
    def of_windows(cls, shapes: Sequence[tuple[int, ...]], windows: Sequence[Window]) -> Subdomain:
        """Make the subdomain of some pieces of blocks of given shapes."""
        layout = BlockLayout.of(shapes)
        starts = layout.starts.tolist()
        rows = [window_rows(window, shapes[window.block], starts[window.block]).ravel() for window in windows]
        return cls(layout.size, np.concatenate([np.zeros(0, dtype=np.int64), *rows]), tuple(windows), tuple(shapes))

    @classmethod
    def of_grid(cls, topology: Topology) -> Subdomain:
        """Make the subdomain of a single process: all nodes."""
        return Partition.of(topology, 1).subdomain(0)

    @classmethod
    def of_rows(cls, rows: Sequence[int] | np.ndarray, n_nodes_of_grid: int) -> Subdomain:
        """Make the subdomain of a process whose nodes a solver names.

        Parameters
        ----------
        rows : sequence of int
            Row in the grid vector of every node, in the solver's order; repetitions are allowed.
        n_nodes_of_grid : int
            Nodes of all blocks of the grid.

        Raises
        ------
        InputError
            If they are not rows of the grid.
        """
        array = np.asarray(rows)
        is_list = array.ndim == 1 and (array.dtype.kind in "iu" or not array.size)
        if not is_list or (array.size and not 0 <= array.min() <= array.max() < n_nodes_of_grid):
            raise InputError(
                f"subdomain of a grid: the rows do not fit {n_nodes_of_grid} nodes; give a list of integers from "
                f"0 to {n_nodes_of_grid - 1}"
            )
        return cls(n_nodes_of_grid, array.astype(np.int64))

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.rows)

    @property
    def is_grid(self) -> bool:
        """Whether the subdomain is all of the grid, in its order."""
        return self.n_nodes == self.n_nodes_of_grid and bool((np.diff(self.rows, prepend=-1) == 1).all())

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Number of nodes of each piece in each direction.

        Raises
        ------
        InputError
            If the subdomain was made of rows.
        """
        return tuple(window.shape for window in self._pieces)

    @property
    def starts(self) -> tuple[int, ...]:
        """Number of the first node of each piece in the subdomain, and the number of all nodes."""
        return tuple(BlockLayout.of(self.shapes).starts.tolist())

    @cached_property
    def cells(self) -> np.ndarray:
        """Number in the grid of every cell of the subdomain: pieces in order, each in C order, as for nodes.

        Cells of the grid are numbered block after block, each in C order; a block with fewer than two directions of
        more than one node has none.

        Raises
        ------
        InputError
            If the subdomain was made of rows.
        """
        layout = BlockLayout.of(self.shapes_of_grid).cells
        cells = [np.zeros(0, dtype=np.int64)]
        for window in self._pieces:
            if math.prod(layout.shapes[window.block]):
                last = tuple(max(hi - 1, lo) for lo, hi in zip(window.lo, window.hi))
                inside = Window(window.block, window.lo, last)
                start = int(layout.starts[window.block])
                cells.append(window_rows(inside, layout.shapes[window.block], start).ravel())
        return np.concatenate(cells)

    @property
    def _pieces(self) -> tuple[Window, ...]:
        if self.windows is None:
            raise InputError(
                "subdomain of a grid: a list of nodes has no cells; give a subdomain of blocks, by "
                "Partition.of(topology, n_ranks).subdomain(rank)"
            )
        return self.windows


@dataclass(frozen=True, eq=False)
class Partition(OneLine):
    """The pieces of a grid on each of several processes. Made by `Partition.of`.

    Parameters
    ----------
    shapes : tuple of tuple of int
        Number of nodes of each block in each direction.
    pieces : tuple of tuple of Window
        Pieces of each process, in the order of the blocks; empty if there are too few.

    Examples
    --------
    >>> from bspline_mdao.core.generators.canonical import flat_plate_grid
    >>> from bspline_mdao.grids.topology.detection import find_topology
    >>> partition = Partition.of(find_topology(flat_plate_grid()), n_ranks=3)
    >>> [len(pieces) for pieces in partition.pieces]
    [4, 4, 4]
    """

    shapes: tuple[tuple[int, ...], ...]
    pieces: tuple[tuple[Window, ...], ...]

    @classmethod
    def of(cls, topology: Topology, n_ranks: int, imbalance: float = 0.15) -> Partition:
        """Distribute blocks to processes, the largest first, each to the process with the fewest nodes.

        Blocks larger than a subdomain may be, and the largest blocks of an overloaded process, are cut along their
        longest direction. Finally, pieces are exchanged until there are few faces between processes.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        n_ranks : int
            Number of processes.
        imbalance : float
            Largest excess of the largest subdomain over the mean, relative to the mean. It is exceeded only if nothing
            can be cut further.

        Returns
        -------
        Partition
            The same on every process.

        Raises
        ------
        InputError
            If there is no process, or the imbalance is not positive.
        """
        if not (isinstance(n_ranks, (int, np.integer)) and n_ranks > 0):
            raise InputError(f"partition: {n_ranks} processes; give a number from 1")
        if not imbalance > 0.0:
            raise InputError(f"partition: an imbalance of {imbalance}; give a positive one, such as 0.15")
        mean = topology.n_nodes / n_ranks
        pieces = []
        for block, shape in enumerate(topology.shapes):
            pieces += _cut(Window.whole(block, shape), max(1, math.ceil(math.prod(shape) / (1.0 + imbalance) / mean)))
        while True:
            dealt = _dealt(pieces, n_ranks)
            most = (1.0 + imbalance) * sum(map(_size, pieces)) / n_ranks
            too_large = {_largest(subdomain) for subdomain in dealt if sum(map(_size, subdomain)) > most}
            halves = {piece: _cut(piece, 2) for piece in too_large}
            if all(len(parts) == 1 for parts in halves.values()):
                dealt = with_short_cuts(topology, dealt)
                order = (sorted(subdomain, key=lambda piece: (piece.block, piece.lo)) for subdomain in dealt)
                return cls(tuple(map(tuple, topology.shapes)), tuple(map(tuple, order)))
            pieces = [part for piece in pieces for part in halves.get(piece, [piece])]

    @cached_property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of the blocks in the grid vector."""
        return BlockLayout.of(self.shapes)

    @property
    def n_ranks(self) -> int:
        """Number of processes."""
        return len(self.pieces)

    def subdomain(self, rank: int) -> Subdomain:
        """Return the subdomain of a process."""
        return Subdomain.of_windows(self.shapes, self.pieces[rank])


def _size(window: Window) -> int:
    return math.prod(window.shape)


def _largest(windows: Sequence[Window]) -> Window:
    """Return the largest of some windows, the first in case of ties."""
    return min(windows, key=lambda window: (-_size(window), window.block, window.lo))


def _dealt(pieces: Sequence[Window], n_ranks: int) -> list[list[Window]]:
    """Distribute pieces, the largest first, each to the process with the fewest nodes."""
    dealt: list[list[Window]] = [[] for _ in range(n_ranks)]
    loads = [(0, rank) for rank in range(n_ranks)]
    heapify(loads)
    for piece in sorted(pieces, key=lambda window: (-_size(window), window.block, window.lo)):
        load, rank = loads[0]
        dealt[rank].append(piece)
        heapreplace(loads, (load + _size(piece), rank))
    return dealt


def _cut(window: Window, n_parts: int) -> list[Window]:
    """Cut a window into parts of about the same size, at most as many as it has layers of cells."""
    d = int(np.argmax(window.shape))
    n_layers = window.hi[d] - window.lo[d]
    if n_parts == 1 or n_layers < 2:
        return [window]
    n_first = n_parts // 2
    at = window.lo[d] + min(max(round(n_layers * n_first / n_parts), 1), n_layers - 1)
    hi, lo = (end[:d] + (at,) + end[d + 1 :] for end in (window.hi, window.lo))
    first, second = Window(window.block, window.lo, hi), Window(window.block, lo, window.hi)
    return _cut(first, n_first) + _cut(second, n_parts - n_first)
