"""Strips of a wing between stations along its span, and the points of the trailing edge at the stations.

Both are determined on the baseline and kept. A grid whose lines run around the sections has its own strips: rows of
wall quads that close around the wing, from the plane of symmetry to the tip. On any other grid, quads are distributed
to strips of equal width by their extent along the span.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components, dijkstra

from ...core.measures.edge_cuts import EdgeCuts, cut_edges, edges_of_quads
from ...errors import InputError

__all__ = ["SpanStrips"]

_NEAR = 1e-9
"""Distance, in spans, within which nodes are level with a station, or equally far downstream: round-off of a grid."""

_SHORT = 1e-6
"""Width of a strip, in spans, that counts as zero: collapsed quads at a tip."""


@dataclass(frozen=True, eq=False)
class SpanStrips:
    """Strips from the left tip to the plane of symmetry, or to the right tip of a whole wing."""

    face_weights: csr_array  # (n, n_faces), weights of the wall faces in every strip; the weights of a face sum to 1
    # (n + 1, n_nodes), weights of the nodes of the grid in the points of the trailing edge at the stations
    trailing: csr_array
    leading: csr_array  # (n + 1, n_nodes), the same for the leading edge: the foremost points of the baseline
    axes: np.ndarray  # (3, 3), rows are the directions downstream, along the span towards the last strip, and up
    is_symmetric: bool  # whether the wing is one half of a symmetric one, whose plane is span 0

    @classmethod
    def of(
        cls,
        # (n_faces, 4) of int, rows of the corners of its wall faces in the grid, such as ``CellFaces.corners``
        corners: np.ndarray,
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
        axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span and up
        *,
        is_symmetric: bool = True,  # whether the wing is one half of a symmetric one about span 0
        n_strips: int = 16,  # number of strips, if the grid has none of its own
    ) -> SpanStrips:
        """Divide the wall of a wing into strips."""
        span = nodes[np.unique(corners)] @ axes[1]
        if not np.ptp(span) > 0.0:
            raise InputError("span strips: the wall has no extent along the span; give other axes, or wall patches")
        is_turned = is_symmetric and span.max() > -span.min()
        axes = axes * np.array([1.0, -1.0 if is_turned else 1.0, 1.0])[:, None]
        numbers = _numbered(corners, nodes @ axes[1]) if is_symmetric else None
        if numbers is None:
            parts = _of_equal_width(corners, nodes, axes, n_strips)
        else:
            parts = _along_grid_lines(corners, nodes @ axes[0], numbers)
        face_weights, trailing, leading = parts
        return cls(*_widened(face_weights, trailing, leading, nodes @ axes.T), axes, is_symmetric)

    @property
    def n_strips(self) -> int:
        """Number of strips along the span."""
        return self.face_weights.shape[0]


def _numbered(corners: np.ndarray, span: np.ndarray) -> np.ndarray | None:
    """Number of the strip of every quad from the tip, if grid lines close around the wing; else None."""
    # Opposite edges of a quad belong to one row of quads. Rows along the span end in the plane of symmetry, at edges of
    # only one quad; rows around the sections do not end.
    edges, is_boundary = _edges(corners)
    rows = _rows_of_edges(edges, len(is_boundary))
    ends = np.zeros(rows.max() + 1, dtype=bool)
    ends[rows[is_boundary]] = True
    both = rows[edges[:, :2]]
    if (ends[both].sum(axis=1) != 1).any():
        return None
    strips = np.where(ends[both[:, 0]], both[:, 1], both[:, 0])
    strips = np.unique(strips, return_inverse=True)[1]
    at_boundary = np.unique(strips[is_boundary[edges].any(axis=1)])
    middles = np.bincount(strips, span[corners].mean(axis=1)) / np.bincount(strips)
    root = at_boundary[np.argmax(middles[at_boundary])]
    return _in_turn(strips, edges, int(root))


def _edges(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the edge from every corner to the next, shape (n, 4), and whether an edge has only one quad."""
    # Edges of zero length are excluded: each has a number of its own.
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    is_none = ends[:, 0] == ends[:, 1]
    ends[is_none, 1] = -1 - np.arange(is_none.sum())
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    is_boundary = count == 1
    is_boundary[number[is_none]] = False
    return number.reshape(corners.shape), is_boundary


def _rows_of_edges(edges: np.ndarray, n_edges: int) -> np.ndarray:
    """Number of the row of quads that crosses an edge, for every edge."""
    pairs = np.concatenate([edges[:, [0, 2]], edges[:, [1, 3]]]).T
    graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(n_edges, n_edges))
    return connected_components(graph, directed=False)[1]


def _in_turn(strips: np.ndarray, edges: np.ndarray, root: int) -> np.ndarray | None:
    """Number the strips of quads from the tip to the root, each next to the previous; None if not so ordered."""
    n = strips.max() + 1
    ends = np.repeat(strips, 4).astype(np.int32), edges.ravel().astype(np.int32)  # types for SciPy's older versions
    touch = coo_array((np.ones(edges.size), ends), shape=(n, edges.max() + 1)).tocsr()
    steps = dijkstra(touch @ touch.T, unweighted=True, indices=root)
    if n < 2 or not np.array_equal(np.sort(steps), np.arange(n)):
        return None
    return (n - 1 - steps).astype(int)[strips]


def _along_grid_lines(corners: np.ndarray, downstream: np.ndarray, strips: np.ndarray) -> tuple[csr_array, ...]:
    """Weights of the faces, and points of the edges: last and first nodes downstream on the lines between strips."""
    n, n_nodes = strips.max() + 1, len(downstream)
    last, first = np.full(n_nodes, -1), np.full(n_nodes, n)
    np.maximum.at(last, corners, strips[:, None])
    np.minimum.at(first, corners, strips[:, None])
    on_wall = np.flatnonzero(last >= 0)
    first, last = first[on_wall], last[on_wall]
    stations = np.where((first < last) | (last == 0), last, n)
    face_weights = csr_array((np.ones(len(strips)), (strips, np.arange(len(strips)))), shape=(n, len(strips)))
    edges = (_last_nodes(stations, on_wall, sign * downstream) for sign in (1.0, -1.0))
    return face_weights, *edges


def _last_nodes(stations: np.ndarray, rows: np.ndarray, downstream: np.ndarray) -> csr_array:
    """Means of the last nodes downstream at every station, from rows of the grid at stations."""
    x = downstream[rows]
    furthest = np.full(stations.max() + 1, -np.inf)
    np.maximum.at(furthest, stations, x)
    is_last = x > furthest[stations] - _NEAR * np.ptp(x)
    stations, rows = stations[is_last], rows[is_last]
    weights = 1.0 / np.bincount(stations)[stations]
    return csr_array((weights, (stations, rows)), shape=(len(furthest), len(downstream)))


def _of_equal_width(corners: np.ndarray, nodes: np.ndarray, axes: np.ndarray, n_strips: int) -> tuple[csr_array, ...]:
    """Weights of the faces in strips of equal width, and points of the trailing and leading edge between these."""
    span, downstream, edges = nodes @ axes[1], nodes @ axes[0], edges_of_quads(corners)
    used = span[corners]
    stations = np.linspace(used.min(), used.max(), n_strips + 1)
    low, near = used.min(axis=1), _NEAR * np.ptp(used)
    passed = np.clip((stations[:, None] - low) / np.maximum(np.ptp(used, axis=1), near), 0.0, 1.0)
    passed[-1] = 1.0  # including quads that lie in the plane of the end
    cuts = [cut_edges(edges, span - station, near) for station in stations]
    ends = (vstack([_last_cut(cut, sign * downstream) for cut in cuts], format="csr") for sign in (1.0, -1.0))
    return csr_array(np.diff(passed, axis=0)), *ends


def _last_cut(cuts: EdgeCuts, downstream: np.ndarray) -> csr_array:
    """Weights of the nodes in the last downstream of some points on edges."""
    points = cuts.matrix(len(downstream))
    return points[[np.argmax(points @ downstream)]]


def _widened(
    face_weights: csr_array, trailing: csr_array, leading: csr_array, points: np.ndarray
) -> tuple[csr_array, csr_array, csr_array]:
    """Join strips of zero width to their neighbours; nodes are in the axes downstream, along the span, up."""
    widths = np.linalg.norm(np.diff((trailing @ points)[:, 1:], axis=0), axis=1)
    group = np.maximum(np.cumsum(widths > _SHORT * widths.sum()) - 1, 0)
    join = csr_array((np.ones(len(group)), (group, np.arange(len(group)))))
    stations = np.concatenate([[0], 1 + np.flatnonzero(np.diff(group)), [len(group)]])
    return csr_array(join @ face_weights), csr_array(trailing[stations]), csr_array(leading[stations])
