"""Area vectors of faces from the nodes of the grid, and their derivatives.

Half the cross product of the diagonals: what is on the rims of the faces of a cell cancels, whatever the nodes, so that
the area vectors of a cell sum to zero.
"""

from __future__ import annotations

import numpy as np

from ...cells import quads


def area_vectors(nodes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Area vectors (m^2), shape (n_faces, 3), of the nodes, shape (n_nodes, 3), at corners, shape (n_faces, 4)."""
    return quads.area_vectors(nodes[corners])


def area_vectors_jvp(nodes: np.ndarray, corners: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Change of the area vectors with the nodes."""
    return quads.area_vectors_jvp(nodes[corners], d_nodes[corners])


def area_vectors_vjp(nodes: np.ndarray, corners: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `area_vectors_jvp`, shape (n_nodes, 3)."""
    return quads.add_to_nodes(corners, quads.area_vectors_vjp(nodes[corners], bar), len(nodes))
