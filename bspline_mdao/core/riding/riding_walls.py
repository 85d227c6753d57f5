"""The walls of a mesh that rides: what fades around them, and what follows them as a rigid body.

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
"""Widths of the faces of a wall over which a difference between where its nodes are asked to be and where the volumes
put them fades, but at least this part of the size of all walls: next to narrow faces at edges, widths alone are less
than the difference, and cells fold (127 of pyHyp's M6 as wedges, bent by 30 degrees at half span; none so)."""

LEAST_SLOPE = 0.5
"""Slope of the line from the nearest corner of a face of a wall to a node, from which on the node turns about corners
and not about its closest point (see `..walls.layer`). Lines from nodes of the H-H wing lean by up to 50 degrees from
its normal, which is a slope of 0.84; a node above the middle of a face a hundred times as wide has one of 0.02."""


@dataclass(frozen=True, eq=False)
class RidingWalls(OneLine):
    """Walls of a mesh that rides."""

    faces: WallFaces  # their faces
    rows: np.ndarray  # (n_wall,) of int, their nodes, ascending
    # list of (ndarray of int, ndarray of shape (3,)) of int, nodes of the mesh in planes that walls end on, and the
    # planes' unit normals
    planes: list[tuple[np.ndarray, np.ndarray]]
    fading: csr_array  # scipy.sparse.csr_array, shape (n_points, n_wall), F, but for these planes
    following: WallFollowing  # nodes that follow them
    missed: np.ndarray  # (n_wall, 3), d: what the volumes miss of their nodes (m)
    first: NodeHeights  # their nodes that have a node of the mesh next to them

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        faces: WallFaces,
        planes: list,
        fixed: np.ndarray,  # nodes that stay
        missed: np.ndarray,  # (n_points, 3), what the volumes miss of all nodes (m)
        fade: tuple[float, float] = FADE,
        # int, ascending: some nodes of the mesh, those of walls among them, that this is of; all by default
        nodes: np.ndarray | None = None,
        images: WallImages | None = None,  # walls beyond periodic sides, whose nodes are behind those of the mesh
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
        least_slope = LEAST_SLOPE if mesh.numbers is None else 0.0  # lines of blocks begin at nodes, however they lean
        layer = WallLayer.of(wall, around, rows, planes, fixed, least_slope=least_slope)
        following = WallFollowing(layer, rows, np.zeros(0, dtype=int), None)
        return cls(faces, rows, planes, _fading(around, points, quads, fade), following, missed, first)

    @property
    def initial(self) -> np.ndarray:
        """Their nodes on the baseline (m)."""
        return self.following.layer.wall.tree.points

    def faded(self, mismatch: np.ndarray) -> np.ndarray:
        """F times what was missed of the nodes, shape (n_wall, 3): no node leaves a plane by it."""
        return self._in_planes(self.fading @ mismatch)

    def faded_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `faded`, from shape (n_points, 3)."""
        return self.fading.T @ self._in_planes(bar.copy(), backwards=True)

    def _in_planes(self, vectors: np.ndarray, backwards: bool = False) -> np.ndarray:
        for ids, normal in self.planes[:: -1 if backwards else 1]:
            vectors[ids] -= np.outer(vectors[ids] @ normal, normal)
        return vectors

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Heights of the nodes next to walls above them (m), shape (m,), of a mesh, shape (n_points, 3)."""
        return self.first.heights(points)


def _fading(points: np.ndarray, wall: np.ndarray, quads: np.ndarray, fade: tuple[float, float] = FADE) -> csr_array:
    """Weights of the nodes of a wall in the nodes of the mesh: one at the wall, zero from where ``fade`` says on."""
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
