"""Rotations of the layer at a wall: the rotations of its neighbourhood, corrected to keep heights above the wall.

A rotation keeps the height of a point above a wall if it turns the wall's normal with the wall. It cannot if the normal
may not turn freely, in a plane of symmetry that the wall meets at another angle after the move, or if there are two
normals, on an edge whose angle changes. So the matrix G of a point is the matrix nearest to its rotation R that takes
the unit normals n' of the sides of the wall there back to the normals n on the baseline::

    G minimises  sum_s w_s |G^T n'_s - n_s|^2 + E |G - R|^2,  or
    (sum_s w_s n'_s (x) n'_s + E I) G = sum_s w_s n'_s (x) n_s + E R,

so the height (G d) . n' of a point at d is d . n. A *side* is a part of the wall with one normal at each of its points:
the sum of the areas of its quads around the point. Every face is a side. A face that is folded upon itself, as in a
C-grid at a sharp trailing edge, is two sides. The weight w is the ratio of the squared length of the sum to the squared
sum of the lengths on the baseline. In a plane of symmetry, only the component of a normal along the plane counts. Where
nothing is bent, G is R.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.numerics.rotation_group import cofactors
from ...errors import InputError
from .rotations import MOVES, LocalRotations, Rotations
from .settings import LAYER, LayerSettings

__all__ = ["Frames", "WallFrames"]

KNIFE_EDGE = 1e-6
"""Length of the summed areas around a point, relative to the sum of their lengths, below which there is no normal:
areas that cancel leave round-off."""


@dataclass(frozen=True, eq=False)
class WallFrames:
    """Matrices that turn the layer above each node of a wall. Made by `WallFrames.of`."""

    rotations: LocalRotations  # rotations of the neighbourhood
    first_sides: np.ndarray  # (n + 1,) of int, first side at each node
    starts: np.ndarray  # (n_sides + 1,) of int, first corner of each side at its node
    corners: np.ndarray  # (n_corners,) of int, four times the number of each corner's quad plus its place in the quad
    weights: np.ndarray  # (n_sides,), weight w of each side's normal
    # (n_sides,), squares of negligible areas, added to the squared lengths of normals to avoid division by zero
    least_squares: np.ndarray
    in_planes: tuple[np.ndarray, ...] = ()  # of int, sides at the nodes in each of the rotations' planes
    rotation_weight: float = LAYER.rotation_weight  # E

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n, 3), nodes of the wall on the baseline (m)
        quads: np.ndarray,  # (n_quads, 4) of int, corners of its quads in order, around the normal into the fluid
        # sequence of (ndarray of int, ndarray of shape (3,)), nodes in planes that they must stay in, and the planes'
        # normals
        planes: Sequence[tuple[np.ndarray, np.ndarray]] = (),
        fixed: np.ndarray | None = None,  # of int, nodes that never turn
        # (n_quads,) of int, number of the face that each quad belongs to; one face by default
        faces: np.ndarray | None = None,
        # number of threads; by default ``NUMBA_NUM_THREADS``. Results do not depend on it.
        n_threads: int | None = None,
        settings: LayerSettings = LAYER,
    ) -> WallFrames:
        """Find the neighbours, the quads and the sides at every node."""
        rotations = LocalRotations.of(points, quads=quads, planes=planes, fixed=fixed, n_threads=n_threads)
        faces = np.zeros(len(rotations.quads), dtype=np.int64) if faces is None else np.asarray(faces)
        if faces.shape != (len(rotations.quads),):
            raise InputError(f"wall layer: faces of shape {faces.shape}; give shape ({len(rotations.quads)},)")
        at = np.repeat(np.arange(len(points)), np.diff(rotations.corner_starts))
        corners, areas = rotations.corners, rotations.areas(np.ascontiguousarray(points, dtype=float))
        order = np.lexsort((faces[corners // 4], at))
        starts = _group_starts(at[order], faces[corners[order] // 4])
        is_back = _is_back(starts, corners[order], areas, settings.folded)
        again = np.lexsort((is_back, faces[corners[order] // 4], at[order]))
        corners, at, is_back = corners[order][again], at[order][again], is_back[again]
        starts = _group_starts(at, faces[corners // 4], is_back)
        first_sides = np.searchsorted(at[starts[:-1]], np.arange(len(points) + 1))
        areas = np.concatenate([areas[corners // 4], np.zeros((1, 3))])
        total = np.add.reduceat(np.linalg.norm(areas, axis=1), starts)[:-1]
        squares = np.sum(np.add.reduceat(areas, starts, axis=0)[:-1] ** 2, axis=1)
        weights = np.divide(squares, total**2, out=np.zeros(len(total)), where=total > 0.0)
        weights[weights < KNIFE_EDGE**2] = 0.0
        in_planes = tuple(np.flatnonzero(np.isin(at[starts[:-1]], ids)) for ids, _ in rotations.planes)
        least_squares = KNIFE_EDGE**2 * np.maximum(squares, 1e-300)  # 1e-300: a side may have no area
        sides = first_sides, starts, corners, weights, least_squares, in_planes
        return cls(rotations, *sides, settings.rotation_weight)

    def at(
        self,
        initial: np.ndarray,  # initial, moved: (n, 3), nodes before and after the move (m); real or complex
        moved: np.ndarray,
        normals: np.ndarray | None = None,  # (n_planes, 3), unit normals of planes after it; by default they stay
    ) -> Frames:
        """Matrices of a move."""
        rotations = self.rotations.at(initial, moved, normals)
        at_rest = np.reshape([normal for _, normal in self.rotations.planes], (-1, 3))
        planes = at_rest, at_rest if normals is None else np.asarray(normals)
        before, after = (_Normals.of(self, areas, planes) for areas, planes in zip(rotations.areas, planes))
        stiffness = self._products(after.vectors, after.vectors) + self.rotation_weight * np.eye(3)
        matrices = self._products(after.vectors, before.vectors) + self.rotation_weight * rotations.matrices
        self._solve(stiffness, matrices)
        matrices[self.rotations.fixed] = np.eye(3)
        return Frames(self, rotations, before, after, stiffness, matrices)

    def _sums(self, areas: np.ndarray) -> np.ndarray:
        """Areas of the sides at their nodes, shape (n_sides, 3)."""
        sums = np.empty((len(self.weights), 3), dtype=areas.dtype)
        _sum_areas(self.starts, self.corners, areas, sums)
        return sums

    def _products(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Sums of w u (x) v over the sides of every node, shape (n, 3, 3)."""
        sums = np.empty((self.rotations.n_points, 3, 3), dtype=np.result_type(u, v))
        self.rotations.over_points(_sum_products, self.first_sides, self.weights, u, v, sums)
        return sums

    def _solve(self, stiffness: np.ndarray, right: np.ndarray) -> None:
        """Solve for every node, overwriting the right-hand sides."""
        self.rotations.over_points(_solve, stiffness, right)


@dataclass(frozen=True, eq=False)
class _Normals:
    """Unit normals of the sides at their nodes, and their components along planes."""

    frames: WallFrames  # the sides
    units: np.ndarray  # (n_sides, 3), unit normals
    lengths: np.ndarray  # (n_sides,), lengths of the areas
    planes: np.ndarray  # (n_planes, 3), unit normals of the planes
    seen: tuple[np.ndarray, ...]  # vectors in each plane, before their component normal to it was removed
    vectors: np.ndarray  # (n_sides, 3), unit normals, without these components

    @classmethod
    def of(cls, frames: WallFrames, areas: np.ndarray, planes: np.ndarray) -> _Normals:
        """Make the normals from the areas of the quads, shape (n_quads, 3)."""
        units, lengths = frames._sums(areas), np.empty(len(frames.weights), dtype=areas.dtype)
        _normalise(units, frames.least_squares, lengths)
        vectors, seen = units.astype(np.result_type(units, planes)), []
        for ids, normal in zip(frames.in_planes, planes):
            seen.append(vectors[ids])
            vectors[ids] = seen[-1] - np.outer(seen[-1] @ normal, normal)
        return cls(frames, units, lengths, planes, tuple(seen), vectors)

    def jvp(self, d_areas: np.ndarray, d_planes: np.ndarray | None) -> np.ndarray:
        """Change of the vectors, shape (n_sides, 3)."""
        change = self.frames._sums(d_areas)
        _project_out(self.units, self.lengths, change)
        for k, ids in enumerate(self.frames.in_planes):
            normal, seen = self.planes[k], self.seen[k]
            part = change[ids] - np.outer(change[ids] @ normal, normal)
            if d_planes is not None:
                part = part - np.outer(seen @ normal, d_planes[k]) - np.outer(seen @ d_planes[k], normal)
            change[ids] = part
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`, overwrites ``bar``: derivatives with respect to areas, shape (n_quads, 3), and planes."""
        planes_bar = np.zeros((len(self.planes), 3), dtype=bar.dtype)
        for k in range(len(self.planes) - 1, -1, -1):
            ids, normal, seen = self.frames.in_planes[k], self.planes[k], self.seen[k]
            along = bar[ids] @ normal
            planes_bar[k] = -(bar[ids].T @ (seen @ normal) + seen.T @ along)
            bar[ids] -= np.outer(along, normal)
        _project_out(self.units, self.lengths, bar)
        areas_bar = np.zeros((len(self.frames.rotations.quads), 3), dtype=bar.dtype)
        _spread_areas(self.frames.starts, self.frames.corners, bar, areas_bar)
        return areas_bar, planes_bar


@dataclass(frozen=True, eq=False)
class Frames:
    """Matrices of one move, and their derivative."""

    of: WallFrames  # neighbours, quads and sides of every node
    rotations: Rotations  # rotations of the move
    # before, after: normals of the sides before and after the move
    before: _Normals
    after: _Normals
    stiffness: np.ndarray  # (n, 3, 3), matrices of the least squares problems
    matrices: np.ndarray  # (n, 3, 3), their solutions

    @property
    def initial(self) -> np.ndarray:
        """Nodes before the move, shape (n, 3)."""
        return self.rotations.initial

    @property
    def moved(self) -> np.ndarray:
        """Nodes after the move, shape (n, 3)."""
        return self.rotations.moved

    def jvp(
        self,
        # d_initial, d_moved: (n, 3), change of the nodes before and after the move; None for no change before
        d_initial: np.ndarray | None,
        d_moved: np.ndarray,
        d_normals: np.ndarray | None = None,  # (n_planes, 3), change of the normals of the planes after the move
    ) -> np.ndarray:
        """Change of the matrices, shape (n, 3, 3)."""
        of, before, after = self.of, self.before.vectors, self.after.vectors
        change = self.of.rotation_weight * self.rotations.jvp(d_initial, d_moved, d_normals)
        d_after = self.after.jvp(of.rotations.areas_jvp(self.moved, d_moved), d_normals)
        change += of._products(d_after, before)
        if d_initial is not None:
            change += of._products(after, self.before.jvp(of.rotations.areas_jvp(self.initial, d_initial), None))
        d_stiffness = of._products(d_after, after)
        of.rotations.over_points(_take_off, d_stiffness, self.matrices, change)
        of._solve(self.stiffness, change)
        change[of.rotations.fixed] = 0.0
        return change

    def vjp(self, bar: np.ndarray, wrt: Collection[str] = MOVES) -> dict[str, np.ndarray]:
        """Transpose of `jvp`, from shape (n, 3, 3): derivatives with respect to the nodes as in `Rotations.vjp`."""
        bar, before_bar, after_bar = self._back(bar)
        bars, of = self.rotations.vjp(bar, wrt), self.of.rotations
        areas_bar, normals_bar = self.after.vjp(after_bar)
        if "moved" in wrt:
            of.add_areas_vjp(self.moved, areas_bar, bars["moved"])
        if "normals" in wrt:
            bars["normals"] = normals_bar + bars["normals"]
        if "initial" in wrt:
            areas_bar, _ = self.before.vjp(before_bar)
            of.add_areas_vjp(self.initial, areas_bar, bars["initial"])
        return bars

    def _back(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives with respect to the rotations, shape (n, 3, 3), and the normals of the sides before and after."""
        of, before, after = self.of, self.before.vectors, self.after.vectors
        bar = np.array(bar, dtype=np.result_type(bar, self.matrices), order="C")
        if bar.shape != self.matrices.shape:
            raise InputError(f"wall layer: derivatives of shape {bar.shape}; give shape {self.matrices.shape}")
        bar[of.rotations.fixed] = 0.0
        of._solve(self.stiffness, bar)
        bars = np.empty((2, *before.shape), dtype=bar.dtype)
        numbers = of.first_sides, of.weights
        of.rotations.over_points(_pull_normals, *numbers, before, after, bar, self.matrices, *bars)
        return of.rotation_weight * bar, *bars


def _group_starts(*keys: np.ndarray) -> np.ndarray:
    """First index of every group of equal neighbouring keys, and the end."""
    is_first = np.concatenate([[True], np.any([key[1:] != key[:-1] for key in keys], axis=0)])[: len(keys[0])]
    return np.append(np.flatnonzero(is_first), len(keys[0]))


def _is_back(starts: np.ndarray, corners: np.ndarray, areas: np.ndarray, folded: float) -> np.ndarray:
    """Whether the quad of each corner faces away from the first one of its group."""
    first = areas[corners[np.repeat(starts[:-1], np.diff(starts))] // 4]
    second = areas[corners // 4]
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return np.sum(first * second, axis=1) < folded * lengths


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_areas(starts, corners, areas, sums):
    for s in range(len(sums)):
        x, y, z = 0.0, 0.0, 0.0
        for k in range(starts[s], starts[s + 1]):
            q = corners[k] // 4
            x, y, z = x + areas[q, 0], y + areas[q, 1], z + areas[q, 2]
        sums[s, 0], sums[s, 1], sums[s, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_areas(starts, corners, bars, areas_bar):
    """Transpose of `_sum_areas`."""
    for s in range(len(bars)):
        for k in range(starts[s], starts[s + 1]):
            for d in range(3):
                areas_bar[corners[k] // 4, d] += bars[s, d]


@njit(cache=True, nogil=True, error_model="numpy")
def _normalise(vectors, least_squares, lengths):
    for s in range(len(vectors)):
        x, y, z = vectors[s, 0], vectors[s, 1], vectors[s, 2]
        length = np.sqrt(x * x + y * y + z * z + least_squares[s])
        vectors[s, 0], vectors[s, 1], vectors[s, 2], lengths[s] = x / length, y / length, z / length, length


@njit(cache=True, nogil=True, error_model="numpy")
def _project_out(normals, lengths, change):
    """Turn changes of vectors into changes of their unit vectors, in place; its own transpose."""
    for s in range(len(normals)):
        along = normals[s, 0] * change[s, 0] + normals[s, 1] * change[s, 1] + normals[s, 2] * change[s, 2]
        for d in range(3):
            change[s, d] = (change[s, d] - normals[s, d] * along) / lengths[s]


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_products(first_sides, weights, u, v, sums, piece):
    for i in range(piece[0], piece[1]):
        for d in range(9):
            sums[i, d // 3, d % 3] = 0.0
        for s in range(first_sides[i], first_sides[i + 1]):
            for d in range(3):
                for e in range(3):
                    sums[i, d, e] += weights[s] * u[s, d] * v[s, e]


@njit(cache=True, nogil=True, error_model="numpy")
def _pull_normals(first_sides, weights, before, after, bar, matrices, before_bar, after_bar, piece):
    """Derivatives in the normals, from those in C = sum w after (x) before in B G = C + E R."""
    # With derivatives -bar G^T in B, the normals after the move get w (bar before - (bar G^T + G bar^T) after).
    for i in range(piece[0], piece[1]):
        x, g = bar[i], matrices[i]
        for s in range(first_sides[i], first_sides[i + 1]):
            n = after[s]
            for d in range(3):
                xn = x[0, d] * n[0] + x[1, d] * n[1] + x[2, d] * n[2]
                before_bar[s, d] = weights[s] * xn
            for d in range(3):
                total = 0.0 * n[0]
                for e in range(3):
                    turned = g[0, e] * n[0] + g[1, e] * n[1] + g[2, e] * n[2]
                    pulled = x[0, e] * n[0] + x[1, e] * n[1] + x[2, e] * n[2]
                    total += x[d, e] * (before[s, e] - turned) - g[d, e] * pulled
                after_bar[s, d] = weights[s] * total


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(stiffness, right, piece):
    """Solve symmetric 3 x 3 systems with three right-hand sides each, in place."""
    c, x = np.empty_like(stiffness[0]), np.empty_like(right[0])
    for i in range(piece[0], piece[1]):
        det = cofactors(stiffness[i], c)
        for d in range(3):
            for e in range(3):
                x[d, e] = (c[d, 0] * right[i, 0, e] + c[d, 1] * right[i, 1, e] + c[d, 2] * right[i, 2, e]) / det
        for d in range(9):
            right[i, d // 3, d % 3] = x[d // 3, d % 3]


@njit(cache=True, nogil=True, error_model="numpy")
def _take_off(half, matrices, right, piece):
    """``right -= (half + half^T) matrix``."""
    for i in range(piece[0], piece[1]):
        for d in range(3):
            for k in range(3):
                s = half[i, d, k] + half[i, k, d]
                for e in range(3):
                    right[i, d, e] -= s * matrices[i, k, e]
