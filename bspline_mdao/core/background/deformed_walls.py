"""Where deformations put the nodes of walls of a mesh without structure, and what they split of copies of nodes.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import numpy as np

from ..design.deformation import Deformation

__all__ = ["deformed_walls", "split_copies"]


def deformed_walls(deformation: Deformation) -> np.ndarray:
    """Where a deformation puts the nodes of the walls that are its surface (m), shape (n_surface, 3)."""
    mesh = deformation.mesh
    return mesh.points[mesh.surface_ids] + mesh.with_copies(_change(deformation))


def split_copies(deformation: Deformation) -> tuple[float, str]:
    """How differently a deformation moves copies of nodes of walls and their originals (m), at most, and where."""
    mesh, change = deformation.mesh, _change(deformation)
    off = np.linalg.norm((change - mesh.with_copies(change.copy()))[mesh.copies[:, 1]], axis=1)
    if not off.any():
        return 0.0, ""
    worst = int(np.argmax(off))
    return float(off[worst]), mesh.place_of_surface_point(mesh.copies[worst, 1])


def _change(deformation: Deformation) -> np.ndarray:
    """Displacements of nodes of walls by a deformation, shape (n_surface, 3), in planes where these are."""
    nodes = deformation.mesh.points[deformation.mesh.surface_ids]
    return deformation.slide(deformation.apply_to_nodes(nodes) - nodes)
