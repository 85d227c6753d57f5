"""Points that were not fitted, such as the nodes of an unstructured mesh, embedded in the control mesh of a grid.

A point keeps its parameters (`bspline_mdao.core.evaluation.inversion`): y = A b + d, where d is its offset from the
mesh on the baseline, zero for a point inside. Near a wall it then follows the wall as the nodes of the grid do,

    x = layer(y; x0, w),

with the wall nodes w of the grid, so embedded points and grid move alike there. Points on planes that walls end on stay
in them. The parameters of a point, and the wall that it is near, are found on the baseline and stay.

Points inside the body, where there are no volumes, ride on the walls (`.body_points`).

Theory: ``docs/theory/inversion.rst``, ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...errors import InputError
from ...names import CONTROL_POINTS, GRID
from ..evaluation.evaluator import Evaluator
from ..evaluation.inversion import PointInversion, embed_points, invert_points
from ..evaluation.node_map import require_inputs
from ..splines.mesh import BSplineMesh
from .body_points import Body, BodyPoints
from .grid_map import GridMap
from .layer import Followed, WallFollowing, WallLayer

__all__ = ["EmbeddedPoints", "EmbeddedState", "planes_of"]

ON_PLANE = 1e-9
"""A point this near to a plane, relative to the size of the grid, lies in it: files round coordinates."""


@dataclass(frozen=True, eq=False)
class EmbeddedPoints(OneLine):
    """The map from control points to embedded points. Made by `EmbeddedPoints.of`, or by `FittedModel.embed_points`."""

    grid_map: GridMap  # map to the grid, whose walls they follow
    evaluator: Evaluator  # A of the points
    points: np.ndarray  # (n, 3), the points on the baseline (m)
    in_volume: np.ndarray  # (n_in_volume,) of int, numbers of the points in the volumes
    offsets: np.ndarray  # (n_in_volume, 3), their offsets from the mesh there (m)
    following: WallFollowing | None  # the ones that follow walls of the grid
    in_body: np.ndarray  # (n_in_body,) of int, numbers of the others, inside the body
    body: BodyPoints | None  # the map that these follow
    wall_rows: np.ndarray  # (n_wall,) of int, rows of the nodes of the walls in the grid

    inputs = (CONTROL_POINTS, GRID)

    @property
    def is_linear(self) -> bool:
        """Whether no point follows walls: all are linear in the control points and nodes."""
        return self.following is None

    @classmethod
    def of(
        cls,
        grid_map: GridMap,  # map to the grid
        mesh: BSplineMesh,  # its volumes
        control_points: np.ndarray,  # (n_control_points, 3), control points of the baseline (m)
        points: np.ndarray,  # (n, 3), the points on the baseline (m)
        # distance (m) up to which a point counts as inside the volumes, see `invert_points`
        tolerance: float | None = None,
        # of int, the walls of the grid on the baseline, and the rows of their nodes
        walls: tuple[Body, np.ndarray] | None = None,
    ) -> EmbeddedPoints:
        """Find volumes and parameters of points, and the weights of those inside the body."""
        points = as_finite_points(points, len(points), "embedded points")
        inversion, in_body = invert_points(mesh, control_points, points, tolerance), np.zeros(len(points), dtype=bool)
        if walls is not None:
            in_body = _rides(walls[0], points, inversion)
        in_volume, following, body = np.flatnonzero(~in_body), None, None
        inversion = PointInversion(*(getattr(inversion, part.name)[in_volume] for part in fields(PointInversion)))
        _require_found(inversion, in_volume, len(points))
        evaluator = embed_points(mesh, inversion)
        offsets = points[in_volume] - evaluator.forward(control_points)
        if grid_map.following is not None:
            planes = planes_of(grid_map, points[in_volume])
            layer = WallLayer.of(grid_map.following.layer.wall, points[in_volume], planes=planes)
            if layer.pieces:  # without pieces, no point follows a wall
                following = replace(grid_map.following, layer=layer)
        rows = np.zeros(0, dtype=int)
        if walls is not None and in_body.any():
            body, rows = BodyPoints.of(walls[0], points[in_body]), walls[1]
        return cls(grid_map, evaluator, points, in_volume, offsets, following, np.flatnonzero(in_body), body, rows)

    def at(
        self,
        control_points: np.ndarray,  # (n_control_points, 3), control points (m)
        # (n_nodes, 3), the nodes of ``grid_map`` at these control points (m); places of wall nodes may have been given
        grid: np.ndarray,
    ) -> EmbeddedState:
        """Points that belong to a grid."""
        nodes, followed = np.empty_like(self.points), None
        places = self.evaluator.forward(control_points) + self.offsets
        if self.following is not None:
            followed = self.following.at(self.points[self.in_volume], places, self.grid_map.nodes, grid)
        nodes[self.in_volume] = places
        if self.body is not None:
            nodes[self.in_body] = self.body.at(grid[self.wall_rows]).nodes
        return EmbeddedState(self, nodes, followed)


@dataclass(frozen=True, eq=False)
class EmbeddedState:
    """Embedded points that belong to a grid, and their derivative."""

    of: EmbeddedPoints  # the map
    nodes: np.ndarray  # (n, 3), the points (m)
    followed: Followed | None  # the points that followed walls

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.of.inputs

    def jvp(
        self,
        # (n_control_points, 3), change of the control points; none by default
        control_points: np.ndarray | None = None,
        grid: np.ndarray | None = None,  # (n_nodes, 3), their change of the grid, by `GridState.jvp`; none by default
    ) -> np.ndarray:
        """Change of the embedded points, shape (n, 3)."""
        of, change = self.of, np.zeros_like(self.nodes)
        places = np.zeros_like(of.offsets) if control_points is None else of.evaluator.forward(control_points)
        if grid is None:
            grid = np.zeros_like(of.grid_map.nodes)
        if self.followed is not None:
            self.followed.jvp(places, grid)
        change[of.in_volume] = places
        if of.body is not None:
            change[of.in_body] = of.body.forward(grid[of.wall_rows])
        return change

    def vjp(
        self,
        bar: np.ndarray,  # (n, 3), derivative of a scalar with respect to the points
        # which derivatives: ``control_points``, shape (n_control_points, 3), and ``grid``, shape (n_nodes, 3), which
        # `GridState.vjp` takes to the control points; both by default
        wrt: Collection[str] | None = None,
    ) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        of, wrt = self.of, require_inputs(wrt, self.inputs)
        bars = {GRID: np.zeros_like(of.grid_map.nodes)}
        if of.body is not None:
            bars[GRID][of.wall_rows] += of.body.adjoint(bar[of.in_body])
        bar = np.array(bar[of.in_volume], dtype=float)
        if self.followed is not None:
            self.followed.add_vjp(bar, bars[GRID])
        if CONTROL_POINTS in wrt:
            bars[CONTROL_POINTS] = of.evaluator.adjoint(bar)
        return {name: bars[name] for name in wrt}


def _rides(body: Body, points: np.ndarray, inversion: PointInversion) -> np.ndarray:
    """Whether points ride on the walls: nodes of walls, and points inside the walls and outside the volumes."""
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
    """Points in the planes that walls end on, and the planes' normals."""
    planes: list[tuple[np.ndarray, np.ndarray]] = []
    following, size = grid_map.following, np.linalg.norm(np.ptp(grid_map.nodes, axis=0))
    if following is None or following.planes is None:
        return planes
    plane_points = grid_map.nodes[following.plane_rows]
    for plane in following.planes:
        normal = plane.normal(plane_points)
        distances = np.abs((points - plane_points[plane.first[0, 0]]) @ normal)
        planes.append((np.flatnonzero(distances <= ON_PLANE * size), normal))
    return planes
