"""Maps that shift whole sections, by what slopes add up to along the axis as it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from .hung_rows import HungRows
from .stations import StationSpline
from .variable import MapPartials, rates_of

__all__ = ["ShiftMap"]


@dataclass(frozen=True, eq=False)
class ShiftMap:
    """Shift sections in one direction by the integral of a slope along the axis, from its first point on.

    The slope is interpolated between stations. Over the segment i of the axis it has the mean ``sum_k B_ik m_k``, which
    counts for the length ``l_i`` of the segment along its path ``g_i`` as it is. Points of the axis move in the
    direction d by the sums up to them, and rows as the axis at their stations, with weights W:
    ``x_p + d sum_qi W_pq [i < q] l_i B_ik m_k``. So sections keep hanging where they are.

    Parameters
    ----------
    neutral : float
        Value at which the slope is none.
    hung : HungRows
        Where the rows hang.
    direction : ndarray, shape (3,)
        In which sections are shifted.
    paths : ndarray, shape (n_axis - 1, 3)
        Unit vector for every segment of the axis, along which its length counts.
    spline : StationSpline
        Between the values.
    slopes : callable
        Slopes, shape (n_values,), of values; complex-safe, one by one.
    """

    neutral: float
    hung: HungRows
    direction: np.ndarray
    paths: np.ndarray
    spline: StationSpline
    slopes: Callable[[np.ndarray], np.ndarray]

    @property
    def initial(self) -> np.ndarray:
        """Neutral values."""
        return np.full(self.spline.n_values, self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        shifts = self._sums @ (self._lengths(points) * (self._means @ self.slopes(values)))
        return points + shifts[:, None] * self.direction

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        rates = rates_of(self.slopes, values)
        by_values = self._sums @ (self._lengths(points)[:, None] * self._means * rates)
        by_points = (self._sums * (self._means @ self.slopes(values))) @ self._steps
        return MapPartials(self._of_points(by_points), self._matrix(by_values, self._values_felt))

    def _lengths(self, points):
        return np.sum(np.diff(points[self.hung.axis_rows], axis=0) * self.paths, axis=1)

    @cached_property
    def _means(self) -> np.ndarray:
        """Mean influence of every value over every segment, shape (n_axis - 1, n_values)."""
        knots = self.hung.knots
        return np.diff(self.spline.integral(knots), axis=0) / np.diff(knots)[:, None]

    @cached_property
    def _sums(self) -> np.ndarray:
        """How much of the slope over every segment reaches every row, shape (n_rows, n_axis - 1)."""
        n = len(self.hung.knots)
        return self.hung.weights @ np.tri(n, n - 1, -1)

    @cached_property
    def _steps(self) -> np.ndarray:
        """Derivatives of the lengths of segments by the points of the axis, shape (n_axis - 1, 3 n_axis)."""
        n = len(self.hung.knots)
        differences = np.eye(n)[1:] - np.eye(n)[:-1]
        return (differences[:, :, None] * self.paths[:, None]).reshape(n - 1, 3 * n)

    @cached_property
    def _values_felt(self) -> np.ndarray:
        return (self._sums != 0.0) @ (self._means != 0.0)

    @cached_property
    def _points_felt(self) -> np.ndarray:
        return (self._sums != 0.0) @ (self._steps != 0.0)

    def _of_points(self, rates) -> csr_array:
        """Derivative of the rows by the rows, of that of the shifts by the points of the axis."""
        shifts = self._matrix(rates, self._points_felt).tocoo()
        columns = (3 * self.hung.axis_rows[:, None] + np.arange(3)).ravel()
        n = shifts.shape[0]
        data = np.concatenate([np.ones(n), shifts.data])
        rows, columns = np.append(np.arange(n), shifts.row), np.append(np.arange(n), columns[shifts.col])
        return csr_array((data, (rows, columns)), shape=(n, n))

    def _matrix(self, rates, felt) -> csr_array:
        """Displacements of shifts whose rates (n_rows, n) may differ from zero where they are felt."""
        coordinates = np.flatnonzero(self.direction)
        shifted, by = np.nonzero(felt)
        data = rates[shifted, by][:, None] * self.direction[coordinates]
        rows, columns = 3 * shifted[:, None] + coordinates, np.repeat(by, len(coordinates))
        return csr_array((data.ravel(), (rows.ravel(), columns)), shape=(3 * len(rates), rates.shape[1]))
