"""Bilinear quads: area vectors, and sums over quads as functions of the nodes.

Corners are numbered around the quad::

        3-----2      x(s, t) with s from corner 0 to 1 and t from corner 0 to 3; the normal is along s x t
    |     |
    0-----1

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

import numpy as np

__all__ = ["add_to_nodes", "area_vectors", "area_vectors_jvp", "area_vectors_vjp", "edges_of", "rings"]


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Integrals of the normal, shape (n, 3), of quads, shape (n, 4, 3): half the cross product of the diagonals."""
    return 0.5 * np.cross(*_diagonals(corners))


def area_vectors_jvp(corners: np.ndarray, d_corners: np.ndarray) -> np.ndarray:
    """Change of the area vectors, shape (n, 3), with the corners, shape (n, 4, 3)."""
    (p, q), (dp, dq) = _diagonals(corners), _diagonals(d_corners)
    return 0.5 * (np.cross(dp, q) + np.cross(p, dq))


def area_vectors_vjp(corners: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Adjoint of the corners, shape (n, 4, 3), from the adjoint of the area vectors, shape (n, 3)."""
    p, q = _diagonals(corners)
    first, second = 0.5 * np.cross(q, bar), 0.5 * np.cross(bar, p)
    return np.stack([-first, -second, first, second], axis=1)


def add_to_nodes(quads: np.ndarray, bar: np.ndarray, n_points: int) -> np.ndarray:
    """Sum vectors of the corners, shape (n, 4, 3), of quads, shape (n, 4), at the nodes: shape (n_points, 3)."""
    sums = [np.bincount(quads.ravel(), part.ravel(), n_points) for part in np.moveaxis(bar, -1, 0)]
    return np.stack(sums, axis=-1).astype(float, copy=False)  # NumPy returns integers if there is nothing to count


def rings(quads: np.ndarray) -> np.ndarray:
    """Closed rings of corners around each quad, shape (n, 4), in sequence, with -1 between them; repeated ones once."""
    around = np.column_stack([quads[:, [0, 1, 2, 3, 0]], np.full(len(quads), -1)])
    is_new = np.column_stack([np.ones(len(quads), dtype=bool), around[:, 1:] != around[:, :-1]])
    return around[is_new]


def edges_of(quads: np.ndarray) -> np.ndarray:
    """Edges of quads, shape (n, 4), triangles with their last corner twice: each once, shape (m, 2), ascending."""
    around = rings(quads)
    edges = np.sort(np.stack([around[:-1], around[1:]], axis=1), axis=1)
    return np.unique(edges[edges[:, 0] >= 0], axis=0)


def _diagonals(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Diagonals of quads from the first and from the second corner."""
    return corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
