"""Points of a wall that are closest to given points: local minima of the distance, with smooth weights.

Next to a smooth or convex wall there is one closest point. In a concave corner, a cove or a gap there are several, and
the nearest one jumps where two are equally near. So a point uses all local minima of its distance up to a few times as
far as the nearest, with weights that set in smoothly. Whether a place is a local minimum depends only on the surface,
not on its reach: next to a nose with narrow faces, which reach less far, no farther place takes over.

Triangles are stored in a complete binary tree of boxes, halved along the longest side of the box of their centres,
where normals count as further coordinates. If no direction in the cone of a box's normals leads to a point, the box has
no minimum and is skipped.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.numerics.threads import run_tasks, thread_count
from .closest_search import MAX_CLOSEST, find_closest
from .normal_cones import cones_of, unit_normals
from .settings import LAYER

__all__ = ["ClosestPoints", "TriangleTree", "smooth_corners"]

LEAF = 4
"""Most triangles in a box that is not halved."""

TURN = 0.25
"""Length, relative to the size of a surface, that a difference of one between normals counts as when its triangles are
halved: otherwise boxes contain both sides of a thin wing, and their cones exclude nothing."""

CHUNK_POINTS = 2**12
"""Points per piece of work."""


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Closest points on a surface of some points; points far from it have none."""

    points: np.ndarray  # (n,) of int, numbers of the points that have closest points
    starts: np.ndarray  # (n + 1,) of int, first closest point of each
    triangles: np.ndarray  # (m,) of int, triangle that each closest point is in, the nearest one of a point first
    barycentric: np.ndarray  # (m, 3), weights of the triangle's corners there, which sum to one
    # (m,), how much the point follows the surface at each: the weights of a point sum to one on the surface, and to
    # zero beyond the surface's reach
    weights: np.ndarray

    def with_wall_nodes(self, tree: TriangleTree, n_wall: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Corners, coordinates and weights of closest points, the wall's nodes first; the nearest triangle of each."""
        corners = np.concatenate(
            [np.repeat(np.arange(n_wall, dtype=np.int32)[:, None], 3, axis=1), tree.triangles[self.triangles]]
        )
        barycentric = np.concatenate([np.tile([1.0, 0.0], (n_wall, 1)), self.barycentric[:, :2]])
        first = np.zeros(len(tree.points), dtype=np.int64)
        if n_wall:
            first[tree.triangles[::-1].ravel()] = np.repeat(np.arange(len(tree.triangles))[::-1], 3)
        return (
            corners,
            barycentric,
            np.concatenate([np.ones(n_wall), self.weights]),
            np.concatenate([first[:n_wall], self.triangles[self.starts[:-1]]]),
        )

    def slopes(self, tree: TriangleTree, points: np.ndarray) -> np.ndarray:
        """Heights of points above their nearest closest points divided by these points' distances from corners."""
        first = self.starts[:-1]
        corners = tree.points[tree.triangles[self.triangles[first]]]
        at = np.einsum("nk,nkd->nd", self.barycentric[first], corners)
        off = np.linalg.norm(corners - at[:, None], axis=2).min(axis=1)
        return np.divide(np.linalg.norm(points - at, axis=1), off, out=np.full(len(at), np.inf), where=off > 0.0)


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """Triangles of a surface, sorted for searches. Made by `TriangleTree.of`."""

    points: np.ndarray  # (n, 3), corners (m)
    # (n_triangles, 3) of int, corners of every triangle, in the order of the tree, around the normal into the fluid
    triangles: np.ndarray
    reach: np.ndarray  # (n,), distance (m) up to which points follow the surface, at its corners
    # (2 n_leaves, 6), lower and upper corner of every box; box k contains boxes 2 k and 2 k + 1, the root is number 1
    boxes: np.ndarray
    far: np.ndarray  # (2 n_leaves,), largest reach in every box
    cones: np.ndarray  # (2 n_leaves, 9), cones of normals in every box, see `.normal_cones`
    # (n_triangles, 4, 4), plane of every triangle, and the planes through its sides across it: unit normal, outwards
    # for sides, and distance from the origin along it (m)
    planes: np.ndarray
    cosines: np.ndarray  # (n_triangles,), cosine of the cone of every triangle
    leaf_starts: np.ndarray  # (n_leaves + 1,) of int, first triangle of every leaf
    around_starts: np.ndarray  # (n + 1,) of int, first triangle around every corner
    around: np.ndarray  # (3 n_triangles,) of int, triangles around corners
    farthest: float  # a local minimum this many times as far as the nearest one has no weight

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n, 3), corners (m)
        quads: np.ndarray,  # int (n_quads, 4), corners of every quad in order, around the normal into the fluid
        reach: np.ndarray,  # (n,), distance (m) up to which points follow the surface, at its corners
        farthest: float = LAYER.farthest,  # see `bspline_mdao.core.walls.settings.LayerSettings`
    ) -> TriangleTree:
        """Halve the quads of a surface along their shorter diagonals and sort the triangles that have an area."""
        triangles = _halves(points, quads)
        corners = points[triangles]
        middles = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
        size = np.linalg.norm(np.ptp(middles, axis=0)) if len(middles) else 0.0
        order, starts = _sorted_in_halves(np.concatenate([middles, TURN * size * unit_normals(corners)], axis=1))
        triangles, corners = np.ascontiguousarray(triangles[order], dtype=np.int32), corners[order]
        lower, upper, far = corners.min(axis=1), corners.max(axis=1), reach[triangles].max(axis=1, initial=0.0)
        if not len(triangles):  # one box, infinitely far from everything
            lower, upper, far = np.full((1, 3), np.inf), np.full((1, 3), -np.inf), np.zeros(1)
        box = np.concatenate([lower, -upper], axis=1)
        levels = [(np.minimum.reduceat(box, starts[:-1]), np.maximum.reduceat(far, starts[:-1]))]
        while len(levels[0][1]) > 1:
            boxes, far = levels[0]
            levels.insert(0, (np.minimum(boxes[::2], boxes[1::2]), np.maximum(far[::2], far[1::2])))
        boxes, far = (np.concatenate([parts[0][:1], *parts]) for parts in zip(*levels))
        around = (np.argsort(triangles.ravel(), kind="stable") // 3).astype(np.int32)
        around_starts = np.concatenate([[0], np.cumsum(np.bincount(triangles.ravel(), minlength=len(points)))])
        boxes = boxes * np.repeat([1.0, -1.0], 3)
        cones, cosines = cones_of(points, triangles, starts, boxes)
        planes = _planes_of(corners)
        return cls(
            points, triangles, reach, boxes, far, cones, planes, cosines, starts, around_starts, around, farthest
        )

    def closest_points(
        self,
        points: np.ndarray,  # (n, 3), the points (m)
        # number of threads; by default ``NUMBA_NUM_THREADS``. Results do not depend on it.
        n_threads: int | None = None,
    ) -> ClosestPoints:
        """Find the closest points of points."""
        tree = self.points, self.triangles, self.reach, self.boxes, self.far, self.cones, self.planes, self.cosines
        around = self.leaf_starts, self.around_starts, self.around
        size = float(np.linalg.norm(np.ptp(self.points, axis=0)))

        def search(first: int) -> tuple[np.ndarray, ...]:
            part = points[first : first + CHUNK_POINTS]
            counts, triangles = np.zeros(len(part), dtype=np.int64), np.empty((len(part), MAX_CLOSEST), dtype=np.int32)
            barycentric, weights = np.empty((len(part), MAX_CLOSEST, 3)), np.empty((len(part), MAX_CLOSEST))
            find_closest(part, *tree, *around, size, self.farthest, counts, triangles, barycentric, weights)
            is_found, near = np.arange(MAX_CLOSEST) < counts[:, None], np.flatnonzero(counts)
            results = triangles[is_found], barycentric[is_found], weights[is_found]
            return first + near, counts[near], *results

        found = run_tasks(search, range(0, len(points), CHUNK_POINTS), thread_count(n_threads))
        empty = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int32)
        found.append((*empty, np.empty((0, 3)), np.empty(0)))
        ids, counts, triangles, barycentric, weights = (np.concatenate(parts) for parts in zip(*found))
        return ClosestPoints(ids, np.concatenate([[0], np.cumsum(counts)]), triangles, barycentric, weights)


def smooth_corners(barycentric: np.ndarray) -> np.ndarray:
    """Weights of the first two corners, in proportion to b^2 (3 - 2 b) of all three barycentric coordinates b."""
    b = np.column_stack([barycentric, 1.0 - barycentric.sum(axis=1)])
    smooth = b * b * (3.0 - 2.0 * b)
    return (smooth / smooth.sum(axis=1, keepdims=True))[:, :2]


def _halves(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Triangles of quads, those with area, shape (n_triangles, 3)."""
    x = points[quads]
    is_first_shorter = np.linalg.norm(x[:, 2] - x[:, 0], axis=1) <= np.linalg.norm(x[:, 3] - x[:, 1], axis=1)
    first, second = quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [1, 2, 3, 1, 3, 0]]
    triangles = np.where(is_first_shorter[:, None], first, second).reshape(-1, 3)
    x = points[triangles]
    sides = x - np.roll(x, 1, axis=1)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return triangles[area > 1e-12 * np.max(np.sum(sides**2, axis=2), axis=1, initial=0.0)]


def _planes_of(corners: np.ndarray) -> np.ndarray:
    """Plane of each triangle, and the planes through its sides across it, shape (n_triangles, 4, 4)."""
    planes, normals = np.empty((len(corners), 4, 4)), unit_normals(corners)
    planes[:, 0, :3] = normals
    for side in range(3):
        across = np.cross(corners[:, (side + 1) % 3] - corners[:, side], normals)
        planes[:, side + 1, :3] = across / np.linalg.norm(across, axis=1)[:, None]
    planes[:, 0, 3] = np.einsum("td,td->t", normals, corners[:, 0])
    planes[:, 1:, 3] = np.einsum("tsd,tsd->ts", planes[:, 1:, :3], corners)
    return planes


def _sorted_in_halves(centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order of points, shape (n, n_axes), and the first of every leaf, after repeated halving."""
    order, starts = np.arange(len(centres)), np.array([0, len(centres)])
    while np.diff(starts).max() > LEAF:
        x = centres[order]
        width = np.maximum.reduceat(x, starts[:-1]) - np.minimum.reduceat(x, starts[:-1])
        number = np.repeat(np.arange(len(width)), np.diff(starts))
        along = np.take_along_axis(x, np.argmax(width, axis=1)[number][:, None], axis=1)[:, 0]
        order = order[np.lexsort((along, number))]
        middle = (starts[:-1] + starts[1:]) // 2
        starts = np.append(np.stack([starts[:-1], middle], axis=1).ravel(), len(order))
    return order, starts
