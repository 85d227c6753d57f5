"""Points inside a body, such as spars, ribs and tanks, that ride on its surface.

A point is a weighted mean of the nodes of the surface around it, by mean value coordinates fixed on the baseline:

    x = sum_i w_i s_i + d ,    sum_i w_i = 1 ,    d = 0 to round-off.

So it follows every affine motion of the surface exactly, and a smooth motion to second order in the distances to the
nodes that count. It lies on the surface if it did so before. The map is linear in the nodes.

Where the surface has an edge, such as in a plane of symmetry, a fan of triangles from the mean of the nodes on the edge
closes it. Points on the fan are means of these nodes, so they stay in the plane.

The weights of all nodes would make a dense matrix. They decay with the fourth power of the distance between opposite
walls, so only `MOST` of them are kept. To fade to zero without a jump, all are lowered by the largest weight that is
left out, and then corrected by the least change that makes the mean exact again.

Theory: ``docs/theory/body_points.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...base.checks import as_finite_points
from ...base.numerics.vectors import unit_vectors
from ...errors import InputError
from ...grids.cells.quads import add_to_nodes, area_vectors
from ...names import SURFACE
from ..evaluation.node_map import require_inputs
from .mean_value import add_weights

__all__ = ["Body", "BodyPoints"]

MOST = 128
"""Most nodes, and means of edges, that a point rides on: 1.5 kB per point."""

INSIDE = 0.5
"""Least fraction of all directions in which an inner point sees the body; on the surface it is a half, and noisy."""

BETWEEN = 0.1
"""Distance out of the body, relative to the edges of its quads there, up to which a point counts as on its surface: the
distance of curved skin from the quads between its nodes."""

SAME = 1e-9
"""Distance, relative to the size of the body, up to which a point is a node."""

FLAT = 1e-13
"""Area of a triangle, relative to the square of its longest edge, below which it counts as zero."""

BYTES = 2**26
"""Memory of the weights of all nodes in the points of one piece of work."""

N_CORRECTIONS = 3
"""Corrections: the first makes the mean exact, the others remove round-off."""


@dataclass(frozen=True, eq=False)
class Body:
    """The surface of a body on the baseline."""

    points: np.ndarray  # (n, 3), its nodes (m)
    quads: np.ndarray  # (n_quads, 4) of int, corners of its quads, around the normal out of the body

    @cached_property
    def _edges(self) -> np.ndarray:
        """Ends of the edges of quads that have no quad on the other side, shape (n_edges, 2), in order."""
        edges = np.concatenate([self.quads[:, [k, (k + 1) % 4]] for k in range(4)])
        edges = edges[edges[:, 0] != edges[:, 1]]
        keys, back = edges @ [len(self.points), 1], edges @ [1, len(self.points)]
        return edges[~np.isin(keys, back)]

    @cached_property
    def means(self) -> csr_array:
        """Means of the nodes on each edge of the surface, shape (n_means, n)."""
        edges, n = self._edges, len(self.points)
        graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
        ids = np.unique(edges)
        _, parts = np.unique(connected_components(graph, directed=False)[1][ids], return_inverse=True)
        counts = np.bincount(parts)
        return coo_array((1.0 / counts[parts], (parts, ids)), shape=(len(counts), n)).tocsr()

    @cached_property
    def corners(self) -> np.ndarray:
        """Nodes, and the mean of the nodes on each edge (m)."""
        return np.concatenate([self.points, self.means @ self.points])

    @cached_property
    def triangles(self) -> np.ndarray:
        """Triangles of the closed surface with an area, shape (n_triangles, 3), around the outward normal."""
        part_of = np.zeros(len(self.points), dtype=int)
        part_of[self.means.indices] = np.repeat(np.arange(self.means.shape[0]), np.diff(self.means.indptr))
        fans = np.column_stack([self._edges[:, ::-1], len(self.points) + part_of[self._edges[:, 0]]])
        found = np.concatenate([self.quads[:, [0, 1, 2]], self.quads[:, [0, 2, 3]], fans])
        x = self.corners[found]
        arms = x[:, [1, 2, 0]] - x
        areas = np.linalg.norm(np.cross(arms[:, 0], arms[:, 1]), axis=1)
        return np.ascontiguousarray(found[areas > FLAT * np.square(arms).sum(axis=2).max(axis=1)])

    def surrounds(self, points: np.ndarray) -> np.ndarray:
        """Whether points, shape (n, 3), are inside the body: shape (n,). Points on its surface may be either."""
        return np.concatenate(
            [np.zeros(0, dtype=bool), *(windings > INSIDE for _, _, windings in self.seen_from(points))]
        )

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points, shape (n, 3), are inside the body or on its surface, see `BETWEEN`: shape (n,)."""
        contained = self.surrounds(points)
        outside = np.flatnonzero(~contained)
        normals, lengths = self._normals_and_lengths
        nearest = self._tree.query(points[outside])[1]
        contained[outside] = self.surrounds(points[outside] - (BETWEEN * lengths[:, None] * normals)[nearest])
        return contained

    def is_node(self, points: np.ndarray) -> np.ndarray:
        """Whether points, shape (n, 3), are nodes of the surface, to the rounding of files: shape (n,)."""
        return self._tree.query(points)[0] <= SAME * np.linalg.norm(np.ptp(self.points, axis=0))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def _normals_and_lengths(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit normals at the nodes, zero if undefined, and mean lengths of the edges there (m)."""
        corners, n = self.points[self.quads], len(self.points)
        areas = area_vectors(corners)
        normals = add_to_nodes(self.quads, np.repeat(areas[:, None], 4, axis=1), n)
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        sums, counts = (np.bincount(self.quads.ravel(), w.ravel(), n) for w in (edges, np.ones_like(edges)))
        return unit_vectors(normals, np.zeros(3), 0.0), sums / np.maximum(counts, 1.0)

    def seen_from(self, points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield numbers of points, weights of all corners in them, and the fraction of directions that see the body."""
        step = max(1, BYTES // (8 * len(self.corners)))
        for start in range(0, len(points), step):
            numbers = np.arange(start, min(start + step, len(points)))
            weights, windings = np.zeros((len(numbers), len(self.corners))), np.zeros(len(numbers))
            add_weights(np.ascontiguousarray(points[numbers]), self.corners, self.triangles, weights, windings)
            yield numbers, weights, windings


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """The map from the nodes of a surface to points that ride on it. Made by `BodyPoints.of`."""

    # (n, n_nodes + n_means), weights in the points of nodes, and of means of nodes on edges of the surface
    weights: csr_array
    means: csr_array  # (n_means, n_nodes), these means
    offsets: np.ndarray  # (n, 3), remainder of the points on the baseline, round-off (m)

    @classmethod
    def of(
        cls,
        body: Body,  # its surface on the baseline
        points: np.ndarray,  # (n, 3), the points on the baseline (m)
    ) -> BodyPoints:
        """Find the weights of points inside a body, or on its surface."""
        points = as_finite_points(points, len(points), "points of a body")
        parts = [csr_array((0, len(body.corners)))]
        for numbers, weights, _ in body.seen_from(points):
            parts.append(_sparse(weights, points[numbers], body.corners))
        found = cls(csr_array(vstack(parts)), body.means, np.zeros_like(points))
        return cls(found.weights, found.means, points - found.forward(body.points))

    def at(self, surface: np.ndarray) -> BodyState:
        """Points and their derivative at nodes of the surface, shape (n_nodes, 3), in metres."""
        return BodyState(self, self.forward(surface) + self.offsets)

    def forward(self, moves: np.ndarray) -> np.ndarray:
        """Displacements of the points, shape (n, 3), from displacements of the nodes, shape (n_nodes, 3)."""
        return self.weights @ np.concatenate([moves, self.means @ moves])

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`."""
        corners_bar, n = self.weights.T @ bar, self.means.shape[1]
        return corners_bar[:n] + self.means.T @ corners_bar[n:]


@dataclass(frozen=True, eq=False)
class BodyState:
    """Points that ride on a surface, and their derivative."""

    of: BodyPoints  # the map
    nodes: np.ndarray  # (n, 3), the points (m)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return (SURFACE,)

    def jvp(self, surface: np.ndarray | None = None) -> np.ndarray:
        """Change of the points with the nodes of the surface."""
        return np.zeros_like(self.nodes) if surface is None else self.of.forward(surface)

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`, under ``surface``."""
        return {name: self.of.adjoint(bar) for name in require_inputs(wrt, self.inputs)}


def require_contained(body: Body, points: np.ndarray, what: str) -> np.ndarray:
    """Return points, shape (n, 3), if all are inside a body or on its surface."""
    points = as_finite_points(points, len(points), what)
    outside = np.flatnonzero(~body.contains(points))
    if len(outside):
        raise InputError(
            f"{what}: {len(outside)} of {len(points)} points are outside the surface, the first is point "
            f"{outside[0] + 1} at {points[outside[0]].tolist()}; give points inside it or on it"
        )
    return points


def _sparse(weights: np.ndarray, points: np.ndarray, corners: np.ndarray) -> csr_array:
    """Matrix of the largest weights of each point, with exact means."""
    n_kept = min(MOST, weights.shape[1])
    weights /= weights.sum(axis=1)[:, None]
    sizes = np.abs(weights)
    kept = np.sort(np.argpartition(-sizes, n_kept - 1, axis=1)[:, :n_kept], axis=1)
    values = np.take_along_axis(weights, kept, axis=1)
    np.put_along_axis(sizes, kept, 0.0, axis=1)
    values = np.sign(values) * np.maximum(np.abs(values) - sizes.max(axis=1)[:, None], 0.0)
    sizes = np.abs(values)
    sizes /= sizes.sum(axis=1)[:, None]
    arms = corners[kept] - points[:, None]
    scale = np.sqrt(np.sum(sizes * np.square(arms).sum(axis=2), axis=1))
    arms /= np.where(scale > 0.0, scale, 1.0)[:, None, None]
    terms = np.concatenate([np.ones_like(arms[..., :1]), arms], axis=2)
    normal = np.linalg.pinv(np.einsum("nk,nki,nkj->nij", sizes, terms, terms), rcond=1e-12, hermitian=True)
    for _ in range(N_CORRECTIONS):
        miss = np.array([1.0, 0.0, 0.0, 0.0]) - np.einsum("nk,nki->ni", values, terms)
        values = values + sizes * np.einsum("nki,nij,nj->nk", terms, normal, miss)
    starts = n_kept * np.arange(len(points) + 1)
    matrix = csr_array((values.ravel(), kept.ravel(), starts), weights.shape)
    matrix.eliminate_zeros()
    return matrix
