"""A face of a CAD file: a surface trimmed by edges, and its points nearest to given ones.

1. Points of the face on a lattice of parameters, and of its edges, give the start of the search.
2. Damped Newton's method finds the nearest point of the surface, within its parameters.
3. If that is outside the edges, the nearest point on the edges is used.

An edge consists of lines between points in (u, v); its deviation from these is within the slack, up to which a point
counts as on the face. Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from .nurbs_surface import NurbsSurface

__all__ = ["Nearest", "TrimmedFace"]

LEAST, PER_SPAN, MOST = 12, 4, 160
"""Number of cells of the lattice of starts in a direction: at least, per span, and approximately at most."""

MAX_STEPS = 60
"""Newton's method takes about five; unconverged points stay where they are."""

ROUND_OFF = 1e-14
"""Steps of parameters that are rounding errors, and relative rounding errors of lengths."""

NOISE = 1e-12
"""Smaller growth of squared distances is ignored: near the nearest point it is rounding error."""

ON_BOUNDARY = 1e-9
"""Parameter distance up to which an edge is on the boundary of the surface, which limits the search anyway."""

DAMPING = 1e-3
"""Initial damping of Newton's method, relative to the lengths of tangents."""

SECTIONS = 40
"""Golden-section steps on the two lines next to the nearest point of an edge: down to the rounding of a minimum."""

NEIGHBOURS = 24
"""Number of starts searched for a second one away from the first, as on the other side of a thin edge."""

AWAY = 0.1
"""Parameter distance of the second start from the first."""


class Nearest(NamedTuple):
    """Points of a face nearest to given ones."""

    uv: np.ndarray  # (n, 2), parameters
    distances: np.ndarray  # (n,), in metres
    on_edge: np.ndarray  # bool (n,), whether an edge inside the surface's parameters limits them


@dataclass(frozen=True, eq=False)
class TrimmedFace(OneLine):
    """A face by its surface and its edges."""

    name: str  # its name in the file, or its number there
    surface: NurbsSurface
    edges: tuple[np.ndarray, ...]  # each (m, 2), points of every edge in (u, v), together closed
    tolerance: float  # of the file (m), within which neighbouring edges coincide
    origin: Any = None  # OpenCascade's own face, of B-splines, in millimetres, as the file has it

    def __str__(self) -> str:
        n_u, n_v = self.surface.weights.shape
        trimmed = "trimmed, " if self.is_trimmed else ""
        return f"{self.name}: {trimmed}{n_u} x {n_v} control points"

    @cached_property
    def is_trimmed(self) -> bool:
        """Whether an edge leaves the boundary of the surface."""
        off = [np.minimum(edge, 1.0 - edge).min(axis=1).max() for edge in self.edges]
        return max(off, default=0.0) > ON_BOUNDARY

    @cached_property
    def _segments(self) -> np.ndarray:
        """Lines of all edges, (k, 2, 2)."""
        return np.concatenate([np.stack([edge[:-1], edge[1:]], axis=1) for edge in self.edges])

    @cached_property
    def slack(self) -> float:
        """Distance (m) up to which a point outside the edges counts as on the face: the error of lines as edges."""
        if not self.is_trimmed:
            return self.tolerance
        missed = [self._missed(edge) for edge in self.edges if len(edge) > 2]
        return max(self.tolerance, *missed)

    def _missed(self, edge: np.ndarray) -> float:
        """A quarter of the largest distance (m) between an edge and lines through every second of its points."""
        odd = edge[1:-1:2]
        between = 0.5 * (edge[0:-2:2] + edge[2::2])[: len(odd)]
        return 0.25 * float(lengths(self.surface.points(odd) - self.surface.points(between)).max())

    def contains(self, uv: np.ndarray) -> np.ndarray:
        """Whether parameters, shape (n, 2), are inside the edges: an odd number of lines is above them."""
        if not self.is_trimmed:
            return np.ones(len(uv), dtype=bool)
        (u_a, v_a), (u_b, v_b) = self._segments[:, 0].T, self._segments[:, 1].T
        found = np.empty(len(uv), dtype=bool)
        width = np.where(u_a == u_b, 1.0, u_b - u_a)
        each = max(2_000_000 // len(u_a), 1)  # number at a time, to limit memory
        for at in range(0, len(uv), each):
            u, v = uv[at : at + each, :1], uv[at : at + each, 1:]
            crosses = (u_a > u) != (u_b > u)
            above = v_a + (u - u_a) / width * (v_b - v_a) > v
            found[at : at + each] = np.count_nonzero(crosses & above, axis=1) % 2 == 1
        return found

    @cached_property
    def edge_points(self) -> np.ndarray:
        """Parameters of points of all edges, (m, 2)."""
        return np.concatenate(self.edges)

    @cached_property
    def _edge_places(self) -> tuple[cKDTree, np.ndarray]:
        """Points of all edges, and the parameters of the previous point, the point itself, and the next."""
        around = [
            np.stack([edge[[0, *range(len(edge) - 1)]], edge, edge[[*range(1, len(edge)), -1]]]) for edge in self.edges
        ]
        return cKDTree(self.surface.points(self.edge_points)), np.concatenate(around, axis=1)

    @cached_property
    def _starts(self) -> tuple[cKDTree, np.ndarray, float]:
        """Points of the face, their parameters, and the largest distance (m) between points of a cell."""
        u, v = self.surface.lattice(LEAST, PER_SPAN, MOST)
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        points = self.surface.points(uv)
        net = points.reshape(len(u), len(v), 3)
        reach = max(float(np.linalg.norm(net[1:, 1:] - net[:-1, :-1], axis=-1).max()),
                    float(np.linalg.norm(net[1:, :-1] - net[:-1, 1:], axis=-1).max()))  # fmt: skip
        inside = self.contains(uv)
        kept, at = uv[inside], points[inside]
        if self.is_trimmed:
            kept, at = np.concatenate([kept, self.edge_points]), np.concatenate([at, self._edge_places[0].data])
        return cKDTree(at), kept, reach

    @property
    def points(self) -> np.ndarray:
        """Points (m) all over the face, shape (m, 3): of the lattice, and of trimming edges."""
        return self._starts[0].data

    def bounds(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (m) of the distances of points, shape (n, 3), from the face, each (n,)."""
        tree, _, reach = self._starts
        above = tree.query(points)[0]
        return above - reach, above

    def nearest(self, points: np.ndarray) -> Nearest:
        """Find its points nearest to given ones, shape (n, 3), in metres."""
        tree, parameters, _ = self._starts
        k = min(NEIGHBOURS, len(parameters))
        numbers = tree.query(points, k=k)[1].reshape(len(points), k)
        found = self._from(points, parameters[numbers[:, 0]])
        # a second start, away from the first: on the other side of a thin edge, another point may be nearer
        away = np.abs(parameters[numbers] - parameters[numbers[:, :1]]).max(axis=2) > AWAY
        rest = np.flatnonzero(away.any(axis=1) & (found.distances > self.tolerance))
        if len(rest):
            second = parameters[numbers[rest, np.argmax(away[rest], axis=1)]]
            other = self._from(points[rest], second)
            better = other.distances < found.distances[rest]
            for into, new in zip(found, other):
                into[rest[better]] = new[better]
        return found

    def _from(self, points: np.ndarray, starts: np.ndarray) -> Nearest:
        """Search from parameters, steps 2 and 3."""
        uv = self._newton(points, starts)
        distances = lengths(self.surface.points(uv) - points)
        on_edge = np.zeros(len(points), dtype=bool)
        outside = np.flatnonzero(~self.contains(uv))
        if len(outside):  # step 3
            on = self._nearest_on_edges(points[outside])
            at = self.surface.points(on)
            is_off = lengths(at - self.surface.points(uv[outside])) > self.slack
            rows = outside[is_off]
            uv[rows], on_edge[rows] = on[is_off], True
            distances[rows] = lengths(at[is_off] - points[rows])
        return Nearest(uv, distances, on_edge)

    def _newton(self, points: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Damped Newton's method for the nearest point of the surface, within its parameters."""
        uv, going = starts.copy(), np.arange(len(points))
        damping = np.full(len(points), DAMPING)
        noise = (ROUND_OFF * np.abs(points).max(initial=0.0)) ** 2
        for _ in range(MAX_STEPS):
            if not len(going):
                break
            at, here = self.surface.jets(uv[going]), uv[going]
            away = points[going] - at.points
            slope = np.einsum("nic,nc->ni", at.tangents, away)
            metric = at.tangents @ at.tangents.swapaxes(1, 2)
            stays = ((here <= 0.0) & (slope < 0.0)) | ((here >= 1.0) & (slope > 0.0))
            step = damped_step(metric, at.second, away, slope, damping[going], stays)
            new = np.clip(here + step, 0.0, 1.0)
            before = (away**2).sum(axis=1)
            after = ((points[going] - self.surface.points(new)) ** 2).sum(axis=1)
            better = after <= before * (1.0 + NOISE) + noise
            uv[going[better]] = new[better]
            damping[going] = np.where(better, damping[going] * 0.01, np.maximum(damping[going], 1e-8) * 30.0)
            settled = (np.abs(new - here).max(axis=1) <= ROUND_OFF) | (damping[going] > 1e8)
            going = going[~settled]
        return uv

    def _nearest_on_edges(self, points: np.ndarray) -> np.ndarray:
        """Parameters of the edge points nearest to given ones, on the two lines next to the nearest vertex."""
        tree, around = self._edge_places
        before, middle, after = around[:, tree.query(points)[1]]

        def place(s: np.ndarray) -> np.ndarray:
            end = np.where((s < 0.0)[:, None], before, after)
            return middle + np.abs(s)[:, None] * (end - middle)

        def distance(s: np.ndarray) -> np.ndarray:
            return lengths(self.surface.points(place(s)) - points)

        ratio = 0.5 * (np.sqrt(5.0) - 1.0)
        low, high = np.full(len(points), -1.0), np.ones(len(points))
        for _ in range(SECTIONS):
            left, right = high - ratio * (high - low), low + ratio * (high - low)
            is_left = distance(left) < distance(right)
            low, high = np.where(is_left, low, left), np.where(is_left, right, high)
        return place(0.5 * (low + high))

    def rates(self, uv: np.ndarray, points: np.ndarray, on_edge: np.ndarray) -> np.ndarray:
        """Derivatives of nearest points' parameters with respect to the given points, (n, 2, 3); zero on edges."""
        at = self.surface.jets(uv)
        away = points - at.points
        slope = np.einsum("nic,nc->ni", at.tangents, away)
        matrix = at.tangents @ at.tangents.swapaxes(1, 2) - np.einsum("nijc,nc->nij", at.second, away)
        stays = ((uv <= 0.0) & (slope < 0.0)) | ((uv >= 1.0) & (slope > 0.0)) | on_edge[:, None]
        scale = np.maximum(np.einsum("nii->ni", matrix).max(axis=1), np.finfo(float).tiny)
        return np.where(stays[:, :, None], 0.0, solved(matrix, at.tangents, stays, ROUND_OFF * scale))


def damped_step(
    metric: np.ndarray,  # (n, 2, 2), first fundamental form
    second: np.ndarray,  # (n, 2, 2, 3), second derivatives
    away: np.ndarray,  # (n, 3), vectors to the points
    slope: np.ndarray,  # (n, 2), right-hand side
    damping: np.ndarray,  # (n,), relative to the metric
    stays: np.ndarray,  # bool (n, 2), fixed parameters
) -> np.ndarray:
    """Return a Newton step if it descends, otherwise a Gauss-Newton step, (n, 2)."""
    full = metric - np.einsum("nijc,nc->nij", second, away)
    determinant = full[:, 0, 0] * full[:, 1, 1] - full[:, 0, 1] ** 2
    is_convex = (determinant > 0.0) & (full[:, 0, 0] > 0.0)
    matrix = np.where(is_convex[:, None, None], full, metric)
    trace = np.einsum("nii->n", metric) + np.finfo(float).tiny
    return solved(matrix, slope[:, :, None], stays, (damping + ROUND_OFF) * trace)[:, :, 0]


def solved(matrix: np.ndarray, right: np.ndarray, stays: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Solve 2 x 2 systems with a diagonal shift, keeping some unknowns zero; right-hand sides (n, 2, m)."""
    a, b, c = matrix[:, 0, 0] + shift, matrix[:, 0, 1], matrix[:, 1, 1] + shift
    b = np.where(stays.any(axis=1), 0.0, b)
    determinant = a * c - b * b
    determinant = np.where(determinant == 0.0, np.inf, determinant)[:, None]
    first = (c[:, None] * right[:, 0] - b[:, None] * right[:, 1]) / determinant
    other = (a[:, None] * right[:, 1] - b[:, None] * right[:, 0]) / determinant
    return np.where(stays[:, :, None], 0.0, np.stack([first, other], axis=1))
