"""Directions of the free stream."""

from __future__ import annotations

import numpy as np

__all__ = ["RADIAN", "stream_axes"]

RADIAN = np.pi / 180.0
"""One degree in radians."""


def stream_axes(alpha: float, axes: np.ndarray) -> np.ndarray:
    """Directions of drag and lift, shape (2, 3); the second is the derivative of the first with respect to the angle.

    Parameters
    ----------
    alpha : float or complex
        Angle of attack (rad).
    axes : ndarray, shape (3, 3)
        Rows are the directions downstream at zero angle, along the span, and up.
    """
    downstream, _, up = axes
    sine, cosine = np.sin(alpha), np.cos(alpha)
    return np.stack([cosine * downstream + sine * up, cosine * up - sine * downstream])
