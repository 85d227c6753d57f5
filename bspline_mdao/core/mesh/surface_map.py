"""The map from surface control points to surface nodes: a constant sparse matrix, and the turned residual of the fit.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial, singledispatch

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...errors import InputError
from ...grids.topology.node_numbering import NodeNumbering
from ...names import CONTROL_POINTS, SURFACE_CONTROL_POINTS
from ..evaluation.evaluator import Evaluator
from ..evaluation.node_map import require_inputs
from ..model.model import Model
from ..model.movable import Movable
from ..walls.node_vectors import FaceNodes
from ..walls.rotation_map import RotationMap, RotationState
from .boundary import require_mesh_of
from .moving_mesh import MovingMesh
from .surface import SurfaceGrid

__all__ = ["SurfaceMap", "SurfaceState", "surface_map_of"]


@dataclass(frozen=True, eq=False)
class SurfaceMap(OneLine):
    """Nodes of a surface from the control points of the design surface, ``x = A s + c + T(s) r``."""

    # These are the nodes of the whole map from control points to the grid, `bspline_mdao.core.walls.grid_map`: nodes on
    # walls are where the residual, turned with the wall alone, puts them.

    matrix: csr_array  # (n, n_surface), A, the basis values at the nodes
    # (n, 3), c (m): the contribution of fixed control points, and the residual of the fit if it does not turn
    constant: np.ndarray
    turned: _TurnedRows | None  # the residual, if the model has one and lets it turn

    @classmethod
    def of(cls, model: Movable, mesh: MovingMesh, surface: SurfaceGrid) -> SurfaceMap:
        """Take the rows of the surface's nodes out of the evaluation of the grid."""
        require_mesh_of(model, mesh, "surface: the mesh")
        if surface.rows.max() >= model.n_nodes:
            raise InputError(f"surface: it has nodes that are not in {model.source}; make it from this model")
        found = surface_map_of(model, mesh, surface)
        if not found.matrix.data.any():
            raise InputError(
                f"surface: {surface.names[0]} and the rest do not depend on the design surface; name others"
            )
        return found

    @classmethod
    def of_rows(
        cls,
        model: Model,  # the fitted grid, or what one of several processes needs of it
        # (n_surface,) of int, numbers of the surface control points; all others count as fixed
        surface_ids: np.ndarray,
        # (n,) of int, rows of the nodes in the grid vector, ascending; of coincident nodes, the first
        rows: np.ndarray,
        # called with each matrix by which the nodes depend on control points (the matrix of the nodes, and the matrix
        # of the corners of spans that their residual turns with) and with whether it is the second; may refuse it
        require: Callable | None = None,
    ) -> SurfaceMap:
        """Take some rows out of the evaluation of the grid."""
        require = require or (lambda matrix, turned: None)
        numbering = NodeNumbering.of(model.topology, rows)
        parameters = model.parameters_of(numbering)
        evaluator = Evaluator.of_nodes(numbering, model.mesh, parameters)
        matrix = evaluator.matrix()
        require(matrix, False)
        is_surface = np.zeros(len(model.control_points), dtype=bool)
        is_surface[surface_ids] = True
        constant = matrix @ np.where(is_surface[:, None], 0.0, model.control_points)
        turned, residual = None, model.residual_at(rows)
        if residual is not None and model.residual_lengths is not None:
            points, lengths = model.control_points, model.residual_lengths
            rotation_map = RotationMap.of(numbering, model.mesh, parameters, points, lengths, evaluator)
            face_nodes = rotation_map.rows(np.arange(len(rows)))
            require(rotation_map.corners.matrix()[rotation_map.seen_by(face_nodes)], True)
            rotation_map = rotation_map.of_rows(face_nodes)
            turned = _TurnedRows(rotation_map, face_nodes, residual, surface_ids, model.control_points)
        elif residual is not None:
            constant += residual
        return cls(csr_array(matrix[:, surface_ids]), constant, turned)

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely) on the control points."""
        return self.turned is None

    def at(self, surface_control_points: np.ndarray) -> SurfaceState:
        """Nodes and their derivative at surface control points, shape (n_surface, 3), in metres."""
        nodes = self.matrix @ surface_control_points + self.constant
        if self.turned is None:
            return SurfaceState(self, nodes, None)
        rotation = self.turned.at(surface_control_points)
        return SurfaceState(self, nodes + self.turned.evaluate(rotation), rotation)

    def apply(self, control_points: np.ndarray) -> np.ndarray:
        """Nodes, shape (n, 3), of surface control points, shape (n_surface, 3), in metres."""
        return self.at(control_points).nodes


@singledispatch
def surface_map_of(model: Movable, mesh: MovingMesh, surface: SurfaceGrid) -> SurfaceMap:
    """Map from the points of a design surface to the nodes of a surface, both of one model, see `SurfaceMap.of`."""
    raise InputError(f"surface: the model is of type {type(model).__name__}; make it with fit_grid(grid)")


@surface_map_of.register
def _of_blocks(model: Model, mesh: MovingMesh, surface: SurfaceGrid) -> SurfaceMap:
    """Take the rows of the surface's nodes out of the evaluation of the grid."""
    return SurfaceMap.of_rows(model, mesh.surface_ids, surface.rows, partial(_require_fixed, mesh, surface))


@dataclass(frozen=True, eq=False)
class SurfaceState:
    """Nodes of a surface, and their derivative."""

    of: SurfaceMap  # the map that gave them
    nodes: np.ndarray  # (n, 3), the nodes (m)
    rotation: RotationState | None  # rotations of the residual

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return (SURFACE_CONTROL_POINTS,)

    def jvp(self, surface_control_points: np.ndarray | None = None) -> np.ndarray:
        """Change of the nodes, shape (n, 3), with a change of the control points, shape (n_surface, 3)."""
        if surface_control_points is None:
            return np.zeros_like(self.nodes)
        found, turned = self.of.matrix @ surface_control_points, self.of.turned
        if self.rotation is None or turned is None:
            return found
        return found + turned.jvp(self.rotation, surface_control_points)

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`: (n, 3) to (n_surface, 3) under ``surface_control_points``."""
        found, turned, wrt = self.of.matrix.T @ bar, self.of.turned, require_inputs(wrt, self.inputs)
        if self.rotation is not None and turned is not None:
            found += turned.vjp(self.rotation, bar)
        return dict.fromkeys(wrt, found)


@dataclass(frozen=True, eq=False)
class _TurnedRows:
    """The residual of some nodes, and how it turns with the design surface."""

    rotation_map: RotationMap  # rotations of the corners that these nodes need
    rows: FaceNodes  # the nodes
    residual: np.ndarray  # (n, 3), their residual (m)
    surface_ids: np.ndarray  # (n_surface,) of int, control points on the design surface
    # (n_control_points, 3), all on the baseline (m); points that slide in planes do not matter, as the planes stay
    control_points: np.ndarray

    def at(self, control_points: np.ndarray) -> RotationState:
        moved = self.control_points.copy()
        moved[self.surface_ids] = control_points
        return self.rotation_map.at(moved)

    def evaluate(self, rotation: RotationState) -> np.ndarray:
        return self.rows.turned(rotation.matrices, rotation.normals, self.residual)

    def jvp(self, rotation: RotationState, change: np.ndarray) -> np.ndarray:
        step = np.zeros_like(self.control_points)
        step[self.surface_ids] = change
        d = rotation.change(step)
        return self.rows.jvp(rotation.matrices, rotation.normals, self.residual, d.matrices, d.normals, None)

    def vjp(self, rotation: RotationState, bar: np.ndarray) -> np.ndarray:
        matrices_bar = np.zeros_like(rotation.matrices)
        normals_bar, _ = self.rows.vjp(rotation.matrices, rotation.normals, self.residual, bar, matrices_bar)
        bars = rotation.change_vjp(RotationState.Change(matrices_bar, normals_bar), (CONTROL_POINTS,))
        return bars[CONTROL_POINTS][self.surface_ids]


def _require_fixed(mesh: MovingMesh, surface: SurfaceGrid, matrix: csr_array, turned: bool) -> None:
    """Refuse nodes, or corners that their residual turns with, that depend on points that a mover moves."""
    is_fixed = mesh.is_free.sum(axis=1) == 0
    nodes, points = matrix.nonzero()
    is_moving = ~is_fixed[points]
    if is_moving.any():
        node, point = nodes[np.argmax(is_moving)], points[np.argmax(is_moving)]
        if turned:
            name, cure = surface.names[0], "fit with wall_layer=False, so that the residual does not turn, "
        else:
            name = next(name for name, ids in zip(surface.names, surface.parts) if (ids == node).any())
            cure = ""
        raise InputError(
            f"surface: {name} depends on {mesh.place_of_point(point)}, which is not on the design surface; {cure}leave "
            f"the patch out, or make it part of the design surface"
        )
