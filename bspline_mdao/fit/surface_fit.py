"""Surface control points of a fitted model for another surface of the same topology."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError
from ..grids.index_space import Window
from ..grids.sharing import block_rows
from ..grids.topology import Topology
from ..model import FittedModel
from .entities import Entity
from .problem import problem_of_mesh

__all__ = ["fit_surface", "replace_nodes"]


def fit_surface(model: FittedModel, surface_ids: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Fit the surface control points of a model to moved surface nodes, section II.D.

    The corners, edges and faces of the surface are solved in turn with the model's own parameters and knots, so that
    nodes which have not moved give back the model's control points.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    surface_ids : ndarray of int, shape (n_surface,)
        Numbers of the surface control points: those of whole faces, such as ``surface_ids`` of a moving mesh.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m) with its surface nodes moved, wherever a block holds them (`replace_nodes`). Others do not count.

    Returns
    -------
    ndarray, shape (n_surface, 3)
        Surface control points (m), in the order of ``surface_ids``.

    Raises
    ------
    InputError
        If the nodes do not fit the model, or the control points are not those of whole faces.
    """
    if nodes.shape != (model.n_nodes, 3):
        raise InputError(f"{model.header.source}: nodes of shape {nodes.shape}; give shape ({model.n_nodes}, 3)")
    problem = problem_of_mesh(model.topology, model.mesh, model.settings.smoothing)
    is_surface = np.zeros(model.mesh.n_control_points, dtype=bool)
    is_surface[surface_ids] = True
    on_surface = tuple(entity for entity in problem.entities if _lies_on(entity, is_surface))
    control_points, is_fitted = np.zeros((model.mesh.n_control_points, 3)), np.zeros_like(is_surface)
    with threadpool_limits(1, "blas"):
        for step in problem.steps(model.parameters, on_surface):
            step.solve(nodes, control_points)
            is_fitted[step.entity.unknown_ids] = True
    if not is_fitted[surface_ids].all():
        missing = surface_ids[np.argmin(is_fitted[surface_ids])]
        raise InputError(
            f"{model.header.source}: control point {missing + 1} belongs to no face of the surface; give whole faces"
        )
    return control_points[surface_ids]


def replace_nodes(topology: Topology, nodes: np.ndarray, pieces: Sequence[tuple[Window, np.ndarray]]) -> np.ndarray:
    """Replace nodes of some windows, wherever a block holds them.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    pieces : sequence of (Window, ndarray of the window's shape and 3)
        New nodes (m). Where windows share nodes the last one counts.

    Returns
    -------
    ndarray, shape (n_nodes, 3)
        The grid with the new nodes, and everything else as it was.
    """
    rows, ids = block_rows(topology.shapes), np.empty(topology.n_nodes, dtype=np.int64)
    for segment, segment_ids in zip(topology.segments, topology.node_ids()):
        ids[rows[segment.block][segment.slices]] = segment_ids
    values, is_new = np.empty((ids.max() + 1, 3)), np.zeros(ids.max() + 1, dtype=bool)
    for window, points in pieces:
        there = ids[rows[window.block][window.slices]]
        values[there], is_new[there] = points, True
    return np.where(is_new[ids][:, None], values[ids], nodes)


def _lies_on(entity: Entity, is_surface: np.ndarray) -> bool:
    """Whether all control points of an entity are on the surface."""
    return bool(is_surface[entity.control_ids].all())
