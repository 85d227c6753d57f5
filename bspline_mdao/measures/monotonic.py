"""Differences between neighbouring stations, which say whether a distribution rises or falls.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import InputError

__all__ = ["Differences", "neighbour_differences"]


class Differences(NamedTuple):
    """Sparse matrix of shape (n - 1, n) by its entries.

    Parameters
    ----------
    rows, cols : ndarray of int, shape (2 n - 2,)
        Places of the entries: first those of the values before, then those of the values after.
    values : ndarray, shape (2 n - 2,)
        Values of the entries.
    """

    rows: np.ndarray
    cols: np.ndarray
    values: np.ndarray

    def apply(self, values: np.ndarray) -> np.ndarray:
        """Differences, shape (n - 1,), of the values of n stations; real or complex."""
        return (self.values * values[self.cols]).reshape(2, -1).sum(axis=0)


def neighbour_differences(n: int, decreasing: bool = False) -> Differences:
    """Differences of successive values: none is negative in a rising distribution, or in a falling one.

    Parameters
    ----------
    n : int
        Number of stations, 2 at least.
    decreasing : bool
        Take each value less the next one, instead of the next one less it.

    Raises
    ------
    InputError
        If there are fewer than two stations.

    Examples
    --------
    >>> neighbour_differences(3, decreasing=True).apply(np.array([5.0, 4.0, 2.0]))
    array([1., 2.])
    """
    if n < 2:
        raise InputError(f"monotonic: {n} stations; give 2 at least")
    before, sign = np.arange(n - 1), -1.0 if decreasing else 1.0
    values = np.repeat([-sign, sign], n - 1)
    return Differences(np.tile(before, 2), np.concatenate([before, before + 1]), values)
