"""Numbers for the points of linked index spaces: each shared point once.

The links of a topology join whole faces, edges and corners of segments, so the same links number the nodes of a grid
and the control points of a control mesh, whatever the shapes, as long as linked sections agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import InputError
from .entities import BoundaryFace, Collapse, Link, Section

if TYPE_CHECKING:
    from .topology import Topology


@dataclass(frozen=True)
class NodeSharing:
    """Which segment evaluates which node of the grid, and where the others get it from.

    Parameters
    ----------
    rows : tuple of ndarray of int, each of the segment's shape
        Row of each node of the segment in the grid vector (shape (n_nodes, 3), blocks in order, each in C order).
    is_evaluated : tuple of ndarray of bool, each of the segment's shape
        True where this segment is the first to hold the node: each unique node exactly once.
    copies : ndarray of int, shape (n_copies, 2)
        (destination row, source row) for all rows that no segment evaluates, by ascending destination.
    """

    rows: tuple[np.ndarray, ...]
    is_evaluated: tuple[np.ndarray, ...]
    copies: np.ndarray

    def source_rows(self) -> np.ndarray:
        """Row that stands for each row of the grid vector: its own, or that of the node that it is a copy of."""
        source = np.arange(1 + max(int(rows.max()) for rows in self.rows))
        source[self.copies[:, 0]] = self.copies[:, 1]
        return source


def shared_ids(
    shapes: Sequence[tuple[int, int, int]],
    links: Sequence[Link],
    collapses: Sequence[Collapse] = (),
    names: Sequence[str] | None = None,
) -> list[np.ndarray]:
    """Give the points of index spaces numbers, linked points the same.

    Parameters
    ----------
    shapes : sequence of (n0, n1, n2)
        Shape of the index space of every segment.
    links : sequence of Link
        Sections that are the same.
    collapses : sequence of Collapse, optional
        Sections without extent in one direction.
    names : sequence of str, optional
        Names of the segments for messages; "block 1", ... by default.

    Returns
    -------
    list of ndarray of int32, each of the given shape
        Numbers 0, 1, 2, ... by first occurrence (segments in order, each in C order).

    Raises
    ------
    InputError
        If two linked sections disagree in their number of points.
    """
    starts = np.concatenate(([0], np.cumsum([np.prod(shape) for shape in shapes], dtype=np.int64)))
    pairs = [_link_pairs(shapes, starts, link, names) for link in links]
    pairs += [_collapse_pairs(shapes, starts, collapse) for collapse in collapses]
    first = _first_of_each(int(starts[-1]), pairs)
    is_first = first == np.arange(len(first))
    ids = (np.cumsum(is_first) - 1).astype(np.int32)[first]
    return [ids[start:end].reshape(shape) for start, end, shape in zip(starts, starts[1:], shapes)]


def node_sharing(topology: Topology) -> NodeSharing:
    """Share the nodes of a grid out among its segments, each unique node to the first that holds it."""
    whole = block_rows(topology.shapes)
    rows = [whole[segment.block][segment.slices] for segment in topology.segments]
    ids = topology.node_ids()
    flat_rows, flat_ids = (np.concatenate([a.ravel() for a in arrays]) for arrays in (rows, ids))
    _, first = np.unique(flat_ids, return_index=True)
    is_evaluated = np.zeros(len(flat_ids), dtype=bool)
    is_evaluated[first] = True
    source = np.empty(topology.n_nodes, dtype=flat_rows.dtype)
    source[flat_rows] = flat_rows[first][flat_ids]
    copied = np.flatnonzero(source != np.arange(len(source)))
    ends = np.cumsum([a.size for a in rows])[:-1]
    owned = [part.reshape(a.shape) for part, a in zip(np.split(is_evaluated, ends), rows)]
    return NodeSharing(tuple(rows), tuple(owned), np.stack([copied, source[copied]], axis=1))


def direction_classes(topology: Topology) -> np.ndarray:
    """Classes of segment directions that must have equal counts and orders.

    Returns
    -------
    ndarray of int, shape (n_segments, 3)
        Class of each direction of each segment, numbered by first occurrence; directions that a chain of links joins
        are in one class.
    """
    ids = np.arange(3 * len(topology.segments)).reshape(-1, 3)
    pairs = [
        [ids[link.a, d], ids[link.b, link.orientation.perm[d]]]
        for link in topology.links
        for d in range(3)
        if link.a_section[d] is None
    ]
    first = _first_of_each(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3)


def directed_classes(topology: Topology) -> np.ndarray:
    """Classes of segment directions that run alike.

    Returns
    -------
    ndarray of int, shape (n_segments, 3, 2)
        Class of each direction of each segment, run forwards and backwards: two that a chain of links joins are in one
        class where they run the same way. Both classes of a direction are one where links turn it round to itself.
    """
    ids = np.arange(6 * len(topology.segments)).reshape(-1, 3, 2)
    pairs = [
        [ids[link.a, d, way], ids[link.b, link.orientation.perm[d], way ^ link.orientation.flip[d]]]
        for link in topology.links
        for d in range(3)
        for way in (0, 1)
        if link.a_section[d] is None
    ]
    first = _first_of_each(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3, 2)


def block_rows(shapes: Sequence[tuple[int, int, int]]) -> list[np.ndarray]:
    """Give the nodes of all blocks their rows, blocks in order, each in C order: arrays of the blocks' shapes."""
    sizes = [int(np.prod(shape)) for shape in shapes]
    starts = np.cumsum([0, *sizes])
    return [np.arange(start, start + n).reshape(shape) for start, n, shape in zip(starts, sizes, shapes)]


def boundary_sections(topology: Topology, points: Sequence[np.ndarray]) -> Iterator[tuple[BoundaryFace, np.ndarray]]:
    """Boundary faces, each with every face of a segment that is on it.

    Declared patches cover whole faces of segments. What nobody declared may end inside one, and counts for all of it.

    Parameters
    ----------
    topology : Topology
        The boundary and the segments.
    points : sequence of ndarray of int, each of shape (N0, N1, N2)
        Numbers of the points of every segment, such as those of its control points.

    Yields
    ------
    face : BoundaryFace
    ids : ndarray of int, shape (ni, nj)
        Numbers of the points of the segment's face.
    """
    for face in topology.boundary:
        for number, segment in enumerate(topology.segments):
            for side in range(6) if segment.block == face.window.block else ():
                if segment.face(side).overlaps(face.window):
                    yield face, np.take(points[number], -(side % 2), axis=side // 2)


def section_rows(shape: tuple[int, int, int], section: Section, start: int = 0) -> np.ndarray:
    """Give the points of a section their rows in the C order of the whole index space, from ``start``."""
    strides = (shape[1] * shape[2], shape[2], 1)
    axes = [np.arange(n) if end is None else np.array([end % n]) for n, end in zip(shape, section)]
    i, j, k = np.ix_(*axes)
    return start + i * strides[0] + j * strides[1] + k * strides[2]


def _link_pairs(shapes, starts, link: Link, names) -> np.ndarray:
    """Points joined by a link, shape (2, n)."""
    a = section_rows(shapes[link.a], link.a_section, starts[link.a])
    b = link.orientation.apply(section_rows(shapes[link.b], link.b_section, starts[link.b]))
    if a.shape != b.shape:
        raise _disagreement(link, a.shape, b.shape, names or [f"block {s + 1}" for s in range(len(shapes))])
    return np.stack([a.ravel(), b.ravel()])


def _disagreement(link: Link, a_shape, b_shape, names) -> InputError:
    """Name the first direction in which two linked sections differ."""
    d = next(d for d in range(3) if a_shape[d] != b_shape[d])
    a, b = names[link.a], names[link.b]
    there = "ijk"[link.orientation.perm[d]]
    return InputError(
        f"{a} has {a_shape[d]} points in direction {'ijk'[d]} and {b} has {b_shape[d]} in direction {there}, "
        f"but they share an interface along these directions; give both the same number"
    )


def _collapse_pairs(shapes, starts, collapse: Collapse) -> np.ndarray:
    """Points joined by a collapse, shape (2, n): each with the first of its line."""
    rows = section_rows(shapes[collapse.segment], collapse.section, starts[collapse.segment])
    first = np.broadcast_to(rows.take([0], axis=collapse.direction), rows.shape)
    return np.stack([first.ravel(), rows.ravel()])


def _first_of_each(n: int, pairs: Sequence[np.ndarray]) -> np.ndarray:
    """First point that each of n points is joined to, through any chain of pairs."""
    first = np.arange(n)
    if not pairs:
        return first
    a, b = np.concatenate(pairs, axis=1)
    is_joined = np.zeros(n, dtype=bool)
    is_joined[a] = is_joined[b] = True
    joined = np.flatnonzero(is_joined)
    place = np.cumsum(is_joined) - 1
    graph = coo_array((np.ones(len(a), dtype=bool), (place[a], place[b])), shape=(len(joined), len(joined)))
    _, labels = connected_components(graph.tocsr(), directed=False)
    _, leaders = np.unique(labels, return_index=True)
    first[joined] = joined[leaders[labels]]
    return first
