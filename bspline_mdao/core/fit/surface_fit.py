"""Surface control points of a fitted model for given surface nodes, which need not lie on any spline.

- `fit_surface` fits the displacements of the nodes as the grid was fitted (section II.D: corners, edges and faces in
  turn, with the model's own parameters, knots and candidates), and adds the result to the control points. It sets up
  the moves of section IV.
- `SurfaceFollower` is used in moves of grids with boundary layers. With Q the iterated quasi-interpolant of
  `.quasi_interpolant`, s0 and w0 control points and nodes of the baseline, and R the rotation of the rigid motion
  nearest to the motion of the nodes w (`bspline_mdao.core.walls.rigid_part`), it is

      s = Q w + R (s0 - Q w0).

  Rigid motions are followed exactly, and nodes at rest keep their control points. Q does not oscillate about kinks and
  narrow edges, as least squares do, so the control mesh behind them does not fold. Its residual at the nodes is removed
  by the correction of `bspline_mdao.core.walls.wall_correction`.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, eye_array

from ...base.display import OneLine
from ...base.sparse.spring_network import SpringNetwork
from ...errors import InputError
from ...grids.topology.index_space import Window
from ...grids.topology.sharing import node_sharing
from ...grids.topology.topology import Topology
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from ..mesh.surface_map import SurfaceMap
from ..model.fitted_model import FittedModel
from ..model.movable import Movable
from ..walls.rigid_part import RigidMotion, RigidPart
from .least_squares import FitOperator
from .problem import problem_of_mesh
from .quasi_interpolant import QuasiInterpolant, SurfaceQuasiInterpolant

LOGGER = logging.getLogger(__name__)
"""Logger of the distance of each surface from its target: a warning beyond `NOTABLE_MISS`."""

NOTABLE_MISS = 1e-3
"""Fraction of its size by which a surface may miss its target before the log entry is a warning."""


N_ITERATIONS = 2
"""Iterations of the quasi-interpolant that follows nodes: with more it oscillates about kinks (a bend of 90 degrees of
an H-H wing leaves 107, 86 and 51 folded control elements with 8, 4 and 2), with none it cuts corners."""


@dataclass(frozen=True)
class SurfaceMiss(OneLine):
    """Distance of the nodes of a surface from the nodes that its control points were fitted to."""

    # largest distance, and the root mean square over all nodes (m)
    largest: float
    rms: float
    size: float  # diagonal of the target's box (m)
    n_nodes: int  # nodes of the surface, each counted once
    # patch and block of the node that is farthest off; empty if no patch is declared there
    patch: str
    block: str
    node: tuple[int, int, int]  # its place in the block, from 1
    unit: str = "m"  # unit of lengths

    @classmethod
    def of(
        cls,
        topology: Topology,
        # row that represents each row of the grid vector, see `NodeSharing.source_rows`
        source: np.ndarray,  # int (n_nodes,)
        rows: np.ndarray,  # int (n,), row of each node in the grid vector
        nodes: np.ndarray,  # (n, 3), actual places of the nodes (m)
        target: np.ndarray,  # (n, 3), intended places (m)
    ) -> SurfaceMiss:
        """Compare nodes of a surface with their target."""
        distances = np.linalg.norm(nodes - target, axis=1)
        worst = int(np.argmax(distances))
        place = _place_on_patch(topology, source, source[rows[worst]])
        rms, size = np.sqrt(np.mean(distances**2)), np.linalg.norm(np.ptp(target, axis=0))
        return cls(float(distances[worst]), float(rms), float(size), len(rows), *place)

    def __str__(self) -> str:
        size = f" ({self.largest / self.size:.2g} of its size)" if self.size else ""
        patch = f", patch {self.patch}" if self.patch else ""
        return (
            f"the surface misses its target by {self.largest:.3g} {self.unit} at most{size}, {self.rms:.3g} "
            f"{self.unit} RMS; the worst is node {self.node} of {self.block}{patch}"
        )

    def log(self, prefix: str = "") -> None:
        """Log it, as a warning if it is notable and as information if not."""
        is_notable = self.largest > NOTABLE_MISS * self.size
        LOGGER.log(logging.WARNING if is_notable else logging.INFO, "%s%s", prefix, self)


@dataclass(frozen=True, eq=False)
class SurfaceFit(OneLine):
    """Surface control points for another surface, and the distance by which it is missed."""

    control_points: np.ndarray  # (n_surface, 3), the surface control points (m)
    miss: SurfaceMiss  # distance of the regenerated surface nodes from the requested ones


def fit_surface(model: FittedModel, surface_ids: np.ndarray, nodes: np.ndarray) -> SurfaceFit:
    """Fit the surface control points of a model to moved surface nodes, section II.D.

    The displacements of the nodes are fitted as the grid was, corners, edges and faces in turn, with the model's own
    parameters, knots and fallback, and the result is added to the control points. Control points of nodes that have not
    moved stay, and control points of a surface that is turned or stretched as a whole follow it.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    surface_ids : ndarray of int, shape (n_surface,)
        Numbers of the surface control points of whole faces, such as ``surface_ids`` of a moving mesh.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m) with its surface nodes moved in every block that has them (`replace_nodes`). Others are ignored.

    Returns
    -------
    SurfaceFit
        Surface control points, in the order of ``surface_ids``, and how far the surface misses the nodes, since control
        points have fewer degrees of freedom than nodes. This distance is also logged, see `LOGGER`.

    Raises
    ------
    InputError
        If the nodes do not fit the model, or the control points do not make up whole faces.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> from bspline_mdao.splines import fit_surface
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> mesh, nodes = moving_mesh(model), model.regenerate().to_vector().reshape(-1, 3)
    >>> found = fit_surface(model, mesh.surface_ids, nodes * [1.0, 1.1, 1.0])  # 10 % thicker
    >>> bool(np.allclose(found.control_points, mesh.points[mesh.surface_ids] * [1.0, 1.1, 1.0]))
    True
    """
    if nodes.shape != (model.n_nodes, 3):
        raise InputError(f"{model.header.source}: nodes of shape {nodes.shape}; give shape ({model.n_nodes}, 3)")
    operator, rows = _fit_of_surface(model, surface_ids)
    moves = nodes - model.regenerate().to_vector().reshape(-1, 3)
    control_points = model.control_points[surface_ids] + operator.forward(moves)[surface_ids]
    fitted = SurfaceMap.of_rows(model, surface_ids, rows).apply(control_points)
    source = node_sharing(model.topology).source_rows()
    miss = SurfaceMiss.of(model.topology, source, rows, fitted, nodes[rows])
    miss.log(f"{model.header.source}: ")
    return SurfaceFit(control_points, miss)


def _fit_of_surface(model: FittedModel, surface_ids: np.ndarray) -> tuple[FitOperator, np.ndarray]:
    """Fit of the control points of whole faces, and the rows of their nodes; the first of coincident nodes."""
    problem = problem_of_mesh(model.topology, model.mesh)
    is_surface = np.zeros(model.mesh.n_control_points, dtype=bool)
    is_surface[surface_ids] = True
    entities = [entity for entity in problem.entities if is_surface[entity.control_ids].all()]
    is_surface[[i for entity in entities for i in entity.unknown_ids]] = False
    if is_surface.any():
        missing = surface_ids[np.argmax(is_surface[surface_ids])]
        raise InputError(
            f"{model.header.source}: control point {missing + 1} belongs to no face of the surface; give whole faces"
        )
    operator = problem.operator(model.parameters, model.candidate_weights, entities)
    return operator, np.unique(np.concatenate([entity.rows for entity in entities]))


@dataclass(frozen=True, eq=False)
class SurfaceFollower(OneLine):
    """Surface control points that follow surface nodes smoothly. Made by `SurfaceFollower.of`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.movers import moving_mesh
    >>> from bspline_mdao.splines import SurfaceFollower
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
    >>> moved = SurfaceFollower.of(model, mesh, surface).at(1.1 * surface.points).control_points
    >>> bool(abs(moved - 1.1 * mesh.points[mesh.surface_ids]).max() < 1e-10)
    True
    """

    quasi: SurfaceQuasiInterpolant  # from the nodes of the surface to its control points
    mesh: MovingMesh  # its surface points follow; points in planes of symmetry stay in them
    baseline: np.ndarray  # (n, 3), the given nodes, on the baseline (m)
    # nodes of the surface from the given ones: the mean if one is given more than once
    means: csr_array  # (n_points, n)
    # displacements of nodes that are not given, from their neighbours'; None if all are given
    springs: SpringNetwork | None
    rigid: RigidPart  # the rigid motion nearest to the motion of the nodes
    # control points less the quasi-interpolant of the nodes, on the baseline (m)
    offsets: np.ndarray  # (n_surface, 3)
    # topology, row that represents each row of the grid vector, and rows of the given nodes
    places: tuple[Topology, np.ndarray, np.ndarray]

    @classmethod
    def of(
        cls,
        model: FittedModel,  # the fitted grid
        mesh: MovingMesh,  # its control mesh
        surface: SurfaceGrid,  # the nodes of the design surface
        # the given nodes, in their order; by default all of the surface in its own order
        numbers: np.ndarray | None = None,  # int (n,)
    ) -> SurfaceFollower:
        """Prepare the control points of a surface."""
        n = surface.n_points
        numbers = np.arange(n) if numbers is None else np.asarray(numbers)
        counts = np.bincount(numbers, minlength=n)
        if np.count_nonzero(counts) < len(mesh.surface_ids):
            raise InputError(
                f"surface: its {np.count_nonzero(counts)} nodes do not determine the {len(mesh.surface_ids)} control "
                f"points of the design surface; give the nodes of all its patches"
            )
        for name, ids in zip(surface.names, surface.faces):
            if not counts[ids].any():
                raise InputError(f"surface: none of the nodes of {name} is given; give nodes of all its patches")
        means = csr_array((1.0 / counts[numbers], (numbers, np.arange(len(numbers)))), shape=(n, len(numbers)))
        springs = None if counts.all() else _springs(surface, np.flatnonzero(counts))
        node_of_row = np.full(model.n_nodes, -1)
        node_of_row[surface.rows] = np.arange(n)
        sharing = problem_of_mesh(model.topology, model.mesh).sharing
        node_of_row = node_of_row[sharing.source_rows()]
        whole = QuasiInterpolant.of(model.mesh, sharing, model.parameters)
        quasi = SurfaceQuasiInterpolant.of(whole, mesh.surface_ids, node_of_row, N_ITERATIONS)
        offsets = model.control_points[mesh.surface_ids] - quasi.forward(surface.points)
        places = model.topology, sharing.source_rows(), surface.rows[numbers]
        given = surface.points[numbers]
        return cls(quasi, mesh, given, means, springs, RigidPart(mesh.plane_normals), offsets, places)

    def at(self, nodes: np.ndarray) -> FollowedSurface:
        """Control points at nodes, shape (n, 3), in metres, and their derivative."""
        # `MovementError` if the nodes are turned inside out as a whole
        motion = self.rigid.at(self.baseline, nodes)
        turned = self.offsets @ (motion.rotation - np.eye(3)).T
        moves = self._slide(self._forward(nodes - self.baseline) + turned)
        return FollowedSurface(self, motion, self.mesh.points[self.mesh.surface_ids] + moves)

    def miss(self, nodes: np.ndarray, target: np.ndarray) -> SurfaceMiss:
        """Compare nodes, shape (n, 3), with their targets."""
        return SurfaceMiss.of(*self.places, nodes, target)

    def _forward(self, moves: np.ndarray) -> np.ndarray:
        """Quasi-interpolant of displacements of the nodes, from shape (n, 3) to (n_surface, 3)."""
        at_points = self.means @ moves
        if self.springs is not None:
            given = np.flatnonzero(np.diff(self.means.indptr))
            at_points[self.springs.ids] = self.springs.dot(at_points[given])
        return self.quasi.forward(at_points)

    def _transpose(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `_forward`."""
        at_points = self.quasi.adjoint(bar)
        if self.springs is not None:
            given = np.flatnonzero(np.diff(self.means.indptr))
            at_points[given] += self.springs.transpose_dot(at_points[self.springs.ids])
        return self.means.T @ at_points

    def _slide(self, change: np.ndarray) -> np.ndarray:
        """Remove from a change of control points the part normal to planes of symmetry; its own transpose."""
        rows, normals, slid = self.mesh.in_plane_rows, self.mesh.in_plane_normals, change.copy()
        np.subtract.at(slid, rows, np.sum(change[rows] * normals, axis=1)[:, None] * normals)
        return slid


class Followed(Protocol):
    """Surface control points that followed nodes, and their derivative."""

    @property
    def control_points(self) -> np.ndarray:
        """The surface control points (m), shape (n_surface, 3)."""

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), with a change of the nodes, shape (n, 3)."""

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`."""


class Follower(Protocol):
    """Surface control points as a function of given nodes."""

    @property
    def baseline(self) -> np.ndarray:
        """The given nodes, on the baseline (m), shape (n, 3)."""

    def at(self, nodes: np.ndarray) -> Followed:
        """Control points at nodes, shape (n, 3), and their derivative."""

    def miss(self, nodes: np.ndarray, target: np.ndarray) -> SurfaceMiss | None:
        """Compare nodes of the control points with their targets; None if nothing is missed."""


@singledispatch
def follower_of(model: Movable, mesh: MovingMesh, surface: SurfaceGrid, numbers: np.ndarray) -> Follower:
    """Prepare control points that follow some nodes of a surface of a model."""
    raise InputError(f"surface: nodes of a {type(model).__name__} cannot be given; give the whole fitted model")


follower_of.register(FittedModel, SurfaceFollower.of)


@dataclass(frozen=True, eq=False)
class FollowedSurface(OneLine):
    """Control points that followed nodes, and their derivative."""

    of: SurfaceFollower  # the map that made them
    motion: RigidMotion  # the rigid motion nearest to the motion of the nodes
    control_points: np.ndarray  # (n_surface, 3), the surface control points (m)

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), with a change of the nodes, shape (n, 3)."""
        d_rotation, _ = self.motion.jvp(np.zeros_like(change), change)
        return self.of._slide(self.of._forward(change) + self.of.offsets @ d_rotation.T)

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: (n_surface, 3) to (n, 3)."""
        slid = self.of._slide(bar)
        _, turned_bar = self.motion.vjp(slid.T @ self.of.offsets, np.zeros(3))
        return self.of._transpose(slid) + turned_bar


def _springs(surface: SurfaceGrid, given: np.ndarray) -> SpringNetwork:
    """Springs along the sides of the surface's quads, between the given nodes."""
    sides = np.unique(np.sort(np.concatenate([surface.quads[:, [k, (k + 1) % 4]] for k in range(4)]), axis=1), axis=0)
    lengths = np.linalg.norm(surface.points[sides[:, 0]] - surface.points[sides[:, 1]], axis=1)
    of_pair = {(i, j): length for (i, j), length in zip(sides.tolist(), lengths.tolist()) if length > 0.0}
    nothing = np.zeros(0, dtype=int)
    return SpringNetwork.of(surface.n_points, of_pair, given, nothing, lambda ids: eye_array(3 * len(ids)).tocsr())


def replace_nodes(
    topology: Topology,  # topology of the grid
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    pieces: Sequence[tuple[Window, np.ndarray]],  # new nodes (m); if windows share nodes, the last one counts
) -> np.ndarray:  # (n_nodes, 3), the grid with the new nodes, otherwise unchanged
    """Replace nodes of some windows in every block that has them."""
    rows, ids = topology.layout.numbers, np.empty(topology.n_nodes, dtype=np.int64)
    for segment, segment_ids in zip(topology.segments, topology.node_ids()):
        ids[rows[segment.block][segment.slices]] = segment_ids
    values, is_new = np.empty((ids.max() + 1, 3)), np.zeros(ids.max() + 1, dtype=bool)
    for window, points in pieces:
        there = ids[rows[window.block][window.slices]]
        values[there], is_new[there] = points, True
    return np.where(is_new[ids][:, None], values[ids], nodes)


def _place_on_patch(topology: Topology, source: np.ndarray, row: int) -> tuple[str, str, tuple[int, int, int]]:
    """Patch, block and place in it, from 1, of a node by its row, on a declared patch if one contains it."""
    blocks = topology.layout.numbers
    faces = [(face.window, face.patch) for face in topology.boundary if face.patch is not None]
    whole = [(Window.whole(number, shape), "") for number, shape in enumerate(topology.shapes)]
    for window, patch in (*faces, *whole):
        found = np.argwhere(source[blocks[window.block][window.slices]] == row)
        if len(found):
            i, j, k = (int(n) + 1 for n in found[0] + window.lo)
            return patch, f"block {window.block + 1}", (i, j, k)
    raise IndexError(row)
