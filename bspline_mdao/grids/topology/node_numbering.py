"""Some nodes of a grid in any order: where each is evaluated, and which are copies of others.

A node that blocks share is always evaluated in the first segment that contains it, so its value is bitwise the same
however the grid is cut. Nothing here is as large as the grid unless all of it is included: links and collapses join
nodes on faces of segments only.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .block_layout import BlockLayout
from .index_space import Window, window_rows
from .topology import BoundaryFace, Topology, joined_pairs, joined_points

__all__ = [
    "NodeNumbering",
    "NodesByRow",
    "boundary_rows",
    "face_layer_rows",
    "face_rows",
    "node_copies",
    "rows_of_places",
    "source_rows",
]


def node_copies(topology: Topology) -> np.ndarray:
    """Rows that are copies and the rows that they copy, shape (n_copies, 2), ascending by the first."""
    # They are as in `bspline_mdao.grids.topology.sharing.node_sharing`.
    segments = topology.segments
    shapes = [segment.shape for segment in segments]
    pairs = joined_pairs(shapes, topology.links, topology.collapses, topology.segment_names)
    rows, sources = (rows_of_places(topology, points) for points in joined_points(pairs))
    rows, first = np.unique(rows, return_index=True)
    sources = sources[first]
    return np.stack([rows, sources], axis=1)[rows != sources]


def source_rows(copies: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows of nodes, or of those that they copy: `node_copies`."""
    if not len(copies):
        return np.asarray(rows)
    at = np.minimum(np.searchsorted(copies[:, 0], rows), len(copies) - 1)
    return np.where(copies[at, 0] == rows, copies[at, 1], rows)


def face_rows(topology: Topology, window: Window) -> np.ndarray:
    """Rows in the grid vector of the nodes of a window of a block: an array of the window's shape."""
    return window_rows(window, topology.shapes[window.block], int(topology.layout.starts[window.block]))


def face_layer_rows(topology: Topology, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the nodes of a face window and of the next layer, shape (n, m), in the order of `face_layers`."""
    flat = window.shape.index(1)
    at = window.lo[flat]
    next_index = min(1, topology.shapes[window.block][flat] - 1) if at == 0 else at - 1
    lo, hi = (end[:flat] + (next_index,) + end[flat + 1 :] for end in (window.lo, window.hi))
    face, inner = face_rows(topology, window), face_rows(topology, Window(window.block, lo, hi))
    return face.squeeze(flat), inner.squeeze(flat)


@dataclass(frozen=True, eq=False)
class NodeNumbering:
    """Some nodes of a grid. Made by `NodeNumbering.of` or `NodeNumbering.of_grid`."""

    topology: Topology  # topology of the grid
    rows: np.ndarray  # (n,) of int, row of every node in the grid vector
    n_asked: int  # number of requested nodes, which come first; the others are needed by these
    # (n_copies, 2) of int, numbers of nodes that are copies, and of the nodes that they copy, ascending by the first
    copies: np.ndarray
    numbers: tuple[np.ndarray, ...]  # of int, per segment, numbers of the nodes evaluated there, ascending
    places: tuple[np.ndarray, ...]  # of int, per segment, places of these nodes in the C order of the segment

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid
        rows: np.ndarray,  # (n_asked,) of int, rows of the nodes in any order, which is kept; repetitions are allowed
        needed: Sequence[np.ndarray] = (),  # of int, rows of nodes to include among the others
    ) -> NodeNumbering:
        """Number some nodes, and the nodes of which they are copies."""
        copies = node_copies(topology)
        also = source_rows(copies, each_once(np.concatenate([np.zeros(0, dtype=np.int64), *needed])))
        also = each_once(np.concatenate([source_rows(copies, rows), also]))
        also = also[~np.isin(also, rows)]
        rows_asked = np.concatenate([rows, also])
        unique, first = np.unique(rows_asked, return_index=True)
        source = first[np.searchsorted(unique, source_rows(copies, rows_asked))]
        is_copy = source != np.arange(len(rows_asked))
        originals = np.flatnonzero(~is_copy)
        numbers, places = _by_segments(topology, rows_asked[originals], originals)
        copied = np.flatnonzero(is_copy)
        return cls(topology, rows_asked, len(rows), np.stack([copied, source[copied]], axis=1), numbers, places)

    @classmethod
    def of_grid(cls, topology: Topology) -> NodeNumbering:
        """Number all nodes of a grid, in its order."""
        # no sorting or searching, with which `of` takes five times as long
        copies, is_copy = node_copies(topology), np.zeros(topology.n_nodes, dtype=bool)
        is_copy[copies[:, 0]] = True
        numbers, places = [], []
        for segment in topology.segments:
            rows, is_first = face_rows(topology, segment), np.zeros(segment.shape, dtype=bool)
            inner = tuple(slice(int(lo > 0), None) for lo in segment.lo)  # the previous segment has the shared nodes
            is_first[inner] = ~is_copy[rows[inner]]
            places.append(np.flatnonzero(is_first))
            numbers.append(rows.ravel()[places[-1]])
        return cls(topology, np.arange(topology.n_nodes), topology.n_nodes, copies, tuple(numbers), tuple(places))

    @property
    def n_nodes(self) -> int:
        """Number of nodes, including those that others need."""
        return len(self.rows)

    def numbers_of(self, rows: np.ndarray) -> np.ndarray:
        """Number of each node, or of the node that it copies, by its row; -1 if it is not included."""
        rows, (unique, first) = source_rows(self._copies_of_grid, rows), self._sorted
        at = np.minimum(np.searchsorted(unique, rows), max(len(unique) - 1, 0))
        return np.where(unique[at] == rows, first[at], -1) if len(unique) else np.full(rows.shape, -1)

    def sources_of(self, rows: np.ndarray) -> np.ndarray:
        """Row of each node of the grid, or of the node that it copies, included or not."""
        return source_rows(self._copies_of_grid, rows)

    @cached_property
    def _copies_of_grid(self) -> np.ndarray:
        return node_copies(self.topology)

    @cached_property
    def _sorted(self) -> tuple[np.ndarray, np.ndarray]:
        is_rising = bool((self.rows[1:] > self.rows[:-1]).all())
        return (self.rows, np.arange(len(self.rows))) if is_rising else np.unique(self.rows, return_index=True)


@dataclass(frozen=True, eq=False)
class NodesByRow:
    """Coordinates of some nodes of a grid, indexed by row as if all nodes were there."""

    rows: np.ndarray  # (n,) of int, rows of the nodes in the grid vector
    points: np.ndarray  # (n, 3), their coordinates (m)

    def __getitem__(self, rows: np.ndarray) -> np.ndarray:
        """Places of nodes by their rows."""
        at = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        if not np.array_equal(self.rows[at], rows):
            raise KeyError("a node that is looked up by its row is not among those that are there")
        return self.points[at]


def boundary_rows(topology: Topology, faces: Sequence[BoundaryFace]) -> np.ndarray:
    """Rows of the nodes of boundary faces, ascending, each once."""
    rows = [face_rows(topology, face.window).ravel() for face in faces]
    return each_once(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))


def each_once(rows: np.ndarray) -> np.ndarray:
    """Sort rows, and keep each once; `np.unique` hashes since NumPy 2.3, and takes a hundred times as long."""
    rows = np.sort(rows)
    return rows[np.concatenate([np.ones(min(1, rows.size), dtype=bool), rows[1:] != rows[:-1]])]


def rows_of_places(topology: Topology, points: np.ndarray) -> np.ndarray:
    """Rows in the grid vector of nodes numbered by segment, each in C order."""
    segments = topology.segments
    number, index = BlockLayout.of(segment.shape for segment in segments).unravel(points)
    blocks = np.array([segment.block for segment in segments])
    lows = np.array([segment.lo for segment in segments])
    return topology.layout.ravel(blocks[number], lows[number] + index)


def _by_segments(
    topology: Topology, rows: np.ndarray, numbers: np.ndarray
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Sort nodes into the first segments that contain them: their numbers, and their places there."""
    layout = topology.layout
    of_block = layout.owner(rows)
    order = np.argsort(of_block, kind="stable")
    sorted_numbers = [np.zeros(0, dtype=np.int64)] * len(topology.segments)
    places = list(sorted_numbers)
    grids = _segment_grids(topology)
    for block, at in _groups(of_block[order], order):
        (lows, table), index = grids[block], np.unravel_index(rows[at] - layout.starts[block], layout.shapes[block])
        intervals = [np.maximum(np.searchsorted(low, i) - 1, 0) for low, i in zip(lows, index)]
        of_segment = table[tuple(intervals)]
        again = np.argsort(of_segment, kind="stable")
        for segment, which in _groups(of_segment[again], again):
            window = topology.segments[segment]
            local = tuple(i[which] - lo for i, lo in zip(index, window.lo))
            sorted_numbers[segment] = numbers[at[which]]
            places[segment] = np.ravel_multi_index(local, window.shape)
    return tuple(sorted_numbers), tuple(places)


def _segment_grids(topology: Topology) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Per block, the low ends of its segments in each direction, and the numbers of the segments by these."""
    by_block: list[list[int]] = [[] for _ in topology.shapes]
    for number, segment in enumerate(topology.segments):
        by_block[segment.block].append(number)
    grids = []
    for numbers in by_block:
        lows = [np.unique([topology.segments[n].lo[d] for n in numbers]) for d in range(3)]
        grids.append((lows, np.reshape(numbers, [len(low) for low in lows])))
    return grids


def _groups(keys: np.ndarray, values: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each of the ascending keys with its values."""
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    for start, end in zip(starts, np.append(starts[1:], len(keys))):
        yield int(keys[start]), values[start:end]
