"""Radial functions and their sums over centres, never stored as a matrix of targets by centres."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.vectors import add, add_to, dot, less, row, scaled

__all__ = [
    "COMPACT",
    "GLOBAL",
    "NEEDS_LINEAR",
    "radial_matrix",
    "radial_sums",
    "radial_sums_jvp",
    "radial_sums_vjp",
]

COMPACT = ("wendland c0", "wendland c2", "wendland c4")
"""Functions that are zero from the radius on (Wendland 1995)."""

GLOBAL = ("volume", "thin plate", "multiquadric", "inverse multiquadric", "gaussian")
"""Functions that are felt everywhere."""

NEEDS_LINEAR = ("volume", "thin plate", "multiquadric")
"""Functions that interpolate only together with a linear polynomial."""

_WENDLAND_C0, _WENDLAND_C2, _WENDLAND_C4, _VOLUME, _THIN_PLATE, _MULTIQUADRIC, _INVERSE_MULTIQUADRIC = range(7)


@njit(cache=True, error_model="numpy")
def _function(kind, r):
    """Value of a radial function at the distance r in radii, and its derivative by r divided by r.

    The latter is not finite at 0 for functions with a peak there, where no direction is special: it counts as 0.
    """
    if kind <= _WENDLAND_C4:
        return _wendland(kind, r) if r < 1.0 else (0.0, 0.0)
    if kind == _VOLUME:
        return r, 1.0 / r if r > 0.0 else 0.0
    if kind == _THIN_PLATE:
        return (r * r * np.log(r), 2.0 * np.log(r) + 1.0) if r > 0.0 else (0.0, 0.0)
    if kind == _MULTIQUADRIC:
        root = np.sqrt(1.0 + r * r)
        return root, 1.0 / root
    if kind == _INVERSE_MULTIQUADRIC:
        inverse = 1.0 / np.sqrt(1.0 + r * r)
        return inverse, -(inverse**3)
    value = np.exp(-r * r)
    return value, -2.0 * value


@njit(cache=True, error_model="numpy")
def _wendland(kind, r):
    left = 1.0 - r
    if kind == _WENDLAND_C0:
        return left**2, -2.0 * left / r if r > 0.0 else 0.0
    if kind == _WENDLAND_C2:
        return left**4 * (4.0 * r + 1.0), -20.0 * left**3
    return left**6 * ((35.0 * r + 18.0) * r + 3.0) / 3.0, -56.0 / 3.0 * left**5 * (5.0 * r + 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def radial_matrix(kind, radius, centres):
    """Values at all centres of the functions about all centres, shape (n_centres, n_centres), symmetric."""
    n, columns = len(centres), np.ascontiguousarray(centres.T)
    matrix = np.empty((n, n))
    for i in range(n):
        _values(kind, radius, row(centres, i), columns[:, : i + 1], matrix[i, : i + 1])
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return matrix


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})
def radial_sums(kind, radius, targets, centres, strengths):
    """Sums at the targets, (n_targets, 3), of the functions about the centres times strengths, (n_centres, 3)."""
    columns, factors = np.ascontiguousarray(centres.T), np.ascontiguousarray(strengths.T)
    values, sums = np.empty(len(centres)), np.zeros_like(targets)
    for j in range(len(targets)):
        _values(kind, radius, row(targets, j), columns, values)
        x = y = z = 0.0
        for i in range(len(centres)):
            x += values[i] * factors[0, i]
            y += values[i] * factors[1, i]
            z += values[i] * factors[2, i]
        sums[j, 0], sums[j, 1], sums[j, 2] = x, y, z
    return sums


@njit(cache=True, error_model="numpy", nogil=True)
def _values(kind, radius, target, columns, values):
    """Values at one target of the functions about centres, shape (3, n): loops that vectorise as far as they can."""
    for i in range(len(values)):
        x, y, z = target[0] - columns[0, i], target[1] - columns[1, i], target[2] - columns[2, i]
        values[i] = np.sqrt(x * x + y * y + z * z) / radius
    if kind != _VOLUME:  # which is the distance itself
        for i in range(len(values)):
            values[i] = _function(kind, values[i])[0]


@njit(cache=True, error_model="numpy")
def radial_sums_jvp(kind, radius, targets, centres, strengths, d_targets, d_centres):
    """Change of `radial_sums` for changes of targets and centres."""
    d_sums = np.zeros_like(targets)
    for j in range(len(targets)):
        total = (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            _, slope = _function(kind, np.sqrt(dot(along, along)) / radius)
            change = slope * dot(along, less(row(d_targets, j), row(d_centres, i))) / radius**2
            total = add(total, scaled(change, row(strengths, i)))
        add_to(d_sums, j, total)
    return d_sums


@njit(cache=True, error_model="numpy")
def radial_sums_vjp(kind, radius, targets, centres, strengths, bar):
    """Transpose of `radial_sums_jvp`: derivatives with respect to targets and centres."""
    targets_bar, centres_bar = np.zeros_like(targets), np.zeros_like(centres)
    for j in range(len(targets)):
        total = (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            _, slope = _function(kind, np.sqrt(dot(along, along)) / radius)
            pull = scaled(slope * dot(row(strengths, i), row(bar, j)) / radius**2, along)
            total = add(total, pull)
            add_to(centres_bar, i, scaled(-1.0, pull))
        add_to(targets_bar, j, total)
    return targets_bar, centres_bar
