"""Surfaces of an unstructured mesh: the faces of its markers, and the map from wall nodes to them.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_array

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ..mesh.frame import Plane
from ..mesh.surface import SurfaceGrid
from ..mesh.surface_map import SurfaceMap
from .end_planes import EndPlane

__all__ = ["map_to_surface", "surface_of_faces"]


def surface_of_faces(
    points: np.ndarray,  # (n, 3), nodes of the mesh (m)
    faces: Mapping[str, np.ndarray],  # faces of each marker, with corners around the normal into the fluid
    ends: tuple[EndPlane, ...],  # end planes of the mesh
) -> SurfaceGrid:
    """Nodes of markers."""
    rows = np.unique(np.concatenate(list(faces.values())))
    planes = []
    for plane in ends:
        heights = points[plane.rows] @ plane.normal
        offset = float(heights.mean())
        planes.append(Plane(plane.normal, offset, float(np.abs(heights - offset).max())))
    return SurfaceGrid(
        points=points[rows],
        rows=rows,
        faces=(),
        names=tuple(f"marker {name}" for name in faces),
        patches=tuple(faces),
        planes=tuple(planes),
        cells=tuple(np.searchsorted(rows, part) for part in faces.values()),
    )


def map_to_surface(
    mesh: MixedMesh,
    walls: np.ndarray,  # int, wall nodes of the design surface, in its order
    given: np.ndarray,  # int, all wall nodes, and fixed nodes
    surface: SurfaceGrid,
) -> SurfaceMap:
    """Map from wall nodes to surface nodes: the same nodes, and fixed ones."""
    rows = np.full(mesh.n_points, -1)
    rows[walls] = np.arange(len(walls))
    at = rows[surface.rows]
    others = np.setdiff1d(surface.rows[at < 0], given)
    if len(others):
        raise InputError(
            f"surface: node {others[0] % mesh.n_stored + 1} of {mesh.source} is on no wall and moves along; name walls "
            f"alone"
        )
    of_walls = np.flatnonzero(at >= 0)
    matrix = csr_array((np.ones(len(of_walls)), (of_walls, at[of_walls])), shape=(len(at), len(walls)))
    return SurfaceMap(matrix, np.where(at[:, None] < 0, mesh.points[surface.rows], 0.0), None)
