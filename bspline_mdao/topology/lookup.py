"""Which nodes of a grid the points are that another program holds in an order of its own."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..numerics.threads import thread_count
from .multiblock import Grid
from .sharing import node_sharing
from .topology import Topology

__all__ = ["numbers_of_points", "rows_of_points"]

_NEARER = 0.1
"""A point is a node if it is nearer to it than this part of its distance to the next one."""


def numbers_of_points(nodes: np.ndarray, points: np.ndarray, what: str) -> np.ndarray:
    """Find every point among nodes that are there once each.

    The precision of the points does not matter as long as they can be told apart.

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
