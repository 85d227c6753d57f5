"""Triangulated surfaces reduced to few enough triangles for fast drawing.

Edges are contracted in rounds, starting with those whose contraction moves a node least out of its tangent plane.
Nodes of sharp edges move only along these, and their corners stay, which preserves leading and trailing edges, tips and
seams of markers. Every drawn node is a node of the mesh, so moved meshes have the same triangles.
"""

from __future__ import annotations

import numpy as np

__all__ = ["thinned"]

SHARP = np.cos(np.radians(30.0))
"""Cosine of the angle between triangles beyond which their edge is sharp."""

CORNER = 2.0 * np.sin(np.radians(15.0))
"""Length of the sum of the two directions of a line from a node, above which the line has a corner there."""

LENGTH = 0.02
"""Weight of an edge's length relative to the surface displacement of its contraction: it thins flat parts evenly."""

TURNED = 0.2
"""Cosine of the largest angle by which a triangle may turn while edges around it are contracted."""

LEAST_ROUND = 0.002
"""Fraction of the triangles that a round of contractions must remove for another round to follow."""


def thinned(points: np.ndarray, triangles: np.ndarray, marker: np.ndarray, most: int) -> np.ndarray:
    """Contract edges of triangles, shape (n, 3), with a marker each, until at most about so many are left."""
    while len(triangles) > most:
        kept, of_kept = _contracted(points, triangles, marker, (len(triangles) - most + 1) // 2)
        if len(triangles) - len(kept) < LEAST_ROUND * len(triangles):
            return kept
        triangles, marker = kept, of_kept
    return triangles


def _contracted(
    points: np.ndarray, triangles: np.ndarray, marker: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Contract at most so many edges, no two of which share a node."""
    nodes, corners = np.unique(triangles, return_inverse=True)
    corners, x = corners.reshape(-1, 3), points[nodes]
    normals = np.cross(x[corners[:, 1]] - x[corners[:, 0]], x[corners[:, 2]] - x[corners[:, 0]])
    edges, is_sharp = _sharp_edges(corners, _units(normals), marker)
    around = np.stack([np.bincount(corners.ravel(), np.repeat(part, 3), len(x)) for part in normals.T], axis=1)
    removed, target = _chosen(x, _units(around), edges, is_sharp)
    removed, target = _unturned(x, corners, normals, removed, target)
    removed, target = _unturned(x, corners, normals, removed[:most], target[:most])  # with fewer, others may turn
    at = np.arange(len(x))
    at[removed] = target
    moved = at[corners]
    is_left = (moved != np.roll(moved, 1, axis=1)).all(axis=1)
    _, place, counts = np.unique(_keys(np.sort(moved[is_left], axis=1)), return_index=True, return_counts=True)
    kept = np.flatnonzero(is_left)[np.sort(place[counts == 1])]  # two on the same corners are a fold
    return nodes[moved[kept]], marker[kept]


def _unturned(
    x: np.ndarray, corners: np.ndarray, normals: np.ndarray, removed: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Leave out contractions at triangles that would turn over."""
    while True:
        at = np.arange(len(x))
        at[removed] = target
        moved = at[corners]
        is_changed = (moved != corners).any(axis=1) & (moved != np.roll(moved, 1, axis=1)).all(axis=1)
        now, before = moved[is_changed], normals[is_changed]
        new = np.cross(x[now[:, 1]] - x[now[:, 0]], x[now[:, 2]] - x[now[:, 0]])
        is_turned = np.sum(_units(new) * _units(before), axis=1) < TURNED
        if not is_turned.any():
            return removed, target
        is_banned = np.zeros(len(x), dtype=bool)
        is_banned[corners[is_changed][is_turned]] = True
        removed, target = removed[~is_banned[removed]], target[~is_banned[removed]]


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)


def _keys(rows: np.ndarray) -> np.ndarray:
    """Numbers of rows of two or three numbers from 0, the same for equal rows, shape (n,)."""
    n = 1 + int(rows.max(initial=0))
    keys = rows[:, 0].astype(np.int64) * n + rows[:, 1]
    return keys if rows.shape[1] == 2 else np.unique(keys, return_inverse=True)[1].ravel() * n + rows[:, 2]


def _sharp_edges(corners: np.ndarray, normals: np.ndarray, marker: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges, shape (n, 2), and whether they are sharp: at an angle, between markers, or not of two triangles."""
    ends = np.sort(np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    keys = _keys(ends)
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    edges, counts = ends[order[first]], np.diff(first, append=len(order))
    order %= len(corners)
    a, b = order[first], order[first + np.minimum(counts, 2) - 1]
    is_sharp = (counts != 2) | (np.sum(normals[a] * normals[b], axis=1) < SHARP) | (marker[a] != marker[b])
    return edges, is_sharp


def _chosen(
    x: np.ndarray, normals: np.ndarray, edges: np.ndarray, is_sharp: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes to remove and the nodes they move to, those that change the surface least first."""
    n_sharp, turn = _turns(x, edges[is_sharp])
    ways = np.concatenate([edges, edges[:, ::-1]])
    along = np.tile(is_sharp, 2)
    is_smooth = (n_sharp == 2) & (turn < CORNER)
    is_allowed = (n_sharp[ways[:, 0]] == 0) | (is_smooth[ways[:, 0]] & along)
    ways = ways[is_allowed]
    off = x[ways[:, 1]] - x[ways[:, 0]]
    cost = np.maximum(*(np.abs(np.sum(off * normals[ways[:, k]], axis=1)) for k in (0, 1)))
    turned = np.where(n_sharp[ways[:, 0]] == 2, 0.5 * turn[ways[:, 0]], 0.0)
    ways = ways[np.argsort(cost + (LENGTH + turned) * np.linalg.norm(off, axis=1), kind="stable")]
    first = np.full(len(x), len(ways))
    for ends in ways.T:
        np.minimum.at(first, ends, np.arange(len(ways)))
    is_first = (first[ways] == np.arange(len(ways))[:, None]).all(axis=1)
    return ways[is_first, 0], ways[is_first, 1]


def _turns(x: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of some edges at each node, and the length of the sum of their directions: 0 on a straight line."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    directions = _units(x[ends[:, 1]] - x[ends[:, 0]])
    sums = np.stack([np.bincount(ends[:, 0], part, len(x)) for part in directions.T], axis=1)
    return np.bincount(ends[:, 0], minlength=len(x)), np.linalg.norm(sums, axis=1)
