"""Nodes near walls follow them as a rigid body, blended smoothly into any map of the others.

A node at x0 on the baseline, mapped to y, with the closest points f on the wall (see `.closest_points`), goes to

    x = y + sum_f beta_f (W'_f + G_f (x0 - W_f) - y),

where W_f and W'_f are the places of the closest point before and after the move and G_f is its rotation (see
`.frames`). They are interpolated from the corners of its triangle, at its barycentric coordinates. Nodes on lines that
begin at nodes of the wall, as in a grid, go to

    x = y + sum_f beta_f (sum_n s_n (w'_n + G_n (x0 - w_n)) - y)

over the corners n of that triangle instead, with s_n in proportion to b_n^2 (3 - 2 b_n) of its barycentric coordinates:
above a corner, where their lines begin, they turn about the corner, whatever the adjacent facets do. A point on a facet
would leave it. The weights beta_f sum to one on the wall and fade to zero at its reach. So a wall node goes exactly
where it is given, the nodes above it keep their heights, and a rigid motion of the wall is a rigid motion of its layer,
wherever the closest points are. This depends only on places, not on grid lines: blocks of any topology, walls that end
inside a grid, and points of other grids are treated alike. Places of the wall's nodes, and normals of planes, are read
off the nodes of the wall's grid (`WallFollowing`). The points are these nodes, or others (`.embedded_points`).

Closest points and weights are found on the baseline and stay. The map is then linear in y and in the wall's places and
rotations, and linear in x0 together with W, except for the addition if a point has several closest points, see
`.corners`.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.threads import run_tasks, thread_count
from ...errors import InputError
from .closest_points import smooth_corners
from .corners import Corners, CornersMoved
from .frames import Frames
from .layer_pieces import Piece, add_up, cut
from .planes import PlaneNormal, projectors_of
from .wall import Wall
from .wall_images import WallImages

__all__ = ["Followed", "Layered", "WallFollowing", "WallLayer"]

INPUTS = ("initial", "mapped", "wall_initial", "wall_moved", "normals")
"""Inputs of the points of a layer."""


@dataclass(frozen=True, eq=False)
class WallLayer:
    """Points that follow a wall. Made by `WallLayer.of`."""

    wall: Wall  # the wall
    pieces: tuple[Piece, ...]  # the nodes that follow it
    corners: Corners  # the ones that have several closest points
    projectors: np.ndarray  # (n_projectors, 3, 3), projectors of the correction onto planes; the first is the identity
    copies: np.ndarray  # (n_copies, 2) of int, rows that are copies of nodes of the layer, and the rows that they copy
    n_points: int  # number of points, some of which follow the wall
    # number of threads; None stands for ``NUMBA_NUM_THREADS``. Results do not depend on it.
    n_threads: int | None = None

    @classmethod
    def of(
        cls,
        wall: Wall,  # the wall
        points: np.ndarray,  # (n, 3), nodes of the grid, or points of another grid, on the baseline (m)
        # of int, rows of the wall's nodes among the points, except for nodes beyond periodic sides, which come last;
        # None if the points are of another grid
        wall_rows: np.ndarray | None = None,
        # sequence of (ndarray of int, ndarray of shape (3,)), points in planes that they must stay in, and the planes'
        # normals. Planes that share points must be at right angles.
        planes: Sequence[tuple[np.ndarray, np.ndarray]] = (),
        # of int, points that do not follow the wall, such as points on a fixed boundary
        fixed: np.ndarray | None = None,
        copies: np.ndarray | None = None,  # (n_copies, 2) of int, rows that are copies, and the rows that they copy
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
        # height of a point above its closest point, divided by the distance of the latter from the nearest corner of
        # its triangle, from which on the point turns about the corners: 0 for nodes of the wall's grid, all of which
        # do; None for points of another grid, none of which do
        least_slope: float | None = None,
        n_beyond: int = 0,  # number of the nodes of the wall beyond periodic sides
    ) -> WallLayer:
        """Find the points that follow a wall."""
        points = np.ascontiguousarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"wall layer: points of shape {points.shape}; give shape (n, 3)")
        wall_rows = np.empty(0, dtype=np.int64) if wall_rows is None else np.asarray(wall_rows)
        if len(wall_rows) not in (0, wall.n_points - n_beyond):
            n_nodes = wall.n_points - n_beyond
            raise InputError(f"wall layer: {len(wall_rows)} rows of {n_nodes} nodes of the wall; give one each")
        copies = np.empty((0, 2), dtype=np.int64) if copies is None else np.asarray(copies)
        is_free = np.ones(len(points), dtype=bool)
        for rows in (wall_rows, copies[:, 0], fixed):
            if rows is not None:
                is_free[rows] = False
        free = np.flatnonzero(is_free)
        closest = wall.tree.closest_points(points[free], n_threads)
        rows = np.concatenate([wall_rows, free[closest.points]])
        counts = np.concatenate([np.ones(len(wall_rows), dtype=np.int64), np.diff(closest.starts)])
        projectors, plane_of = projectors_of(planes, len(points))
        plane_of[wall_rows] = 0
        corners, barycentric, weights, places = closest.with_wall_nodes(wall.tree, len(wall_rows))
        by_corners = np.full(len(rows), least_slope is not None)
        if least_slope:
            by_corners[len(wall_rows) :] = closest.slopes(wall.tree, points[free[closest.points]]) >= least_slope
        turns, by_node = np.repeat(by_corners, counts), barycentric.copy()
        by_node[turns] = smooth_corners(barycentric[turns])
        pieces = cut(rows, counts, places, plane_of[rows], corners, by_node, weights, by_corners)
        among, kept = counts > 1, np.repeat(counts > 1, counts)
        several = Corners.of(
            wall.tree.points,
            points,
            rows[among],
            counts[among],
            corners[kept],
            barycentric[kept],
            by_node[kept],
            weights[kept],
            by_corners[among],
            projectors[plane_of[rows[among]]],
        )
        is_followed = np.zeros(len(points), dtype=bool)
        is_followed[rows] = True
        return cls(wall, pieces, several, projectors, copies[is_followed[copies[:, 1]]], len(points), n_threads)

    @property
    def n_followers(self) -> int:
        """Number of points that follow the wall, including points on it."""
        return sum(len(piece.rows) for piece in self.pieces)

    @property
    def n_bytes(self) -> int:
        """Memory that the nodes of the layer take."""
        arrays = [part for piece in self.pieces for part in vars(piece).values() if isinstance(part, np.ndarray)]
        return sum(array.nbytes for array in arrays) + self.copies.nbytes

    def at(
        self,
        initial: np.ndarray,  # (n, 3), points before the move (m)
        mapped: np.ndarray,  # (n, 3), where a map puts them (m); points that follow the wall are overwritten in place
        # wall_initial, wall_moved: (wall.n_points, 3), nodes of the wall before and after the move (m)
        wall_initial: np.ndarray,
        wall_moved: np.ndarray,
        # (n_planes, 3), unit normals of the wall's planes after the move; by default they stay
        normals: np.ndarray | None = None,
    ) -> Layered:  # with the nodes, and their derivative
        """Move the points that follow a wall with it."""
        frames = self.wall.frames.at(wall_initial, wall_moved, normals)
        self._follow(initial, _packed(frames.moved, frames.matrices, frames.initial), mapped)
        corners = None
        if len(self.corners.rows):
            corners = self.corners.moved(initial, frames.initial, frames.moved, frames.matrices)
            corners.add(mapped)
        self._copy(mapped)
        return Layered(self, initial, frames, corners, mapped)

    def _follow(self, initial: np.ndarray, frames: np.ndarray, mapped: np.ndarray) -> None:
        """Overwrite mapped points; linear in them and the frames after the move, and in all places before it."""
        self._over_pieces(lambda piece: _follow(*self._arrays(piece), initial, frames[piece.wall_ids], mapped))

    def _copy(self, nodes: np.ndarray) -> None:
        """Give copies the places of their originals."""
        nodes[self.copies[:, 0]] = nodes[self.copies[:, 1]]

    def _arrays(self, piece: Piece) -> tuple:
        """Arguments of the kernels from a piece and the layer."""
        per_node = piece.rows, piece.starts, piece.planes
        return *per_node, piece.corners, piece.barycentric, piece.weights, self.projectors, piece.by_corners

    def _over_pieces(self, task: Callable[[Piece], Any]) -> list:
        """Results of a task for every piece, in order."""
        return run_tasks(task, self.pieces, thread_count(self.n_threads))


@dataclass(frozen=True, eq=False)
class Layered:
    """Points that followed a move of a wall, and their derivative."""

    layer: WallLayer  # the points that follow
    initial: np.ndarray  # (n, 3), points before the move (m)
    frames: Frames  # the move of the wall, with its nodes before and after
    corners: CornersMoved | None  # displacements of nodes in corners from the mean; None without such nodes
    nodes: np.ndarray  # (n, 3), points after it (m)

    def jvp(
        self,
        d_initial: np.ndarray | None,  # (n, 3), change of the points before the move; None for none
        d_mapped: np.ndarray,  # (n, 3), change of the mapped points, overwritten in place by the change of the points
        d_wall_initial: np.ndarray | None,  # (wall.n_points, 3), change of the wall's nodes before the move
        d_wall_moved: np.ndarray,  # (wall.n_points, 3), change of the wall's nodes after it
        d_normals: np.ndarray | None = None,  # (n_planes, 3), change of the normals of its planes after it
    ) -> np.ndarray:  # (n, 3), `d_mapped`
        """Change of the points."""
        frames = self.frames
        d_matrices = frames.jvp(d_wall_initial, d_wall_moved, d_normals)
        self.layer._follow(self.initial, _packed(d_wall_moved, d_matrices, frames.initial), d_mapped)
        if d_initial is not None and d_wall_initial is not None:
            change = np.zeros_like(d_mapped)
            self.layer._follow(d_initial, _packed(0.0 * d_wall_initial, frames.matrices, d_wall_initial), change)
            d_mapped += change
        if self.corners is not None:
            self.corners.add_jvp(d_initial, d_wall_initial, d_wall_moved, d_matrices, d_mapped)
        self.layer._copy(d_mapped)
        return d_mapped

    def vjp(
        self,
        # (n, 3), derivative of a scalar with respect to the points, overwritten in place by the derivative with respect
        # to the mapped ones
        bar: np.ndarray,
        # which derivatives: with respect to the points before the move, ``initial``, and where the map puts them,
        # ``mapped``, shape (n, 3); to the nodes of the wall, ``wall_initial`` and ``wall_moved``, shape (wall.n_points,
        # 3); and to the ``normals`` of its planes, shape (n_planes, 3)
        wrt: Collection[str] = INPUTS,
    ) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        _move_rows(self.layer.copies, bar)
        bars, names = {"mapped": bar}, ["moved", "normals"]
        if "initial" in wrt or "wall_initial" in wrt:
            bars["initial"], bars["wall_initial"] = self._before_vjp(bar)
            names.append("initial")
        at_corners, before = bar[self.layer.corners.rows], (bars.get("initial"), bars.get("wall_initial"))
        places_bar, matrices_bar = self._frames_vjp(bar)
        if self.corners is not None:
            self.corners.add_vjp(at_corners, places_bar, matrices_bar, *before)
        by_frames = self.frames.vjp(matrices_bar, names)
        bars |= {"wall_moved": places_bar + by_frames["moved"], "normals": by_frames["normals"]}
        if "initial" in by_frames:
            bars["wall_initial"] += by_frames["initial"]
        return {name: bars[name] for name in wrt}

    def _before_vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives with respect to points and wall before the move, at constant rotations."""
        initial_bar, wall_bar = np.zeros_like(bar), np.zeros_like(bar, shape=self.frames.initial.shape)
        layer, frames = self.layer, self._motion
        sums = layer._over_pieces(
            lambda piece: _turned_back(*layer._arrays(piece), frames[piece.wall_ids], bar, initial_bar)
        )
        add_up(layer.pieces, sums, wall_bar)
        return initial_bar, wall_bar

    @property
    def _motion(self) -> np.ndarray:
        """Places and rotations of the wall's nodes, shape (n, 15)."""
        return _packed(self.frames.moved, self.frames.matrices, self.frames.initial)

    def _frames_vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives with respect to the wall's places and rotations; ``bar`` becomes the mapped points'."""
        layer, frames = self.layer, self._motion
        sums = layer._over_pieces(
            lambda piece: _follow_back(*layer._arrays(piece), self.initial, frames[piece.wall_ids], bar)
        )
        frames_bar = np.zeros((len(frames), 12), dtype=bar.dtype)
        add_up(layer.pieces, sums, frames_bar)
        return frames_bar[:, :3], frames_bar[:, 3:].reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False)
class WallFollowing:
    """The points that follow the walls of a grid, and the rows of the walls in the grid."""

    layer: WallLayer  # the points that follow
    rows: np.ndarray  # int (n_wall,), numbers of the nodes of all walls, shared ones once
    plane_rows: np.ndarray  # int (n_plane,), numbers of the nodes on the outlines of planes that walls end on
    planes: tuple[PlaneNormal, ...] | None  # normals of these planes, as functions of those nodes; None if they stay
    images: WallImages | None = None  # walls beyond periodic sides, which the layer's wall has after those nodes

    def at(
        self,
        # points before the move, and where a map puts them; the latter are overwritten in place
        initial: np.ndarray,  # (n, 3)
        mapped: np.ndarray,  # (n, 3), C order
        # the grid before and after the move; the latter may be `mapped`
        grid_initial: np.ndarray,  # (n_nodes, 3)
        grid: np.ndarray,  # (n_nodes, 3)
    ) -> Followed:
        """Move the points with the walls."""
        # `MovementError` if the surroundings of a node of a wall are turned inside out
        plane_points = grid[self.plane_rows]
        walls = self._walls(grid_initial), self._walls(grid)
        return Followed(self, self.layer.at(initial, mapped, *walls, self.normals(plane_points)), plane_points)

    def _walls(self, grid: np.ndarray) -> np.ndarray:
        """Nodes of walls, shape (wall.n_points, 3), of a grid, shape (n_nodes, 3)."""
        nodes = grid[self.rows]
        return nodes if self.images is None else self.images.beyond(nodes, self.layer.wall.tree.points[: len(nodes)])

    def changes(self, change: np.ndarray) -> np.ndarray:
        """Changes of the nodes of walls with changes of a grid."""
        nodes = change[self.rows]
        return nodes if self.images is None else self.images.changes(nodes)

    def add_changes_vjp(self, bar: np.ndarray, grid_bar: np.ndarray) -> None:
        """Transpose of `changes`."""
        grid_bar[self.rows] += bar if self.images is None else self.images.changes_vjp(bar)

    def normals(self, plane_points: np.ndarray) -> np.ndarray | None:
        """Normals, shape (n_planes, 3), of the planes that walls end on, from the points on their outlines."""
        if self.planes is None:
            return None
        return np.reshape([plane.normal(plane_points) for plane in self.planes], (-1, 3))


@dataclass(frozen=True, eq=False)
class Followed:
    """Points that followed the walls of a grid, and their derivative."""

    of: WallFollowing
    layered: Layered
    plane_points: np.ndarray  # (n_plane, 3), nodes on the outlines of planes (m)

    def jvp(
        self,
        change: np.ndarray,  # (n, 3), of the mapped points, overwritten in place by the change of the points
        d_grid: np.ndarray,  # (n_nodes, 3), of the grid; may be `change`
        # of the grid before the move, whose nodes the points then are; None for no change
        d_initial: np.ndarray | None = None,  # (n_nodes, 3)
    ) -> None:
        """Change of the points."""
        of, at, d_normals = self.of, self.plane_points, None
        if of.planes is not None:
            d_plane_points = d_grid[of.plane_rows]
            d_normals = np.reshape([plane.normal_jvp(at, d_plane_points) for plane in of.planes], (-1, 3))
        d_before = None if d_initial is None else of.changes(d_initial)
        self.layered.jvp(d_initial, change, d_before, of.changes(d_grid), d_normals)

    def add_vjp(
        self,
        bar: np.ndarray,  # (n, 3), of the points, overwritten in place by the derivative of the mapped ones
        # derivatives to add to, with respect to the grid, which may be `bar`, and to the grid before the move
        grid_bar: np.ndarray,  # (n_nodes, 3)
        initial_bar: np.ndarray | None = None,  # (n_nodes, 3)
    ) -> None:
        """Transpose of `jvp`."""
        wrt = ("mapped", "wall_moved", "normals")
        bars = self.layered.vjp(bar, wrt if initial_bar is None else (*wrt, "initial", "wall_initial"))
        planes_bar = np.zeros_like(self.plane_points)
        for plane, normal_bar in zip(self.of.planes or (), bars["normals"]):
            plane.add_normal_vjp(self.plane_points, normal_bar, planes_bar)
        self.of.add_changes_vjp(bars["wall_moved"], grid_bar)
        grid_bar[self.of.plane_rows] += planes_bar
        if initial_bar is not None:
            initial_bar += bars["initial"]
            self.of.add_changes_vjp(bars["wall_initial"], initial_bar)


def _packed(places: np.ndarray, matrices: np.ndarray, initial: np.ndarray) -> np.ndarray:
    """Places and rotations after a move and places before it side by side, shape (n, 15)."""
    return np.concatenate([places, matrices.reshape(-1, 9), initial], axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _move_rows(copies, bar):
    for n in range(len(copies)):
        for d in range(3):
            bar[copies[n, 1], d] += bar[copies[n, 0], d]
            bar[copies[n, 0], d] = 0.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _corners(corners, barycentric, k):
    """Corners of the triangle of a closest point, and its barycentric coordinates."""
    # unsigned: signed numbers would be checked for negative indices
    a, b, c = np.uint64(corners[k, 0]), np.uint64(corners[k, 1]), np.uint64(corners[k, 2])
    u, v = np.float64(barycentric[k, 0]), np.float64(barycentric[k, 1])
    return (a, b, c), (u, v, 1.0 - u - v)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _closest(frames, at, barycentric):
    """A closest point before the move."""
    (a, b, c), (u, v, w) = at, barycentric
    return (
        u * frames[a, 12] + v * frames[b, 12] + w * frames[c, 12],
        u * frames[a, 13] + v * frames[b, 13] + w * frames[c, 13],
        u * frames[a, 14] + v * frames[b, 14] + w * frames[c, 14],
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _arm(initial, row, frames, n, closest, by_corners):
    """Vector to a point from its centre of rotation, a corner or the closest point."""
    x, y, z = (frames[n, 12], frames[n, 13], frames[n, 14]) if by_corners else closest
    return initial[row, 0] - x, initial[row, 1] - y, initial[row, 2] - z


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _projected(projector, x, y, z):
    p = projector
    return (
        p[0, 0] * x + p[0, 1] * y + p[0, 2] * z,
        p[1, 0] * x + p[1, 1] * y + p[1, 2] * z,
        p[2, 0] * x + p[2, 1] * y + p[2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _follow(rows, starts, planes, corners, barycentric, weights, projectors, by_corners, initial, frames, mapped):
    for i in range(len(rows)):
        row, total = np.uint64(rows[i]), 0.0
        x, y, z = 0.0, 0.0, 0.0
        for k in range(starts[i], starts[i + 1]):
            at, at_weights = _corners(corners, barycentric, k)
            beta = np.float64(weights[k])
            closest = _closest(frames, at, at_weights)
            for n, weight in zip(at, at_weights):
                s, (d, e, f) = beta * weight, _arm(initial, row, frames, n, closest, by_corners)
                x += s * (frames[n, 0] + frames[n, 3] * d + frames[n, 4] * e + frames[n, 5] * f)
                y += s * (frames[n, 1] + frames[n, 6] * d + frames[n, 7] * e + frames[n, 8] * f)
                z += s * (frames[n, 2] + frames[n, 9] * d + frames[n, 10] * e + frames[n, 11] * f)
            total += beta
        if planes[i] == 0:
            mapped[row, 0] = (1.0 - total) * mapped[row, 0] + x
            mapped[row, 1] = (1.0 - total) * mapped[row, 1] + y
            mapped[row, 2] = (1.0 - total) * mapped[row, 2] + z
        else:
            x, y, z = x - total * mapped[row, 0], y - total * mapped[row, 1], z - total * mapped[row, 2]
            x, y, z = _projected(projectors[planes[i]], x, y, z)
            mapped[row, 0] += x
            mapped[row, 1] += y
            mapped[row, 2] += z


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _follow_back(rows, starts, planes, corners, barycentric, weights, projectors, by_corners, initial, frames, bar):
    """Transpose of `_follow` with respect to the frames, returned, and the mapped points, overwriting ``bar``."""
    sums = np.zeros((len(frames), 12), dtype=bar.dtype)
    for i in range(len(rows)):
        row, total = np.uint64(rows[i]), 0.0
        x, y, z = bar[row, 0], bar[row, 1], bar[row, 2]
        if planes[i] != 0:
            x, y, z = _projected(projectors[planes[i]], x, y, z)
        for k in range(starts[i], starts[i + 1]):
            at, at_weights = _corners(corners, barycentric, k)
            beta = np.float64(weights[k])
            closest = _closest(frames, at, at_weights)
            for n, weight in zip(at, at_weights):
                s, (d, e, f) = beta * weight, _arm(initial, row, frames, n, closest, by_corners)
                sums[n, 0] += s * x
                sums[n, 1] += s * y
                sums[n, 2] += s * z
                sums[n, 3] += s * x * d
                sums[n, 4] += s * x * e
                sums[n, 5] += s * x * f
                sums[n, 6] += s * y * d
                sums[n, 7] += s * y * e
                sums[n, 8] += s * y * f
                sums[n, 9] += s * z * d
                sums[n, 10] += s * z * e
                sums[n, 11] += s * z * f
            total += beta
        bar[row, 0] -= total * x
        bar[row, 1] -= total * y
        bar[row, 2] -= total * z
    return sums


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _turned_back(rows, starts, planes, corners, barycentric, weights, projectors, by_corners, frames, bar, initial_bar):
    """Transpose of `_follow` with respect to the points before the move, added to, and the wall's, returned."""
    sums = np.zeros((len(frames), 3), dtype=bar.dtype)
    for i in range(len(rows)):
        row = np.uint64(rows[i])
        x, y, z = bar[row, 0], bar[row, 1], bar[row, 2]
        if planes[i] != 0:
            x, y, z = _projected(projectors[planes[i]], x, y, z)
        for k in range(starts[i], starts[i + 1]):
            at, at_weights = _corners(corners, barycentric, k)
            beta = np.float64(weights[k])
            all_d, all_e, all_f = 0.0, 0.0, 0.0
            for n, weight in zip(at, at_weights):
                s = beta * weight
                d = s * (frames[n, 3] * x + frames[n, 6] * y + frames[n, 9] * z)
                e = s * (frames[n, 4] * x + frames[n, 7] * y + frames[n, 10] * z)
                f = s * (frames[n, 5] * x + frames[n, 8] * y + frames[n, 11] * z)
                all_d, all_e, all_f = all_d + d, all_e + e, all_f + f
                if by_corners:
                    sums[n, 0] -= d
                    sums[n, 1] -= e
                    sums[n, 2] -= f
            initial_bar[row, 0] += all_d
            initial_bar[row, 1] += all_e
            initial_bar[row, 2] += all_f
            if not by_corners:
                for n, weight in zip(at, at_weights):
                    sums[n, 0] -= weight * all_d
                    sums[n, 1] -= weight * all_e
                    sums[n, 2] -= weight * all_f
    return sums
