"""Smooth functions of an index through given values: the map from indices to parameters, section II.C.

Between neighbouring integers the function is a polynomial of degree 2 k + 1. Its first k derivatives at integers are
taken from the polynomial through the nearest values (five for k up to 4), so it has k continuous derivatives. It is
local, linear in the values, the same from both ends, and exact for polynomials of degree four.

Increasing values get an increasing function: a polynomial increases if the increments of its Bernstein coefficients
are positive. Increments next to an integer depend only on the derivatives there. If one would fall below `LEAST` times
its value with the safe derivatives (the smaller neighbouring difference, then zeros), the derivatives at the integer
are blended with the safe ones, just as far as needed. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

from functools import cache
from math import comb, factorial

import numpy as np

__all__ = ["interpolate", "interpolate_linearly"]

LEAST = 0.05
"""Fraction of the safe increments of Bernstein coefficients that remains where derivatives are limited."""


def interpolate(
    values: np.ndarray,
    axis: int,  # axis along which they are interpolated
    n: int,  # number of positions, including the first and the last value
    # limit derivatives to interpolate increasing values by an increasing function
    is_increasing: bool = False,
    continuity: int = 2,  # number k of continuous derivatives
) -> np.ndarray:
    """Interpolate values at integers smoothly, at ``n`` evenly spread positions."""
    # returns ``n`` long along the axis. Positions at integers get the values themselves, and equal values give the same
    # bits
    x = np.moveaxis(values, axis, -1)
    if x.shape[-1] == 1:
        return np.moveaxis(np.repeat(x, n, axis=-1), -1, axis)
    steps = np.diff(x, axis=-1)
    jets = _derivatives(steps, continuity)
    before, after = _limited_increments(steps, jets) if is_increasing else _increments(jets)
    middle = steps - before[..., 1:].sum(axis=0) - after[..., :-1].sum(axis=0)
    at, s = _positions(x.shape[-1], n)
    powers = _partial_sums(s, continuity)
    inner = x[..., at] + powers[continuity] * middle[..., at]
    for j in range(continuity):
        inner += powers[j] * after[j][..., at] + powers[-1 - j] * before[j][..., at + 1]
    return np.moveaxis(np.where(s == 1.0, x[..., at + 1], inner), -1, axis)


def interpolate_linearly(values: np.ndarray, axis: int, n: int) -> np.ndarray:
    """Interpolate values at integers linearly, at ``n`` evenly spread positions."""
    x = np.moveaxis(values, axis, -1)
    if x.shape[-1] == 1:
        return np.moveaxis(np.repeat(x, n, axis=-1), -1, axis)
    at, s = _positions(x.shape[-1], n)
    return np.moveaxis((1 - s) * x[..., at] + s * x[..., at + 1], -1, axis)


def _positions(n_values: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Interval of each position, and the fraction of the interval before it."""
    position = np.arange(n) * (n_values - 1) / max(n - 1, 1)
    at = np.minimum(position.astype(int), n_values - 2)
    return at, position - at


def _derivatives(steps: np.ndarray, k: int) -> np.ndarray:
    """Derivatives 1 to k at all integers from the differences between values, shape (k, ..., n)."""
    n = steps.shape[-1] + 1
    width = min(max(5, k + 1 + k % 2), n)
    low, high = width // 2, n - (width - 1) // 2  # integers that have a stencil of their own
    stencil = _stencils(width, k)
    jets = np.zeros((k, *steps.shape[:-1], n))
    for d in range(k):
        for place in range(low):
            jets[d, ..., place] = steps[..., : width - 1] @ stencil[place, d]
        for place in range(high, n):
            jets[d, ..., place] = steps[..., n - width :] @ stencil[width - n + place, d]
        for m in range(width - 1):
            jets[d, ..., low:high] += stencil[low, d, m] * steps[..., m : m + high - low]
    return jets


@cache
def _stencils(width: int, k: int) -> np.ndarray:
    """Weights of differences in derivatives 1 to k at each of ``width`` integers; shape (width, k, width - 1)."""
    weights = np.zeros((width, k, width - 1))
    for place in range(width):
        powers = np.vander(np.arange(width) - place, increasing=True).astype(float)
        of_values = np.rint(np.linalg.inv(powers) * factorial(width)) / factorial(width)  # rational of that denominator
        for d in range(1, min(k, width - 1) + 1):
            weights[place, d - 1] = -factorial(d) * np.cumsum(of_values[d])[:-1]
    return weights


def _factors(k: int) -> np.ndarray:
    """Contribution of derivative i + 1 at an integer to increment j of the coefficients after it, shape (k, k)."""
    degree = 2 * k + 1
    return np.array(
        [
            [(comb(j + 1, i) - comb(j, i)) * factorial(degree - i) / factorial(degree) for i in range(1, k + 1)]
            for j in range(k)
        ]
    )


def _increments(jets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Increments of Bernstein coefficients before and after every integer, the nearest first; shape (k, ..., n)."""
    k = len(jets)
    signs = (-1.0) ** np.arange(k)
    return np.tensordot(_factors(k) * signs, jets, 1), np.tensordot(_factors(k), jets, 1)


def _limited_increments(steps: np.ndarray, jets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Increments before and after every integer, limited so that all are positive, including those in the middle."""
    k = len(jets)
    padded = np.concatenate([steps[..., :1], steps, steps[..., -1:]], axis=-1)
    safe = np.minimum(padded[..., :-1], padded[..., 1:]) / (2 * k + 1)  # each increment with the safe derivatives
    before, after = _increments(jets)
    fraction = np.ones_like(safe)  # remaining fraction of the derivatives of high order
    for side, increments in ((np.s_[..., 1:], before), (np.s_[..., :-1], after)):  # integers that have an interval
        for each in increments:
            fraction[side] = np.minimum(fraction[side], _fraction(safe[side], (safe - each)[side]))
    # what the derivatives at the ends of every interval take from its middle, or add, with the remaining fractions
    taken = np.stack([after.sum(axis=0) - k * safe, before.sum(axis=0) - k * safe])
    taken = np.stack([taken[0, ..., :-1], taken[1, ..., 1:]])
    middle, given = steps - k * (safe[..., 1:] + safe[..., :-1]), 0.0
    for _ in range(2):
        bound = _fraction(middle + given / (1.0 - LEAST), np.maximum(taken, 0.0).sum(axis=0))
        left = fraction.copy()
        left[..., 1:] = np.minimum(left[..., 1:], bound)
        left[..., :-1] = np.minimum(left[..., :-1], bound)
        given = np.sum(np.maximum(-taken, 0.0) * np.stack([left[..., :-1], left[..., 1:]]), axis=0)
    return (safe + left * (before - safe)), (safe + left * (after - safe))


def _fraction(amount: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Fraction of a loss, at most 1, that leaves `LEAST` times an amount."""
    allowed = (1.0 - LEAST) * amount
    return np.where(loss > allowed, allowed / np.where(loss > 0.0, loss, 1.0), 1.0)


def _partial_sums(s: np.ndarray, k: int) -> np.ndarray:
    """Factors of the increments 0 to 2 k of Bernstein coefficients: sums of the polynomials behind each."""
    degree = 2 * k + 1
    basis = np.array([comb(degree, m) * s**m * (1 - s) ** (degree - m) for m in range(degree + 1)])
    return np.cumsum(basis[:0:-1], axis=0)[::-1]
