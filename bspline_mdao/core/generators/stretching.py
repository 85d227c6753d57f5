"""One-dimensional point distributions with given spacings at both ends.

The two-sided function of Vinokur, *On one-dimensional stretching functions for finite-difference calculations*, Journal
of Computational Physics 50 (1983) 215-234. Vinokur prescribes the slopes at the ends. Here they are adjusted until the
first and the last *interval* are exactly as requested.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, root

from ...errors import InputError

_TOLERANCE = 1e-9
"""Relative error of the end intervals."""

_LOWEST_SLOPE, _HIGHEST_SLOPE = -60.0, 18.0
"""Range of the logarithms of the end slopes in the search, within which nothing overflows."""


@lru_cache(maxsize=1024)  # adjacent blocks need equal lines: two in three times for a wing of twelve blocks
def stretch(
    n: int,  # number of points, at least 3
    # first and last interval, as fractions of the length
    first: float,
    last: float,
) -> np.ndarray:  # (n,), strictly increasing from 0 to 1, read-only
    """Distribute n points smoothly over [0, 1] with given first and last interval.

    Examples
    --------
    >>> stretch(5, 0.1, 0.1).round(3).tolist()
    [0.0, 0.1, 0.5, 0.9, 1.0]
    """
    rest = 1.0 - first - last
    if n < 3 or not (first > 0.0 and last > 0.0 and (rest > 0.0 if n > 3 else abs(rest) <= _TOLERANCE)):
        raise InputError(f"stretching: {n} points with end intervals {first:g} and {last:g} of the length do not fit")
    points = np.array([0.0, first, 1.0]) if n == 3 else _two_sided(n, first, last)
    points.setflags(write=False)
    return points


def _two_sided(n: int, first: float, last: float) -> np.ndarray:
    """Search the end slopes that give the requested intervals there."""
    target = np.log([first, last])
    highest = _HIGHEST_SLOPE - np.log(n - 1)

    def excess(slopes: np.ndarray) -> np.ndarray:
        inside = np.clip(slopes, _LOWEST_SLOPE, highest)
        points, left = _vinokur(n, *np.exp(inside))
        # beyond the range the excess grows with the slopes, which leads the search back into it
        return np.log([points[1], left[-2]]) - target + slopes - inside

    solution = root(excess, np.clip(target, _LOWEST_SLOPE, highest), tol=1e-13)
    points = _vinokur(n, *np.exp(np.clip(solution.x, _LOWEST_SLOPE, highest)))[0]
    if np.abs(excess(solution.x)).max() > _TOLERANCE or not np.all(np.diff(points) > 0.0):
        raise InputError(f"stretching: {n} points cannot grow from an interval of {first:g} to {last:g} of the length")
    return points


def geometric_last(
    n: int,  # number of points, at least 3
    first: float,  # first interval, as a fraction of the length
) -> float:  # the last interval: the end spacing that needs the least growth ratio
    """Find the last of n - 1 intervals that fill [0, 1] in geometric progression from the first."""
    cells = n - 1
    if first * cells >= 1.0 - _TOLERANCE:
        return 1.0 / cells
    steepest = -np.log(first) / (cells - 1)  # the last interval would fill the whole length
    growth = brentq(lambda g: np.log(first * np.expm1(cells * g) / np.expm1(g)), 1e-12, steepest)
    return first * np.exp(growth * (cells - 1))


def stretch_from(n: int, first: float) -> np.ndarray:
    """Distribute n points over [0, 1] from a given first interval, in near-geometric progression; see `stretch`."""
    return stretch(n, first, geometric_last(n, first))


def stretch_lines(
    lengths: np.ndarray,  # (...,), length of every line (m)
    n: int,  # points on every line
    # first and last interval (m)
    first: float,
    last: float,
) -> np.ndarray:
    """Distribute points over many lines with the same end intervals in length units."""
    # returns (..., n), fractions of each length. The shortest and the longest line use `stretch`; the others are
    # interpolated linearly in the inverse length, which keeps the end intervals exact
    inverse = 1.0 / np.asarray(lengths, dtype=np.float64)
    low, high = inverse.min(), inverse.max()
    at_low = stretch(n, first * low, last * low)
    if high - low < 1e-12 * high:
        return np.broadcast_to(at_low, (*inverse.shape, n)).copy()
    weight = ((inverse - low) / (high - low))[..., None]
    return (1.0 - weight) * at_low + weight * stretch(n, first * high, last * high)


def _vinokur(n: int, first_slope: float, last_slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Vinokur's function with end slopes (n - 1) first_slope and (n - 1) last_slope, and one minus it."""
    xi = np.linspace(0.0, 1.0, n)
    skew = np.sqrt(last_slope / first_slope)
    symmetric = _symmetric(xi, 1.0 / ((n - 1) * np.sqrt(first_slope * last_slope)))
    left = skew * symmetric[::-1]
    return symmetric / (symmetric + left), left / (symmetric + left)


def _symmetric(xi: np.ndarray, steepness: float) -> np.ndarray:
    """Symmetric stretching with middle slope ``steepness``: tanh clusters towards the ends, tan away from them."""
    # Vinokur's ``(1 + tanh(d (xi - 1/2)) / tanh(d / 2)) / 2`` is written as a product, which has all digits where it is
    # small; one minus it is its mirror image.
    if abs(steepness - 1.0) < 1e-6:
        return xi * (1.0 + 2.0 * (steepness - 1.0) * (xi - 0.5) * (1.0 - xi))
    if steepness > 1.0:
        delta = brentq(lambda d: np.sinh(d) / d - steepness, 1e-6, 700.0)
        return 0.5 * np.sinh(delta * xi) / (np.sinh(0.5 * delta) * np.cosh(delta * (xi - 0.5)))
    delta = brentq(lambda d: np.sin(d) / d - steepness, 1e-6, np.pi - 1e-9)
    return 0.5 * np.sin(delta * xi) / (np.sin(0.5 * delta) * np.cos(delta * (xi - 0.5)))
