"""Values at stations joined by straight lines whose corners are rounded."""

from __future__ import annotations

import numpy as np

__all__ = ["corner_widths", "rounded_weights"]


def corner_widths(stations: np.ndarray, share: float, is_mirrored: bool) -> np.ndarray:
    """Half-widths, shape (n,), within which the corners at stations (n,) are rounded.

    Parameters
    ----------
    stations : ndarray, shape (n,)
        Ascending from 0.
    share : float
        Half-width of a corner as a part of the shorter of the two lines that meet there, up to 1.
    is_mirrored : bool
        Whether the values go on beyond 0 as in a mirror, so that they have a corner there.
    """
    lines = np.diff(stations)
    before = np.concatenate([lines[:1] if is_mirrored else [0.0], lines])
    return share * np.minimum(before, np.concatenate([lines, [0.0]]))


def rounded_weights(at: np.ndarray, stations: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Weights of the values at stations in the rounded polygon through them.

    Each line from one station to the next is a difference of two ramps; a ramp rounded within w of its foot,
    ``(x + w)^3 (3 w - x) / (16 w^3)``, has a continuous curvature.

    Parameters
    ----------
    at : ndarray, shape (m,)
        Where the polygon is wanted, within the stations.
    stations, widths : ndarray, shape (n,)
        Where the values are given and the half-widths of the corners there, the first of which is mirrored.

    Returns
    -------
    ndarray, shape (m, n)
        Rows sum to one. Values change linearly, and exactly so outside the corners.

    Examples
    --------
    >>> stations = np.array([0.0, 1.0, 2.0])
    >>> rounded_weights(np.array([0.5]), stations, np.array([0.0, 0.4, 0.0]))
    array([[0.5, 0.5, 0. ]])
    """
    ramps = np.stack([_ramp(at - s, w) for s, w in zip(stations, widths)], axis=1)
    ramps[:, 0] += _ramp(-at, widths[0])
    slopes = np.diff(np.eye(len(stations)), axis=0) / np.diff(stations)[:, None]
    weights = (ramps[:, :-1] - ramps[:, 1:]) @ slopes
    weights[:, 0] += 1.0
    return weights


def _ramp(x, width):
    """The larger of x and 0, rounded within ``width`` of 0."""
    if width == 0.0:
        return np.maximum(x, 0.0)
    rounded = (x + width) ** 3 * (3.0 * width - x) / (16.0 * width**3)
    return np.where(np.abs(x) < width, rounded, np.maximum(x, 0.0))
