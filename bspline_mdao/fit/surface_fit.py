"""Surface control points of a fitted model for another surface of the same topology."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError
from ..model.fitted_model import FittedModel
from ..topology.index_space import Window, block_rows
from ..topology.topology import Topology
from .entities import Entity
from .problem import problem_of_mesh

__all__ = ["SurfaceFit", "SurfaceMiss", "fit_surface", "replace_nodes"]

LOGGER = logging.getLogger(__name__)
"""Tells how far each surface misses its target: a warning beyond `NOTABLE_MISS`."""

NOTABLE_MISS = 1e-3
"""A surface that misses its target by this fraction of its size is not left to those who ask."""


@dataclass(frozen=True)
class SurfaceMiss:
    """How far the nodes of a surface are off those that its control points were fitted to.

    Parameters
    ----------
    largest, rms : float
        Largest distance, and the root mean square over all nodes (m).
    size : float
        Diagonal of the target's box (m).
    n_nodes : int
        Nodes of the surface, each counted once.
    patch, block : str
        Patch and block of the node that is farthest off; empty where no patch is declared there.
    node : tuple of three int
        Its place in the block, from 1.
    """

    largest: float
    rms: float
    size: float
    n_nodes: int
    patch: str
    block: str
    node: tuple[int, int, int]

    @classmethod
    def of(
        cls, topology: Topology, source: np.ndarray, rows: np.ndarray, nodes: np.ndarray, target: np.ndarray
    ) -> SurfaceMiss:
        """Compare nodes of a surface with their target.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        source : ndarray of int, shape (n_nodes,)
            Row that stands for each row of the grid vector, see
        `bspline_mdao.topology.sharing.NodeSharing.source_rows`.
        rows : ndarray of int, shape (n,)
            Row of each node in the grid vector.
        nodes, target : ndarray, shape (n, 3)
            Where the nodes are, and where they were to be (m).
        """
        distances = np.linalg.norm(nodes - target, axis=1)
        worst = int(np.argmax(distances))
        place = _place_on_patch(topology, source, source[rows[worst]])
        rms, size = np.sqrt(np.mean(distances**2)), np.linalg.norm(np.ptp(target, axis=0))
        return cls(float(distances[worst]), float(rms), float(size), len(rows), *place)

    def __str__(self) -> str:
        size = f" ({self.largest / self.size:.2g} of its size)" if self.size else ""
        patch = f", patch {self.patch}" if self.patch else ""
        return (
            f"the surface misses its target by {self.largest:.3g} m at most{size}, {self.rms:.3g} m RMS; the worst is "
            f"node {self.node} of {self.block}{patch}"
        )

    def log(self, prefix: str = "") -> None:
        """Tell it: as a warning if it is notable, and else to those who ask for information."""
        is_notable = self.largest > NOTABLE_MISS * self.size
        LOGGER.log(logging.WARNING if is_notable else logging.INFO, "%s%s", prefix, self)


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """Surface control points for another surface, and how far that is missed.

    Parameters
    ----------
    control_points : ndarray, shape (n_surface, 3)
        The surface control points (m).
    miss : SurfaceMiss
        Distance of the regenerated surface nodes to those that were asked for.
    """

    control_points: np.ndarray
    miss: SurfaceMiss


def fit_surface(model: FittedModel, surface_ids: np.ndarray, nodes: np.ndarray) -> SurfaceFit:
    """Fit the surface control points of a model to moved surface nodes, section II.D.

    What the nodes have moved is fitted as the grid was, corners, edges and faces in turn, with the model's own
    parameters, knots and fallback, and added to the control points: those of nodes which have not moved stay, and those
    of a surface that is turned or stretched as a whole follow it.

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
    SurfaceFit
        Surface control points, in the order of ``surface_ids``, and how far the surface misses the nodes: control
        points have fewer freedoms than nodes. That is logged, too, see `LOGGER`.

    Raises
    ------
    InputError
        If the nodes do not fit the model, or the control points are not those of whole faces.
    """
    if nodes.shape != (model.n_nodes, 3):
        raise InputError(f"{model.header.source}: nodes of shape {nodes.shape}; give shape ({model.n_nodes}, 3)")
    problem = problem_of_mesh(model.topology, model.mesh)
    is_surface = np.zeros(model.mesh.n_control_points, dtype=bool)
    is_surface[surface_ids] = True
    on_surface = tuple(entity for entity in problem.entities if _lies_on(entity, is_surface))
    control_points, is_fitted = np.zeros_like(model.control_points), np.zeros_like(is_surface)
    moves = nodes - model.regenerate().to_vector().reshape(-1, 3)
    fitted = np.zeros_like(nodes)
    with threadpool_limits(1, "blas"):
        steps = list(problem.steps(model.parameters, on_surface))
        for step in steps:
            step.solve(moves, control_points)
            is_fitted[step.entity.unknown_ids] = True
        control_points = problem.mixture(model.parameters, model.candidate_weights).forward(control_points, moves)
        control_points += model.control_points
        for step in steps:
            fitted[step.entity.rows] += step.evaluate(control_points)
    if not is_fitted[surface_ids].all():
        missing = surface_ids[np.argmin(is_fitted[surface_ids])]
        raise InputError(
            f"{model.header.source}: control point {missing + 1} belongs to no face of the surface; give whole faces"
        )
    rows = np.concatenate([entity.rows for entity in on_surface])
    fitted[rows] += _residual(model, problem.sharing.source_rows()[rows], surface_ids, control_points)
    miss = SurfaceMiss.of(model.topology, problem.sharing.source_rows(), rows, fitted[rows], nodes[rows])
    miss.log(f"{model.header.source}: ")
    return SurfaceFit(control_points[surface_ids], miss)


def _residual(model: FittedModel, rows: np.ndarray, surface_ids: np.ndarray, control_points: np.ndarray) -> np.ndarray:
    """Residual of surface nodes by their rows, turned where it turns; 0 where there is none."""
    if model.residual is None:
        return np.zeros((len(rows), 3))
    turning = model.grid_map().turning
    if turning is None:
        return model.residual[rows]
    moved = model.control_points.copy()
    moved[surface_ids] = control_points[surface_ids]
    unique, place = np.unique(rows, return_inverse=True)
    nodes = turning.rows(unique)
    turn = turning.of_rows(nodes).at(moved)
    return nodes.turned(turn.matrices, turn.normals, model.residual[unique])[place]


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


def _place_on_patch(topology: Topology, source: np.ndarray, row: int) -> tuple[str, str, tuple[int, int, int]]:
    """Patch, block and place in it, from 1, of a node by its row: on a declared patch if one holds it."""
    blocks = block_rows(topology.shapes)
    faces = [(face.window, face.patch) for face in topology.boundary if face.patch is not None]
    whole = [(Window.whole(number, shape), "") for number, shape in enumerate(topology.shapes)]
    for window, patch in (*faces, *whole):
        found = np.argwhere(source[blocks[window.block][window.slices]] == row)
        if len(found):
            return patch, f"block {window.block + 1}", tuple(int(n) + 1 for n in found[0] + window.lo)
    raise IndexError(row)
