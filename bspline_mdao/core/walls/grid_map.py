"""The whole map from control points, and from wall nodes where their places are given, to the grid.

    y = A b + T(b) r                    r: residual of the fit, turned with its surroundings (`.turning`)
    y <- y + E (w - y_wall)             w: wall nodes where they are to be; E fades over blocks (`.wall_correction`)
    x = layer(y; x0, w)                 nodes near walls follow them as a rigid body (`.layer`)

At the control points of the baseline it gives the baseline, and a rigid motion of all control points moves all nodes
with it, to round-off. Without walls the layer is nothing, and without a residual there is none to turn. What is near
which wall, and where in its span a node is, is that of the baseline and stays.

Theory: ``docs/theory/wall_layer.rst``, ``docs/theory/asked_walls.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.held_nodes import HeldNodes
from ...grids.topology.topology import Topology
from ..evaluation.evaluator import Evaluator
from ..splines.mesh import BSplineMesh
from .grid_walls import GridWalls
from .layer import Layered, WallLayer
from .node_vectors import Vectors
from .planes import PlaneNormal
from .turning import Turn, Turning
from .wall_correction import WallCorrection

__all__ = ["GridMap", "GridState"]


@dataclass(frozen=True, eq=False)
class GridMap(OneLine):
    """The map from control points to the nodes of a grid. Made by `GridMap.of`."""

    evaluator: Evaluator  # A
    nodes: np.ndarray  # (n, 3), the nodes on the baseline (m): those asked for, and after them what they need
    turning: Turning | None  # how the residual turns; None where there is none, or where it stays as it is
    # Vectors, ndarray of shape (n, 3) or None, the residual of the fit, ready to be turned, or to be added
    residual: Vectors | np.ndarray | None
    layer: WallLayer | None  # nodes that follow walls
    wall_rows: np.ndarray  # (n_wall,) of int, numbers of the nodes of all walls, each shared one once
    plane_rows: np.ndarray  # (n_plane,) of int, numbers of the nodes on the outlines of planes that walls end on
    planes: tuple[PlaneNormal, ...]  # normals of these planes, as functions of those nodes
    held: HeldNodes  # which nodes of the grid they are; in the map of all of it every number is that of its row

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid; faces of kind "wall" are walls
        mesh: BSplineMesh,  # one volume per segment
        # sequence of ndarray, each of shape (L0, L1, L2, 3), parameters of the nodes of every segment
        parameters: Sequence[np.ndarray],
        control_points: np.ndarray,  # (n_control_points, 3), fitted control points (m)
        residual: np.ndarray | None,  # (n_nodes, 3), baseline minus fitted points (m)
        # (n_corners,), how long it is around every corner of the spans (m), see `.residual_lengths`
        residual_lengths: np.ndarray | None,
        wall_layer: bool,  # whether nodes follow walls and the residual turns; without, the map is ``A b + r``
        evaluator: Evaluator,  # evaluation of the nodes, by `Evaluator.of_grid`
    ) -> GridMap:
        """Prepare the map of a fitted grid."""
        nodes = _baseline(evaluator, control_points, residual)
        walls = GridWalls.of(topology, nodes, evaluator.n_threads) if wall_layer else None
        held = HeldNodes.of_grid(topology)
        own = [x.reshape(-1, 3)[places] for x, places in zip(parameters, held.places)]
        return cls.of_nodes(held, mesh, own, control_points, residual, residual_lengths, wall_layer, walls, evaluator)

    @classmethod
    def of_nodes(
        cls,
        held: HeldNodes,  # the nodes, with those that walls need
        mesh: BSplineMesh,  # one volume per segment
        # sequence of ndarray, each of shape (n_v, 3), parameters of the nodes that each segment evaluates
        parameters: Sequence[np.ndarray],
        # control_points, residual, residual_lengths, wall_layer: as of `of`, the residual of the nodes alone, shape (n,
        # 3)
        control_points: np.ndarray,
        residual: np.ndarray | None,
        residual_lengths: np.ndarray | None,
        wall_layer: bool,
        walls: GridWalls | None,  # the walls of the grid; None where there are none, or nothing follows them
        evaluator: Evaluator,  # evaluation of the nodes, by `Evaluator.of_nodes`
    ) -> GridMap:
        """Prepare the map to some nodes of a fitted grid: they get the bits that they have in all of it."""
        nodes = _baseline(evaluator, control_points, residual)
        turning, layer = None, None
        vectors: Vectors | np.ndarray | None = residual
        if wall_layer and residual is not None and residual_lengths is not None:
            turning = Turning.of(held, mesh, parameters, control_points, residual_lengths, evaluator)
            vectors = turning.vectors(residual)
        rows = plane_rows = np.zeros(0, dtype=int)
        planes: tuple[PlaneNormal, ...] = ()
        if walls is not None:
            layer, planes = walls.layer(held, nodes, evaluator.n_threads), walls.normals
            rows, plane_rows = map(held.numbers_of, walls.needed)
        return cls(evaluator, nodes, turning, vectors, layer, rows, plane_rows, planes, held)

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely, with a residual) on the control points."""
        return self.turning is None and self.layer is None

    @property
    def n_asked(self) -> int:
        """Number of the nodes that were asked for, the first ones."""
        return self.held.n_asked

    def padded(self, bar: np.ndarray) -> np.ndarray:
        """Return derivatives with respect to the nodes asked for, shape (n_asked, 3), with zeros for the others."""
        if self.n_asked == len(self.nodes):
            return bar
        return np.concatenate([bar, np.zeros((len(self.nodes) - self.n_asked, 3), dtype=bar.dtype)])

    @property
    def n_bytes(self) -> int:
        """Memory besides the evaluator's and the model's (B)."""
        packed = self.residual.n_bytes if isinstance(self.residual, Vectors) else 0
        return packed + sum(part.n_bytes for part in (self.turning, self.layer) if part is not None) + self.nodes.nbytes

    def at(
        self,
        control_points: np.ndarray,  # (n_control_points, 3), control points (m)
        # correction of the nodes whose places are given, made for the baseline `nodes`
        correction: WallCorrection | None = None,
        wall: np.ndarray | None = None,  # (n_wall, 3), where these nodes are to be (m)
    ) -> GridState:
        """Nodes and their derivative."""
        turn = layered = None
        if self.turning is not None and isinstance(self.residual, Vectors):
            turn = self.turning.at(control_points)
            nodes = turn.evaluate(control_points, self.residual)
        else:
            nodes = self.evaluator.forward(control_points)
            if isinstance(self.residual, np.ndarray):
                nodes += self.residual
        mismatch = None if correction is None or wall is None else correction.meet(nodes, wall)
        plane_points = nodes[self.plane_rows]
        if self.layer is not None:
            rows, normals = self.wall_rows, self.normals(plane_points)
            layered = self.layer.at(self.nodes, nodes, self.nodes[rows], nodes[rows], normals)
        return GridState(self, nodes, turn, layered, plane_points, correction, mismatch)

    def normals(self, plane_points: np.ndarray) -> np.ndarray:
        """Normals, shape (n_planes, 3), of the planes that walls end on, from the points on their outlines."""
        return np.reshape([plane.normal(plane_points) for plane in self.planes], (-1, 3))

    def normals_jvp(self, plane_points: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Change of `normals` with that of the points."""
        return np.reshape([plane.normal_jvp(plane_points, change) for plane in self.planes], (-1, 3))

    def normals_vjp(self, plane_points: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transpose of `normals_jvp`."""
        points_bar = np.zeros_like(plane_points)
        for plane, normal_bar in zip(self.planes, bar):
            plane.add_normal_vjp(plane_points, normal_bar, points_bar)
        return points_bar


@dataclass(frozen=True, eq=False)
class GridState:
    """A grid and its derivative."""

    of: GridMap  # the map
    nodes: np.ndarray  # (n_nodes, 3), the grid (m)
    turn: Turn | None  # rotations of the residual
    layered: Layered | None  # nodes that followed walls
    plane_points: np.ndarray  # (n_plane, 3), nodes on the outlines of planes before that (m)
    correction: WallCorrection | None = None  # correction of the nodes whose places were given
    mismatch: np.ndarray | None = None  # (n_wall, 3), given places minus those of the control points alone (m)

    def jvp(
        self,
        d_control_points: np.ndarray,  # (n_control_points, 3), change of the control points
        d_wall: np.ndarray | None = None,  # (n_wall, 3), change of the given places; needed where there are any
    ) -> np.ndarray:  # (n_nodes, 3)
        """Change of the nodes."""
        of = self.of
        if self.turn is not None and isinstance(of.residual, Vectors):
            change = self.turn.jvp(d_control_points, self.turn.change(d_control_points), of.residual)
        else:
            change = of.evaluator.forward(d_control_points)
        if self.correction is not None:
            change += self.correction.forward(d_wall - change[self.correction.rows])
        if self.layered is not None:
            d_normals = of.normals_jvp(self.plane_points, change[of.plane_rows])
            self.layered.jvp(None, change, None, change[of.wall_rows], d_normals)
        return change

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp` where no places are given: (n_nodes, 3) to (n_control_points, 3)."""
        return self.full_vjp(bar)[0]

    def full_vjp(
        self,
        bar: np.ndarray,  # (n_nodes, 3), derivative of a scalar with respect to the nodes
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Transpose of `jvp`."""
        # Returns control_points_bar: (n_control_points, 3); wall_bar: (n_wall, 3), with respect to the given places;
        # None where there are none.
        of = self.of
        if self.layered is not None:
            bar, wall_bar, normals_bar = self.layered.frozen_vjp(bar.copy())
            bar[of.wall_rows] += wall_bar
            bar[of.plane_rows] += of.normals_vjp(self.plane_points, normals_bar)
        given_bar = None
        if self.correction is not None:
            given_bar = self.correction.adjoint(bar)
            bar = bar.copy() if self.layered is None else bar
            bar[self.correction.rows] -= given_bar
        if self.turn is not None and isinstance(of.residual, Vectors):
            return self.turn.control_vjp(of.residual, bar), given_bar
        return of.evaluator.adjoint(bar), given_bar


def _baseline(evaluator: Evaluator, control_points: np.ndarray, residual: np.ndarray | None) -> np.ndarray:
    """Nodes at the fitted control points."""
    nodes = evaluator.forward(control_points)
    if residual is not None:
        nodes += residual
    return nodes
