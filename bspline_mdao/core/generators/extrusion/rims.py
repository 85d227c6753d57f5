"""Conditions at the rim of a surface: planes of symmetry, planes that edges stay in, and free edges.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ....base.numerics.vectors import dots, is_line, lengths, nearest_plane, unit_vectors
from ....errors import InputError
from .repeats import Repeats
from .rings import Fans, Rings, complete_rings
from .step_system import FREE
from .surface import SurfaceMesh, half_edges

FLATNESS = 1e-5
"""Distance from a plane, relative to the extent of the rim, within which nodes are in it."""

NORMALITY = 0.9
"""Least mean cosine between edges off the rim and the normal of its plane for a surface that ends normally in it."""

Plane = str | Sequence[float]
"""A coordinate direction ``"x"``, ``"y"`` or ``"z"``, or the normal of a plane."""

KINDS = ("free", "symmetry", "constant", "periodic")


@dataclass(frozen=True, eq=False)
class Rim:
    """The edges at the rim, and the constraints of their nodes."""

    edges: np.ndarray  # int (n_edges, 2), nodes of each edge, the lower number first
    quads: np.ndarray  # int (n_edges, 4), the quad at each
    kinds: np.ndarray  # int (n_edges,), places in `KINDS`
    planes: np.ndarray  # int (n_edges,), place of the normal of the plane of each; -1 for free ones
    normals: np.ndarray  # (n_planes, 3), unit normals

    @classmethod
    def of(
        cls,
        mesh: SurfaceMesh,
        fans: Fans,  # of all nodes
        symmetry: Sequence[Plane] | None,
        constant: Sequence[Plane],
        periodic: Sequence[Plane],
    ) -> Rim:
        """Find the rim; if no planes of symmetry are given, they are the planes in which it ends normally."""
        start, end, quad = half_edges(mesh.quads)
        both = np.sort(np.stack([start, end], axis=1), axis=1)
        pairs, first, counts = np.unique(both, axis=0, return_index=True, return_counts=True)
        edges, quads = pairs[counts == 1], mesh.quads[quad[first[counts == 1]]]
        found = cls(edges, quads, np.zeros(len(edges), int), np.full(len(edges), -1), np.zeros((0, 3)))
        for kind, planes in (("symmetry", symmetry or ()), ("constant", constant), ("periodic", periodic)):
            for plane in planes:
                found = found._with_plane(mesh, kind, plane)
        return found._with_guesses(mesh, fans) if symmetry is None else found

    def _with_plane(self, mesh: SurfaceMesh, kind: str, plane: Plane) -> Rim:
        """The rim with the edges in the two planes of a normal that bound the surface."""
        normal = _normal(plane)
        heights = mesh.points @ normal
        ends, near = heights[self.edges], FLATNESS * np.ptp(mesh.points, axis=0).max()
        leaves = np.ptp(heights[self.quads], axis=1) > near  # a face in the plane does not end there
        inside = (ends <= heights.min() + near).all(axis=1) | (ends >= heights.max() - near).all(axis=1)
        inside &= leaves & (self.kinds == 0)
        if not inside.any():
            raise InputError(
                f"{mesh.source}: no edge of the surface's rim lies in a plane of normal {plane} at its end, as "
                f"requested ({kind}); leave that out, or close the surface up to the plane"
            )
        return self._marked(inside, kind, normal)

    def _with_guesses(self, mesh: SurfaceMesh, fans: Fans) -> Rim:
        """The rim with planes of symmetry in which whole loops of it, or smooth parts, end normally."""
        found = self
        corners = _turns(mesh.points, self.edges)
        for apart in (np.zeros(len(corners), bool), corners):
            for part in found._parts(found.kinds == 0, apart):
                nodes = np.unique(found.edges[part])
                points = mesh.points[nodes]
                if is_line(points):
                    continue
                normal, distances, _ = nearest_plane(points)
                if distances.max() > FLATNESS * np.ptp(points, axis=0).max():
                    continue
                if _ends_normally(mesh, fans, nodes, normal):
                    found = found._marked(part, "symmetry", normal)
        return found

    def _marked(self, edges: np.ndarray, kind: str, normal: np.ndarray) -> Rim:
        kinds, planes = self.kinds.copy(), self.planes.copy()
        kinds[edges], planes[edges] = KINDS.index(kind), len(self.normals)
        return Rim(self.edges, self.quads, kinds, planes, np.vstack([self.normals, normal]))

    def _parts(self, chosen: np.ndarray, apart: np.ndarray) -> list[np.ndarray]:
        """Connected parts of the chosen edges, as numbers; some nodes separate parts."""
        numbers = np.flatnonzero(chosen)
        nodes, place = np.unique(self.edges[numbers], return_inverse=True)
        place = place.reshape(-1, 2)
        row, side = np.nonzero(~apart[nodes][place])
        n = len(numbers)
        graph = coo_array((np.ones(len(row)), (row, n + place[row, side])), shape=(n + len(nodes),) * 2)
        labels = connected_components(graph, directed=False)[1][:n]
        return [numbers[labels == label] for label in np.unique(labels)]

    def repeats(self, mesh: SurfaceMesh) -> Repeats:
        """Nodes of periodic edges, identified if a translation maps them onto each other."""
        repeats = Repeats.none(len(mesh.points))
        for plane in np.unique(self.planes[self.kinds == KINDS.index("periodic")]):
            repeats = repeats.joined(mesh, np.unique(self.edges[self.planes == plane]), self.normals[plane])
        return repeats

    def rings(self, fans: Fans, repeats: Repeats) -> Rings:
        """Neighbours of the marching nodes, completed at the rim."""
        mirrors = np.eye(3) - 2.0 * self.normals[:, :, None] * self.normals[:, None, :]
        maps = np.concatenate([np.eye(3)[None], -np.eye(3)[None], mirrors])
        of_edges = np.where(self.kinds == KINDS.index("symmetry"), self.planes + 2, 1)
        kinds = np.zeros((len(fans.is_open), 2), np.int64)
        rim = np.flatnonzero(fans.is_open)
        ends = np.concatenate([self.edges, self.edges[:, ::-1]])
        directed = repeats.directed(*ends.T)
        order = np.argsort(directed)
        for side, at in enumerate((fans.starts[rim], fans.starts[rim + 1] - 1)):
            wanted = (rim * len(repeats.first) + fans.nodes[at]) * repeats.n_shifts + fans.shift[at]
            kinds[rim, side] = np.tile(of_edges, 2)[order[np.searchsorted(directed[order], wanted)]]
        return complete_rings(fans, kinds, maps, repeats.shifts)

    def _find(self, pairs: np.ndarray) -> np.ndarray:
        """Numbers of the edges between pairs of nodes; -1 for none."""
        if not len(self.edges):
            return np.full(len(pairs), -1)
        n = self.edges.max() + 1
        keys, wanted = self.edges @ [n, 1], np.sort(pairs, axis=1) @ [n, 1]
        order = np.argsort(keys)
        at = order[np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)]
        return np.where((keys[at] == wanted) & (pairs.max(axis=1) < n), at, -1)

    @property
    def _is_bound(self) -> np.ndarray:
        """Whether edges stay in a plane, bool (n_edges,)."""
        return np.isin(self.kinds, [KINDS.index("symmetry"), KINDS.index("constant")])

    def constraints(self, repeats: Repeats) -> tuple[np.ndarray, np.ndarray]:
        """Constraint of each marching node, (n,), see `FREE`, and projectors, (n_projectors, 3, 3)."""
        on_plane = np.zeros((len(repeats.first), max(1, len(self.normals))), bool)
        bound = self._is_bound
        on_plane[repeats.unknown[self.edges[bound]].ravel(), np.repeat(self.planes[bound], 2)] = True
        sets, constraint = np.unique(np.vstack([np.zeros_like(on_plane[:1]), on_plane]), axis=0, return_inverse=True)
        projectors = [_projector(self.normals[row[: len(self.normals)]]) for row in sets]
        constraint = constraint.ravel()[1:].astype(np.int64)
        constraint[repeats.unknown[self.edges[self.kinds == 0]].ravel()] = FREE
        return constraint, np.array(projectors)

    def splay(self, mesh: SurfaceMesh, fans: Fans, repeats: Repeats, angle: float) -> np.ndarray:
        """Outward part of a step of marching nodes at free edges, (n, 3); fans are of all nodes."""
        outwards = np.zeros((len(repeats.first), 3))
        nodes = np.unique(repeats.unknown[self.edges[self.kinds == 0]])
        counts = np.diff(fans.starts)
        owner = np.repeat(np.arange(len(counts)), counts)
        vectors = unit_vectors(mesh.points[owner] - mesh.points[fans.nodes], np.zeros(3), 1e-300)
        np.add.at(outwards, repeats.unknown[owner], vectors)
        shift = np.zeros_like(outwards)
        shift[nodes] = np.tan(angle) * unit_vectors(outwards[nodes], np.zeros(3), 1e-6)
        for number in np.unique(self.planes[self._is_bound]):
            normal, there = self.normals[number], np.unique(repeats.unknown[self.edges[self.planes == number]])
            shift[there] -= dots(shift[there], normal)[:, None] * normal
        return shift

    def kind_of(self, pairs: np.ndarray) -> np.ndarray:
        """Label of edges between pairs of nodes: -1 inside, 0 free, and 1 more than the place of their plane."""
        at = self._find(pairs)
        return np.append(self.planes + 1, -1)[at]  # of no edge, -1, the last


def _normal(plane: Plane) -> np.ndarray:
    """Unit normal of a plane in a user's notation."""
    if isinstance(plane, str) and plane in ("x", "y", "z"):
        return np.eye(3)["xyz".index(plane)]
    normal = np.asarray(plane, dtype=np.float64) if not isinstance(plane, str) else np.zeros(0)
    if normal.shape != (3,) or not np.isfinite(normal).all() or not normal.any():
        raise InputError(f"extrusion: plane {plane!r} is not known; give x, y, z or the three numbers of a normal")
    return normal / lengths(normal)


def _projector(normals: np.ndarray) -> np.ndarray:
    """Projector onto the directions common to some planes."""
    if not len(normals):
        return np.eye(3)
    _, sizes, rows = np.linalg.svd(normals)
    span = rows[: np.count_nonzero(sizes > 1e-6)]
    return np.eye(3) - span.T @ span


def _turns(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Whether the rim turns by more than 45 degrees at a node, (n,)."""
    sums, counts = np.zeros_like(points), np.zeros(len(points), int)
    unit = unit_vectors(points[edges[:, 1]] - points[edges[:, 0]], np.zeros(3), 1e-300)
    np.add.at(sums, edges[:, 0], unit)
    np.add.at(sums, edges[:, 1], -unit)
    np.add.at(counts, edges.ravel(), 1)
    return (counts != 2) | (lengths(sums) > 2.0 * np.sin(np.pi / 8.0))


def _ends_normally(mesh: SurfaceMesh, fans: Fans, nodes: np.ndarray, normal: np.ndarray) -> bool:
    """Whether the edges off the rim at its nodes are along the normal of its plane."""
    is_rim = np.zeros(len(mesh.points), bool)
    is_rim[nodes] = True
    owner = np.repeat(np.arange(len(mesh.points)), np.diff(fans.starts))
    off = is_rim[owner] & ~is_rim[fans.nodes]
    vectors = unit_vectors(mesh.points[fans.nodes[off]] - mesh.points[owner[off]], np.zeros(3), 1e-300)
    return bool(off.any() and np.abs(vectors @ normal).mean() >= NORMALITY)
