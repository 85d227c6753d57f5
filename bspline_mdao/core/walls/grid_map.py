"""The whole map from control points, and from wall nodes with given places, to the grid.

    y = A b + T(b) r                    r: residual of the fit, turned with its neighbourhood (`.rotation_map`)
    y <- y + E (w - y_wall)             w: places for wall nodes; E fades over blocks (`.wall_correction`).
                                        For nodes that slide on fixed surfaces w is the closest point there to y, or
                                        to their given place (`bspline_mdao.core.sliding`)
    x = layer(y; x0, w)                 nodes near walls follow them as a rigid body (`.layer`)
    x <- x0 + P (x - x0)                nodes of periodic sides move alike
                                        (`bspline_mdao.grids.topology.periodic_ties`). The layer, which sees walls
                                        beyond them (`.wall_images`), satisfies this up to rounding; y does not, as
                                        residuals are smoothed on either side separately

At the control points of the baseline it gives the baseline, and a rigid motion of all control points moves all nodes
with it, to round-off. Without walls there is no layer, and without a residual nothing to turn. Which nodes are near
which wall, and the place of a node in its span, are found on the baseline and stay.

Theory: ``docs/theory/wall_layer.rst``, ``docs/theory/asked_walls.rst``, ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.periodic_ties import NodeTies
from ...grids.topology.topology import Topology
from ...names import CONTROL_POINTS, SURFACE
from ..evaluation.evaluator import Evaluator
from ..evaluation.node_map import require_inputs
from ..sliding.sliding_nodes import SlidingNodes, SlidNodes
from ..splines.mesh import BSplineMesh
from .grid_walls import GridWalls
from .layer import Followed, WallFollowing
from .node_vectors import Vectors
from .rotation_map import RotationMap, RotationState
from .settings import LAYER, LayerSettings
from .wall_correction import WallCorrection

__all__ = ["GridMap", "GridState"]


@dataclass(frozen=True, eq=False)
class GridMap(OneLine):
    """The map from control points to the nodes of a grid. Made by `GridMap.of`."""

    evaluator: Evaluator  # A
    nodes: np.ndarray  # (n, 3), the nodes on the baseline (m): the requested ones, then the nodes that these need
    rotation_map: RotationMap | None  # rotation of the residual; None if there is no residual or it does not turn
    # the residual of the fit: Vectors, ready to be turned, ndarray of shape (n, 3) to be added, or None
    residual: Vectors | np.ndarray | None
    following: WallFollowing | None  # nodes that follow walls
    numbering: NodeNumbering  # their numbers in the grid; in the map of the whole grid every number equals its row
    ties: NodeTies | None = None  # nodes of periodic sides
    correction: WallCorrection | None = None  # correction of nodes whose places are known, see `meeting`
    n_given: int = 0  # number of given ones among these, which come first; the others slide from where they are
    sliding: SlidingNodes | None = None  # which of both slide on surfaces

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid; faces of kind "wall" are walls
        mesh: BSplineMesh,  # one volume per segment
        # each (L0, L1, L2, 3), parameters of the nodes of every segment
        parameters: Sequence[np.ndarray],
        control_points: np.ndarray,  # (n_control_points, 3), fitted control points (m)
        residual: np.ndarray | None,  # (n_nodes, 3), baseline minus fitted points (m)
        # (n_corners,), its length around every corner of the spans (m), see `.residual_lengths`
        residual_lengths: np.ndarray | None,
        wall_layer: bool,  # whether nodes follow walls and the residual turns; without, the map is ``A b + r``
        evaluator: Evaluator,  # evaluation of the nodes, by `Evaluator.of_grid`
        settings: LayerSettings = LAYER,
    ) -> GridMap:
        """Prepare the map of a fitted grid."""
        nodes = _baseline(evaluator, control_points, residual)
        walls = GridWalls.of(topology, nodes, evaluator.n_threads, settings) if wall_layer else None
        numbering = NodeNumbering.of_grid(topology)
        local = [x.reshape(-1, 3)[places] for x, places in zip(parameters, numbering.places)]
        return cls.of_nodes(
            numbering, mesh, local, control_points, residual, residual_lengths, wall_layer, walls, evaluator
        )

    @classmethod
    def of_nodes(
        cls,
        numbering: NodeNumbering,  # the nodes, with those that walls need
        mesh: BSplineMesh,  # one volume per segment
        # each (n_v, 3), parameters of the nodes that each segment evaluates
        parameters: Sequence[np.ndarray],
        # control_points, residual, residual_lengths, wall_layer: as for `of`, the residual only of these nodes, shape
        # (n, 3)
        control_points: np.ndarray,
        residual: np.ndarray | None,
        residual_lengths: np.ndarray | None,
        wall_layer: bool,
        walls: GridWalls | None,  # the walls of the grid; None if there are none, or nothing follows them
        evaluator: Evaluator,  # evaluation of the nodes, by `Evaluator.of_nodes`
    ) -> GridMap:
        """Prepare the map to some nodes of a fitted grid: they get the same bits as in the whole grid."""
        nodes = _baseline(evaluator, control_points, residual)
        rotation_map, following = None, None
        vectors: Vectors | np.ndarray | None = residual
        if wall_layer and residual is not None and residual_lengths is not None:
            rotation_map = RotationMap.of(numbering, mesh, parameters, control_points, residual_lengths, evaluator)
            vectors = rotation_map.vectors(residual)
        if walls is not None:
            layer = walls.layer(numbering, nodes, evaluator.n_threads)
            rows, plane_rows = map(numbering.numbers_of, walls.needed)
            following = WallFollowing(layer, rows, plane_rows, walls.normals, walls.images)
        return cls(evaluator, nodes, rotation_map, vectors, following, numbering, NodeTies.of(numbering))

    def meeting(
        self, correction: WallCorrection, n_given: int | None = None, sliding: SlidingNodes | None = None
    ) -> GridMap:
        """The map with a second input, ``surface``: places for the nodes of a correction of `nodes`."""
        # the first ones of them are given, all by default; with none there is no such input
        n_given = len(correction.rows) if n_given is None else n_given
        return replace(self, correction=correction, n_given=n_given, sliding=sliding)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return (CONTROL_POINTS, SURFACE) if self.n_given else (CONTROL_POINTS,)

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely, with a residual) on the control points."""
        return all(part is None for part in (self.rotation_map, self.following, self.sliding, self.ties))

    @property
    def n_asked(self) -> int:
        """Number of the requested nodes, which come first."""
        return self.numbering.n_asked

    def padded(self, bar: np.ndarray) -> np.ndarray:
        """Derivatives with respect to the requested nodes, shape (n_asked, 3), with zeros added for the others."""
        if self.n_asked == len(self.nodes):
            return bar
        return np.concatenate([bar, np.zeros((len(self.nodes) - self.n_asked, 3), dtype=bar.dtype)])

    @property
    def n_bytes(self) -> int:
        """Memory in addition to the evaluator's and the model's (B)."""
        packed = self.residual.n_bytes if isinstance(self.residual, Vectors) else 0
        n_rotation = 0 if self.rotation_map is None else self.rotation_map.n_bytes
        return packed + n_rotation + (0 if self.following is None else self.following.layer.n_bytes) + self.nodes.nbytes

    def at(
        self,
        control_points: np.ndarray,  # (n_control_points, 3), control points (m)
        # (n_surface, 3), places (m) for the nodes of the correction in `meeting`; None for a map without one
        surface: np.ndarray | None = None,
    ) -> GridState:
        """Nodes and their derivative."""
        rotation = mismatch = followed = slid = None
        if self.rotation_map is not None and isinstance(self.residual, Vectors):
            rotation = self.rotation_map.at(control_points)
            nodes = rotation.evaluate(control_points, self.residual)
        else:
            nodes = self.evaluator.forward(control_points)
            if isinstance(self.residual, np.ndarray):
                nodes += self.residual
        if self.ties is not None:
            self.ties.move_alike(nodes, self.nodes)
        if (surface is not None) != (self.n_given > 0):
            raise InputError("grid: places of nodes and a correction that meets them go together; give both or none")
        if self.correction is not None:
            wall = nodes[self.correction.rows]
            if surface is not None:
                mismatch = surface - wall[: self.n_given]
                wall[: self.n_given] = surface
            if self.sliding is not None:
                slid = self.sliding.at(wall)
                wall[self.sliding.places] = slid.points
            self.correction.meet(nodes, wall)
        if self.following is not None:
            followed = self.following.at(self.nodes, nodes, self.nodes, nodes)
        if self.ties is not None and (self.correction is not None or followed is not None):
            self.ties.move_alike(nodes, self.nodes)
        return GridState(self, nodes, rotation, followed, mismatch, slid)


@dataclass(frozen=True, eq=False)
class GridState:
    """A grid and its derivative."""

    of: GridMap  # the map
    nodes: np.ndarray  # (n_nodes, 3), the grid (m)
    rotation: RotationState | None  # rotations of the residual
    followed: Followed | None  # nodes that followed walls
    mismatch: np.ndarray | None = None  # (n_surface, 3), given places minus the places from the control points (m)
    slid: SlidNodes | None = None  # positions of nodes after sliding, and the derivative

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.of.inputs

    def jvp(
        self,
        # (n_control_points, 3), change of the control points; none by default
        control_points: np.ndarray | None = None,
        surface: np.ndarray | None = None,  # (n_surface, 3), change of the given places; none by default
    ) -> np.ndarray:  # (n_nodes, 3)
        """Change of the nodes."""
        of = self.of
        if control_points is None:
            change = np.zeros_like(self.nodes)
        elif self.rotation is not None and isinstance(of.residual, Vectors):
            change = self.rotation.jvp(control_points, self.rotation.change(control_points), of.residual)
        else:
            change = of.evaluator.forward(control_points)
        if of.ties is not None:
            of.ties.alike(change)
        if of.correction is not None:
            met = change[of.correction.rows]
            asked = met.copy()
            asked[: of.n_given] = 0.0 if surface is None else surface
            if self.slid is not None and of.sliding is not None:
                asked[of.sliding.places] = self.slid.jvp(asked[of.sliding.places])
            change += of.correction.forward(asked - met)
        if self.followed is not None:
            self.followed.jvp(change, change)
        if of.ties is not None:
            of.ties.alike(change)
        return change

    def vjp(
        self,
        bar: np.ndarray,  # (n_nodes, 3), derivative of a scalar with respect to the nodes
        # which derivatives: ``control_points``, shape (n_control_points, 3), and ``surface``, shape (n_surface, 3); in
        # all `inputs` by default
        wrt: Collection[str] | None = None,
    ) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        of, wrt = self.of, require_inputs(wrt, self.inputs)
        bars: dict[str, np.ndarray] = {}
        if self.followed is not None or of.correction is not None or of.ties is not None:
            bar = bar.copy()
        if of.ties is not None:
            of.ties.alike_vjp(bar)
        if self.followed is not None:
            self.followed.add_vjp(bar, bar)
        if of.correction is not None:
            asked_bar = of.correction.adjoint(bar)
            bar[of.correction.rows] -= asked_bar
            if self.slid is not None and of.sliding is not None:
                asked_bar[of.sliding.places] = self.slid.vjp(asked_bar[of.sliding.places])
            bars[SURFACE] = asked_bar[: of.n_given]
            bar[of.correction.rows[of.n_given :]] += asked_bar[of.n_given :]
        if of.ties is not None:
            of.ties.alike_vjp(bar)
        if CONTROL_POINTS in wrt:
            if self.rotation is not None and isinstance(of.residual, Vectors):
                parts = self.rotation.vjp(of.residual, bar, ("points", "control_points"))
                bars[CONTROL_POINTS] = parts["points"] + parts["control_points"]
            else:
                bars[CONTROL_POINTS] = of.evaluator.adjoint(bar)
        return {name: bars[name] for name in wrt}


def _baseline(evaluator: Evaluator, control_points: np.ndarray, residual: np.ndarray | None) -> np.ndarray:
    """Nodes at the fitted control points."""
    nodes = evaluator.forward(control_points)
    if residual is not None:
        nodes += residual
    return nodes
