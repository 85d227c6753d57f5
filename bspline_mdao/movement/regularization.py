"""A smooth positive floor, for measures of elements that real meshes hold flat or folded.

The floor of t at t_0 is t itself from t_0 up, and levels off at t_0 / 2 below, with two continuous derivatives::

    floor(t) = t                                           t >= t_0
    floor(t) = t_0 / 2 (1 + 1 / (1 + z + z^2))             t <  t_0,   z = 2 (1 - t / t_0)
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["FLAT_CORNER", "FLAT_ELEMENT", "floored", "floored_array"]

FLAT_CORNER = 0.01
"""Floor of the triple product of unit edges at a corner: 0.6 degrees from flat."""

FLAT_ELEMENT = 0.05
"""Floor of the Jacobian by the lengths of the slopes, and of the volume by those of the edges: 3 degrees from flat."""


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def floored(t, t_0):
    """Floor of t at t_0, and its derivative; t may be complex."""
    z = 2.0 * (1.0 - t / t_0)
    g = 1.0 / (1.0 + z + z * z)
    is_above = t.real >= t_0
    return (t if is_above else 0.5 * t_0 * (1.0 + g)), (1.0 + 0.0 * t if is_above else (1.0 + 2.0 * z) * g * g)


@njit(cache=True, error_model="numpy")
def floored_array(values, t_0):
    """Floors of an array and their derivatives, both of its shape."""
    floors, slopes = np.empty_like(values), np.empty_like(values)
    for index in np.ndindex(values.shape):
        floors[index], slopes[index] = floored(values[index], t_0)
    return floors, slopes
