"""Directions of the free stream."""

from __future__ import annotations

import numpy as np

__all__ = ["RADIAN", "stream_axes"]

RADIAN = np.pi / 180.0
"""One degree in radians."""


def stream_axes(alpha: float, axes: np.ndarray) -> np.ndarray:
    """Directions of drag and lift, (2, 3), at an angle (rad); the second is the first one's derivative by the angle."""
    # rows of ``axes`` are the directions downstream at zero angle, along the span, and up
    downstream, _, up = axes
    sine, cosine = np.sin(alpha), np.cos(alpha)
    return np.stack([cosine * downstream + sine * up, cosine * up - sine * downstream])
