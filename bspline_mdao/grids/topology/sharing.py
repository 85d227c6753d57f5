"""Nodes and directions that segments share, and the grid nodes of another program's points.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...base.numerics.processes import ONE, summed, together
from ...base.numerics.threads import thread_count
from ...errors import InputError
from .block_layout import BlockLayout
from .grid import Grid
from .node_numbering import node_copies
from .stored_grid import StoredGrid
from .topology import BoundaryFace, Topology, first_joined


@dataclass(frozen=True)
class NodeSharing:
    """Rows of the nodes of segments, which segment evaluates each node, and the sources of the other rows."""

    # tuple of ndarray of int, each of the segment's shape of int, row of each node of the segment in the grid vector
    # (shape (n_nodes, 3), blocks in order, each in C order)
    rows: tuple[np.ndarray, ...]
    # tuple of ndarray of bool, each of the segment's shape of bool, true if this segment is the first to contain the
    # node: each unique node exactly once
    is_evaluated: tuple[np.ndarray, ...]
    # (n_copies, 2) of int, (destination row, source row) for all rows that no segment evaluates, ascending by
    # destination
    copies: np.ndarray

    def source_rows(self) -> np.ndarray:
        """Row that stands for each row of the grid vector: its own, or the row of the node that it copies."""
        source = np.arange(1 + max(int(rows.max()) for rows in self.rows))
        source[self.copies[:, 0]] = self.copies[:, 1]
        return source


def node_sharing(topology: Topology) -> NodeSharing:
    """Assign each unique node of a grid to the first segment that contains it."""
    whole = topology.layout.numbers
    rows = [whole[segment.block][segment.slices] for segment in topology.segments]
    ids = topology.node_ids()
    layout = BlockLayout.of(segment.shape for segment in topology.segments)
    flat_rows, flat_ids = layout.join(rows), layout.join(ids)
    _, first = np.unique(flat_ids, return_index=True)
    is_evaluated = np.zeros(len(flat_ids), dtype=bool)
    is_evaluated[first] = True
    source = np.empty(topology.n_nodes, dtype=flat_rows.dtype)
    source[flat_rows] = flat_rows[first][flat_ids]
    copied = np.flatnonzero(source != np.arange(len(source)))
    return NodeSharing(tuple(rows), tuple(layout.split(is_evaluated)), np.stack([copied, source[copied]], axis=1))


def direction_classes(topology: Topology) -> np.ndarray:
    """Group segment directions that must have equal counts and orders."""
    # Returns (n_segments, 3) of int, class of each direction of each segment, numbered by first occurrence; directions
    # joined by a chain of links are in one class.
    ids = np.arange(3 * len(topology.segments)).reshape(-1, 3)
    pairs = [
        [ids[link.a, d], ids[link.b, link.orientation.perm[d]]]
        for link in topology.alike
        for d in range(3)
        if link.a_section[d] is None
    ]
    first = first_joined(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3)


def directed_classes(topology: Topology) -> np.ndarray:
    """Group segment directions with their senses: forwards, or backwards."""
    # Returns (n_segments, 3, 2) of int, class of each direction of each segment, forwards and backwards: two directions
    # joined by a chain of links are in one class if they have the same sense. Both classes of a direction are equal if
    # links map it to itself reversed.
    ids = np.arange(6 * len(topology.segments)).reshape(-1, 3, 2)
    pairs = [
        [ids[link.a, d, way], ids[link.b, link.orientation.perm[d], way ^ link.orientation.flip[d]]]
        for link in topology.alike
        for d in range(3)
        for way in (0, 1)
        if link.a_section[d] is None
    ]
    first = first_joined(ids.size, [np.reshape(pairs, (-1, 2)).T.astype(np.int64)])
    return np.unique(first, return_inverse=True)[1].reshape(-1, 3, 2)


def boundary_sections(
    topology: Topology,  # the boundary and the segments
    # sequence of ndarray of int, each of shape (N0, N1, N2) of int, numbers of the points of every segment, such as
    # its control points
    points: Sequence[np.ndarray],
) -> Iterator[tuple[BoundaryFace, np.ndarray]]:
    """Yield boundary faces, each with every face of a segment on it, see `boundary_sides`."""
    # Returns face; ids: (ni, nj) of int, numbers of the points of the segment's face.
    for face, number, side in boundary_sides(topology):
        yield face, np.take(points[number], -(side % 2), axis=side // 2)


def boundary_sides(topology: Topology) -> Iterator[tuple[BoundaryFace, int, int]]:
    """Yield boundary faces, each with the number of every segment that has a face on it, and of this face."""
    # Declared patches cover whole faces of segments. Undeclared boundary may end inside one, and counts for all of it.
    for face in topology.boundary:
        for number, segment in enumerate(topology.segments):
            for side in range(6) if segment.block == face.window.block else ():
                if segment.face(side).overlaps(face.window):
                    yield face, number, side


def rows_of_points(
    grid: Grid | StoredGrid, topology: Topology, points: np.ndarray, what: str = "volume", comm: Any = ONE
) -> np.ndarray:
    """Find the rows in the grid vector of the points of another program.

    Blocks are searched one after another, and only those that may contain points. For a grid that stays in its file,
    see `bspline_mdao.open_grid`, one block is in memory at a time.

    Parameters
    ----------
    grid : Grid or StoredGrid
        The grid.
    topology : Topology
        Its topology: nodes that blocks share are one.
    points : ndarray, shape (m, 3) or (3 m,)
        Points (m), each a node of the grid, in any order and with repetitions: the points of this process, which may
        have none.
    what : str
        Description of the points for messages.
    comm : communicator, optional
        Several processes that each search for their own points: all call this, share the reading of the blocks, and
        raise the errors of any of them.

    Returns
    -------
    ndarray of int, shape (m,)
        Row of every point.

    Raises
    ------
    InputError
        As in `numbers_of_points`.

    Examples
    --------
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.mphys import rows_of_points
    >>> grid = brick_grid((5, 5, 5, 5))
    >>> points = grid.to_vector().reshape(-1, 3)[[7, 3]]
    >>> rows_of_points(grid, find_topology(grid), points)
    array([7, 3])
    """
    points = np.reshape(points, (-1, 3))
    starts, copies = topology.layout.starts, node_copies(topology)[:, 0]
    boxes = _boxes(grid, comm)
    rows = np.full(len(points), -1)
    near, far, elsewhere = np.full((3, len(points)), np.inf)
    with together(comm):
        for block, (low, high) in enumerate(boxes):
            outside = np.linalg.norm(points - np.clip(points, low, high), axis=1)
            is_near = outside <= _MARGIN * np.linalg.norm(high - low)
            elsewhere[~is_near] = np.minimum(elsewhere, outside)[~is_near]
            if is_near.any():
                at = np.flatnonzero(is_near)
                in_block = np.setdiff1d(np.arange(starts[block], starts[block + 1]), copies, assume_unique=True)
                nodes = grid.blocks[block].nodes.reshape(-1, 3)[in_block - starts[block]]
                distance, number = _two_nearest(nodes, points[at])
                is_first = distance[:, 0] < near[at]
                rows[at[is_first]] = in_block[number[is_first]]
                near[at], far[at] = np.sort(np.column_stack([near[at], far[at], distance]), axis=1)[:, :2].T
        _require_found(near, np.minimum(far, elsewhere), what)
    return rows


_MARGIN = 0.05
"""Margin around the box of a block, relative to its diagonal, within which points are searched among its nodes."""


def _boxes(grid: Grid | StoredGrid, comm: Any) -> np.ndarray:
    """Lowest and highest coordinates of every block (m), shape (n_blocks, 2, 3), each read by one process."""
    boxes = np.zeros((len(grid.blocks), 2, 3))
    with together(comm):
        for block in range(comm.rank, len(boxes), comm.size):
            nodes = grid.blocks[block].nodes.reshape(-1, 3)
            boxes[block] = nodes.min(axis=0), nodes.max(axis=0)
    return summed(comm, boxes)


_NEARER = 0.1
"""A point is a node if it is closer to it than this fraction of its distance to the next one."""


def numbers_of_points(nodes: np.ndarray, points: np.ndarray, what: str, comm: Any = ONE) -> np.ndarray:
    """Find every point among nodes that occur once each.

    The precision of the points does not matter as long as they can be distinguished.

    Parameters
    ----------
    nodes : ndarray, shape (n, 3)
        Nodes (m), such as the nodes of a `bspline_mdao.measures.SurfaceGrid`.
    points : ndarray, shape (m, 3) or (3 m,)
        Points (m), such as a solver's surface.
    what : str
        Description of the points for messages.
    comm : communicator, optional
        Several processes that each search for their own points: all call this, and raise the errors of any of them.

    Returns
    -------
    ndarray of int, shape (m,)
        The node of every point.

    Raises
    ------
    InputError
        If a point is not a node, or coincides with two, such as on both sides of a plate.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.mphys import numbers_of_points
    >>> nodes = np.arange(12.0).reshape(4, 3)
    >>> numbers_of_points(nodes, nodes[[2, 0]].ravel(), "surface")
    array([2, 0])
    """
    with together(comm):
        distance, number = _two_nearest(nodes, np.reshape(points, (-1, 3)))
        _require_found(distance[:, 0], distance[:, 1], what)
    return number


def _two_nearest(nodes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) of points to the two nearest nodes, shape (m, 2), infinite if there is none, and the nearest."""
    if not len(nodes):
        return np.full((len(points), 2), np.inf), np.zeros(len(points), dtype=int)
    distance, number = cKDTree(nodes).query(points, k=2, workers=thread_count(None))
    return distance, number[:, 0]


def _require_found(near: np.ndarray, far: np.ndarray, what: str) -> None:
    """Refuse points that are not nodes, by the distances (m) to the two nearest ones."""
    is_found = near < _NEARER * far
    if not is_found.all():
        point = int(np.argmin(is_found))
        raise InputError(
            f"{what}: point {point + 1} is {near[point]:.2g} m from one node and {far[point]:.2g} m from another; give "
            f"nodes of the same grid, or, where two lie at one place, their numbers yourself"
        )
