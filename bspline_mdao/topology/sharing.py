"""Nodes and directions that segments share, and the nodes that points of another program are.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..numerics.threads import thread_count
from .grid import Grid
from .index_space import block_rows
from .topology import BoundaryFace, Topology, first_joined


@dataclass(frozen=True)
class NodeSharing:
    """Rows of the nodes of segments, which segment evaluates each node, and where the other rows get it from.

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


def node_sharing(topology: Topology) -> NodeSharing:
    """Assign each unique node of a grid to the first segment that holds it."""
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
    """Group segment directions that must have equal counts and orders.

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
    first = first_joined(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3)


def directed_classes(topology: Topology) -> np.ndarray:
    """Group segment directions with their senses: forwards, or backwards.

    Returns
    -------
    ndarray of int, shape (n_segments, 3, 2)
        Class of each direction of each segment, forwards and backwards: two that a chain of links joins are in one
        class where they have the same sense. Both classes of a direction are one where links turn it round to itself.
    """
    ids = np.arange(6 * len(topology.segments)).reshape(-1, 3, 2)
    pairs = [
        [ids[link.a, d, way], ids[link.b, link.orientation.perm[d], way ^ link.orientation.flip[d]]]
        for link in topology.links
        for d in range(3)
        for way in (0, 1)
        if link.a_section[d] is None
    ]
    first = first_joined(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3, 2)


def boundary_sections(topology: Topology, points: Sequence[np.ndarray]) -> Iterator[tuple[BoundaryFace, np.ndarray]]:
    """Yield boundary faces, each with every face of a segment that is on it, see `boundary_sides`.

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
    for face, number, side in boundary_sides(topology):
        yield face, np.take(points[number], -(side % 2), axis=side // 2)


def boundary_sides(topology: Topology) -> Iterator[tuple[BoundaryFace, int, int]]:
    """Yield boundary faces, each with the number of every segment that has a face on it, and the number of this one.

    Declared patches cover whole faces of segments. What nobody declared may end inside one, and counts for all of it.
    """
    for face in topology.boundary:
        for number, segment in enumerate(topology.segments):
            for side in range(6) if segment.block == face.window.block else ():
                if segment.face(side).overlaps(face.window):
                    yield face, number, side


def rows_of_points(grid: Grid, topology: Topology, points: np.ndarray, what: str = "volume") -> np.ndarray:
    """Find the rows in the grid vector of points that another program holds.

    Parameters
    ----------
    grid : Grid
        The grid.
    topology : Topology
        Its topology: nodes that blocks share are one.
    points : ndarray, shape (m, 3) or (3 m,)
        Points (m), each a node of the grid, in any order and as often as the program likes.
    what : str
        What the points are, for messages.

    Returns
    -------
    ndarray of int, shape (m,)
        Row of every point.

    Raises
    ------
    InputError
        As `numbers_of_points`.
    """
    rows = np.delete(np.arange(topology.n_nodes), node_sharing(topology).copies[:, 0])
    return rows[numbers_of_points(grid.to_vector().reshape(-1, 3)[rows], points, what)]


_NEARER = 0.1
"""A point is a node if it is nearer to it than this part of its distance to the next one."""


def numbers_of_points(nodes: np.ndarray, points: np.ndarray, what: str) -> np.ndarray:
    """Find every point among nodes that are there once each.

    The precision of the points does not matter as long as they can be distinguished.

    Parameters
    ----------
    nodes : ndarray, shape (n, 3)
        Nodes (m), such as those of a `bspline_mdao.SurfaceGrid`.
    points : ndarray, shape (m, 3) or (3 m,)
        Points (m), such as a solver's surface.
    what : str
        What the points are, for messages.

    Returns
    -------
    ndarray of int, shape (m,)
        The node of every point.

    Raises
    ------
    InputError
        If a point is no node, or is two that lie at one place, such as those on both sides of a plate.
    """
    points = np.reshape(points, (-1, 3))
    distance, number = cKDTree(nodes).query(points, k=2, workers=thread_count(None))
    is_found = distance[:, 0] < _NEARER * distance[:, 1]
    if not is_found.all():
        point = int(np.argmin(is_found))
        near, far = distance[point]
        raise InputError(
            f"{what}: point {point + 1} is {near:.2g} m from one node and {far:.2g} m from another; give nodes of the "
            f"same grid, or, where two lie at one place, their numbers yourself"
        )
    return number[:, 0]
