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

from ..evaluation.evaluator import Evaluator
from ..numerics.vectors import is_line, nearest_plane
from ..splines.mesh import BSplineMesh
from ..topology.boundary_surface import BoundarySurface
from ..topology.index_space import Window, block_rows
from ..topology.sharing import node_sharing
from ..topology.topology import Topology
from .layer import Layered, WallLayer
from .node_vectors import Vectors
from .planes import PlaneNormal
from .turning import Turn, Turning
from .wall import Wall
from .wall_correction import WallCorrection

__all__ = ["GridMap", "GridState"]


@dataclass(frozen=True, eq=False)
class GridMap:
    """The map from control points to the nodes of a grid. Made by `GridMap.of`.

    Parameters
    ----------
    evaluator : Evaluator
        A.
    nodes : ndarray, shape (n_nodes, 3)
        The baseline (m).
    turning : Turning or None
        How the residual turns; None where there is none, or where it stays as it is.
    residual : Vectors, ndarray of shape (n_nodes, 3) or None
        The residual of the fit, ready to be turned, or to be added.
    layer : WallLayer or None
        Nodes that follow walls.
    wall_rows : ndarray of int, shape (n_wall,)
        Rows of the nodes of all walls, each shared one once.
    plane_rows : ndarray of int, shape (n_plane,)
        Rows of the nodes on the outlines of planes that walls end on.
    planes : tuple of PlaneNormal
        Normals of these planes, as functions of those nodes.
    """

    evaluator: Evaluator
    nodes: np.ndarray
    turning: Turning | None
    residual: Vectors | np.ndarray | None
    layer: WallLayer | None
    wall_rows: np.ndarray
    plane_rows: np.ndarray
    planes: tuple[PlaneNormal, ...]

    @classmethod
    def of(
        cls,
        topology: Topology,
        mesh: BSplineMesh,
        parameters: Sequence[np.ndarray],
        control_points: np.ndarray,
        residual: np.ndarray | None,
        wall_layer: bool,
        evaluator: Evaluator,
    ) -> GridMap:
        """Prepare the map of a fitted grid.

        Parameters
        ----------
        topology : Topology
            Topology of the grid; faces of kind "wall" are walls.
        mesh : BSplineMesh
            One volume per segment.
        parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
            Parameters of the nodes of every segment.
        control_points : ndarray, shape (n_control_points, 3)
            Fitted control points (m).
        residual : ndarray, shape (n_nodes, 3), or None
            Baseline minus fitted points (m).
        wall_layer : bool
            Whether nodes follow walls and the residual turns; without, the map is ``A b + r``.
        evaluator : Evaluator
            Evaluation of the nodes, by `Evaluator.of_grid`.

        Returns
        -------
        GridMap
        """
        nodes = evaluator.forward(control_points)
        if residual is not None:
            nodes += residual
        rows = plane_rows = np.zeros(0, dtype=int)
        turning = layer = None
        vectors: Vectors | np.ndarray | None = residual
        planes: tuple[PlaneNormal, ...] = ()
        if not wall_layer:
            return cls(evaluator, nodes, turning, vectors, layer, rows, plane_rows, planes)
        if residual is not None:
            turning = Turning.of(topology, mesh, parameters, control_points, evaluator, node_sharing(topology))
            vectors = turning.vectors(residual)
        walls = [face for face in topology.boundary if face.kind == "wall"]
        if walls:
            surface = BoundarySurface.of(topology, nodes, walls)
            layer, plane_rows, planes = _wall_layer(topology, nodes, surface, evaluator.n_threads)
            rows = surface.rows
        return cls(evaluator, nodes, turning, vectors, layer, rows, plane_rows, planes)

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely, with a residual) on the control points."""
        return self.turning is None and self.layer is None

    @property
    def n_bytes(self) -> int:
        """Memory besides the evaluator's and the model's (B)."""
        packed = self.residual.n_bytes if isinstance(self.residual, Vectors) else 0
        return packed + sum(part.n_bytes for part in (self.turning, self.layer) if part is not None) + self.nodes.nbytes

    def at(
        self, control_points: np.ndarray, correction: WallCorrection | None = None, wall: np.ndarray | None = None
    ) -> GridState:
        """Nodes and their derivative.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Control points (m).
        correction : WallCorrection, optional
            Correction of the nodes whose places are given, made for the baseline `nodes`.
        wall : ndarray, shape (n_wall, 3), optional
            Where these nodes are to be (m).

        Raises
        ------
        MovementError
            If the surroundings of a point are turned inside out.
        """
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
    """A grid and its derivative.

    Parameters
    ----------
    of : GridMap
        The map.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    turn : Turn or None
        Rotations of the residual.
    layered : Layered or None
        Nodes that followed walls.
    plane_points : ndarray, shape (n_plane, 3)
        Nodes on the outlines of planes before that (m).
    correction : WallCorrection or None
        Correction of the nodes whose places were given.
    mismatch : ndarray, shape (n_wall, 3), or None
        Given places minus those of the control points alone (m).
    """

    of: GridMap
    nodes: np.ndarray
    turn: Turn | None
    layered: Layered | None
    plane_points: np.ndarray
    correction: WallCorrection | None = None
    mismatch: np.ndarray | None = None

    def jvp(self, d_control_points: np.ndarray, d_wall: np.ndarray | None = None) -> np.ndarray:
        """Change of the nodes.

        Parameters
        ----------
        d_control_points : ndarray, shape (n_control_points, 3)
            Change of the control points.
        d_wall : ndarray, shape (n_wall, 3), optional
            Change of the given places; needed where there are any.

        Returns
        -------
        ndarray, shape (n_nodes, 3)
        """
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

    def full_vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Transpose of `jvp`.

        Parameters
        ----------
        bar : ndarray, shape (n_nodes, 3)
            Derivative of a scalar with respect to the nodes.

        Returns
        -------
        control_points_bar : ndarray, shape (n_control_points, 3)
        wall_bar : ndarray, shape (n_wall, 3), or None
            With respect to the given places; None where there are none.
        """
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


def _wall_layer(
    topology: Topology, nodes: np.ndarray, surface: BoundarySurface, n_threads: int | None
) -> tuple[WallLayer, np.ndarray, tuple[PlaneNormal, ...]]:
    """Nodes that follow the walls of a grid: those in planar faces stay in them, those on other faces do not follow.

    Planes are told apart to five digits of their normals and places: faces of one plane, whose corners leave it by
    round-off of the file, are one.
    """
    sharing, blocks = node_sharing(topology), block_rows(topology.shapes)
    source, number, size = sharing.source_rows(), np.full(topology.n_nodes, -1), np.linalg.norm(np.ptp(nodes, axis=0))
    number[surface.rows] = np.arange(len(surface.rows))
    planes: dict[tuple, tuple[np.ndarray, list[np.ndarray]]] = {}
    fixed = [np.zeros(0, dtype=int)]
    for face in topology.boundary:
        if face.kind != "wall":
            rows = source[blocks[face.window.block][face.window.slices].reshape(_face_shape(face.window))]
            normal, distances, near = nearest_plane(nodes[rows.ravel()])
            area = PlaneNormal.of_outline([rows]).area_vector(nodes)
            if distances.max() > near:
                fixed.append(rows.ravel())
            elif area.any() and not is_line(nodes[rows.ravel()]):
                normal = normal * np.sign(normal[np.argmax(np.abs(normal))])
                key = tuple(np.round([*normal, normal @ nodes[rows.flat[0]] / size], 5))
                planes.setdefault(key, (normal, []))[1].append(rows if area @ normal > 0.0 else rows.T)
    found = [(np.unique(np.concatenate([f.ravel() for f in faces])), normal) for normal, faces in planes.values()]
    on_wall = [k for k, (rows, _) in enumerate(found) if (number[rows] >= 0).any()]
    of_wall = [(number[rows[number[rows] >= 0]], normal) for rows, normal in (found[k] for k in on_wall)]
    faces = surface.quad_faces
    wall = Wall.of(nodes[surface.rows], surface.quads, surface.heights, of_wall, faces=faces, n_threads=n_threads)
    rows, outlines = np.concatenate(fixed), [PlaneNormal.of_outline(faces) for _, faces in planes.values()]
    layer = WallLayer.of(wall, nodes, surface.rows, found, rows[number[rows] < 0], sharing.copies, n_threads)
    outlines = [outlines[k] for k in on_wall]
    plane_rows = np.unique(np.concatenate([np.zeros(0, dtype=int), *(outline.ids for outline in outlines)]))
    return layer, plane_rows, tuple(outline.among(plane_rows) for outline in outlines)


def _face_shape(window: Window) -> tuple[int, int]:
    """Nodes of a face window in its two directions."""
    direction = window.shape.index(1)
    first, second = (n for d, n in enumerate(window.shape) if d != direction)
    return first, second
