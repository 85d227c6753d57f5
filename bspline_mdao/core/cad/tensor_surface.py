"""Tensor B-spline surfaces of sides of volumes: exact for straight knots, within a tolerance for curved ones.

1. Along its edges a side has constant knots. The surface starts from their union over opposite edges, and over edges of
   neighbours, so all four edges are exact, by knot insertion, and neighbours meet.
2. The interior control points come from least squares, on a lattice of parameters, with fixed edges.
3. If the distance at other parameters is larger than the tolerance, spans are halved: in the direction in which a
   projection on the splines of only that direction has too large an error.

Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...errors import InputError
from ..splines.basis import basis, basis_gradients
from ..splines.knot_insertion import insertion_matrix
from ..splines.knots import ConstantKnots
from ..splines.side import VolumeSide
from .side_knots import SideKnots

__all__ = ["MOST_CONTROL", "TensorSurface", "tensor_surface"]

SAME_KNOT = 1e-12
"""Knots closer than this are one."""

MOST_CONTROL = 400
"""Default number of control points in a direction at which a refit is given up."""

CHECKED = 2, 12
"""Number of parameters in a span, in addition to the order, at which the distance is measured: the first to halve
spans, the second to accept a surface."""

SURE = 0.95
"""Fraction of the tolerance allowed for the distance at these, so that points in between keep the tolerance."""

MARGIN = 0.5
"""Fraction of the tolerance allowed for the error in one direction, so that both together keep it."""


@dataclass(frozen=True, eq=False)
class TensorSurface(OneLine):
    """A B-spline surface with constant knots, and its distance from the side it represents."""

    knots: tuple[ConstantKnots, ConstantKnots]  # knots in u and v
    control_points: np.ndarray  # (N_u, N_v, 3), control points (m)
    error: float = 0.0  # largest distance to the side, at equal parameters (m)
    angle: float = 0.0  # largest angle between the normals of both, at equal parameters (deg)
    is_exact: bool = True  # whether it is the side itself, whose knots are straight

    def lattice(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points at all pairs of parameters, shape (n_u, n_v, 3)."""
        return _on_lattice(_design(self.knots[0], u), self.control_points, _design(self.knots[1], v))


def tensor_surface(
    side: VolumeSide,  # the side
    tolerance: float,  # largest distance (m) from it, if its knots are curved
    what: str,  # name of the side in messages
    most: int = MOST_CONTROL,  # control points in a direction at which a refit is given up
    known: SideKnots | None = None,  # knots to start from; without neighbours by default
) -> TensorSurface:
    """Make the surface of a side."""
    known = SideKnots.of(side) if known is None else known
    knots = known.start
    if side.is_straight:
        u, v = (insertion_matrix(known.edges[axis][0], knots[axis]) for axis in (0, 1))
        return _measured(side, TensorSurface(knots, _on_lattice(u, side.control_points, v)))
    while True:
        surface = _fitted(side, knots, known.edges)
        for more in CHECKED:
            samples = _Samples.of(side, knots, more)
            distances = lengths(surface.lattice(samples.u, samples.v) - samples.points)
            if distances.max() > SURE * tolerance:
                break
        else:
            return _measured(side, surface)
        marks = samples.too_coarse(knots, distances, tolerance)
        knots = _halved(knots[0], marks[0]), _halved(knots[1], marks[1])
        if max(k.n_control for k in knots) > most:
            raise InputError(
                f"{what}: {distances.max():.2g} m off with {surface.knots[0].n_control} x "
                f"{surface.knots[1].n_control} control points, more than the tolerance of {tolerance:.2g} m; raise it"
            )


def _breaks(knots: ConstantKnots) -> np.ndarray:
    return np.unique(knots.knots)


def _halved(knots: ConstantKnots, is_marked: np.ndarray) -> ConstantKnots:
    """Insert a knot in the middle of each marked span."""
    breaks = _breaks(knots)
    middles = 0.5 * (breaks[:-1] + breaks[1:])[is_marked]
    return ConstantKnots(np.sort(np.concatenate([knots.knots, middles])), knots.order)


def _design(knots: ConstantKnots, x: np.ndarray) -> np.ndarray:
    """Values of all basis functions at parameters, shape (n, N)."""
    spans, values = basis(knots, x)
    matrix = np.zeros((len(x), knots.n_control))
    matrix[np.arange(len(x))[:, None], spans[:, None] + np.arange(1 - knots.order, 1)] = values
    return matrix


def _slopes(knots: ConstantKnots, x: np.ndarray) -> np.ndarray:
    """Slopes of all basis functions at parameters, shape (n, N)."""
    at = np.zeros((len(x), 3))
    at[:, 0] = x
    spans, values = basis_gradients(knots, 0, at)
    matrix = np.zeros((len(x), knots.n_control))
    matrix[np.arange(len(x))[:, None], spans[:, None] + np.arange(1 - knots.order, 1)] = values[..., 1]
    return matrix


def _on_lattice(u: np.ndarray, control_points: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Sum of products of functions of u, shape (n_u, N_u), and v, shape (n_v, N_v)."""
    return np.tensordot(u, np.tensordot(control_points, v, axes=(1, 1)), axes=(1, 0)).transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Points of a side on a lattice of parameters, and the spans of the parameters."""

    u: np.ndarray
    v: np.ndarray
    points: np.ndarray
    spans: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, side: VolumeSide, knots: tuple[ConstantKnots, ConstantKnots], more: int) -> _Samples:
        """Take ``more`` parameters than the order in every span, including both ends of the side."""
        axes, spans = zip(*(cls._axis(k, k.order + more) for k in knots))
        grid = np.meshgrid(*axes, indexing="ij")
        points = side.points(*(x.ravel() for x in grid)).reshape(*grid[0].shape, 3)
        return cls(axes[0], axes[1], points, (spans[0], spans[1]))

    @staticmethod
    def _axis(knots: ConstantKnots, n: int) -> tuple[np.ndarray, np.ndarray]:
        breaks = _breaks(knots)
        inside = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)  # clustered at the ends of spans
        x = (breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel()
        spans = np.repeat(np.arange(len(breaks) - 1), n)
        return np.concatenate([[0.0], x, [1.0]]), np.concatenate([[0], spans, [len(breaks) - 2]])

    def too_coarse(
        self, knots: tuple[ConstantKnots, ConstantKnots], distances: np.ndarray, tolerance: float
    ) -> list[np.ndarray]:
        """Mark the spans of each direction in which splines of only this direction have too large an error."""
        marks = []
        for axis, (k, x) in enumerate(zip(knots, (self.u, self.v))):
            lines = np.moveaxis(self.points, axis, 0).reshape(len(x), -1)
            q = qr(_design(k, x), mode="economic")[0]
            missed = lengths((lines - q @ (q.T @ lines)).reshape(len(x), -1, 3)).max(axis=1)
            marks.append(self._any(axis, missed > MARGIN * tolerance))
        if not any(mark.any() for mark in marks):  # both directions together: halve where the distance is
            marks = [self._any(axis, distances.max(axis=1 - axis) > SURE * tolerance) for axis in (0, 1)]
        return marks

    def _any(self, axis: int, is_bad: np.ndarray) -> np.ndarray:
        return np.bincount(self.spans[axis], is_bad) > 0


def _fitted(
    side: VolumeSide,
    knots: tuple[ConstantKnots, ConstantKnots],
    edges: tuple[tuple[ConstantKnots, ConstantKnots], tuple[ConstantKnots, ConstantKnots]],
) -> TensorSurface:
    """Insert knots along the edges, and find the control points inside by least squares, steps 1 and 2."""
    samples, net = _Samples.of(side, knots, 1), side.control_points
    control = np.zeros((knots[0].n_control, knots[1].n_control, 3))
    for end in (0, -1):
        control[:, end] = insertion_matrix(edges[0][-end], knots[0]) @ net[:, end]
        control[end] = insertion_matrix(edges[1][-end], knots[1]) @ net[end]
    u, v = _design(knots[0], samples.u), _design(knots[1], samples.v)
    if min(control.shape[:2]) > 2:
        rest = samples.points - _on_lattice(u, control, v)
        half = _least_squares(u[:, 1:-1], rest.reshape(len(u), -1)).reshape(-1, len(v), 3)
        inside = _least_squares(v[:, 1:-1], half.swapaxes(0, 1).reshape(len(v), -1))
        control[1:-1, 1:-1] = inside.reshape(-1, len(half), 3).swapaxes(0, 1)
    return TensorSurface(knots, control, is_exact=False)


def _least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    q, r = qr(matrix, mode="economic")
    return solve_triangular(r, q.T @ right)


def _measured(side: VolumeSide, surface: TensorSurface) -> TensorSurface:
    """Measure the distance to the side and the angle between normals, at parameters not used by the fit."""
    samples = _Samples.of(side, surface.knots, 3)
    error = float(lengths(surface.lattice(samples.u, samples.v) - samples.points).max())
    grid = np.meshgrid(samples.u[1:-1], samples.v[1:-1], indexing="ij")
    gradients = side.gradients(*(x.ravel() for x in grid))
    ours = np.cross(gradients[..., 0], gradients[..., 1])
    bases = [(_design(k, x[1:-1]), _slopes(k, x[1:-1])) for k, x in zip(surface.knots, (samples.u, samples.v))]
    (u, du), (v, dv) = bases
    net = surface.control_points
    theirs = np.cross(_on_lattice(du, net, v), _on_lattice(u, net, dv)).reshape(-1, 3)
    sines, cosines = lengths(np.cross(ours, theirs)), np.sum(ours * theirs, axis=1)
    angle = float(np.degrees(np.arctan2(sines, cosines)).max())
    return TensorSurface(surface.knots, net, error, angle, surface.is_exact)
