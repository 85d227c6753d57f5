"""Maps that change every section in its own plane, about the point of the axis that it hangs on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from .hung_rows import HungRows
from .variable import MapPartials, rates_of

__all__ = ["SectionMap", "along_vectors"]


@dataclass(frozen=True, eq=False)
class SectionMap:
    """Multiply places in the planes of sections, about the axis as it is, by a matrix of an amount per section.

    Row x with the axis point c, the axes E (2 x 3) of its section and the amount a moves to
    ``x + E^T (M(a) - 1) E (x - c)``.

    Parameters
    ----------
    neutral : float
        Amount, and value, at which nothing moves.
    hung : HungRows
        Where the rows hang.
    axes : ndarray, shape (n_rows, 2, 3)
        Two orthonormal directions in the plane of each row's section.
    spline : csr_array, shape (n_rows, n_values)
        Amounts of sections, less the neutral one, of values less the neutral one.
    matrices : callable
        Matrices, shape (n_rows, 2, 2), of amounts, shape (n_rows,); complex-safe.
    """

    neutral: float
    hung: HungRows
    axes: np.ndarray
    spline: csr_array
    matrices: Callable[[np.ndarray], np.ndarray]

    @property
    def initial(self) -> np.ndarray:
        """Neutral values."""
        return np.full(self.spline.shape[1], self.neutral)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres."""
        changes = self.matrices(self._amounts(values)) - np.eye(2)
        return points + self._in_space(np.einsum("nij,nj->ni", changes, self._in_plane(points)))

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        amounts = self._amounts(values)
        changes = self.axes.swapaxes(1, 2) @ (self.matrices(amounts) - np.eye(2)) @ self.axes
        rates = rates_of(self.matrices, amounts)
        moved = self._in_space(np.einsum("nij,nj->ni", rates, self._in_plane(points)))
        return MapPartials(self._by_points(changes), along_vectors(moved, self.spline))

    def _amounts(self, values):
        return self.neutral + self.spline @ (values - self.neutral)

    def _in_plane(self, points):
        """Coordinates about the axis in the plane of the section, shape (n_rows, 2)."""
        return np.einsum("nij,nj->ni", self.axes, points - self.hung.centres(points))

    def _in_space(self, local):
        return np.einsum("nij,ni->nj", self.axes, local)

    def _by_points(self, changes) -> csr_array:
        """Derivative by the row itself and by the points of the axis, of changes (n_rows, 3, 3)."""
        weights, n = self.hung.weights.tocoo(), len(changes)
        influenced = np.concatenate([np.arange(n), weights.row])
        influences = np.concatenate([np.arange(n), self.hung.axis_rows[weights.col]])
        by_axis = -weights.data[:, None, None] * changes[weights.row]
        data = np.concatenate([np.eye(3) + changes, by_axis])
        rows = np.broadcast_to(3 * influenced[:, None, None] + np.arange(3)[:, None], data.shape)
        columns = np.broadcast_to(3 * influences[:, None, None] + np.arange(3), data.shape)
        return csr_array((data.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, 3 * n))


def along_vectors(vectors: np.ndarray, amounts: csr_array) -> csr_array:
    """Displacements along a vector per row, shape (n_rows, 3), of amounts per row and value, shape (n_rows, n_values).

    Returns
    -------
    csr_array, shape (3 n_rows, n_values)
        xyz interleaved; entries that happen to be zero are kept.
    """
    entries = amounts.tocoo()
    data = vectors[entries.row] * entries.data[:, None]
    rows = 3 * entries.row[:, None] + np.arange(3)
    shape = 3 * amounts.shape[0], amounts.shape[1]
    return csr_array((data.ravel(), (rows.ravel(), np.repeat(entries.col, 3))), shape=shape)
