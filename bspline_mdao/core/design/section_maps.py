"""Maps of wing sections: formulas for rotation, scaling and shear, and the resulting maps of points along an axis.

A named deformation applies a formula by one amount (`bspline_mdao.core.design.deformation`: `RotateSections`,
`ScaleChord`, `ScaleThickness`, `ShearDownstream`, `ShearUpwards`); a design variable by one amount per station along
an axis (`bspline_mdao.core.design.planform`: `Twist`, `Chord`, `ThicknessFactor`, `Taper`, `Sweep`, `Dihedral`), which
multiplies sections in their planes, `SectionMap`, or shifts whole sections, `ShiftMap`. All are complex-safe in the
amount. Theory: ``docs/theory/parametrization.rst`` and ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.sparse import csr_array

from .variable import MapPartials, rates_of

__all__ = [
    "SCALED_AFTER_TURN",
    "SectionMap",
    "ShiftMap",
    "along_vectors",
    "order_notes",
    "rotation",
    "scaling",
    "shear",
]

SCALED_AFTER_TURN = (
    "chord and thickness scale along fixed axes, so they change angles made before them; ask for them before twist, "
    "pitch, bend and rotate to keep these"
)
"""Note on deformations or variables that turn sections first and scale them then."""


def order_notes(
    # deformations or variables in order of application; ``turns`` are directions of the baseline, "stream" or "normal",
    # from which one turns sections away, ``scales`` those along which one scales them
    steps: Iterable[object],
) -> tuple[str, ...]:
    """Say if an order changes angles."""
    is_late = any(
        set(getattr(before, "turns", ())) & set(getattr(after, "scales", ()))
        for before, after in combinations(steps, 2)
    )
    return (SCALED_AFTER_TURN,) if is_late else ()


def rotation(
    angle: np.ndarray | float,  # ndarray, any shape, angles (rad)
) -> np.ndarray:  # (..., 2, 2)
    """Return matrices of stream and normal coordinates that rotate sections, upstream end up."""
    cos, sin = np.cos(angle), np.sin(angle)
    return _matrix(cos, sin, -sin, cos)


def scaling(stream: np.ndarray | float, normal: np.ndarray | float) -> np.ndarray:
    """Return matrices, shape (..., 2, 2), that scale stream and normal coordinates by factors of any shape."""
    stream, normal = np.broadcast_arrays(stream, normal)
    return _matrix(stream, 0.0 * stream, 0.0 * normal, normal)  # zeros that are complex if the factors are


def shear(angle: np.ndarray | float) -> np.ndarray:
    """Return the shift of sections per length of span for a shear angle (rad)."""
    return np.tan(angle)


def _matrix(a: np.ndarray | float, b: np.ndarray | float, c: np.ndarray | float, d: np.ndarray | float) -> np.ndarray:
    return np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)


@dataclass(frozen=True, eq=False)
class SectionMap:
    """Multiply positions in section planes, about the current axis, by a matrix with one amount per section."""

    # Row x with the axis point c, the axes E (2 x 3) of its section and the amount a moves to ``x + E^T (M(a) - 1) E (x
    # - c)``.

    neutral: float  # amount and value at which nothing moves
    # (n_rows, n_axis), which give the point of the axis at the station of every row
    weights: csr_array
    axis_rows: np.ndarray  # (n_axis,) of int, rows of the axis' own points
    axes: np.ndarray  # (n_rows, 2, 3), two orthonormal directions in the plane of each row's section
    spline: csr_array  # (n_rows, n_values), from values to amounts of sections, both less the neutral one
    # matrices, shape (n_rows, 2, 2), from amounts times the unit, shape (n_rows,); complex-safe
    formula: Callable[[np.ndarray], np.ndarray]
    unit: float = 1.0  # unit of the amounts, in the formula's

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return np.full(self.spline.shape[1], self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        changes = self._matrices(self._amounts(values)) - np.eye(2)
        return points + self._in_space(np.einsum("nij,nj->ni", changes, self._in_plane(points)))

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        amounts = self._amounts(values)
        changes = self.axes.swapaxes(1, 2) @ (self._matrices(amounts) - np.eye(2)) @ self.axes
        rates = rates_of(self._matrices, amounts)
        moved = self._in_space(np.einsum("nij,nj->ni", rates, self._in_plane(points)))
        return MapPartials(self._points_jacobian(changes), along_vectors(moved, self.spline))

    def _amounts(self, values: np.ndarray) -> np.ndarray:
        return self.neutral + self.spline @ (values - self.neutral)

    def _matrices(self, amounts: np.ndarray) -> np.ndarray:
        return self.formula(self.unit * amounts)

    def _in_plane(self, points: np.ndarray) -> np.ndarray:
        """Coordinates about the axis in the plane of the section, shape (n_rows, 2)."""
        return np.einsum("nij,nj->ni", self.axes, points - self.weights @ points[self.axis_rows])

    def _in_space(self, local: np.ndarray) -> np.ndarray:
        return np.einsum("nij,ni->nj", self.axes, local)

    def _points_jacobian(self, changes: np.ndarray) -> csr_array:
        """Derivative with respect to the row itself and to the points of the axis, from changes (n_rows, 3, 3)."""
        weights, n = self.weights.tocoo(), len(changes)
        influenced = np.concatenate([np.arange(n), weights.row])
        influences = np.concatenate([np.arange(n), self.axis_rows[weights.col]])
        d_axis = -weights.data[:, None, None] * changes[weights.row]
        data = np.concatenate([np.eye(3) + changes, d_axis])
        rows = np.broadcast_to(3 * influenced[:, None, None] + np.arange(3)[:, None], data.shape)
        columns = np.broadcast_to(3 * influences[:, None, None] + np.arange(3), data.shape)
        return csr_array((data.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, 3 * n))


def along_vectors(
    vectors: np.ndarray,
    amounts: csr_array,
) -> csr_array:  # (3 n_rows, n_values), xyz interleaved; entries that happen to be zero are kept
    """Displacements along a vector per row, shape (n_rows, 3), by amounts, shape (n_rows, n_values)."""
    entries = amounts.tocoo()
    data = vectors[entries.row] * entries.data[:, None]
    rows = 3 * entries.row[:, None] + np.arange(3)
    shape = 3 * amounts.shape[0], amounts.shape[1]
    return csr_array((data.ravel(), (rows.ravel(), np.repeat(entries.col, 3))), shape=shape)


@dataclass(frozen=True, eq=False)
class ShiftMap:
    """Shift sections in one direction by the integral of a slope along the axis, from its first point on."""

    # The slope is interpolated between stations. Over segment i of the axis it has the mean ``sum_k B_ik m_k``, which
    # multiplies the current length ``l_i`` of the segment along its path ``g_i``. Points of the axis move in the
    # direction d by the sums up to them, and rows like the axis at their stations, with weights W:
    # ``x_p + d sum_qi W_pq [i < q] l_i B_ik m_k``. So sections stay attached at their stations.

    neutral: float  # value at which the slope is zero
    # (n_rows, n_axis), which give the point of the axis at the station of every row
    weights: csr_array
    axis_rows: np.ndarray  # (n_axis,) of int, rows of the axis' own points
    direction: np.ndarray  # (3,), in which sections are shifted
    paths: np.ndarray  # (n_axis - 1, 3), unit vector for every segment of the axis, along which its length is measured
    means: np.ndarray  # (n_axis - 1, n_values), mean influence of every value over every segment
    # slopes, shape (n_values,), from values times the unit; complex-safe, elementwise
    formula: Callable[[np.ndarray], np.ndarray]
    unit: float = 1.0  # unit of the values, in the formula's

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return np.full(self.means.shape[1], self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        shifts = self._sums @ (self._lengths(points) * (self.means @ self._slopes(values)))
        return points + shifts[:, None] * self.direction

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        rates = rates_of(self._slopes, values)
        d_values = self._sums @ (self._lengths(points)[:, None] * self.means * rates)
        d_points = (self._sums * (self.means @ self._slopes(values))) @ self._steps
        return MapPartials(self._points_jacobian(d_points), self._matrix(d_values, self._influence_of_values))

    def _slopes(self, values: np.ndarray) -> np.ndarray:
        return self.formula(self.unit * values)

    def _lengths(self, points: np.ndarray) -> np.ndarray:
        return np.sum(np.diff(points[self.axis_rows], axis=0) * self.paths, axis=1)

    @cached_property
    def _sums(self) -> np.ndarray:
        """Weights of shape (n_rows, n_axis - 1) that sum the slopes over segments up to every row."""
        n = len(self.axis_rows)
        return self.weights @ np.tri(n, n - 1, -1)

    @cached_property
    def _steps(self) -> np.ndarray:
        """Derivatives of segment lengths with respect to the points of the axis, shape (n_axis - 1, 3 n_axis)."""
        n = len(self.axis_rows)
        differences = np.eye(n)[1:] - np.eye(n)[:-1]
        return (differences[:, :, None] * self.paths[:, None]).reshape(n - 1, 3 * n)

    @cached_property
    def _influence_of_values(self) -> np.ndarray:
        """Whether each row may depend on each value, shape (n_rows, n_values)."""
        return (self._sums != 0.0) @ (self.means != 0.0)

    @cached_property
    def _influence_of_points(self) -> np.ndarray:
        """Whether each row may depend on each coordinate of the axis, shape (n_rows, 3 n_axis)."""
        return (self._sums != 0.0) @ (self._steps != 0.0)

    def _points_jacobian(self, rates: np.ndarray) -> csr_array:
        """Derivative of the rows with respect to the rows, from the shifts' derivative with respect to the axis."""
        shifts = self._matrix(rates, self._influence_of_points).tocoo()
        columns = (3 * self.axis_rows[:, None] + np.arange(3)).ravel()
        n = shifts.shape[0]
        data = np.concatenate([np.ones(n), shifts.data])
        rows, columns = np.append(np.arange(n), shifts.row), np.append(np.arange(n), columns[shifts.col])
        return csr_array((data, (rows, columns)), shape=(n, n))

    def _matrix(self, rates: np.ndarray, influence: np.ndarray) -> csr_array:
        """Displacements from shift rates (n_rows, n), with entries wherever there may be an influence."""
        coordinates = np.flatnonzero(self.direction)
        shifted, sources = np.nonzero(influence)
        data = rates[shifted, sources][:, None] * self.direction[coordinates]
        rows, columns = 3 * shifted[:, None] + coordinates, np.repeat(sources, len(coordinates))
        return csr_array((data.ravel(), (rows.ravel(), columns)), shape=(3 * len(rates), rates.shape[1]))
