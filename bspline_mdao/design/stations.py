"""Splines of values at stations along an axis: what lies between is interpolated, with local support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.sparse import csr_array

from ..errors import InputError

__all__ = ["StationSpline"]


@dataclass(frozen=True)
class StationSpline:
    """Interpolation between stations, constant beyond the first and the last.

    Parameters
    ----------
    stations : tuple of float
        Ascending parts of the axis, 0 at its first point and 1 at its last.
    order : int
        2: straight lines, one interval to either side of a station feels its value. 4: cubics that have at each
        station the slope of the parabola through it and its neighbours; two intervals to either side feel the value.

    Raises
    ------
    InputError
        If the order is another, or the stations do not ascend from 0 to 1.
    """

    stations: tuple[float, ...]
    order: int = 4

    def __post_init__(self):
        if self.order not in (2, 4):
            raise InputError(f"stations: order {self.order}; give 2 for straight lines or 4 for cubics")
        places = np.asarray(self.stations)
        if not (len(places) and np.all(np.diff(places) > 0.0) and places[0] >= 0.0 and places[-1] <= 1.0):
            raise InputError(f"stations: {list(self.stations)} do not ascend within 0 (root) to 1 (end of the axis)")

    @classmethod
    def of(cls, stations: int | Sequence[float], order: int = 4) -> StationSpline:
        """Make the spline of a number of stations, evenly from 0 to 1, or of stations where they are given.

        Examples
        --------
        >>> StationSpline.of(3).stations
        (0.0, 0.5, 1.0)
        """
        if isinstance(stations, (int, np.integer)):
            if stations < 1:
                raise InputError(f"stations: {stations} of them; give at least one")
            stations = np.linspace(0.0, 1.0, stations)
        if np.ndim(stations) != 1:
            raise InputError(f"stations: {stations}; give how many, or a list of places from 0 to 1")
        return cls(tuple(float(station) for station in stations), order)

    @property
    def n_values(self) -> int:
        """Number of stations."""
        return len(self.stations)

    def matrix(self, at: np.ndarray) -> csr_array:
        """Sparse matrix, shape (n, n_values), that gives the values at parts of the axis, shape (n,)."""
        return csr_array(self.basis(at))

    def basis(self, at: np.ndarray) -> np.ndarray:
        """Influence of every value at parts of the axis of any shape; shape (..., n_values)."""
        return self._pieces(np.clip(at, self._ends[0], self._ends[1]))

    def integral(self, at: np.ndarray) -> np.ndarray:
        """Integrals of `basis` from one place that is the same for all, to parts of the axis; shape (..., n_values)."""
        inside = np.clip(at, self._ends[0], self._ends[1])
        return self._antiderivative(inside) + (at - inside)[..., None] * self._pieces(inside)

    @property
    def _ends(self):
        return self.stations[0], self.stations[-1]

    @cached_property
    def _pieces(self) -> PPoly:
        values, places = np.eye(self.n_values), np.array(self.stations)
        if self.n_values == 1:
            return PPoly(np.ones((1, 1, 1)), [places[0], places[0] + 1.0])
        if self.order == 2:
            return PPoly(np.stack([np.diff(values, axis=0) / np.diff(places)[:, None], values[:-1]]), places)
        # second-order differences are the slopes of parabolas, one-sided at the ends
        slopes = np.gradient(values, places, axis=0, edge_order=min(2, self.n_values - 1))
        return CubicHermiteSpline(places, values, slopes)

    @cached_property
    def _antiderivative(self) -> PPoly:
        return self._pieces.antiderivative()
