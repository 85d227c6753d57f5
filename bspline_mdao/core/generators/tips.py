"""Tips of wings: rounding of their thickness, and stations clustered there."""

from __future__ import annotations

import numpy as np

__all__ = ["tip_clustered", "tip_rounding"]


def tip_rounding(distance: np.ndarray, length: float) -> np.ndarray:
    """Factor on the thickness at distances (m) from a tip that is rounded over a length (m) of span."""
    # It is ``sqrt(1 - s^3)``, s from 0 to 1 over this length: blunt, without a jump in curvature; 1 without a length.
    if length == 0.0:
        return np.ones_like(distance)
    s = np.clip(1.0 - distance / length, 0.0, 1.0)
    return np.sqrt((1.0 - s) * (1.0 + s + s * s))


def tip_clustered(n: int) -> np.ndarray:
    """Distribute n points over [0, 1], clustered at 1."""
    return 1.0 - np.linspace(1.0, 0.0, n) ** 4
