"""Points of other disciplines that follow an unstructured mesh: in the body with its walls, elsewhere with the lattice.

Points in the lattice move with it, without the small part of the walls' motion that it does not match and that mesh
nodes get from the walls: probes in the flow, not nodes of a second mesh.

Theory: ``docs/theory/body_points.rst``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...errors import InputError
from ...names import CONTROL_POINTS
from ..evaluation.evaluator import Evaluator
from ..evaluation.node_map import require_inputs
from ..evaluation.turned_evaluator import TurnedEvaluator
from ..walls.body_points import Body, BodyPoints
from .background_lattice import BackgroundLattice

__all__ = ["MeshPoints", "MeshPointsState"]


@dataclass(frozen=True, eq=False)
class MeshPoints(OneLine):
    """The map from control points of a mesh, wall nodes first, to points. Made by `MeshPoints.of`."""

    points: np.ndarray  # (n, 3), the points on the baseline (m)
    in_volume: np.ndarray  # int, numbers of points in the lattice
    in_body: np.ndarray  # int, numbers of points in the body
    evaluator: Evaluator | TurnedEvaluator  # the lattice at its points
    offsets: np.ndarray  # (n_in_volume, 3), round-off of its values on the baseline (m)
    body: BodyPoints | None  # embedding of the points in the body
    wall_rows: np.ndarray  # int (n_walls,), wall nodes among the nodes of the mesh
    n_walls: int

    inputs = (CONTROL_POINTS,)
    is_linear = True

    @classmethod
    def of(
        cls,
        lattice: BackgroundLattice,
        body: Body,  # the walls on the baseline
        wall_rows: np.ndarray,  # int (n_walls,), its nodes among the nodes of the mesh
        points: np.ndarray,  # (n, 3), the points on the baseline (m)
        tolerance: float,  # distance (m) up to which a point counts as inside the lattice
    ) -> MeshPoints:
        """Locate points; `InputError` if one is neither in the body nor in the lattice."""
        points = as_finite_points(points, len(points), "embedded points")
        is_in_body = body.is_node(points)
        others = np.flatnonzero(~is_in_body)
        is_in_body[others] = body.contains(points[others])
        in_volume, in_body = np.flatnonzero(~is_in_body), np.flatnonzero(is_in_body)
        off = lattice.distances(points[in_volume])
        lost = np.flatnonzero(off > tolerance)
        if len(lost):
            raise InputError(
                f"embedded points: {len(lost)} of {len(points)} points lie outside the mesh and not inside the walls, "
                f"the first is point {in_volume[lost[0]] + 1} at distance {off[lost[0]]:.3g}; remove them or raise the "
                f"tolerance"
            )
        evaluator = lattice.evaluator(points[in_volume])
        offsets = points[in_volume] - evaluator.forward(lattice.control_points)
        rides = BodyPoints.of(body, points[in_body]) if len(in_body) else None
        return cls(points, in_volume, in_body, evaluator, offsets, rides, wall_rows, len(wall_rows))

    def at(self, control_points: np.ndarray) -> MeshPointsState:
        """Points at control points, shape (n_control_points, 3), in metres."""
        nodes = self.forward(control_points)
        nodes[self.in_volume] += self.offsets
        if self.body is not None:
            nodes[self.in_body] += self.body.offsets
        return MeshPointsState(self, nodes)

    def forward(self, moves: np.ndarray) -> np.ndarray:
        """Moves of the points, shape (n, 3), from moves of the control points."""
        found = np.empty_like(self.points)
        found[self.in_volume] = self.evaluator.forward(np.ascontiguousarray(moves[self.n_walls :]))
        if self.body is not None:
            found[self.in_body] = self.body.forward(moves[: self.n_walls])
        return found

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`."""
        of_lattice = self.evaluator.adjoint(np.ascontiguousarray(bar[self.in_volume]))
        of_walls = np.zeros((self.n_walls, 3)) if self.body is None else self.body.adjoint(bar[self.in_body])
        return np.concatenate([of_walls, of_lattice])


@dataclass(frozen=True, eq=False)
class MeshPointsState:
    """Points at control points, and their derivative."""

    of: MeshPoints
    nodes: np.ndarray  # (n, 3), the points (m)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.of.inputs

    def jvp(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Change of the points with the control points."""
        return np.zeros_like(self.nodes) if control_points is None else self.of.forward(control_points)

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        return {name: self.of.adjoint(bar) for name in require_inputs(wrt, self.inputs)}
