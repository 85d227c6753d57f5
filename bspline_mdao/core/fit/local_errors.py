r"""The residual of a fit relative to the size of the cells around it.

Next to a wall with a boundary layer a cell is up to a hundred thousand times longer than high. The residual along the
wall relative to the height of such a cell means little: the nodes there follow their wall in any case, and grids with
residuals of thousands of heights move well. So the unit is the *width* of the cells at a node::

    .  +-----------------+-------+          of the shortest edge in each direction that has any at the node,
       |                 |       | height   the middle one: here b, where the third direction has longer ones
    ---+-----------------o-------+--- wall
               a             b              on a wall, of those in the wall the shorter one

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numba import njit

from ...grids.topology.index_space import Window
from ..model.records import LocalError
from .fit_nodes import FitNodes

NO_DIRECTION = -1
"""Value for the direction that leaves a wall if there is no wall."""


def worst_local_errors(
    sharing: FitNodes,  # nodes of the segments of this process; all processes call this
    # nodes of its blocks, and the residual there (m)
    nodes: np.ndarray,  # (n_own, 3)
    residual: np.ndarray,  # (n_own, 3)
) -> tuple[LocalError | None, LocalError | None]:
    """Where the residual is largest relative to the width of the cells, anywhere and on walls."""
    # Creates no array of the size of the grid.
    # returns anywhere, on_walls: the first of equally bad nodes; None if no cell has a width, and if there are no walls
    anywhere: list[LocalError] = []
    on_walls: list[LocalError] = []
    residuals = sharing.by_blocks(residual)
    for block, part in sharing.by_blocks(nodes).items():
        arrays = [x.reshape(*sharing.topology.shapes[block], 3) for x in (part, residuals[block])]
        anywhere += _worst_of(arrays, Window.whole(block, sharing.topology.shapes[block]), NO_DIRECTION, "")
        for face in sharing.topology.boundary:
            if face.kind == "wall" and face.window.block == block:
                on_walls += _worst_of(arrays, face.window, _off_wall(face.window, arrays[0].shape), face.patch or "")
    return _worst(sharing.comm, anywhere), _worst(sharing.comm, on_walls)


def flattest_cell(
    sharing: FitNodes,  # nodes of the segments of this process; all processes call this
    nodes: np.ndarray,  # (n_own, 3), nodes of its blocks (m)
) -> float:
    """Smallest ratio of height to width of a cell: of the edges at a node, the shortest over the middle one."""
    shapes, parts = sharing.topology.shapes, sharing.by_blocks(nodes).items()
    flattest = min((flattest_at_node(part.reshape(*shapes[block], 3)) for block, part in parts), default=np.inf)
    return flattest if sharing.comm.size == 1 else min(sharing.comm.allgather(flattest))


def _off_wall(window: Window, shape: Sequence[int]) -> int:
    """Direction that leaves a wall."""
    flat = (d for d in range(3) if window.lo[d] == window.hi[d] and shape[d] > 1)
    return next(flat, NO_DIRECTION)


def _worst_of(arrays: Sequence[np.ndarray], window: Window, across: int, patch: str) -> Iterator[LocalError]:
    """The worst node of a window of a block, if cells have a width there."""
    square, width, i, j, k = find_worst(*arrays, np.array(window.lo), np.array(window.hi), across)
    if width > 0.0:
        error, width = float(np.sqrt(square)), float(width)
        yield LocalError(error / width, error, width, window.block + 1, i + 1, j + 1, k + 1, patch)


def _worst(comm: Any, found: list[LocalError]) -> LocalError | None:
    """The worst of all processes, the first of equally bad ones."""
    if comm.size > 1:
        found = [error for part in comm.allgather(found) for error in part]
    return min(found, key=lambda error: (-error.in_widths, error.block, error.i, error.j, error.k), default=None)


@njit(cache=True)
def find_worst(
    # of a block (m)
    nodes,  # (L0, L1, L2, 3)
    residual,  # (L0, L1, L2, 3)
    # ends of the window, inclusive
    low,  # int (3,)
    high,  # int (3,)
    across,  # int, direction whose edges do not count, which leaves a wall; -1 counts all, and takes the middle one
):  # tuple, square of the residual (m^2), width (m), and i, j, k from 0; a width of 0 means that no node has one
    """Find the node of a window with the largest residual relative to the width of its cells."""
    worst, result = -1.0, (0.0, 0.0, 0, 0, 0)
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                width = cell_width(nodes, i, j, k, across)
                missed = residual[i, j, k]
                square = missed[0] ** 2 + missed[1] ** 2 + missed[2] ** 2
                if width < np.inf and square > worst * width**2:
                    worst, result = square / width**2, (square, width, i, j, k)
    return result


@njit(cache=True)
def flattest_at_node(nodes):
    """Smallest ratio of shortest to middle edge at a node of a block, shape (L0, L1, L2, 3); infinite without any."""
    flattest = np.inf
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            for k in range(nodes.shape[2]):
                width = cell_width(nodes, i, j, k, NO_DIRECTION)
                for d in range(3):
                    if width < np.inf:
                        flattest = min(flattest, _shortest_edge(nodes, i, j, k, d) / width)
    return flattest


@njit(cache=True)
def cell_width(nodes, i, j, k, across):
    """Width of the cells at a node, infinite if none has one; ``across`` as in `find_worst`."""
    smallest = middle = np.inf
    for d in range(3):
        edge = np.inf if d == across else _shortest_edge(nodes, i, j, k, d)
        if edge < smallest:
            smallest, middle = edge, smallest
        elif edge < middle:
            middle = edge
    return smallest if across >= 0 or middle == np.inf else middle


@njit(cache=True)
def _shortest_edge(nodes, i, j, k, d):
    """Shortest non-zero length of the edges of a node in a direction; infinite if there is none."""
    shortest, here = np.inf, nodes[i, j, k]
    for step in (-1, 1):
        a, b, c = i + step * (d == 0), j + step * (d == 1), k + step * (d == 2)
        if 0 <= a < nodes.shape[0] and 0 <= b < nodes.shape[1] and 0 <= c < nodes.shape[2]:
            there = nodes[a, b, c]
            square = (there[0] - here[0]) ** 2 + (there[1] - here[1]) ** 2 + (there[2] - here[2]) ** 2
            if 0.0 < square < shortest:
                shortest = square
    return np.sqrt(shortest)
