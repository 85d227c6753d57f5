"""Points that were not fitted, such as the nodes of an unstructured mesh, embedded in the control mesh of a grid.

A point keeps its parameters (`.inversion`): y = A b + d, with d its offset from the mesh on the baseline, zero for a
point inside. Near a wall it then follows the wall as the nodes of the grid do,

    x = layer(y; x0, w),

with the wall nodes w of the grid, so that embedded points and grid move alike there. Points on planes that walls end on
stay in them. The parameters of a point, and the wall that it is near, are those of the baseline and stay.

Theory: ``docs/theory/inversion.rst``, ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..evaluation.evaluator import Evaluator
from ..evaluation.inversion import embed_points, invert_points, require_inside
from ..splines.mesh import BSplineMesh
from .grid_map import GridMap, GridState
from .layer import Layered, WallLayer

__all__ = ["EmbeddedPoints", "EmbeddedState"]

ON_PLANE = 1e-9
"""A point nearer to a plane than this part of the size of the grid lies in it: coordinates are rounded in files."""


@dataclass(frozen=True, eq=False)
class EmbeddedPoints:
    """The map from control points to embedded points. Made by `EmbeddedPoints.of`, or by `FittedModel.embed_points`.

    Parameters
    ----------
    grid_map : GridMap
        Map to the grid, whose walls they follow.
    evaluator : Evaluator
        A of the points.
    points : ndarray, shape (n, 3)
        The points on the baseline (m).
    offsets : ndarray, shape (n, 3)
        Their offsets from the mesh there (m).
    layer : WallLayer or None
        Those that follow walls.
    """

    grid_map: GridMap
    evaluator: Evaluator
    points: np.ndarray
    offsets: np.ndarray
    layer: WallLayer | None

    @classmethod
    def of(
        cls,
        grid_map: GridMap,
        mesh: BSplineMesh,
        control_points: np.ndarray,
        points: np.ndarray,
        tolerance: float | None = None,
    ) -> EmbeddedPoints:
        """Find volumes and parameters of points.

        Parameters
        ----------
        grid_map : GridMap
            Map to the grid.
        mesh : BSplineMesh
            Its volumes.
        control_points : ndarray, shape (n_control_points, 3)
            Control points of the baseline (m).
        points : ndarray, shape (n, 3)
            The points on the baseline (m).
        tolerance : float, optional
            Distance (m) up to which a point counts as inside the volumes, see `.inversion.invert_points`.

        Returns
        -------
        EmbeddedPoints

        Raises
        ------
        InputError
            If an array cannot be used, or a point is outside all volumes.
        """
        inversion = require_inside(invert_points(mesh, control_points, points, tolerance), "embedded points")
        points = np.array(points, dtype=float)
        evaluator, layer = embed_points(mesh, inversion), None
        if grid_map.layer is not None:
            layer = WallLayer.of(grid_map.layer.wall, points, planes=_planes(grid_map, points))
        return cls(grid_map, evaluator, points, points - evaluator.forward(control_points), layer)

    def at(self, control_points: np.ndarray, state: GridState) -> EmbeddedState:
        """Return the points beside a grid.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Control points (m).
        state : GridState
            The grid of these control points, by `GridMap.at` of ``grid_map``; places of wall nodes may have been given.

        Returns
        -------
        EmbeddedState
        """
        places, layered, of = self.evaluator.forward(control_points) + self.offsets, None, self.grid_map
        if self.layer is not None:
            wall, normals = state.nodes[of.wall_rows], of.normals(state.nodes[of.plane_rows])
            layered = self.layer.at(self.points, places, of.nodes[of.wall_rows], wall, normals)
        return EmbeddedState(self, state, places, layered)


@dataclass(frozen=True, eq=False)
class EmbeddedState:
    """Embedded points beside a grid, and their derivative.

    Parameters
    ----------
    of : EmbeddedPoints
        The map.
    grid : GridState
        The grid.
    points : ndarray, shape (n, 3)
        The points (m).
    layered : Layered or None
        Those that followed walls.
    """

    of: EmbeddedPoints
    grid: GridState
    points: np.ndarray
    layered: Layered | None

    def jvp(self, d_control_points: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of the embedded points, shape (n, 3).

        Parameters
        ----------
        d_control_points : ndarray, shape (n_control_points, 3)
            Change of the control points.
        d_nodes : ndarray, shape (n_nodes, 3)
            That of the grid with them, by `GridState.jvp`.
        """
        change, of = self.of.evaluator.forward(d_control_points), self.of.grid_map
        if self.layered is not None:
            d_normals = of.normals_jvp(self.grid.nodes[of.plane_rows], d_nodes[of.plane_rows])
            self.layered.jvp(None, change, None, d_nodes[of.wall_rows], d_normals)
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`.

        Parameters
        ----------
        bar : ndarray, shape (n, 3)
            Derivative of a scalar with respect to the points.

        Returns
        -------
        control_points_bar : ndarray, shape (n_control_points, 3)
        nodes_bar : ndarray, shape (n_nodes, 3)
            With respect to the nodes of the grid: `GridState.vjp` takes it to the control points.
        """
        bar, of, nodes_bar = np.array(bar, dtype=float), self.of.grid_map, np.zeros_like(self.grid.nodes)
        if self.layered is not None:
            bar, wall_bar, normals_bar = self.layered.frozen_vjp(bar)
            nodes_bar[of.wall_rows] += wall_bar
            nodes_bar[of.plane_rows] += of.normals_vjp(self.grid.nodes[of.plane_rows], normals_bar)
        return self.of.evaluator.adjoint(bar), nodes_bar


def _planes(grid_map: GridMap, points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points in the planes that walls end on, and the normals of these."""
    plane_points, size = grid_map.nodes[grid_map.plane_rows], np.linalg.norm(np.ptp(grid_map.nodes, axis=0))
    planes = []
    for plane, normal in zip(grid_map.planes, grid_map.normals(plane_points)):
        distances = np.abs((points - plane_points[plane.first[0, 0]]) @ normal)
        planes.append((np.flatnonzero(distances <= ON_PLANE * size), normal))
    return planes
