"""Points that were not fitted, such as the nodes of an unstructured mesh, embedded in the control mesh of a grid.

A point keeps its parameters (`.inversion`): y = A b + d, with d its offset from the mesh on the baseline, zero for a
point inside. Near a wall it then follows the wall as the nodes of the grid do,

    x = layer(y; x0, w),

with the wall nodes w of the grid, so that embedded points and grid move alike there. Points on planes that walls end on
stay in them. The parameters of a point, and the wall that it is near, are those of the baseline and stay.

Points inside the body, where there are no volumes, ride on the walls (`.body_points`).

Theory: ``docs/theory/inversion.rst``, ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...errors import InputError
from ..evaluation.evaluator import Evaluator
from ..evaluation.inversion import PointInversion, embed_points, invert_points
from ..splines.mesh import BSplineMesh
from .body_points import Body, BodyPoints
from .grid_map import GridMap
from .layer import Layered, WallLayer

__all__ = ["EmbeddedPoints", "EmbeddedState", "planes_of"]

ON_PLANE = 1e-9
"""A point nearer to a plane than this part of the size of the grid lies in it: coordinates are rounded in files."""


class HasNodes(Protocol):
    """What has the nodes of a grid, shape (n_nodes, 3), such as a `GridState`."""

    @property
    def nodes(self) -> np.ndarray:
        """The nodes (m)."""


@dataclass(frozen=True, eq=False)
class EmbeddedPoints(OneLine):
    """The map from control points to embedded points. Made by `EmbeddedPoints.of`, or by `FittedModel.embed_points`."""

    grid_map: GridMap  # map to the grid, whose walls they follow
    evaluator: Evaluator  # A of the points
    points: np.ndarray  # (n, 3), the points on the baseline (m)
    in_volume: np.ndarray  # (n_in_volume,) of int, numbers of those in the volumes
    offsets: np.ndarray  # (n_in_volume, 3), their offsets from the mesh there (m)
    layer: WallLayer | None  # those of them that follow walls
    in_body: np.ndarray  # (n_in_body,) of int, numbers of the others, inside the body
    body: BodyPoints | None  # what these ride on
    wall_rows: np.ndarray  # (n_wall,) of int, rows of the nodes of the walls in the grid

    @classmethod
    def of(
        cls,
        grid_map: GridMap,  # map to the grid
        mesh: BSplineMesh,  # its volumes
        control_points: np.ndarray,  # (n_control_points, 3), control points of the baseline (m)
        points: np.ndarray,  # (n, 3), the points on the baseline (m)
        # distance (m) up to which a point counts as inside the volumes, see `.inversion.invert_points`
        tolerance: float | None = None,
        # of int, the walls of the grid on the baseline, and the rows of their nodes
        walls: tuple[Body, np.ndarray] | None = None,
    ) -> EmbeddedPoints:
        """Find volumes and parameters of points, and the weights of those inside the body."""
        points = as_finite_points(points, len(points), "embedded points")
        inversion, in_body = invert_points(mesh, control_points, points, tolerance), np.zeros(len(points), dtype=bool)
        if walls is not None:
            in_body = _rides(walls[0], points, inversion)
        in_volume, layer, body = np.flatnonzero(~in_body), None, None
        inversion = PointInversion(*(getattr(inversion, part.name)[in_volume] for part in fields(PointInversion)))
        _require_found(inversion, in_volume, len(points))
        evaluator = embed_points(mesh, inversion)
        offsets = points[in_volume] - evaluator.forward(control_points)
        if grid_map.layer is not None:
            planes = planes_of(grid_map, points[in_volume])
            found = WallLayer.of(grid_map.layer.wall, points[in_volume], planes=planes)
            layer = found if found.pieces else None  # none follows a wall
        rows = np.zeros(0, dtype=int)
        if walls is not None and in_body.any():
            body, rows = BodyPoints.of(walls[0], points[in_body]), walls[1]
        return cls(grid_map, evaluator, points, in_volume, offsets, layer, np.flatnonzero(in_body), body, rows)

    def at(
        self,
        control_points: np.ndarray,  # (n_control_points, 3), control points (m)
        # the grid of these control points, by `GridMap.at` of ``grid_map``; places of wall nodes may have been given
        state: HasNodes,
    ) -> EmbeddedState:
        """Return the points beside a grid."""
        places, layered, of = self.evaluator.forward(control_points) + self.offsets, None, self.grid_map
        if self.layer is not None:
            wall, normals = state.nodes[of.wall_rows], of.normals(state.nodes[of.plane_rows])
            layered = self.layer.at(self.points[self.in_volume], places, of.nodes[of.wall_rows], wall, normals)
        points = np.empty_like(self.points)
        points[self.in_volume] = places
        if self.body is not None:
            points[self.in_body] = self.body.at(state.nodes[self.wall_rows])
        return EmbeddedState(self, state, points, layered)


@dataclass(frozen=True, eq=False)
class EmbeddedState:
    """Embedded points beside a grid, and their derivative."""

    of: EmbeddedPoints  # the map
    grid: HasNodes  # the grid
    points: np.ndarray  # (n, 3), the points (m)
    layered: Layered | None  # those that followed walls

    def jvp(
        self,
        d_control_points: np.ndarray,  # (n_control_points, 3), change of the control points
        d_nodes: np.ndarray,  # (n_nodes, 3), that of the grid with them, by `GridState.jvp`
    ) -> np.ndarray:
        """Change of the embedded points, shape (n, 3)."""
        places, of = self.of.evaluator.forward(d_control_points), self.of.grid_map
        if self.layered is not None:
            d_normals = of.normals_jvp(self.grid.nodes[of.plane_rows], d_nodes[of.plane_rows])
            self.layered.jvp(None, places, None, d_nodes[of.wall_rows], d_normals)
        change = np.empty_like(self.points)
        change[self.of.in_volume] = places
        if self.of.body is not None:
            change[self.of.in_body] = self.of.body.jvp(d_nodes[self.of.wall_rows])
        return change

    def vjp(
        self,
        bar: np.ndarray,  # (n, 3), derivative of a scalar with respect to the points
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        # Returns control_points_bar: (n_control_points, 3); nodes_bar: (n_nodes, 3), with respect to the nodes of the
        # grid: `GridState.vjp` takes it to the control points.
        of, nodes_bar = self.of.grid_map, np.zeros_like(self.grid.nodes)
        if self.of.body is not None:
            nodes_bar[self.of.wall_rows] += self.of.body.vjp(bar[self.of.in_body])
        bar = np.array(bar[self.of.in_volume], dtype=float)
        if self.layered is not None:
            bar, wall_bar, normals_bar = self.layered.frozen_vjp(bar)
            nodes_bar[of.wall_rows] += wall_bar
            nodes_bar[of.plane_rows] += of.normals_vjp(self.grid.nodes[of.plane_rows], normals_bar)
        return self.of.evaluator.adjoint(bar), nodes_bar


def _rides(body: Body, points: np.ndarray, inversion: PointInversion) -> np.ndarray:
    """Whether points ride on the walls: those that are nodes of them, and those outside the volumes and inside them."""
    rides = body.is_node(points)
    outside = np.flatnonzero(~inversion.is_inside & ~rides)
    rides[outside] = body.contains(points[outside])
    return rides


def _require_found(inversion: PointInversion, numbers: np.ndarray, n_points: int) -> None:
    """Refuse points that are neither in a volume nor in the body, by their numbers, from 1."""
    lost = np.flatnonzero(~inversion.is_inside)
    if len(lost):
        first = ", ".join(f"point {numbers[q] + 1} at distance {inversion.distance[q]:.3g}" for q in lost[:3])
        more = ", ..." if len(lost) > 3 else ""
        raise InputError(
            f"embedded points: {len(lost)} of {n_points} points lie outside all volumes and not inside the walls: "
            f"{first}{more}; remove them or raise the tolerance (largest distance {inversion.distance[lost].max():.3g})"
        )


def planes_of(grid_map: GridMap, points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points in the planes that walls end on, and the normals of these."""
    plane_points, size = grid_map.nodes[grid_map.plane_rows], np.linalg.norm(np.ptp(grid_map.nodes, axis=0))
    planes = []
    for plane, normal in zip(grid_map.planes, grid_map.normals(plane_points)):
        distances = np.abs((points - plane_points[plane.first[0, 0]]) @ normal)
        planes.append((np.flatnonzero(distances <= ON_PLANE * size), normal))
    return planes
