"""Area vectors of faces from the nodes of the grid, and their derivatives.

Half the cross product of the diagonals: what is on the rims of the faces of a cell cancels, whatever the nodes, so that
the area vectors of a cell sum to zero.
"""

from __future__ import annotations

import numpy as np


def area_vectors(nodes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Area vectors (m^2), shape (n_faces, 3), of the nodes, shape (n_nodes, 3), at corners, shape (n_faces, 4)."""
    return 0.5 * np.cross(*_diagonals(nodes, corners))


def area_vectors_jvp(nodes: np.ndarray, corners: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Change of the area vectors with the nodes."""
    (p, q), (dp, dq) = _diagonals(nodes, corners), _diagonals(d_nodes, corners)
    return 0.5 * (np.cross(dp, q) + np.cross(p, dq))


def area_vectors_vjp(nodes: np.ndarray, corners: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `area_vectors_jvp`, shape (n_nodes, 3)."""
    p, q = _diagonals(nodes, corners)
    p_bar, q_bar = 0.5 * np.cross(q, bar), 0.5 * np.cross(bar, p)
    ends = np.stack([-p_bar, -q_bar, p_bar, q_bar], axis=1).reshape(-1, 3)
    return np.stack([np.bincount(corners.ravel(), ends[:, n], len(nodes)) for n in range(3)], axis=1)


def _diagonals(nodes: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Diagonals of the faces from the first and from the second corner."""
    a, b, c, d = (nodes[corners[:, n]] for n in range(4))
    return c - a, d - b
