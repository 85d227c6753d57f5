"""Cells of other component grids that contain points: donors, as overset solvers find them.

From the nearest node of a block a walk goes from cell to cell, following the trilinear coordinates of the point, until
the point lies in the cell or beyond the block [1].

[1] J. A. Benek, J. L. Steger, F. C. Dougherty, "A flexible grid embedding technique with application to the Euler
equations", AIAA 83-1944, 1983.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine

__all__ = ["Donors", "find_donors", "places_in_cells"]

STEPS = 40
"""Largest number of steps of a walk: the nearest node is a corner of the cell, or a few cells away in skewed grids."""

NEWTON = 8
"""Iterations for the coordinates in a cell; a parallelepiped needs one."""

FAR = 1e3
"""Distance of a point from its cell after a move, in cell sides: cells of boundary layers are thin."""

INSIDE = 1e-6
"""Distance of a point from a cell, in cell sides, that counts as inside: rounding at the faces between two cells."""


@dataclass(frozen=True, eq=False)
class Donors(OneLine):
    """Cells of blocks that contain points."""

    block: np.ndarray  # int (n,), block of each point's cell; -1 if it is in none
    cell: np.ndarray  # int (n, 3), first node of the cell in each direction
    place: np.ndarray  # (n, 3), trilinear coordinates in the cell, 0 to 1


def find_donors(
    nodes: Sequence[np.ndarray],  # (ni, nj, nk, 3), nodes of the blocks to search (m)
    points: np.ndarray,  # (n, 3), the points (m)
) -> Donors:
    """Find the cells that contain points; if there are several, the smallest."""
    n = len(points)
    block, cell, place = np.full(n, -1), np.zeros((n, 3), dtype=np.int64), np.zeros((n, 3))
    smallest = np.full(n, np.inf)
    for number, block_nodes in enumerate(nodes):
        flat = block_nodes.reshape(-1, 3)
        near = np.flatnonzero(((points >= flat.min(axis=0)) & (points <= flat.max(axis=0))).all(axis=1))
        if not len(near) or min(block_nodes.shape[:3]) < 2:
            continue
        starts = np.stack(np.unravel_index(cKDTree(flat).query(points[near])[1], block_nodes.shape[:3]), axis=1)
        cells, places, is_inside = _walk(block_nodes, starts, points[near])
        sizes = np.abs(np.linalg.det(_gradients(_corners(block_nodes, cells), places)))
        is_better = is_inside & (sizes < smallest[near])
        at = near[is_better]
        block[at], cell[at], place[at], smallest[at] = number, cells[is_better], places[is_better], sizes[is_better]
    return Donors(block, cell, place)


def places_in_cells(nodes: Sequence[np.ndarray], donors: Donors, points: np.ndarray) -> np.ndarray:
    """Trilinear coordinates of points, shape (n, 3), in known cells of blocks that may have moved."""
    places = donors.place.copy()
    for number, block_nodes in enumerate(nodes):
        at = np.flatnonzero(donors.block == number)
        places[at] = _solved(_corners(block_nodes, donors.cell[at]), points[at], places[at], FAR)
    return places


def _walk(nodes: np.ndarray, starts: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Final cells of walks in a block, the coordinates there, and whether points are inside."""
    last = np.array(nodes.shape[:3]) - 2
    cells, places = np.minimum(starts, last), np.full(points.shape, 0.5)
    is_inside, walking = np.zeros(len(points), dtype=bool), np.arange(len(points))
    for _ in range(STEPS):
        places[walking] = _solved(_corners(nodes, cells[walking]), points[walking], np.full((len(walking), 3), 0.5))
        out = np.where(places[walking] < -INSIDE, -1, np.where(places[walking] > 1.0 + INSIDE, 1, 0))
        is_inside[walking] = ~out.any(axis=1)
        stepped = np.clip(cells[walking] + out, 0, last)
        goes_on = (stepped != cells[walking]).any(axis=1)
        cells[walking] = stepped
        walking = walking[goes_on]
        if not len(walking):
            break
    return cells, places, is_inside


def _corners(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Corners of cells, shape (n, 2, 2, 2, 3)."""
    i, j, k = np.ix_(*[range(2)] * 3)
    first, second, third = cells.T[:, :, None, None, None]
    return nodes[first + i, second + j, third + k]


def _weights(places: np.ndarray) -> tuple[np.ndarray, ...]:
    """Weights of both ends in each direction, shape (n, 2)."""
    return tuple(np.stack([1.0 - x, x], axis=1) for x in places.T)


def _gradients(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Derivatives of places with respect to coordinates in cells, shape (n, 3, 3): columns are the directions."""
    a, b, c = _weights(places)
    ends = np.array([-1.0, 1.0])
    parts = (
        np.einsum("i,nj,nk,nijkd->nd", ends, b, c, corners),
        np.einsum("ni,j,nk,nijkd->nd", a, ends, c, corners),
        np.einsum("ni,nj,k,nijkd->nd", a, b, ends, corners),
    )
    return np.stack(parts, axis=2)


def _solved(corners: np.ndarray, points: np.ndarray, places: np.ndarray, reach: float = 1.0) -> np.ndarray:
    """Coordinates of points in cells by Newton's method, limited to a distance from the cell, in its sides."""
    tiny = np.finfo(float).tiny
    for _ in range(NEWTON):
        a, b, c = _weights(places)
        off = points - np.einsum("ni,nj,nk,nijkd->nd", a, b, c, corners)
        matrix = _gradients(corners, places)
        # the matrix of a collapsed cell is singular: a least-squares step
        step = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=1e-12), off) if len(matrix) else off
        places = np.clip(places + step, -reach, 1.0 + reach)
        if np.abs(step).max(initial=tiny) < 1e-13:
            break
    return places
