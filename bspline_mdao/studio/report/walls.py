"""The walls of a grid as they are drawn: faces of few enough triangles, values on them, sections through them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.first_cells import FirstCells
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.boundary_surface import facing, quads_in_turn
from ...grids.topology.node_numbering import face_layer_rows, node_copies, source_rows
from ...grids.topology.topology import Topology

__all__ = ["DrawnWalls", "cut", "wall_quads"]


@dataclass(frozen=True, eq=False)
class DrawnWalls:
    """The walls of a grid, or its whole boundary where no patch is a wall."""

    # tuple of ndarray of int, each of shape (n, m) of int, rows of their nodes in the grid
    faces: tuple[np.ndarray, ...]
    drawn: tuple[np.ndarray, ...]  # of int, those that are drawn: every n-th line of each face, and its ends
    sources: np.ndarray  # (n_nodes,) of int, row that each node of the grid is a copy of
    are_walls: bool  # whether these are walls

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray, most_triangles: int) -> DrawnWalls:
        """Choose what is drawn of the walls of a grid, nodes (n_nodes, 3), with at most about so many triangles."""
        faces = boundary_faces(topology, nodes, "wall")
        are_walls = bool(faces)
        faces = faces or boundary_faces(topology, nodes, None)
        step = _step(sum(_n_triangles(face) for face in faces), most_triangles)
        every = tuple(face[np.ix_(*(_every(n, step) for n in face.shape))] for face in faces)
        return cls(faces, every, source_rows(node_copies(topology), np.arange(len(nodes))), are_walls)

    @property
    def n_triangles(self) -> int:
        """Triangles that are drawn."""
        return sum(map(_n_triangles, self.drawn))

    @property
    def n_of_all(self) -> int:
        """Triangles of the walls."""
        return sum(map(_n_triangles, self.faces))

    @property
    def rows(self) -> np.ndarray:
        """Rows of the nodes that are drawn, face by face."""
        return np.concatenate([face.ravel() for face in self.drawn])

    def triangles(self) -> np.ndarray:
        """Corners of the triangles among `rows`, shape (n_triangles, 3)."""
        corners = np.concatenate([quads_in_turn(ids) for ids in BlockLayout.of(map(np.shape, self.drawn)).numbers])
        return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])

    def quads(self) -> np.ndarray:
        """Corners of all quads of the walls, shape (n, 4), as rows in the grid."""
        return np.concatenate([quads_in_turn(face) for face in self.faces])

    def of_faces(self, corners: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means, at the nodes that are drawn, of values (n,) of faces with these corners (n, 4)."""
        rows, n = self.sources[corners].ravel(), len(self.sources)
        sums, counts = np.bincount(rows, np.repeat(values, 4), n), np.bincount(rows, minlength=n)
        at = self.sources[self.rows]
        return sums[at] / np.maximum(counts[at], 1)

    def heights(self, cells: FirstCells, nodes: np.ndarray) -> np.ndarray:
        """Heights of the first cells (m) at the nodes that are drawn; where there is none the smallest."""
        rows, heights, n = self.sources[cells.rows[cells.at]], cells.heights(nodes), len(self.sources)
        sums, counts = np.bincount(rows, heights, n), np.bincount(rows, minlength=n)
        at = self.sources[self.rows]
        return np.where(counts[at] > 0, sums[at] / np.maximum(counts[at], 1), heights.min(initial=np.inf))


def boundary_faces(topology: Topology, nodes: np.ndarray, kind: str | None) -> tuple[np.ndarray, ...]:
    """Rows of the nodes of the boundary faces of a kind, or of all, that have quads; i x j points into the fluid."""
    windows = [face.window for face in topology.boundary if kind is None or face.kind == kind]
    layers = [face_layer_rows(topology, window) for window in windows if 1 in window.shape]
    return tuple(facing(*layer, nodes) for layer in layers if layer[0].ndim == 2 and min(layer[0].shape) > 1)


def wall_quads(topology: Topology, nodes: np.ndarray) -> np.ndarray | None:
    """Corners of the wall faces in the order of ``Cp``, shape (n, 4); None where blocks have no cells for a flow."""
    try:
        return CellFaces.of(topology, nodes).corners_of("wall")
    except InputError:
        return None


def cut(
    points: np.ndarray,  # (n_points, 3), corners (m)
    quads: np.ndarray,  # (n, 4) of int, their numbers
    axis: int,  # the axis
    place: float,  # coordinate of the plane (m)
) -> np.ndarray:  # (n_segments, 2, 3), ends of the segments (m)
    """Cut quads with a plane across an axis."""
    heights = points[:, axis] - place
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    above = heights[triangles] > 0.0
    triangles, above = (array[above.any(axis=1) & ~above.all(axis=1)] for array in (triangles, above))
    # the corner that is alone on its side first
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    turned = np.take_along_axis(triangles, (alone[:, None] + np.arange(3)) % 3, axis=1)
    a, ends = turned[:, [0]], turned[:, 1:]
    part = heights[a] / (heights[a] - heights[ends])
    return points[a] + part[..., None] * (points[ends] - points[a])


def _n_triangles(face: np.ndarray) -> int:
    return 2 * (face.shape[0] - 1) * (face.shape[1] - 1)


def _step(n_triangles: int, most: int) -> int:
    """Every how many lines are drawn."""
    return max(1, math.ceil(math.sqrt(n_triangles / most)))


def _every(n: int, step: int) -> np.ndarray:
    """Lines that are drawn of n, both ends among them; the same from either end."""
    half = np.arange(0, (n + 1) // 2, step)
    return np.unique(np.concatenate([half, n - 1 - half]))


def every_line(faces: Sequence[np.ndarray], most_points: int) -> list[np.ndarray]:
    """Faces with so few of their lines that they have at most about so many points."""
    step = _step(sum(face.size for face in faces), most_points)
    return [face[np.ix_(*(_every(n, step) for n in face.shape))] for face in faces]
