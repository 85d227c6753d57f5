"""Transfinite (Coons) interpolation of the inner points of an index space from its boundary."""

from __future__ import annotations

import numpy as np


def interpolate_boundary(points: np.ndarray, blends) -> np.ndarray:
    """Points whose inside is the Boolean sum of linear interpolations between opposite ends.

    With ``P_d`` the interpolation along direction d this is ``I - (I - P_0) (I - P_1) (I - P_2)``, in which the
    inner points of the argument cancel. Directions of one point take no part.

    Parameters
    ----------
    points : ndarray, shape (N0, N1, N2, m)
        Points; the boundary counts, the inside must be finite.
    blends : sequence of three ndarray, each of shape (N_d,)
        Where each point stands between the two ends of its direction, from 0 to 1.

    Returns
    -------
    ndarray, shape (N0, N1, N2, m)
        The same boundary with the interpolated inside.

    References
    ----------
    W. J. Gordon and C. A. Hall, "Construction of curvilinear co-ordinate systems and applications to mesh generation",
    International Journal for Numerical Methods in Engineering 7, 1973.
    """
    points = _without_inside(points)
    rest = points
    for d in _free_directions(points.shape):
        rest = rest - _between_ends(rest, blends[d], d)
    return points - rest


def interpolate_boundary_transpose(bar: np.ndarray, blends) -> np.ndarray:
    """Transpose of `interpolate_boundary`."""
    rest = bar
    for d in _free_directions(bar.shape):
        rest = rest - _between_ends_transpose(rest, blends[d], d)
    return _without_inside(bar - rest)


def _free_directions(shape) -> list[int]:
    return [d for d in range(3) if shape[d] > 1]


def _inside(shape):
    """Slices of the inner points; the whole of a direction of one point."""
    return tuple(slice(1, -1) if n > 1 else slice(None) for n in shape[:3])


def _without_inside(points: np.ndarray) -> np.ndarray:
    points = points.copy()
    points[_inside(points.shape)] = 0
    return points


def _between_ends(points: np.ndarray, blend: np.ndarray, d: int) -> np.ndarray:
    """P_d: linear between the first and the last point of each line along d."""
    weights = _along(blend, points.ndim, d)
    return (1 - weights) * points.take([0], d) + weights * points.take([-1], d)


def _between_ends_transpose(bar: np.ndarray, blend: np.ndarray, d: int) -> np.ndarray:
    weights = _along(blend, bar.ndim, d)
    result = np.zeros_like(bar)
    ends = np.moveaxis(result, d, 0)
    ends[0], ends[-1] = ((1 - weights) * bar).sum(axis=d), (weights * bar).sum(axis=d)
    return result


def _along(blend: np.ndarray, ndim: int, d: int) -> np.ndarray:
    """Return the weights as an array that extends along direction d alone."""
    return blend.reshape([-1 if axis == d else 1 for axis in range(ndim)])
