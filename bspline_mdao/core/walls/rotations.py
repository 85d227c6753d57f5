"""Rotations of the neighbourhood of every point of a set when the points move: a smooth rotation per point.

Point i sees the vectors e to its neighbours and the areas a of the quads around it, before and (primed) after a move::

    M_i = sum_e e' (x) e / |e|^2 + sum_q a'_q (x) a_q / |a_q|^2,        M_i = R_i S_i, S_i symmetric,

and R_i, the rotation nearest to M_i, is its rotation. A rigid motion of the points gives M = R A with the symmetric
matrix A of the points at rest, hence R to round-off. Each edge counts the same however long it is, so spacings of 1e-3
by 1 do not matter. Quads determine which way a surface faces: both sides of a thin plate, whose areas cancel as
vectors, add up as products. The scales ``|e|^2`` and ``|a|^2`` are taken from the baseline and stay, so M is linear in
the points before and in the edges and areas after the move.

Points of tied periodic sides also see what their copies see (`.tied_sums`). `rotation_group` finds R, and its
derivative.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numba import njit
from scipy.sparse import coo_array, csr_array

from ...base.numerics.rotation_group import nearest_rotations, rotation_changes
from ...base.numerics.threads import run_tasks, thread_count
from ...errors import InputError, MovementError
from ...grids.topology.node_numbering import each_once
from ...grids.topology.periodic_ties import Ties
from .planes import MirrorMeans
from .tied_sums import TiedSums

__all__ = ["LocalRotations", "Rotations"]

MOVES = ("initial", "moved", "normals")
"""Inputs of rotations: points before and after the move, and normals of planes after it."""

CHUNK_POINTS = 2**11
"""Points per piece of work: about 1 ms, long compared with the start of a thread."""

NO_LENGTH = 1e-10
"""Edges much shorter than this fraction of the size of the set do not count: only round-off turns them."""

NO_SPREAD = 1e-6
"""Second eigenvalue of the matrix of a point at rest, relative to the first, below which the point sees only one
direction and no rotation is determined: it then also takes what its neighbours see."""


@dataclass(frozen=True, eq=False)
class LocalRotations:
    """Rotation of each point's neighbourhood as a smooth function of the points. Made by `LocalRotations.of`.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> rotations = LocalRotations.of(square, quads=np.array([[0, 1, 2, 3]]))
    >>> quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    >>> np.abs(rotations.at(square, square @ quarter.T).matrices - quarter).max() < 1e-15
    np.True_
    """

    starts: np.ndarray  # int (n + 1,), first neighbour of each point
    neighbours: np.ndarray  # int32 (n_sides,), the other end of each edge of each point
    scales: np.ndarray  # (n_sides,), 1 / squared length of each of these edges on the baseline
    quads: np.ndarray  # int32 (n_quads, 4), corners of the quads in order
    quad_scales: np.ndarray  # (n_quads,), 1 / squared area of each on the baseline; 0 for one without area
    # int (n + 1,) and (4 n_quads,), first corner at each point, and the corners: four times the number of the quad plus
    # the number of its corner
    corner_starts: np.ndarray
    corners: np.ndarray
    mix: csr_array | None = None  # weights of the neighbours' matrices for points that see only one direction
    planes: tuple[tuple[np.ndarray, np.ndarray], ...] = ()  # of int, points in each plane of symmetry, and unit normal
    fixed: np.ndarray | None = None  # of int, points that never turn
    tied: TiedSums | None = None  # points that are the same up to a motion
    n_threads: int | None = None  # None stands for ``NUMBA_NUM_THREADS``; results do not depend on it

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n, 3), the points on the baseline (m)
        # (n_edges, 2) of int, pairs of neighbours, in any order; edges without length do not count, nor does a repeated
        # edge
        edges: np.ndarray | None = None,
        # (n_quads, 4) of int, corners of quads in order; their sides are edges. A point may be several corners.
        quads: np.ndarray | None = None,
        # sequence of (ndarray of int, ndarray of shape (3,)), points in a plane of symmetry, and its normal; they also
        # see the mirror image of what they see. Planes that share points must be at right angles. If a plane itself
        # moves, give `at` its normal.
        planes: Sequence[tuple[np.ndarray, np.ndarray]] = (),
        fixed: np.ndarray | None = None,  # of int, points that must not turn
        ties: Ties | None = None,  # points of periodic sides, which turn as their copies do
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
    ) -> LocalRotations:  # points without neighbours and quads never turn
        """Find the neighbours and the quads of every point."""
        points = np.ascontiguousarray(points, dtype=float)
        n = len(points)
        quads = _numbers(quads, 4, n, "quads")
        edges = _numbers(edges, 2, n, "edges")
        sides = [quads[:, [k, (k + 1) % 4]] for k in range(4)]
        starts, neighbours, scales = _neighbours(points, np.concatenate([edges, *sides]))
        tied = TiedSums(ties) if ties is not None and len(ties) else None
        fractions = np.ones(len(scales)) if tied is None else tied.fractions(starts, neighbours, _size(points))
        corner_starts, corners = _corners(quads, n)
        quad_scales = _quad_scales(points, quads)
        planes = tuple((np.asarray(ids), np.asarray(p, dtype=float) / np.linalg.norm(p)) for ids, p in planes)
        fixed = np.empty(0, dtype=int) if fixed is None else np.asarray(fixed)
        made = cls(
            starts,
            neighbours,
            scales * fractions,
            quads.astype(np.int32),
            quad_scales,
            corner_starts,
            corners,
            planes=planes,
            fixed=fixed,
            tied=tied,
            n_threads=n_threads,
        )
        mix, lost = made._neighbour_mix(points, fractions)
        return cls(**{**vars(made), "mix": mix, "fixed": np.union1d(fixed, lost)})

    @property
    def n_points(self) -> int:
        """Number of points."""
        return len(self.starts) - 1

    def at(
        self,
        initial: np.ndarray,  # initial, moved: (n, 3), points before and after the move (m); real or complex
        moved: np.ndarray,
        # (n_planes, 3), unit normals of the planes of symmetry after the move; by default they stay
        normals: np.ndarray | None = None,
    ) -> Rotations:
        """Rotations of a move."""
        initial, moved = self._checked(initial, "points before the move"), self._checked(moved, "points after the move")
        areas = self.areas(initial), self.areas(moved)
        matrices = self._moments(initial, moved, *areas)
        mirrored = MirrorMeans.of(self.planes, normals, matrices)
        matrices[self.fixed] = np.eye(3)
        stiffness, is_fine = np.empty_like(matrices), np.empty(self.n_points, dtype=np.bool_)
        self.over_points(nearest_rotations, matrices, stiffness, is_fine)
        if not is_fine.all():
            lost = int(np.argmin(is_fine))
            place = ", ".join(f"{x:.6g}" for x in moved[lost].real)
            raise MovementError(
                f"the surroundings of point {lost} at ({place}) m are turned inside out by the move; move less"
            )
        return Rotations(self, initial, moved, areas, matrices, stiffness, mirrored)

    def _checked(self, points: np.ndarray, what: str) -> np.ndarray:
        points = np.asarray(points)
        if points.shape != (self.n_points, 3):
            raise InputError(f"rotations: {what} of shape {points.shape}; give shape ({self.n_points}, 3)")
        return np.ascontiguousarray(points, dtype=complex if np.iscomplexobj(points) else float)

    def areas(self, points: np.ndarray) -> np.ndarray:
        """Areas of the quads, shape (n_quads, 3)."""
        areas = np.empty((len(self.quads), 3), dtype=points.dtype)
        _area_vectors(points, self.quads, areas)
        return areas

    def areas_jvp(self, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the areas of the quads, shape (n_quads, 3)."""
        d_areas = np.empty((len(self.quads), 3), dtype=np.result_type(points, d_points))
        _area_vectors_jvp(points, d_points, self.quads, d_areas)
        return d_areas

    def add_areas_vjp(self, points: np.ndarray, areas_bar: np.ndarray, points_bar: np.ndarray) -> None:
        """Add the transpose of `areas_jvp` to ``points_bar``, shape (n, 3)."""
        _add_area_vjp(points, self.quads, areas_bar, points_bar)

    def _moments(
        self, initial: np.ndarray, moved: np.ndarray, initial_areas: np.ndarray, moved_areas: np.ndarray
    ) -> np.ndarray:
        """Sum up M of every point, shape (n, 3, 3): linear in the points before and in the points after the move."""
        sums = np.empty((self.n_points, 3, 3), dtype=np.result_type(initial, moved))
        graph = self.starts, self.neighbours, self.scales, self.corner_starts, self.corners, self.quad_scales
        self.over_points(_moments, *graph, initial, moved, initial_areas, moved_areas, sums)
        return self._with_neighbours(sums, self.mix)

    def _alike(self, matrices: np.ndarray) -> np.ndarray:
        """Matrices that include what copies see; its own transpose."""
        return matrices if self.tied is None else self.tied.of(matrices)

    def _moments_transposed(
        self,
        bar: np.ndarray,  # (n, 3, 3), one matrix per point
        points: np.ndarray,  # points, areas: (n, 3) and (n_quads, 3), points and areas of the other side
        areas: np.ndarray,
        asked: np.ndarray,  # (n, 3), points of the side to differentiate in
        transposed: bool,  # whether this side is the one before the move
    ) -> np.ndarray:
        """Derivative of ``sum(bar M)`` with respect to the points after the move, or before it, shape (n, 3)."""
        if self.mix is not None:
            bar = bar + (self.mix.T @ self._alike(bar).reshape(-1, 9)).reshape(-1, 3, 3)
        bar = self._alike(bar)
        bar = np.ascontiguousarray(bar.transpose(0, 2, 1) if transposed else bar)
        pulls = np.empty((len(self.quads), 2, 3), dtype=np.result_type(bar, asked, points))
        _diagonal_pulls(bar, self.quads, self.quad_scales, areas, asked, pulls)
        out = np.empty((self.n_points, 3), dtype=pulls.dtype)
        graph = self.starts, self.neighbours, self.scales, self.corner_starts, self.corners
        self.over_points(_gather, *graph, bar, points, pulls, out)
        return out

    def _with_neighbours(self, matrices: np.ndarray, mix: csr_array | None) -> np.ndarray:
        """Add the matrices of copies, and the matrices of neighbours for the points that need them."""
        matrices = self._alike(matrices)
        return matrices if mix is None else matrices + self._alike((mix @ matrices.reshape(-1, 9)).reshape(-1, 3, 3))

    def _neighbour_mix(self, points: np.ndarray, fractions: np.ndarray) -> tuple[csr_array | None, np.ndarray]:
        """Weights of neighbours for points that see only one direction, and points that still see no more."""
        areas = self.areas(points)
        seen = self._moments(points, points, areas, areas)
        alone = _is_alone(seen)
        if not alone.any():
            return None, np.flatnonzero(alone)
        ends = np.repeat(np.arange(self.n_points), np.diff(self.starts))
        is_asked = alone[ends]
        pairs = ends[is_asked], self.neighbours[is_asked]
        mix = coo_array((fractions[is_asked], pairs), shape=(self.n_points, self.n_points)).tocsr()
        seen = seen + self._alike((mix @ seen.reshape(-1, 9)).reshape(-1, 3, 3))
        MirrorMeans.of(self.planes, None, seen)
        return mix, np.flatnonzero(_is_alone(seen))

    def over_points(self, kernel: Callable[..., None], *arguments: Any) -> None:
        """Call a kernel with its arguments and each piece of the points: its first one, and the one after its last."""
        cuts = [*range(0, self.n_points, CHUNK_POINTS), self.n_points]
        run_tasks(partial(kernel, *arguments), list(zip(cuts, cuts[1:])), thread_count(self.n_threads))


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotations of one move, and their derivative.

    Parameters
    ----------
    of : LocalRotations
        Neighbours and quads of every point.
    initial, moved : ndarray, shape (n, 3)
        Points before and after the move.
    areas : tuple of two ndarray of shape (n_quads, 3)
        Areas of the quads before and after the move.
    matrices : ndarray, shape (n, 3, 3)
        The rotations.
    stiffness : ndarray, shape (n, 3, 3)
        ``tr(S) I - S`` of every point.
    mirrored : MirrorMeans
        Means of mirror images for points in planes of symmetry.
    """

    of: LocalRotations
    initial: np.ndarray
    moved: np.ndarray
    areas: tuple[np.ndarray, np.ndarray]
    matrices: np.ndarray
    stiffness: np.ndarray
    mirrored: MirrorMeans

    def jvp(self, d_initial: np.ndarray | None, d_moved: np.ndarray, d_normals: np.ndarray | None = None) -> np.ndarray:
        """Change of the rotations, shape (n, 3, 3).

        Parameters
        ----------
        d_initial, d_moved : ndarray, shape (n, 3)
            Change of the points before and after the move; None for no change before.
        d_normals : ndarray, shape (n_planes, 3), optional
            Change of the normals of the planes after the move.
        """
        of, (initial_areas, moved_areas) = self.of, self.areas
        d_moved = of._checked(d_moved, "change of the points after the move")
        change = of._moments(self.initial, d_moved, initial_areas, of.areas_jvp(self.moved, d_moved))
        if d_initial is not None:
            d_initial = of._checked(d_initial, "change of the points before the move")
            change += of._moments(d_initial, self.moved, of.areas_jvp(self.initial, d_initial), moved_areas)
        self.mirrored.jvp(change, d_normals)
        change[of.fixed] = 0.0
        of.over_points(rotation_changes, self.matrices, self.stiffness, change)
        return change

    def vjp(self, bar: np.ndarray, wrt: Collection[str] = MOVES) -> dict[str, np.ndarray]:
        """Transpose of `jvp`.

        Parameters
        ----------
        bar : ndarray, shape (n, 3, 3)
            Derivative of a scalar with respect to the rotations.
        wrt : collection of str
            Which derivatives: with respect to the points before the move, ``initial``, and after it, ``moved``, both of
            shape (n, 3), and to the ``normals`` of the planes after it, shape (n_planes, 3).
        """
        back, normals_bar = self._back(bar)
        bars, transposed = {"normals": normals_bar}, self.of._moments_transposed
        if "initial" in wrt:
            bars["initial"] = transposed(back.copy(), self.moved, self.areas[1], self.initial, True)
        if "moved" in wrt:
            bars["moved"] = transposed(back, self.initial, self.areas[0], self.moved, False)
        return {name: bars[name] for name in wrt}

    def _back(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the scalar with respect to M, shape (n, 3, 3), and to the normals."""
        bar = np.array(bar, dtype=np.result_type(bar, self.matrices), order="C")
        if bar.shape != self.matrices.shape:
            raise InputError(f"rotations: derivatives of shape {bar.shape}; give shape {self.matrices.shape}")
        self.of.over_points(rotation_changes, self.matrices, self.stiffness, bar)
        bar[self.of.fixed] = 0.0
        return bar, self.mirrored.vjp(bar)


def _numbers(ids: np.ndarray | None, n_columns: int, n: int, what: str) -> np.ndarray:
    """Numbers of points, shape (m, n_columns)."""
    ids = np.empty((0, n_columns), dtype=np.int64) if ids is None else np.asarray(ids)
    if ids.ndim != 2 or ids.shape[1] != n_columns or not np.issubdtype(ids.dtype, np.integer):
        raise InputError(f"rotations: {what} of shape {ids.shape}; give integers of shape (m, {n_columns})")
    if ids.size and not 0 <= ids.min() <= ids.max() < n:
        raise InputError(f"rotations: {what} number points from {ids.min()} to {ids.max()}; there are {n}")
    return ids.astype(np.int64)


def _neighbours(points: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First neighbour of every point, the numbers of the neighbours, each once, and the scales of the edges."""
    n = len(points)
    ends = np.concatenate([edges, edges[:, ::-1]])
    keys = each_once((ends[:, 0] * n + ends[:, 1])[ends[:, 0] != ends[:, 1]])
    ends = np.stack([keys // n, keys % n], axis=1)
    squares = np.sum((points[ends[:, 1]] - points[ends[:, 0]]) ** 2, axis=1)
    negligible = (NO_LENGTH * _size(points)) ** 2
    scales = np.divide(squares, (squares + negligible) ** 2, out=np.zeros(len(ends)), where=squares > 0.0)
    starts = np.searchsorted(ends[:, 0], np.arange(n + 1))
    return starts, ends[:, 1].astype(np.int32), scales


def _corners(quads: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """First corner at every point, and the corners: four times the number of the quad plus the corner's."""
    order = np.argsort(quads.ravel(), kind="stable")
    return np.searchsorted(quads.ravel()[order], np.arange(n + 1)), order


def _quad_scales(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """1 / squared areas; 0 for quads that have none."""
    x = points[quads]
    diagonals = x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]
    area = np.linalg.norm(0.5 * np.cross(*diagonals), axis=1)
    lengths = [np.linalg.norm(d, axis=1) for d in diagonals]
    least = NO_LENGTH * np.maximum(*lengths) * np.maximum(np.maximum(*lengths), _size(points))
    return np.divide(1.0, area**2, out=np.zeros(len(quads)), where=area > least)


def _size(points: np.ndarray) -> float:
    """Diagonal of the box."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def _is_alone(matrices: np.ndarray) -> np.ndarray:
    """Whether a matrix at rest has one direction or none, so no rotation is nearest."""
    second, first = np.linalg.eigvalsh(matrices)[:, 1:].T
    return ~(second > NO_SPREAD * np.maximum(first, 1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _area_vectors(points, quads, areas):
    for q in range(len(quads)):
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        _set_half_cross(areas, q, _between(points, a, c), _between(points, b, d))


@njit(cache=True, nogil=True, error_model="numpy")
def _area_vectors_jvp(points, d_points, quads, d_areas):
    for q in range(len(quads)):
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        u, v = _between(points, a, c), _between(points, b, d)
        s, t = _between(d_points, a, c), _between(d_points, b, d)
        d_areas[q, 0] = 0.5 * (s[1] * v[2] - s[2] * v[1] + u[1] * t[2] - u[2] * t[1])
        d_areas[q, 1] = 0.5 * (s[2] * v[0] - s[0] * v[2] + u[2] * t[0] - u[0] * t[2])
        d_areas[q, 2] = 0.5 * (s[0] * v[1] - s[1] * v[0] + u[0] * t[1] - u[1] * t[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _between(points, i, j):
    """Vector from one point to another."""
    return points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _set_half_cross(out, n, u, v):
    """Write half the cross product of two vectors to row n."""
    out[n, 0] = 0.5 * (u[1] * v[2] - u[2] * v[1])
    out[n, 1] = 0.5 * (u[2] * v[0] - u[0] * v[2])
    out[n, 2] = 0.5 * (u[0] * v[1] - u[1] * v[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _add_product(m, scale, u, v):
    """``m += scale u (x) v``."""
    for r in range(3):
        m[r, 0] += scale * u[r] * v[0]
        m[r, 1] += scale * u[r] * v[1]
        m[r, 2] += scale * u[r] * v[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _moments(
    starts, neighbours, scales, corner_starts, corners, quad_scales, before, after, areas, new_areas, sums, piece
):
    for i in range(piece[0], piece[1]):
        m = sums[i]
        for d in range(9):
            m[d // 3, d % 3] = 0.0
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            _add_product(m, scales[k], _between(after, i, j), _between(before, i, j))
        for k in range(corner_starts[i], corner_starts[i + 1]):
            q = corners[k] // 4
            u, v = new_areas[q], areas[q]
            _add_product(m, quad_scales[q], (u[0], u[1], u[2]), (v[0], v[1], v[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def _diagonal_pulls(bar, quads, quad_scales, areas, asked, pulls):
    """Derivatives with respect to the two diagonals of every quad, through its area."""
    for q in range(len(quads)):
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        x, y, z = 0.0, 0.0, 0.0
        u, v, w = areas[q, 0] * quad_scales[q], areas[q, 1] * quad_scales[q], areas[q, 2] * quad_scales[q]
        for corner in (a, b, c, d):
            m = bar[corner]
            x += m[0, 0] * u + m[0, 1] * v + m[0, 2] * w
            y += m[1, 0] * u + m[1, 1] * v + m[1, 2] * w
            z += m[2, 0] * u + m[2, 1] * v + m[2, 2] * w
        p = (x, y, z)
        _set_half_cross(pulls[q], 0, _between(asked, b, d), p)
        _set_half_cross(pulls[q], 1, p, _between(asked, a, c))


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(starts, neighbours, scales, corner_starts, corners, bar, points, pulls, out, piece):
    """Sum up what edges and quads pull at every point; an edge is seen from both ends."""
    for i in range(piece[0], piece[1]):
        x, y, z = 0.0, 0.0, 0.0
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            u, v, w = _between(points, j, i)
            m, n, s = bar[i], bar[j], scales[k]
            x += s * ((m[0, 0] + n[0, 0]) * u + (m[0, 1] + n[0, 1]) * v + (m[0, 2] + n[0, 2]) * w)
            y += s * ((m[1, 0] + n[1, 0]) * u + (m[1, 1] + n[1, 1]) * v + (m[1, 2] + n[1, 2]) * w)
            z += s * ((m[2, 0] + n[2, 0]) * u + (m[2, 1] + n[2, 1]) * v + (m[2, 2] + n[2, 2]) * w)
        for k in range(corner_starts[i], corner_starts[i + 1]):
            q, corner = corners[k] // 4, corners[k] % 4
            sign = 1.0 if corner >= 2 else -1.0
            pull = pulls[q, corner % 2]
            x, y, z = x + sign * pull[0], y + sign * pull[1], z + sign * pull[2]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _add_area_vjp(points, quads, areas_bar, points_bar):
    """Add derivatives with respect to the corners of quads, from those with respect to their areas."""
    pulls = np.empty_like(points_bar[:2])
    for q in range(len(quads)):
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        p = areas_bar[q, 0], areas_bar[q, 1], areas_bar[q, 2]
        _set_half_cross(pulls, 0, _between(points, b, d), p)
        _set_half_cross(pulls, 1, p, _between(points, a, c))
        for e in range(3):
            points_bar[a, e] -= pulls[0, e]
            points_bar[c, e] += pulls[0, e]
            points_bar[b, e] -= pulls[1, e]
            points_bar[d, e] += pulls[1, e]
