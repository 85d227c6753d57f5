"""The base of a blunt trailing edge in a C-grid: the cut opens to a block behind it.

The grid is made about the section less a wedge, which is as thick as the base at the trailing edge and zero at the
nose. Both halves of the grid are then moved apart by the wedge: exactly at the wall, by more along the cut, and not at
all far away.
"""

from __future__ import annotations

import numpy as np

from .stretching import stretch

_OPENING = 0.1
"""Width of the block behind a base relative to the distance from it, far away."""

_GROWTH, _FEWEST = 1.15, 4
"""Growth of the cells from both corners to the middle of the base, and their least number."""


def grown(first: float, slope: float, behind: np.ndarray) -> np.ndarray:
    """Lengths (chords) that equal given ones at the trailing edge, and finally grow with the distance behind it."""
    # in their logarithm: layers many orders lower than the chord leave the wall's within about a chord, and slowly
    return first * np.hypot(1.0, slope * behind / first) ** (behind**2 / (behind**2 + 1.0))


def opening(
    points: np.ndarray,  # (m,), complex nodes of wall and cut about the section less the wedge, lower side first
    feet: np.ndarray,  # (m,), their places on the real axis of the half plane, with the trailing edge at -2 and 2
    up: np.ndarray,  # (m, n), heights of the nodes on their lines
    behind: np.ndarray,  # (m,), distances behind the trailing edge (chords)
    base: complex,  # from the lower to the upper corner (chords)
) -> np.ndarray:  # (m, n), complex displacements
    """Move both halves apart by the wedge, exactly at the wall."""
    side = 0.5 * np.sign(feet) * base
    # for a point of the wall less the wedge: the wedge is evaluated at the place of the resulting point
    of_wall = points.real / (1.0 - side.real)
    part = np.where(np.abs(feet) < 2.0, of_wall, grown(abs(base), _OPENING, behind) / abs(base))
    return (side * part)[:, None] / (1.0 + up**2 / np.maximum(feet**2, 4.0)[:, None])


def behind_base(lower: np.ndarray, upper: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Nodes (n, n_base + 1) of the block between both sides of the cut (n,), with first cells (n,) at them."""
    widths = np.abs(upper - lower)
    half = np.log1p((_GROWTH - 1.0) * 0.5 * widths[0] / heights[0]) / np.log(_GROWTH)
    n_base = max(_FEWEST, 2 * int(np.ceil(half)))
    ends = np.minimum(heights / widths, 1.0 / n_base)
    across = np.stack([stretch(n_base + 1, end, end) for end in ends])
    return lower[:, None] + (upper - lower)[:, None] * across
