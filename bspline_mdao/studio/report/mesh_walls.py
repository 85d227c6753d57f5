"""Walls of an unstructured mesh as they are drawn: few enough triangles, and their edges as lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...grids.cells.quads import edges_of
from ..plotting.thinned_surface import thinned
from .walls import means_at

__all__ = ["MeshWalls", "edge_lines"]


@dataclass(frozen=True, eq=False)
class MeshWalls:
    """The walls of a mesh."""

    faces: np.ndarray  # (n, 4) of int, all faces; triangles repeat their last corner
    drawn: np.ndarray  # (m, 3) of int, triangles that are drawn
    edges: np.ndarray  # (k, 2) of int, their edges, without the diagonals of quads if all is drawn
    n_of_all: int  # triangles of the walls

    are_walls, how_fewer = True, "edges are contracted"

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n_nodes, 3)
        faces: np.ndarray,  # (n, 4) of int
        marker: np.ndarray,  # (n,) of int, marker of each: seams of markers are kept
        most_triangles: int,
    ) -> MeshWalls:
        """Choose the triangles to draw, at most about so many."""
        corners = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
        is_triangle = corners[:, 1] != corners[:, 2]
        triangles, of_marker = corners[is_triangle], np.tile(marker, 2)[is_triangle]
        drawn = thinned(points, triangles, of_marker, most_triangles)
        edges = edges_of(faces if len(drawn) == len(triangles) else drawn[:, [0, 1, 2, 2]])
        return cls(faces, drawn, edges, len(triangles))

    @property
    def n_triangles(self) -> int:
        """Triangles that are drawn."""
        return len(self.drawn)

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of the nodes that are drawn, ascending."""
        return np.unique(self.drawn)

    def triangles(self) -> np.ndarray:
        """Corners of the triangles among `rows`."""
        return np.searchsorted(self.rows, self.drawn)

    def quads(self) -> np.ndarray:
        """All faces."""
        return self.faces

    def lines(self, nodes: np.ndarray) -> np.ndarray:
        """Edges that are drawn."""
        return edge_lines(nodes, self.edges)

    def of_faces(self, corners: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means of values of faces at the nodes that are drawn."""
        return self.of_nodes(corners.ravel(), np.repeat(values, corners.shape[1]))

    def of_nodes(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values at the nodes that are drawn."""
        return means_at(self.rows, rows, values)


def edge_lines(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Join edges, shape (n, 2), of points, shape (k, d), into few long lines with gaps, shape (m, d)."""
    if not len(edges):
        return np.zeros((0, points.shape[1]))
    nodes, ends = np.unique(edges, return_inverse=True)
    path = np.array(_trails(ends.reshape(-1, 2), len(nodes)))
    return np.where(path[:, None] < 0, np.nan, points[nodes[path]])


def _trails(edges: np.ndarray, n_nodes: int) -> list[int]:
    """Lines that pass each edge once, starting from nodes with an odd number of edges if any; -1 ends each."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    order = np.argsort(ends[:, 0], kind="stable")
    other, edge = ends[order, 1].tolist(), (order % len(edges)).tolist()
    stop = np.cumsum(np.bincount(ends[:, 0], minlength=n_nodes))
    degree = np.diff(stop, prepend=0)
    at, last = (stop - degree).tolist(), stop.tolist()
    is_passed = bytearray(len(edges))
    path: list[int] = []
    for start in np.argsort(degree % 2 == 0, kind="stable").tolist():
        while True:
            node, n = start, len(path)
            path.append(node)
            while True:
                while at[node] < last[node] and is_passed[edge[at[node]]]:
                    at[node] += 1
                if at[node] == last[node]:
                    break
                is_passed[edge[at[node]]] = 1
                node = other[at[node]]
                path.append(node)
            if len(path) == n + 1:
                path.pop()
                break
            path.append(-1)
    return path
