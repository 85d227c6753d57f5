"""Points between several walls, as in the corner of a wing and a body: they keep their heights above each wall.

Each closest point k of such a point moves it to a position T_k that keeps its height above the wall there, but not
above the others. If the angle between two walls changes by 10 degrees, first cells at the mean m of the T_k, with the
weights b_k, have heights that are wrong by 9 %. The point therefore goes to m + e, near m, where all heights are kept:

    e minimises  sum_k b_k (n'_k . (e - c_k (T_k - m)))^2 + E |e|^2,  or
    (sum_k b_k n'_k (x) n'_k + E I) e = sum_k b_k c_k n'_k (n'_k . (T_k - m)),

Here n'_k is the wall's normal after the move: the vector from the closest point to the point, turned by the cofactors
of G (a matrix G turns vectors, its cofactors turn area normals). If the point stays in a plane, only the component of a
normal along the plane counts. Heights above the wall that a point follows most are kept, c_k = 1. The less a point
follows another wall, the less its height above that wall is kept. Otherwise cells fold where a point far from one wall,
and a first cell off the other, begins to keep both. If the walls move as one body, e is zero. Between the opposite
walls of a gap a point cannot keep both heights, and stays at the mean.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Corners", "CornersMoved"]

DEVIATION = 0.001
"""E. It is small: heights in the corner have 0.5 % of the mean's error left (3 % with 0.01). It is not zero, as two
normals do not determine a position."""

ON_WALL = 1e-12
"""Distance from the wall, relative to its size, up to which a point counts as on it: the vector is round-off."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Points with several closest points on a wall. Made by `Corners.of`."""

    rows: np.ndarray  # int (n,), the points
    starts: np.ndarray  # int (n,), the first closest point of each
    at: np.ndarray  # int (m,), the point of each closest point, among `rows`
    ids: np.ndarray  # int (m, 3), nodes of the wall: corners of the triangles of the closest points
    barycentric: np.ndarray  # (m, 3), positions of the closest points in their triangles
    # (m, 3), weights of the nodes: the barycentric coordinates, or the weights with which points turn about the nodes
    weights: np.ndarray
    by_corners: np.ndarray  # bool (m,), whether points turn about the nodes, and not about the closest points
    fractions: np.ndarray  # (m,), weights of the closest points, b_k, which sum to one for each point
    kept: np.ndarray  # (m,), how much of the heights above them is kept, c_k
    seen: np.ndarray  # (m, 3, 3), projection onto the planes of the points, times the square roots of the fractions
    follows: np.ndarray  # (n, 3, 3), this projection, times how much the points follow

    @classmethod
    def of(
        cls,
        wall: np.ndarray,  # (n_wall, 3), nodes of the wall (m)
        points: np.ndarray,  # (n_points, 3), all points, including the following ones (m)
        rows: np.ndarray,  # int (n_rows,), points with several closest points
        counts: np.ndarray,  # int (n_rows,), closest points of each
        ids: np.ndarray,  # int (m_all, 3), nodes of the wall at the corners of the triangles of these
        barycentric: np.ndarray,  # (m_all, 2), the first two of their barycentric coordinates
        weights: np.ndarray,  # (m_all, 2), the first two weights with which points turn
        follows: np.ndarray,  # (m_all,), how much points follow each closest point
        by_corners: np.ndarray,  # bool (n_rows,), whether they turn about corners
        projectors: np.ndarray,  # (n_rows, 3, 3), onto the planes that they stay in
    ) -> Corners:
        """Take the points, except those on the wall."""
        barycentric, weights = (np.column_stack([each, 1.0 - each.sum(axis=1)]) for each in (barycentric, weights))
        ways = np.repeat(points[rows], counts, axis=0) - np.einsum("kn,knd->kd", barycentric, wall[ids])
        nearest = np.minimum.reduceat(np.linalg.norm(ways, axis=1), np.cumsum(counts) - counts)
        is_off = nearest > ON_WALL * np.linalg.norm(np.ptp(wall, axis=0))
        kept, rows, counts = np.repeat(is_off, counts), rows[is_off], counts[is_off]
        starts, at = np.cumsum(counts) - counts, np.repeat(np.arange(len(rows)), counts)
        totals, planes = np.add.reduceat(follows[kept], starts), projectors[is_off]
        fractions = follows[kept] / totals[at]
        return cls(
            rows=rows,
            starts=starts,
            at=at,
            ids=ids[kept],
            barycentric=barycentric[kept],
            weights=weights[kept],
            by_corners=by_corners[is_off][at],
            fractions=fractions,
            kept=1.0 - np.maximum(1.0 - 2.0 * fractions, 0.0) ** 4,  # between two walls, the smaller is a half at most
            seen=np.sqrt(fractions)[:, None, None] * planes[at],
            follows=totals[:, None, None] * planes,
        )

    def moved(
        self,
        initial: np.ndarray,  # (n_points, 3), points before the move (m)
        # (n_wall, 3), nodes of the wall before and after the move (m), and (n_wall, 3, 3), matrices of their frames
        wall_initial: np.ndarray,
        wall_moved: np.ndarray,
        matrices: np.ndarray,
    ) -> CornersMoved:
        """Find the displacements of the points from the mean of the places of their closest points."""
        turned = matrices[self.ids]
        up, arms = self._vectors(initial, wall_initial)
        places = self._means(wall_moved[self.ids] + _times(turned, arms))
        areas = self._means(_times(0.5 * _products(turned, turned), up[:, None]))
        lengths = np.sqrt(np.sum(areas * areas, axis=1))
        units = areas / lengths[:, None]
        normals, apart = _times(self.seen, units), self._apart(places)
        stiffness = self._sums(_outer(normals, normals)) + DEVIATION * np.eye(3)
        right = self._sums(np.sum(normals * apart, axis=1)[:, None] * normals)
        left = np.linalg.solve(stiffness, right[..., None])[..., 0][self.at] - apart
        return CornersMoved(self, turned, up, arms, lengths, units, normals, stiffness, left, left + apart)

    def _vectors(self, initial: np.ndarray, wall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vectors to the points from their closest points, (m, 3), and their centres of rotation, (m, 3, 3); linear."""
        points, nodes = initial[self.rows][self.at], wall[self.ids]
        up = points - np.einsum("kn,knd->kd", self.barycentric, nodes)
        return up, np.where(self.by_corners[:, None, None], points[:, None] - nodes, up[:, None])

    def _means(self, values: np.ndarray) -> np.ndarray:
        """Weighted means over the nodes of the wall, shape (m, 3)."""
        return np.einsum("kn,knd->kd", self.weights, values)

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """Sums over the closest points of every point."""
        return np.add.reduceat(values, self.starts, axis=0)

    def _apart(self, places: np.ndarray) -> np.ndarray:
        """Vectors from the weighted means of places to the places, times how much they are kept, shape (m, 3)."""
        return self.kept[:, None] * (places - self._sums(self.fractions[:, None] * places)[self.at])


@dataclass(frozen=True, eq=False)
class CornersMoved:
    """Points in corners after a move, and their derivative."""

    of: Corners  # the points
    turned: np.ndarray  # (m, 3, 3, 3), matrices of the nodes of the wall, G
    up: np.ndarray  # (m, 3), vectors from the closest points to the points before the move (m)
    arms: np.ndarray  # (m, 3, 3), vectors to the points from their centres of rotation (m)
    lengths: np.ndarray  # (m,), lengths of the turned vectors before normalisation
    units: np.ndarray  # (m, 3), normals n'_k
    normals: np.ndarray  # (m, 3), their components along planes, times the square roots of the fractions
    stiffness: np.ndarray  # (n, 3, 3), matrices of the least squares problems
    left: np.ndarray  # (m, 3), e - c_k (T_k - m) (m)
    found: np.ndarray  # (m, 3), e (m)

    def add(self, nodes: np.ndarray) -> None:
        """Add e to the points, shape (n_points, 3)."""
        self._add(self.found[self.of.starts], nodes)

    def add_jvp(
        self,
        # changes of the arguments of `Corners.moved`; None for no change of points and wall before the move
        d_initial: np.ndarray | None,
        d_wall_initial: np.ndarray | None,
        d_wall_moved: np.ndarray,
        d_matrices: np.ndarray,
        change: np.ndarray,  # (n_points, 3)
    ) -> None:
        """Add the change of e to the change of the points."""
        of, d_turned = self.of, d_matrices[self.of.ids]
        places, areas = d_wall_moved[of.ids] + _times(d_turned, self.arms), _products(self.turned, d_turned)
        areas = _times(areas, self.up[:, None])
        if d_initial is not None and d_wall_initial is not None:
            d_up, d_arms = of._vectors(d_initial, d_wall_initial)
            places = places + _times(self.turned, d_arms)
            areas = areas + _times(0.5 * _products(self.turned, self.turned), d_up[:, None])
        d_normals = _times(of.seen, self._along_units(of._means(areas)))
        missed = np.sum(d_normals * self.left - self.normals * of._apart(of._means(places)), axis=1)
        along = np.sum(self.normals * self.left, axis=1)
        right = of._sums(along[:, None] * d_normals + missed[:, None] * self.normals)
        self._add(-np.linalg.solve(self.stiffness, right[..., None])[..., 0], change)

    def add_vjp(
        self,
        bar: np.ndarray,  # (n, 3), derivative of a scalar with respect to the points in corners
        # derivatives to add to, with respect to the wall's nodes and matrices after the move, and to points and wall
        # before it, shapes as for `Corners.moved`; None if not wanted
        wall_moved_bar: np.ndarray,
        matrices_bar: np.ndarray,
        initial_bar: np.ndarray | None = None,
        wall_initial_bar: np.ndarray | None = None,
    ) -> None:
        """Transpose of `add_jvp`."""
        of = self.of
        right = -np.linalg.solve(self.stiffness, _times(of.follows, bar)[..., None])[..., 0][of.at]
        missed = np.sum(right * self.normals, axis=1)[:, None]
        along = np.sum(self.normals * self.left, axis=1)[:, None]
        units_bar = _times(of.seen, along * right + missed * self.left)
        areas_bar = of.weights[..., None] * self._along_units(units_bar)[:, None]
        places_bar = -missed * of.kept[:, None] * self.normals
        places_bar = places_bar - of.fractions[:, None] * of._sums(places_bar)[of.at]
        places_bar = of.weights[..., None] * places_bar[:, None]
        np.add.at(wall_moved_bar, of.ids, places_bar)
        turned_bar = _outer(places_bar, self.arms) + _products(self.turned, _outer(areas_bar, self.up[:, None]))
        np.add.at(matrices_bar, of.ids, turned_bar)
        if initial_bar is not None and wall_initial_bar is not None:
            back = np.swapaxes(self.turned, -1, -2)
            arms_bar = _times(back, places_bar)
            up_bar = _times(0.5 * np.swapaxes(_products(self.turned, self.turned), -1, -2), areas_bar).sum(axis=1)
            self._add_vectors_vjp(up_bar, arms_bar, initial_bar, wall_initial_bar)

    def _add(self, values: np.ndarray, nodes: np.ndarray) -> None:
        """Add values of the points in corners to nodes, in proportion to how much they follow."""
        nodes[self.of.rows] += _times(self.of.follows, values)

    def _along_units(self, areas: np.ndarray) -> np.ndarray:
        """Change of unit vectors with a change of the vectors before normalisation; its own transpose."""
        return (areas - np.sum(areas * self.units, axis=1)[:, None] * self.units) / self.lengths[:, None]

    def _add_vectors_vjp(
        self, up_bar: np.ndarray, arms_bar: np.ndarray, initial_bar: np.ndarray, wall_bar: np.ndarray
    ) -> None:
        """Transpose of `Corners._vectors`."""
        of, all_arms = self.of, arms_bar.sum(axis=1)
        up_bar = up_bar + np.where(of.by_corners[:, None], 0.0, all_arms)
        nodes_bar = of.barycentric[..., None] * up_bar[:, None]
        np.add.at(wall_bar, of.ids, -nodes_bar - np.where(of.by_corners[:, None, None], arms_bar, 0.0))
        points_bar = up_bar + np.where(of.by_corners[:, None], all_arms, 0.0)
        initial_bar[of.rows] += of._sums(points_bar)


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products of matrices and vectors."""
    return (matrices @ vectors[..., None])[..., 0]


def _outer(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Outer products of vectors."""
    return one[..., :, None] * other[..., None, :]


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Bilinear form of matrices that is twice the cofactors at equal arguments; in each, its own transpose."""
    after, last = ([np.roll(part, -n, axis=-2) for part in (one, other)] for n in (1, 2))
    return np.cross(after[0], last[1]) + np.cross(after[1], last[0])
