"""The walls of an embedded mesh: what fades around them, and what follows them as a rigid body.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from ...base.display import OneLine
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.node_heights import NodeHeights
from ...grids.cells.quads import area_vectors
from ..walls.closest_points import TriangleTree
from ..walls.layer import WallFollowing, WallLayer
from ..walls.settings import MESH_LAYER
from ..walls.wall import Wall
from ..walls.wall_images import WallImages
from .wall_faces import WallFaces

__all__ = ["RidingWalls"]

FADE = 8.0, 0.1
"""Number of wall face widths over which a difference between prescribed node positions and the volumes fades, but at
least this fraction of the size of all walls: next to narrow faces at edges, widths alone are less than the difference,
and cells fold (127 of pyHyp's M6 as wedges, bent by 30 degrees at half span; none with the minimum)."""

LEAST_SLOPE = 0.5
"""Slope of the line from the nearest corner of a wall face to a node, from which the node rotates about corners instead
of its closest point (see `..walls.layer`). Lines from nodes of the H-H wing lean by up to 50 degrees from its normal, a
slope of 0.84; a node above the middle of a face a hundred times as wide has a slope of 0.02."""


@dataclass(frozen=True, eq=False)
class RidingWalls(OneLine):
    """Walls of an embedded mesh."""

    faces: WallFaces  # their faces
    rows: np.ndarray  # (n_wall,) of int, their nodes, ascending
    # list of (ndarray of int, ndarray of shape (3,)) of int, nodes of the mesh in planes at which walls end, and the
    # planes' unit normals
    planes: list[tuple[np.ndarray, np.ndarray]]
    fading: csr_array  # scipy.sparse.csr_array, shape (n_points, n_wall), F, except in these planes
    following: WallFollowing  # nodes that follow them
    missed: np.ndarray  # (n_wall, 3), d: distance of their nodes from the volumes (m)
    first: NodeHeights  # their nodes with an adjacent node of the mesh

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        faces: WallFaces,
        planes: list,
        fixed: np.ndarray,  # fixed nodes
        missed: np.ndarray,  # (n_points, 3), distance of all nodes from the volumes (m)
        fade: tuple[float, float] = FADE,
        # int, ascending: the nodes considered, including wall nodes; all by default
        nodes: np.ndarray | None = None,
        images: WallImages | None = None,  # walls beyond periodic sides, whose nodes follow the nodes of the mesh
    ) -> RidingWalls:
        """Find what follows walls."""
        first, quads, markers, around = NodeHeights.of(mesh, faces.faces), faces.faces, faces.marker, mesh.points
        if images is not None:
            quads, markers = np.concatenate([quads, images.faces]), np.concatenate([markers, images.marker])
            around, beyond = images.beyond(around, around), mesh.n_points + np.arange(len(images.points))
            missed = np.concatenate([missed, images.turned(missed[images.originals])])
            planes = [(np.union1d(ids, beyond[np.isin(images.originals, ids)]), normal) for ids, normal in planes]
            nodes = None if nodes is None else np.concatenate([nodes, beyond])
        rows = np.unique(quads)
        quads, points, heights = np.searchsorted(rows, quads), around[rows], np.zeros(len(rows))
        heights[np.searchsorted(rows, first.rows)] = first.baseline
        if images is not None:
            heights[np.searchsorted(rows, beyond)] = heights[np.searchsorted(rows, images.originals)]
        of_wall = [(np.flatnonzero(np.isin(rows, ids)), normal) for ids, normal in planes]
        of_wall = [(ids, normal) for ids, normal in of_wall if len(ids)]
        wall = Wall.of(points, quads, heights, of_wall, faces=markers, settings=MESH_LAYER)
        missed = missed[rows]
        if nodes is not None:
            around, rows = around[nodes], np.searchsorted(nodes, rows)
            faces = replace(faces, faces=np.searchsorted(nodes, faces.faces))
            planes = [(np.flatnonzero(np.isin(nodes, ids)), normal) for ids, normal in planes]
            fixed, first = np.flatnonzero(np.isin(nodes, fixed)), first.among(nodes)
        least_slope = LEAST_SLOPE if mesh.numbers is None else 0.0  # lines of blocks begin at nodes, however oblique
        layer = WallLayer.of(wall, around, rows, planes, fixed, least_slope=least_slope)
        following = WallFollowing(layer, rows, np.zeros(0, dtype=int), None)
        return cls(faces, rows, planes, _fading(around, points, quads, fade), following, missed, first)

    @property
    def initial(self) -> np.ndarray:
        """Their nodes on the baseline (m)."""
        return self.following.layer.wall.tree.points

    def faded(self, mismatch: np.ndarray) -> np.ndarray:
        """F times the mismatch of wall nodes, shape (n_wall, 3), without moving any node out of a plane."""
        return self._in_planes(self.fading @ mismatch)

    def faded_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `faded`, from shape (n_points, 3)."""
        return self.fading.T @ self._in_planes(bar.copy(), backwards=True)

    def _in_planes(self, vectors: np.ndarray, backwards: bool = False) -> np.ndarray:
        for ids, normal in self.planes[:: -1 if backwards else 1]:
            vectors[ids] -= np.outer(vectors[ids] @ normal, normal)
        return vectors

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Heights (m) above walls of their adjacent nodes, shape (m,), for mesh points, shape (n_points, 3)."""
        return self.first.heights(points)


def _fading(points: np.ndarray, wall: np.ndarray, quads: np.ndarray, fade: tuple[float, float] = FADE) -> csr_array:
    """Weights of wall nodes in the nodes of the mesh: one at the wall, zero beyond the distance given by ``fade``."""
    width = np.sqrt(np.linalg.norm(area_vectors(wall[quads]), axis=1))
    counts = np.bincount(quads.ravel(), minlength=len(wall))
    widths = np.bincount(quads.ravel(), np.repeat(width, 4), len(wall)) / np.maximum(counts, 1)
    size = float(np.linalg.norm(np.ptp(wall, axis=0)))
    tree = TriangleTree.of(wall, quads, np.maximum(fade[0] * widths, fade[1] * size))
    near = tree.closest_points(points)
    rows = np.repeat(near.points, np.diff(near.starts))
    weights = near.weights[:, None] * near.barycentric
    corners = tree.triangles[near.triangles]
    places = np.repeat(rows, 3), corners.ravel()
    return coo_array((weights.ravel(), places), shape=(len(points), len(wall))).tocsr()
