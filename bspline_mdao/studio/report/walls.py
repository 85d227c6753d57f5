"""Walls as they are drawn: faces with few enough triangles, values on them, sections through them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.boundary_surface import facing, quads_in_turn
from ...grids.topology.node_numbering import face_layer_rows, node_copies, source_rows
from ...grids.topology.topology import Topology

__all__ = ["DrawnWalls", "WallHeights", "Walls", "lines_near", "means_at", "net_lines"]


class Walls(Protocol):
    """Walls as they are drawn, or the whole boundary if there are none."""

    @property
    def how_fewer(self) -> str:
        """How the number of triangles is reduced."""

    @property
    def are_walls(self) -> bool:
        """Whether these are walls."""

    @property
    def n_triangles(self) -> int:
        """Triangles that are drawn."""

    @property
    def n_of_all(self) -> int:
        """Triangles of the walls."""

    @property
    def rows(self) -> np.ndarray:
        """Rows of the nodes that are drawn."""

    def triangles(self) -> np.ndarray:
        """Corners of the triangles among `rows`, shape (n_triangles, 3)."""

    def quads(self) -> np.ndarray:
        """Corners of all faces of the walls, shape (n, 4), as rows; triangles may repeat their last corner."""

    def lines(self, nodes: np.ndarray) -> np.ndarray:
        """Lines of what is drawn, with gaps, shape (n, 3)."""

    def of_faces(self, corners: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means, at the nodes that are drawn, of values (n,) of faces with these corners (n, 4)."""

    def of_nodes(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means of values (n,) at nodes by their rows, at the drawn nodes; the smallest where there is none."""


class WallHeights(Protocol):
    """Heights of the first cells at walls."""

    @property
    def patches(self) -> Sequence[str]:
        """Names of the walls."""

    @property
    def baseline(self) -> np.ndarray:
        """Heights on the baseline (m), shape (n,)."""

    @property
    def wall_rows(self) -> np.ndarray:
        """Rows of the nodes of the walls, shape (n,)."""

    def heights(self, nodes: np.ndarray) -> np.ndarray:
        """Heights with nodes (m), shape (n,)."""

    def by_patch(self) -> Iterator[tuple[int, np.ndarray]]:
        """Number of each wall, and which of the heights are at it."""


@dataclass(frozen=True, eq=False)
class DrawnWalls:
    """The walls of a grid, or its whole boundary if no patch is a wall."""

    # tuple of ndarray of int, each of shape (n, m) of int, rows of their nodes in the grid
    faces: tuple[np.ndarray, ...]
    drawn: tuple[np.ndarray, ...]  # of int, the drawn nodes: every n-th line of each face, and its ends
    sources: np.ndarray  # (n_nodes,) of int, row that each node of the grid copies
    are_walls: bool  # whether these are walls

    how_fewer = "lines are left out"

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray, most_triangles: int) -> DrawnWalls:
        """Choose the drawn part of the walls of a grid, nodes (n_nodes, 3), with at most about so many triangles."""
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
        """Corners of all quads of the walls, shape (n, 4), as rows in the grid; of copies the one they are of."""
        return self.sources[np.concatenate([quads_in_turn(face) for face in self.faces])]

    def lines(self, nodes: np.ndarray) -> np.ndarray:
        """Grid lines that are drawn."""
        return net_lines([nodes[face] for face in self.drawn])

    def of_faces(self, corners: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means, at the nodes that are drawn, of values (n,) of faces with these corners (n, 4)."""
        return self.of_nodes(corners.ravel(), np.repeat(values, 4))

    def of_nodes(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means, at the nodes that are drawn, of values (n,) at nodes; where there is none, the smallest."""
        return means_at(self.sources[self.rows], self.sources[rows], values)


def means_at(
    asked: np.ndarray,  # (m,) of int, rows of nodes
    rows: np.ndarray,  # (n,) of int, rows of the values, in any order and number
    values: np.ndarray,  # (n,)
) -> np.ndarray:  # (m,)
    """Means of values at nodes; where there is none, the smallest."""
    n = 1 + int(max(asked.max(initial=-1), rows.max(initial=-1)))
    sums, counts = np.bincount(rows, values, n)[asked], np.bincount(rows, minlength=n)[asked]
    return np.where(counts > 0, sums / np.maximum(counts, 1), values.min(initial=np.inf))


def net_lines(nets: Sequence[np.ndarray]) -> np.ndarray:
    """Lines of all directions of nets, each of shape (n, m, 3) or (n, m, l, 3), as one, with a gap after each."""
    parts = [np.zeros((0, 3))]
    for net in nets:
        for axis in range(net.ndim - 1):
            lines = np.moveaxis(net, axis, -2)
            if lines.shape[-2] > 1:
                gaps = np.full((*lines.shape[:-2], 1, 3), np.nan)
                parts.append(np.concatenate([lines, gaps], axis=-2).reshape(-1, 3))
    return np.concatenate(parts)


def lines_near(
    lines: np.ndarray,  # (n, 3), lines with gaps
    points: np.ndarray,  # (m, 3)
    reach: float,  # margin around the box of the points, in units of its longest side
) -> np.ndarray:
    """Lines near points; what is farther away is a gap."""
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = reach * (high - low).max()
    lines = np.where(np.all((lines >= low - beyond) & (lines <= high + beyond), axis=1)[:, None], lines, np.nan)
    is_gap = np.isnan(lines[:, 0])
    return lines[~(is_gap & np.append(False, is_gap[:-1]))]  # one gap in place of many


def boundary_faces(topology: Topology, nodes: np.ndarray, kind: str | None) -> tuple[np.ndarray, ...]:
    """Rows of the nodes of the boundary faces of a kind, or of all, that have quads; i x j points into the fluid."""
    windows = [face.window for face in topology.boundary if kind is None or face.kind == kind]
    layers = [face_layer_rows(topology, window) for window in windows if 1 in window.shape]
    return tuple(facing(*layer, nodes) for layer in layers if layer[0].ndim == 2 and min(layer[0].shape) > 1)


def _n_triangles(face: np.ndarray) -> int:
    return 2 * (face.shape[0] - 1) * (face.shape[1] - 1)


def _step(n_triangles: int, most: int) -> int:
    """Step between drawn lines."""
    return max(1, math.ceil(math.sqrt(n_triangles / most)))


def _every(n: int, step: int) -> np.ndarray:
    """Drawn lines among n, both ends included; the same from either end."""
    half = np.arange(0, (n + 1) // 2, step)
    return np.unique(np.concatenate([half, n - 1 - half]))


def every_line(faces: Sequence[np.ndarray], most_points: int) -> list[np.ndarray]:
    """Faces with a subset of their lines, such that they have at most about so many points."""
    step = _step(sum(face.size for face in faces), most_points)
    return [face[np.ix_(*(_every(n, step) for n in face.shape))] for face in faces]
