"""Points that follow the walls of a grid: places of wall nodes, and normals of planes, are read off its nodes.

The points are the nodes of the grid itself, or others beside it (`.embedded_points`).

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .layer import Layered, WallLayer
from .planes import PlaneNormal
from .wall_images import WallImages

__all__ = ["Followed", "WallFollowing"]


@dataclass(frozen=True, eq=False)
class WallFollowing:
    """Which points follow the walls of a grid, and where in it these are."""

    layer: WallLayer  # the points that follow
    rows: np.ndarray  # int (n_wall,), numbers of the nodes of all walls, each shared one once
    plane_rows: np.ndarray  # int (n_plane,), numbers of the nodes on the outlines of planes that walls end on
    planes: tuple[PlaneNormal, ...] | None  # normals of these planes, as functions of those nodes; None where they stay
    images: WallImages | None = None  # walls beyond periodic sides, which the layer's wall has behind those nodes

    def at(
        self,
        # places before the move, and of points where a map puts them; these are overwritten in place
        initial: np.ndarray,  # (n, 3)
        mapped: np.ndarray,  # (n, 3), C order
        # the grid before and after the move; the latter may be `mapped`
        grid_initial: np.ndarray,  # (n_nodes, 3)
        grid: np.ndarray,  # (n_nodes, 3)
    ) -> Followed:
        """Move the points with the walls."""
        # `MovementError` if the surroundings of a node of a wall are turned inside out
        plane_points = grid[self.plane_rows]
        walls = self._walls(grid_initial), self._walls(grid)
        return Followed(self, self.layer.at(initial, mapped, *walls, self.normals(plane_points)), plane_points)

    def _walls(self, grid: np.ndarray) -> np.ndarray:
        """Nodes of walls, shape (wall.n_points, 3), of a grid, shape (n_nodes, 3)."""
        nodes = grid[self.rows]
        return nodes if self.images is None else self.images.beyond(nodes, self.layer.wall.tree.points[: len(nodes)])

    def changes(self, change: np.ndarray) -> np.ndarray:
        """Changes of the nodes of walls with those of a grid."""
        nodes = change[self.rows]
        return nodes if self.images is None else self.images.changes(nodes)

    def add_changes_vjp(self, bar: np.ndarray, grid_bar: np.ndarray) -> None:
        """Transpose of `changes`."""
        grid_bar[self.rows] += bar if self.images is None else self.images.changes_vjp(bar)

    def normals(self, plane_points: np.ndarray) -> np.ndarray | None:
        """Normals, shape (n_planes, 3), of the planes that walls end on, from the points on their outlines."""
        if self.planes is None:
            return None
        return np.reshape([plane.normal(plane_points) for plane in self.planes], (-1, 3))


@dataclass(frozen=True, eq=False)
class Followed:
    """Points that followed the walls of a grid, and their derivative."""

    of: WallFollowing
    layered: Layered
    plane_points: np.ndarray  # (n_plane, 3), nodes on the outlines of planes (m)

    def jvp(
        self,
        change: np.ndarray,  # (n, 3), of the mapped points, overwritten in place by that of the points
        d_grid: np.ndarray,  # (n_nodes, 3), of the grid; may be `change`
        # of the grid before the move, whose nodes the points then are; None for none
        d_initial: np.ndarray | None = None,  # (n_nodes, 3)
    ) -> None:
        """Change of the points."""
        of, at, d_normals = self.of, self.plane_points, None
        if of.planes is not None:
            d_plane_points = d_grid[of.plane_rows]
            d_normals = np.reshape([plane.normal_jvp(at, d_plane_points) for plane in of.planes], (-1, 3))
        d_before = None if d_initial is None else of.changes(d_initial)
        self.layered.jvp(d_initial, change, d_before, of.changes(d_grid), d_normals)

    def add_vjp(
        self,
        bar: np.ndarray,  # (n, 3), of the points, overwritten in place by that of the mapped ones
        # what is added to: derivatives with respect to the grid, which may be `bar`, and to the grid before the move
        grid_bar: np.ndarray,  # (n_nodes, 3)
        initial_bar: np.ndarray | None = None,  # (n_nodes, 3)
    ) -> None:
        """Transpose of `jvp`."""
        wrt = ("mapped", "wall_moved", "normals")
        bars = self.layered.vjp(bar, wrt if initial_bar is None else (*wrt, "initial", "wall_initial"))
        planes_bar = np.zeros_like(self.plane_points)
        for plane, normal_bar in zip(self.of.planes or (), bars["normals"]):
            plane.add_normal_vjp(self.plane_points, normal_bar, planes_bar)
        self.of.add_changes_vjp(bars["wall_moved"], grid_bar)
        grid_bar[self.of.plane_rows] += planes_bar
        if initial_bar is not None:
            initial_bar += bars["initial"]
            self.of.add_changes_vjp(bars["wall_initial"], initial_bar)
