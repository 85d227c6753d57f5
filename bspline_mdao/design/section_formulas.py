"""Formulas of sections, once: what a named deformation does by one amount, a design variable does by one per station.

All are complex-safe in the amount.
"""

from __future__ import annotations

import numpy as np

__all__ = ["scaled", "slope", "turned"]


def turned(angle) -> np.ndarray:
    """Matrices of stream and normal coordinates that turn sections, upstream end up.

    Parameters
    ----------
    angle : ndarray, any shape
        Angles (rad).

    Returns
    -------
    ndarray, shape (..., 2, 2)
    """
    cos, sin = np.cos(angle), np.sin(angle)
    return _matrices(cos, sin, -sin, cos)


def scaled(stream, normal) -> np.ndarray:
    """Matrices, shape (..., 2, 2), that scale stream and normal coordinates by factors of any shape."""
    stream, normal = np.broadcast_arrays(stream, normal)
    return _matrices(stream, 0.0 * stream, 0.0 * normal, normal)


def slope(angle):
    """Shift per length of what is sheared by an angle (rad)."""
    return np.tan(angle)


def _matrices(a, b, c, d):
    return np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)
