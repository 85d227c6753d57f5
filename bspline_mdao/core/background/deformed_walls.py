"""Positions of deformed wall nodes of an unstructured mesh, and splits between nodes and their copies.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import numpy as np

from ..design.deformation import Deformation

__all__ = ["deformed_walls", "split_copies"]


def deformed_walls(deformation: Deformation) -> np.ndarray:
    """Positions (m) of the deformed wall nodes on the design surface, shape (n_surface, 3)."""
    mesh = deformation.mesh
    return mesh.points[mesh.surface_ids] + mesh.with_copies(_change(deformation))


def split_copies(deformation: Deformation) -> tuple[float, str]:
    """Largest difference (m) between a deformation of wall nodes and of their copies, and its location."""
    mesh, change = deformation.mesh, _change(deformation)
    off = np.linalg.norm((change - mesh.with_copies(change.copy()))[mesh.copies[:, 1]], axis=1)
    if not off.any():
        return 0.0, ""
    worst = int(np.argmax(off))
    return float(off[worst]), mesh.place_of_surface_point(mesh.copies[worst, 1])


def _change(deformation: Deformation) -> np.ndarray:
    """Displacements of wall nodes by a deformation, shape (n_surface, 3), within their planes."""
    nodes = deformation.mesh.points[deformation.mesh.surface_ids]
    return deformation.slide(deformation.apply_to_nodes(nodes) - nodes)
