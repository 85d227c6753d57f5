"""The walls of a grid, the planes that nodes near them stay in, and which nodes do not follow them.

Everything here is found from the nodes of the boundary and of the layer next to walls, and is the same however the grid
is cut. Every process that has part of a grid has all of its walls: they are only as large as a surface.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.numerics.mean_planes import MeanPlane, mean_planes, near_enough
from ...base.numerics.vectors import is_line, nearest_plane
from ...grids.topology.boundary_surface import BoundarySurface
from ...grids.topology.index_space import Window
from ...grids.topology.node_numbering import (
    NodeNumbering,
    NodesByRow,
    boundary_rows,
    each_once,
    face_layer_rows,
    face_rows,
    node_copies,
    source_rows,
)
from ...grids.topology.periodic_ties import rows_of_sides, tied_sides
from ...grids.topology.sharing import boundary_sides
from ...grids.topology.topology import BoundaryFace, Topology
from .layer import WallLayer
from .planes import PlaneNormal
from .settings import LAYER, LayerSettings
from .wall import Wall
from .wall_images import WallImages

__all__ = ["GridWalls"]

RINGS = 6.0
"""How far beyond a periodic side walls are seen, in longest diagonals of their faces: layers reach over three widths, a
reach is a mean over `LayerSettings.smoothings` neighbours, and rotations see one more ring of faces."""

SAME_PLANE = 1e-5
"""A plane whose normal is turned by less than this (rad) is mapped onto itself."""


@dataclass(frozen=True, eq=False)
class GridWalls:
    """The walls of a grid. Made by `GridWalls.of`."""

    wall: Wall  # all walls as one, followed by walls beyond periodic sides
    rows: np.ndarray  # (n_wall,) of int, rows of their nodes in the grid vector, shared ones once
    plane_rows: np.ndarray  # (n_plane,) of int, rows of the nodes on the outlines of planes that walls end on
    normals: tuple[PlaneNormal, ...]  # normals of these planes, as functions of those nodes
    # tuple of (ndarray of int, ndarray of shape (3,)), rows of the nodes in planes, and the planes' normals on the
    # baseline
    planes: tuple[tuple[np.ndarray, np.ndarray], ...]
    fixed: np.ndarray  # of int, rows of the nodes on other boundary faces, which do not follow walls
    images: WallImages | None = None  # walls beyond periodic sides, numbered by the nodes of the walls

    @staticmethod
    def rows_seen(topology: Topology) -> np.ndarray:
        """Rows of the nodes that `of` reads, ascending."""
        # These are the nodes of the boundary and of the layer next to walls, and the nodes that any of them are copies
        # of.
        next_rows = [face_layer_rows(topology, f.window)[1].ravel() for f in topology.boundary if f.kind == "wall"]
        rows = np.unique(np.concatenate([boundary_rows(topology, topology.boundary), *next_rows]))
        return np.union1d(rows, source_rows(node_copies(topology), rows))

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid; faces of kind "wall" are walls
        nodes: np.ndarray | NodesByRow,  # (n_nodes, 3), the baseline (m), or its nodes in `rows_seen`
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
        settings: LayerSettings = LAYER,
    ) -> GridWalls | None:  # None if there is no wall
        """Find the walls of a grid, and the planar faces of its boundary."""
        # Planes are distinguished to five digits of their normals and offsets: faces of one plane, whose corners leave
        # it by round-off of the file, are one.
        walls = [face for face in topology.boundary if face.kind == "wall"]
        if not walls:
            return None
        surface, copies = BoundarySurface.of(topology, nodes, walls), node_copies(topology)
        size = np.linalg.norm(np.ptp(nodes[boundary_rows(topology, topology.boundary)], axis=0))
        planes: dict[tuple, tuple[np.ndarray, list[np.ndarray]]] = {}
        fixed = [np.zeros(0, dtype=int)]
        of_ties = tied_sides(topology)
        tied = {face for face, *side in boundary_sides(topology) if tuple(side) in of_ties} if of_ties else set()
        others = [face for face in topology.boundary if face.kind != "wall" and face not in tied]
        rows_of = [source_rows(copies, face_rows(topology, f.window).reshape(_face_shape(f.window))) for f in others]
        for rows, plane in zip(rows_of, _planes(others, [nodes[rows.ravel()] for rows in rows_of])):
            area = PlaneNormal.of_outline([rows]).area_vector(nodes)
            if plane is None:
                fixed.append(rows.ravel())
            elif area.any() and not is_line(nodes[rows.ravel()]):
                sign = np.sign(plane.normal[np.argmax(np.abs(plane.normal))])
                key = tuple(np.round(sign * np.append(plane.normal, plane.offset / size), 5))
                normal, parts = planes.setdefault(key, (sign * plane.normal, []))
                parts.append(rows if area @ normal > 0.0 else rows.T)
        found = tuple((each_once(np.concatenate([f.ravel() for f in faces])), n) for n, faces in planes.values())
        is_met = [np.isin(rows, surface.rows) for rows, _ in found]
        of_wall = [(np.searchsorted(surface.rows, rows[m]), n) for (rows, n), m in zip(found, is_met) if m.any()]
        quads, faces = surface.quads, surface.quad_faces
        points, heights = nodes[surface.rows], surface.heights
        images = _images(topology, nodes, surface.rows, quads, faces)
        if images is not None:
            of_wall = [(_with_images(ids, normal, images, len(points)), normal) for ids, normal in of_wall]
            points, heights = images.beyond(points, points), np.append(heights, heights[images.originals])
            # faces end on periodic sides, as between blocks
            quads, faces = np.concatenate([quads, images.faces]), np.append(faces, images.marker + faces.max() + 1)
        wall = Wall.of(points, quads, heights, of_wall, None, faces, n_threads, settings)
        outlines = [PlaneNormal.of_outline(f) for (_, f), m in zip(planes.values(), is_met) if m.any()]
        plane_rows = np.unique(np.concatenate([np.zeros(0, dtype=int), *(outline.ids for outline in outlines)]))
        normals = tuple(outline.among(plane_rows) for outline in outlines)
        return cls(
            wall, surface.rows, plane_rows, normals, found, np.setdiff1d(np.concatenate(fixed), surface.rows), images
        )

    @property
    def needed(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the nodes that every part of the grid depends on."""
        return self.rows, self.plane_rows

    def layer(
        self,
        numbering: NodeNumbering,  # nodes of the grid, `needed` ones among them
        nodes: np.ndarray,  # (n, 3), their places on the baseline (m)
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
    ) -> WallLayer:
        """Find which nodes follow the walls."""
        planes = [
            (numbers[numbers >= 0], n) for numbers, n in ((numbering.numbers_of(rows), n) for rows, n in self.planes)
        ]
        fixed = numbering.numbers_of(self.fixed)
        rows = numbering.numbers_of(self.rows)
        fixed, copies = fixed[fixed >= 0], numbering.copies
        n_beyond = self.wall.n_points - len(rows)
        return WallLayer.of(
            self.wall, nodes, rows, planes, fixed, copies, n_threads, least_slope=0.0, n_beyond=n_beyond
        )


def _images(
    topology: Topology, nodes: np.ndarray | NodesByRow, rows: np.ndarray, quads: np.ndarray, faces: np.ndarray
) -> WallImages | None:
    """Walls beyond periodic sides, of walls by the rows of their nodes and by quads of these."""
    sides = rows_of_sides(topology)
    used = np.unique(np.concatenate([rows, *(side for _, a, b in sides for side in (a, b))]))
    points, of_walls = nodes[used], np.searchsorted(used, rows)
    corners = points[of_walls[quads]]
    diagonals = np.stack([corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]])
    reach = RINGS * np.linalg.norm(diagonals, axis=-1).max(axis=0)
    places = [(motion, np.searchsorted(used, a), np.searchsorted(used, b)) for motion, a, b in sides]
    images = WallImages.of(points, of_walls[quads], faces, reach, places)
    if images is None:
        return None
    numbers = np.append(np.full(len(used), -1), len(rows) + np.arange(len(images.points)))
    numbers[of_walls] = np.arange(len(rows))
    return replace(images, originals=numbers[images.originals], faces=numbers[images.faces])


def _with_images(ids: np.ndarray, normal: np.ndarray, images: WallImages, n: int) -> np.ndarray:
    """Nodes of a wall in a plane, and images of them that are also in it; there are n nodes."""
    is_in = np.isin(images.originals, ids) & (np.abs(images.turns @ normal - normal).max(axis=1) < SAME_PLANE)
    return np.append(ids, n + np.flatnonzero(is_in))


def _planes(faces: Sequence[BoundaryFace], nodes: Sequence[np.ndarray]) -> list[MeanPlane | None]:
    """Planes of faces; planes of symmetry may be rough. None if a face is not planar."""
    alone = [nearest_plane(points) for points in nodes]
    planes = [
        MeanPlane(normal, float(normal @ points[0]), float(distances.max())) if distances.max() <= near else None
        for points, (normal, distances, near) in zip(nodes, alone)
    ]
    numbers = [n for n, face in enumerate(faces) if face.kind == "symmetry"]
    parts = [nodes[n] for n in numbers]
    for n, plane in zip(numbers, mean_planes(parts)):
        planes[n] = plane if plane.roughness <= near_enough(parts) else None
    return planes


def _face_shape(window: Window) -> tuple[int, int]:
    """Nodes of a face window in its two directions."""
    direction = window.shape.index(1)
    first, second = (n for d, n in enumerate(window.shape) if d != direction)
    return first, second
