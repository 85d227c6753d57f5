"""From surface control points to surface nodes: a constant sparse matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from ..evaluation.evaluator import Evaluator
from ..grids.sharing import node_sharing
from ..model import FittedModel
from ..movement.boundary import require_mesh_of
from ..movement.mesh import MovingMesh
from .surface import SurfaceGrid

__all__ = ["SurfaceMap"]


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Nodes of a surface from the control points of the design surface, ``x = A s + c``.

    Parameters
    ----------
    matrix : csr_array, shape (n, n_surface)
        A, the basis values at the nodes.
    constant : ndarray, shape (n, 3)
        c (m): what control points that are held contribute, and the residual of the fit where the model carries it.
    """

    matrix: csr_array
    constant: np.ndarray

    @classmethod
    def of(cls, model: FittedModel, mesh: MovingMesh, surface: SurfaceGrid) -> SurfaceMap:
        """Take the rows of the surface's nodes out of the evaluation of the grid.

        Raises
        ------
        InputError
            If a node depends on a control point that is free to move and not on the design surface, none depends on one
            that is, or the surface or the mesh is of another model.
        """
        require_mesh_of(model, mesh, "surface: the mesh")
        if surface.rows.max() >= model.n_nodes:
            raise InputError(f"surface: it has nodes that {model.header.source} has not; make it of this model")
        matrix = _evaluator(model, surface).matrix()
        _require_known(matrix, mesh, surface)
        is_design = np.zeros(mesh.n_points, dtype=bool)
        is_design[mesh.surface_ids] = True
        if not matrix[:, mesh.surface_ids].data.any():
            raise InputError(
                f"surface: {surface.names[0]} and the rest do not depend on the design surface; name others"
            )
        constant = matrix @ np.where(is_design[:, None], 0.0, model.control_points)
        if model.residual is not None:
            constant += model.residual[surface.rows]
        return cls(csr_array(matrix[:, mesh.surface_ids]), constant)

    def apply(self, control_points: np.ndarray) -> np.ndarray:
        """Nodes, shape (n, 3), of surface control points, shape (n_surface, 3), in metres."""
        return self.matrix @ control_points + self.constant


def _evaluator(model: FittedModel, surface: SurfaceGrid) -> Evaluator:
    """Evaluation of the surface's nodes alone, each in the volume that evaluates it in the grid."""
    number = np.full(model.n_nodes, -1)
    number[surface.rows] = np.arange(surface.n_points)
    sharing = node_sharing(model.topology)
    wanted = [own & (number[rows] >= 0) for rows, own in zip(sharing.rows, sharing.is_evaluated)]
    parameters = [x[mask] for x, mask in zip(model.parameters, wanted)]
    rows = [number[rows[mask]] for rows, mask in zip(sharing.rows, wanted)]
    return Evaluator.build(model.mesh, parameters, rows, surface.n_points)


def _require_known(matrix: csr_array, mesh: MovingMesh, surface: SurfaceGrid) -> None:
    """Refuse nodes that depend on what a mover decides."""
    is_known = ~mesh.is_free.any(axis=1)
    nodes, points = matrix.nonzero()
    unknown = ~is_known[points]
    if unknown.any():
        node, point = nodes[np.argmax(unknown)], points[np.argmax(unknown)]
        name = next(name for name, ids in zip(surface.names, surface.faces) if (ids == node).any())
        raise InputError(
            f"surface: {name} depends on {mesh.place_of_point(point)}, which is not on the design surface; leave the "
            f"patch out, or make it part of the design surface"
        )
