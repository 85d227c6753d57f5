"""Measures that are one number of the whole surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError

__all__ = ["by_baseline", "row_at", "single_row"]


def by_baseline(measure, least: float):
    """Divide a measure by what it is on the baseline.

    Parameters
    ----------
    measure : dataclass
        Measure with a field ``scale`` that it is divided by.
    least : float
        Number that is taken for none.

    Raises
    ------
    InputError
        If it is none on the baseline.
    """
    value = float(measure.evaluate(measure.surface.points)[0])
    if not abs(value) > least:
        raise InputError(f"{measure.name}: {value:.3g} on the baseline, nothing to be relative to; take relative=False")
    return replace(measure, scale=measure.scale * value)


def single_row(gradient: np.ndarray) -> csr_array:
    """Derivatives of one number, shape (1, 3 n_points), of its gradient, shape (n_points, 3); zeros kept."""
    return row_at(np.arange(len(gradient)), gradient, len(gradient))


def row_at(ids: np.ndarray, gradient: np.ndarray, n_points: int) -> csr_array:
    """Derivatives of one number, shape (1, 3 n_points), that depends on some nodes: its gradient in these; zeros kept.

    Parameters
    ----------
    ids : ndarray of int, shape (n,)
        The nodes.
    gradient : ndarray, shape (n, 3)
        Derivatives in their coordinates.
    n_points : int
        Number of all nodes.
    """
    columns = (3 * ids[:, None] + np.arange(3)).ravel()
    return csr_array((gradient.ravel(), columns, np.array([0, len(columns)])), shape=(1, 3 * n_points))
