"""Wake sheets: parts of a surface that lie on another part of it and are extruded to the other side.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ....base.numerics.vectors import lengths

SAME = 1e-6
"""Distance of quads, relative to the longest edge, within which they lie on each other."""

PAIRINGS = np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]])
"""Pairings of four quads at an edge, first with second and third with fourth."""


def lie_on(
    corners: np.ndarray,  # (n_quads, 4, 3), corners of quads (m)
    at_sides: np.ndarray,  # bool (n_quads,), quads at sides of blocks, which every sheet has
) -> np.ndarray:  # int (n_quads,), the quad that each lies on; -1 for none
    """Find the quads that lie on each other, with coincident corners."""
    found = np.full(len(corners), -1)
    for among in (at_sides, np.ones(len(corners), bool)):
        chosen = np.flatnonzero(among)
        centres = corners[chosen].mean(axis=1)
        distance, nearest = cKDTree(centres).query(centres, k=2) if len(chosen) > 1 else (np.ones((0, 2)), None)
        if nearest is None:
            return found
        near = SAME * lengths(corners - np.roll(corners, 1, axis=1)).max(axis=1)[chosen]
        itself = np.arange(len(chosen))
        other = np.where(nearest[:, 0] == itself, nearest[:, 1], nearest[:, 0])
        close = distance[:, 1] <= near
        apart = corners[chosen][:, :, None] - corners[chosen[other]][:, None]
        close &= (lengths(apart).min(axis=2) <= 2.0 * near[:, None]).all(axis=1)
        found[chosen] = np.where(close, chosen[other], -1)
        if not close.any():
            break
    return found


def sides_apart(
    numbers: np.ndarray,  # int (n_places,), number of the node at each place of each block
    quads: np.ndarray,  # int (n_quads, 4), places around each quad
    on: np.ndarray,  # int (n_quads,), see `lie_on`
) -> np.ndarray:  # int (n_places,)
    """Number the nodes of both sides of sheets separately: places joined by adjacent quads are one node."""
    start, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    quad = np.repeat(np.arange(len(quads)), 4)
    is_point = numbers[start] == numbers[end]
    links = [np.stack([start[is_point], end[is_point]])]
    start, end, quad = start[~is_point], end[~is_point], quad[~is_point]
    forward = numbers[start] < numbers[end]
    # of each edge from the lower number to the higher one
    low, high = np.where(forward, start, end), np.where(forward, end, start)
    _, edge = np.unique(np.stack([numbers[low], numbers[high]], axis=1), axis=0, return_inverse=True)
    edge = edge.ravel()
    order, counts = np.argsort(edge, kind="stable"), np.bincount(edge)
    first = np.cumsum(counts) - counts
    for count in np.unique(counts):
        groups = order[first[counts == count, None] + np.arange(count)]
        if count == 4:
            groups = _paired(groups, quad, forward, on)
        elif count == 2:
            groups = groups[on[quad[groups[:, 0]]] != quad[groups[:, 1]]]
        for nodes in (low, high):
            links.extend(np.stack([nodes[groups[:, 0]], nodes[groups[:, k]]]) for k in range(1, groups.shape[1]))
    row, column = np.concatenate(links, axis=1)
    n = len(numbers)
    return connected_components(coo_array((np.ones(len(row)), (row, column)), shape=(n, n)), directed=False)[1]


def _paired(groups: np.ndarray, quad: np.ndarray, forward: np.ndarray, on: np.ndarray) -> np.ndarray:
    """Pairs of half edges from groups of four: of quads not on each other, with equal orientation if possible."""
    ways = groups[:, PAIRINGS].reshape(-1, 3, 2, 2)
    apart = (on[quad[ways[..., 0]]] != quad[ways[..., 1]]).all(axis=2)
    alike = (forward[ways[..., 0]] != forward[ways[..., 1]]).all(axis=2)
    best = ways[np.arange(len(groups)), (apart * (1 + alike)).argmax(axis=1)]
    return best[apart.any(axis=1)].reshape(-1, 2)
