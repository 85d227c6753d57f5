"""Differences between neighbouring stations, which show whether a distribution rises or falls.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import InputError

__all__ = ["Differences", "neighbour_differences"]


class Differences(NamedTuple):
    """Sparse matrix of shape (n - 1, n) by its entries."""

    # positions of the entries: first of the values before, then of the values after
    rows: np.ndarray  # int (2 n - 2,)
    cols: np.ndarray  # int (2 n - 2,)
    values: np.ndarray  # (2 n - 2,), values of the entries

    def apply(self, values: np.ndarray) -> np.ndarray:
        """Differences, shape (n - 1,), of the values at n stations; real or complex."""
        return (self.values * values[self.cols]).reshape(2, -1).sum(axis=0)


def neighbour_differences(
    n: int,  # number of stations, at least 2
    decreasing: bool = False,  # subtract the next value from each, instead of each from the next
) -> Differences:
    """Differences of successive values: none is negative in a rising distribution, or in a falling one.

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
