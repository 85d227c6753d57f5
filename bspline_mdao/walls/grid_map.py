"""The whole map from control points, and where asked from wall nodes, to the grid.

    y = A b + T(b) r                    r: residual of the fit, turned with its surroundings (`.turning`)
    y <- y + E (w - y_wall)             w: wall nodes, where they are asked; the miss fades (`.miss_spread`)
    x = layer(y; x0, w)                 nodes near walls follow them as a rigid body (`.wall_layer`)

At the control points of the baseline it gives the baseline, and a rigid motion of all control points moves all nodes
with it, to round-off. Without walls the layer is nothing, and without a residual there is none to turn. What is near
which wall, and where in its span a node is, is that of the baseline and stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..evaluation.evaluator import Evaluator
from ..numerics.planes import is_line, nearest_plane
from ..splines.mesh import BSplineMesh
from ..topology.boundary_surface import BoundarySurface
from ..topology.index_space import Window, block_rows
from ..topology.sharing import node_sharing
from ..topology.topology import Topology
from .layer import Layered, Wall, WallLayer
from .miss_spread import MissSpread
from .turning import Turn, Turning, Vectors

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
    rim_rows : ndarray of int, shape (n_rim,)
        Rows of the nodes on the rims of planes that walls end on.
    rims : tuple
        These rims, by the numbers of their nodes among those.
    """

    evaluator: Evaluator
    nodes: np.ndarray
    turning: Turning | None
    residual: Vectors | np.ndarray | None
    layer: WallLayer | None
    wall_rows: np.ndarray
    rim_rows: np.ndarray
    rims: tuple[_Rim, ...]

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
        rows = rim_rows = np.zeros(0, dtype=int)
        turning = layer = None
        vectors, rims = residual, ()
        if not wall_layer:
            return cls(evaluator, nodes, turning, vectors, layer, rows, rim_rows, rims)
        if residual is not None:
            turning = Turning.of(topology, mesh, parameters, control_points, evaluator, node_sharing(topology))
            vectors = turning.vectors(residual)
        walls = [face for face in topology.boundary if face.kind == "wall"]
        if walls:
            sheet = BoundarySurface.of(topology, nodes, walls)
            layer, rim_rows, rims = _wall_layer(topology, nodes, sheet, evaluator.n_threads)
            rows = sheet.rows
        return cls(evaluator, nodes, turning, vectors, layer, rows, rim_rows, rims)

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely, with a residual) on the control points."""
        return self.turning is None and self.layer is None

    @property
    def n_bytes(self) -> int:
        """Memory held besides the evaluator's and the model's."""
        packed = self.residual.n_bytes if self.turning else 0
        return packed + sum(part.n_bytes for part in (self.turning, self.layer) if part is not None) + self.nodes.nbytes

    def at(
        self, control_points: np.ndarray, spread: MissSpread | None = None, wall: np.ndarray | None = None
    ) -> GridState:
        """Nodes and their derivative.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Control points (m).
        spread : MissSpread, optional
            Which nodes are asked to be somewhere, made for the baseline `nodes`, and how what is missed of them fades.
        wall : ndarray, shape (n_wall, 3), optional
            Where these nodes are asked to be (m).

        Raises
        ------
        MovementError
            If the surroundings of a point are turned inside out.
        """
        turn = layered = None
        if self.turning is None:
            nodes = self.evaluator.forward(control_points)
            if self.residual is not None:
                nodes += self.residual
        else:
            turn = self.turning.at(control_points)
            nodes = turn.evaluate(control_points, self.residual)
        miss = None if spread is None else spread.meet(nodes, wall)
        rim_points = nodes[self.rim_rows]
        if self.layer is not None:
            rows, normals = self.wall_rows, self.normals(rim_points)
            layered = self.layer.at(self.nodes, nodes, self.nodes[rows], nodes[rows], normals)
        return GridState(self, nodes, turn, layered, rim_points, spread, miss)

    def normals(self, rim_points: np.ndarray) -> np.ndarray:
        """Normals, shape (n_rims, 3), of the planes that walls end on, from the points on their rims."""
        return np.reshape([rim.normal(rim_points) for rim in self.rims], (-1, 3))

    def normals_jvp(self, rim_points: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Change of `normals` with that of the points."""
        return np.reshape([rim.normal_jvp(rim_points, change) for rim in self.rims], (-1, 3))

    def normals_vjp(self, rim_points: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transpose of `normals_jvp`."""
        rim_bar = np.zeros_like(rim_points)
        for rim, normal_bar in zip(self.rims, bar):
            rim.add_normal_vjp(rim_points, normal_bar, rim_bar)
        return rim_bar


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
    rim_points : ndarray, shape (n_rim, 3)
        Nodes on the rims of planes before that (m).
    spread : MissSpread or None
        Which nodes were asked to be somewhere.
    miss : ndarray, shape (n_wall, 3), or None
        How far the control points alone would have missed that (m).
    """

    of: GridMap
    nodes: np.ndarray
    turn: Turn | None
    layered: Layered | None
    rim_points: np.ndarray
    spread: MissSpread | None = None
    miss: np.ndarray | None = None

    def jvp(self, d_control_points: np.ndarray, d_wall: np.ndarray | None = None) -> np.ndarray:
        """Change of the nodes.

        Parameters
        ----------
        d_control_points : ndarray, shape (n_control_points, 3)
            Change of the control points.
        d_wall : ndarray, shape (n_wall, 3), optional
            Change of where nodes are asked to be; needed where they are.

        Returns
        -------
        ndarray, shape (n_nodes, 3)
        """
        of = self.of
        if self.turn is None:
            change = of.evaluator.forward(d_control_points)
        else:
            change = self.turn.jvp(d_control_points, self.turn.change(d_control_points), of.residual)
        if self.spread is not None:
            change += self.spread.forward(d_wall - change[self.spread.rows])
        if self.layered is not None:
            d_normals = of.normals_jvp(self.rim_points, change[of.rim_rows])
            self.layered.jvp(None, change, None, change[of.wall_rows], d_normals)
        return change

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp` where nothing is asked of nodes: (n_nodes, 3) to (n_control_points, 3)."""
        return self.asked_vjp(bar)[0]

    def asked_vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Transpose of `jvp`.

        Parameters
        ----------
        bar : ndarray, shape (n_nodes, 3)
            Derivative of a scalar with respect to the nodes.

        Returns
        -------
        control_points_bar : ndarray, shape (n_control_points, 3)
        wall_bar : ndarray, shape (n_wall, 3), or None
            With respect to where nodes are asked to be; None where none are.
        """
        of = self.of
        if self.layered is not None:
            bar, wall_bar, normals_bar = self.layered.frozen_vjp(bar.copy())
            bar[of.wall_rows] += wall_bar
            bar[of.rim_rows] += of.normals_vjp(self.rim_points, normals_bar)
        asked_bar = None
        if self.spread is not None:
            asked_bar = self.spread.adjoint(bar)
            bar = bar.copy() if self.layered is None else bar
            bar[self.spread.rows] -= asked_bar
        if self.turn is None:
            return of.evaluator.adjoint(bar), asked_bar
        return self.turn.control_vjp(of.residual, bar), asked_bar


@dataclass(frozen=True, eq=False)
class _Rim:
    """Rim of a planar part of the boundary: pairs of points in turn around it, which tell its area and its normal."""

    starts: np.ndarray
    ends: np.ndarray

    @classmethod
    def of(cls, faces: Sequence[np.ndarray]) -> _Rim:
        """Take the rim of faces of points, each of shape (ni, nj), which look the same way."""
        pairs = [np.zeros((2, 0), dtype=int)]
        for ids in faces:
            for side in (ids[:, 0], ids[-1, :], ids[::-1, -1], ids[0, ::-1]):
                pairs.append(np.stack([side[:-1], side[1:]]))
        return cls(*np.concatenate(pairs, axis=1))

    def among(self, ids: np.ndarray) -> _Rim:
        """Number the points by their places among ascending numbers."""
        return _Rim(np.searchsorted(ids, self.starts), np.searchsorted(ids, self.ends))

    def area(self, points: np.ndarray) -> np.ndarray:
        """Area vector; exact in coordinates that all points share."""
        return 0.5 * np.cross(*self._arms(points)).sum(axis=0)

    def normal(self, points: np.ndarray) -> np.ndarray:
        """Unit normal."""
        area = self.area(points)
        return area / np.sqrt(area @ area)

    def normal_jvp(self, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the normal."""
        (u, v), (d_u, d_v), area = self._arms(points), self._arms(d_points), self.area(points)
        d_area = 0.5 * (np.cross(d_u, v) + np.cross(u, d_v)).sum(axis=0)
        length = np.sqrt(area @ area)
        return (d_area - area * (area @ d_area) / length**2) / length

    def add_normal_vjp(self, points: np.ndarray, bar: np.ndarray, points_bar: np.ndarray) -> None:
        """Add the transpose of `normal_jvp` to ``points_bar``."""
        (u, v), area = self._arms(points), self.area(points)
        length = np.sqrt(area @ area)
        area_bar = 0.5 * (bar - area * (area @ bar) / length**2) / length
        u_bar, v_bar = np.cross(v, area_bar), np.cross(area_bar, u)
        np.add.at(points_bar, self.starts, u_bar)
        np.add.at(points_bar, self.ends, v_bar)
        points_bar[self.starts[0]] -= (u_bar + v_bar).sum(axis=0)

    def _arms(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both ends of all pairs, seen from the first point."""
        return points[self.starts] - points[self.starts[0]], points[self.ends] - points[self.starts[0]]


def _wall_layer(
    topology: Topology, nodes: np.ndarray, sheet: BoundarySurface, n_threads: int | None
) -> tuple[WallLayer, np.ndarray, tuple[_Rim, ...]]:
    """Nodes that follow the walls of a grid: those in planar faces stay in them, those on other faces stay behind."""
    sharing, blocks = node_sharing(topology), block_rows(topology.shapes)
    source, number, size = sharing.source_rows(), np.full(topology.n_nodes, -1), np.linalg.norm(np.ptp(nodes, axis=0))
    number[sheet.rows] = np.arange(len(sheet.rows))
    planes, held = {}, [np.zeros(0, dtype=int)]
    for face in topology.boundary:
        if face.kind != "wall":
            rows = source[blocks[face.window.block][face.window.slices].reshape(_face_shape(face.window))]
            normal, distances, near = nearest_plane(nodes[rows.ravel()])
            area = _Rim.of([rows]).area(nodes)
            if distances.max() > near:
                held.append(rows.ravel())
            elif area.any() and not is_line(nodes[rows.ravel()]):
                normal = normal * np.sign(normal[np.argmax(np.abs(normal))])
                key = tuple(np.round([*normal, normal @ nodes[rows.flat[0]] / size], 5))
                planes.setdefault(key, (normal, []))[1].append(rows if area @ normal > 0.0 else rows.T)
    found = [(np.unique(np.concatenate([f.ravel() for f in faces])), normal) for normal, faces in planes.values()]
    on_wall = [k for k, (rows, _) in enumerate(found) if (number[rows] >= 0).any()]
    of_wall = [(number[rows[number[rows] >= 0]], normal) for rows, normal in (found[k] for k in on_wall)]
    faces = sheet.quad_faces
    wall = Wall.of(nodes[sheet.rows], sheet.quads, sheet.heights, of_wall, sheets=faces, n_threads=n_threads)
    rows, rims = np.concatenate(held), [_Rim.of(faces) for _, faces in planes.values()]
    layer = WallLayer.of(wall, nodes, sheet.rows, found, rows[number[rows] < 0], sharing.copies, n_threads)
    rims = [rims[k] for k in on_wall]
    rim_rows = np.unique(np.concatenate([np.zeros(0, dtype=int), *(rim.starts for rim in rims)]))
    return layer, rim_rows, tuple(rim.among(rim_rows) for rim in rims)


def _face_shape(window: Window) -> tuple[int, int]:
    """Nodes of a face window in its two directions."""
    direction = window.shape.index(1)
    return tuple(n for d, n in enumerate(window.shape) if d != direction)
