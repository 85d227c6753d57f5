"""Proof that a polynomial on the unit cube is positive everywhere, by its Bernstein coefficients.

A polynomial of degree ``(l, m, n)`` lies between the smallest and the largest of its ``(l+1)(m+1)(n+1)`` Bernstein
coefficients, and the eight at the corners are its values there. If the smallest coefficient is positive, so is the
polynomial; if a corner is not, neither is the polynomial. Otherwise the cube is halved by de Casteljau's algorithm, in
the direction in which the coefficients differ most, and both halves are examined.

Coefficients are known up to a rounding error, which the caller bounds and halving increases: only values larger than
this error count as positive. Coefficients that are zero by construction, on collapsed edges, do not count.

Theory: ``docs/theory/validity.rst``.

References
----------
A. Johnen, J.-F. Remacle and C. Geuzaine, Geometrical validity of curvilinear finite elements, *Journal of Computational
Physics* 233, 2013, pp. 359-372.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import njit

__all__ = ["INVALID", "MAX_HALVINGS", "UNDECIDED", "UNIT", "VALID", "decide", "inverse_of"]

VALID, UNDECIDED, INVALID = 0, 1, 2
"""What is known about a polynomial: positive everywhere, undecided, not positive somewhere."""

UNIT = 2.0**-53
"""Largest relative error of one rounding."""

MAX_HALVINGS = 18
"""Largest number of successive halvings: six in each direction."""

MAX_BOXES = 4000
"""Largest number of boxes to examine before a polynomial is left undecided."""


@njit(cache=True, nogil=True, error_model="numpy")
def _smallest(c, counts, has_zeros):
    """Smallest of the coefficients that count; infinite if none does."""
    least = np.inf
    for i in range(c.shape[0]):
        for j in range(c.shape[1]):
            for k in range(c.shape[2]):
                if c[i, j, k] < least and (not has_zeros or counts[i, j, k] > 0.0):
                    least = c[i, j, k]
                elif np.isnan(c[i, j, k]):
                    return np.nan
    return least


@njit(cache=True, nogil=True, error_model="numpy")
def _smallest_corner(c, counts, has_zeros):
    """Smallest of the values at corners that count; infinite if none does."""
    least, (l, m, n) = np.inf, c.shape
    for i in range(0, l, max(l - 1, 1)):
        for j in range(0, m, max(m - 1, 1)):
            for k in range(0, n, max(n - 1, 1)):
                if not has_zeros or counts[i, j, k] > 0.0:
                    least = min(least, c[i, j, k])
    return least


@njit(cache=True, nogil=True, error_model="numpy")
def _widest(c):
    """Direction in which neighbouring coefficients differ most."""
    l, m, n = c.shape
    d_0, d_1, d_2 = 0.0, 0.0, 0.0
    for i in range(l):
        for j in range(m):
            for k in range(n):
                if i + 1 < l:
                    d_0 = max(d_0, abs(c[i + 1, j, k] - c[i, j, k]))
                if j + 1 < m:
                    d_1 = max(d_1, abs(c[i, j + 1, k] - c[i, j, k]))
                if k + 1 < n:
                    d_2 = max(d_2, abs(c[i, j, k + 1] - c[i, j, k]))
    return 0 if d_0 >= d_1 and d_0 >= d_2 else 1 if d_1 >= d_2 else 2


@njit(cache=True, nogil=True, error_model="numpy")
def _halve(c, upper, direction):
    """Leave the lower half of a box in ``c`` and write the upper half to ``upper``."""
    size = c.shape[direction]
    others = c.shape[(direction + 1) % 3], c.shape[(direction + 2) % 3]
    line = np.empty(size)
    for a in range(others[0]):
        for b in range(others[1]):
            for n in range(size):
                line[n] = c[n, a, b] if direction == 0 else c[b, n, a] if direction == 1 else c[a, b, n]
            for step in range(size):
                low, high = line[0], line[size - 1 - step]
                at = size - 1 - step
                if direction == 0:
                    c[step, a, b], upper[at, a, b] = low, high
                elif direction == 1:
                    c[b, step, a], upper[b, at, a] = low, high
                else:
                    c[a, b, step], upper[a, b, at] = low, high
                for n in range(at):
                    line[n] = 0.5 * (line[n] + line[n + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(c, out):
    """Copy a box; the loops compile in a tenth of the time of an array assignment."""
    for i in range(c.shape[0]):
        for j in range(c.shape[1]):
            for k in range(c.shape[2]):
                out[i, j, k] = c[i, j, k]


@njit(cache=True, nogil=True, error_model="numpy")
def decide(
    coefficients,  # (l + 1, m + 1, n + 1), Bernstein coefficients on the unit cube
    # 0 for coefficients that are zero by construction, which do not count, else 1; unused if there are none
    counts,  # ndarray, same shape
    margin,  # bound of the error of every coefficient
    has_zeros,  # bool, whether there are such coefficients
    max_halvings,  # int, largest number of successive halvings
):
    """Decide whether a polynomial is positive."""
    # returns status int: `VALID`, `UNDECIDED` or `INVALID`
    # returns bound: lower bound of the polynomial if it is valid, where it counts; the smallest known value otherwise
    l, m, n = coefficients.shape
    largest = 0.0
    for i in range(l):
        for j in range(m):
            for k in range(n):
                largest = max(largest, abs(coefficients[i, j, k]))
    per_halving = 2.0 * max(l, m, n) * UNIT * largest  # a halving takes means of two values, in sequence
    boxes, marks = np.empty((max_halvings + 1, l, m, n)), np.empty((max_halvings + 1, l, m, n))
    levels = np.zeros(max_halvings + 1, dtype=np.int64)
    _copy(coefficients, boxes[0])
    if has_zeros:
        _copy(counts, marks[0])
    top, bound, is_open, n_boxes = 0, np.inf, False, 0
    while top >= 0:
        box, mark, level = boxes[top], marks[top], levels[top]
        error = margin + level * per_halving
        least = _smallest(box, mark, has_zeros)
        n_boxes += 1
        if least - error > 0.0:
            bound = min(bound, least - error)
            top -= 1
            continue
        corner = _smallest_corner(box, mark, has_zeros)
        if corner + error <= 0.0:
            return INVALID, corner
        if not corner - error > 0.0 or level == max_halvings or n_boxes > MAX_BOXES:
            is_open, bound = True, min(bound, least - error)
            if n_boxes > MAX_BOXES or np.isnan(least):
                return UNDECIDED, bound
            top -= 1
            continue
        direction = _widest(box)
        _halve(box, boxes[top + 1], direction)
        if has_zeros:
            _halve(mark, marks[top + 1], direction)
        levels[top], levels[top + 1] = level + 1, level + 1
        top += 1
    if bound == np.inf:  # nothing counts: the polynomial is zero everywhere
        return INVALID, 0.0
    return (UNDECIDED, bound) if is_open else (VALID, bound)


def inverse_of(rows: list[list[Fraction]]) -> list[list[Fraction]]:
    """Inverse of a matrix of fractions, without rounding."""
    n = len(rows)
    work = [[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(rows)]
    for i in range(n):
        pivot = next(r for r in range(i, n) if work[r][i] != 0)
        work[i], work[pivot] = work[pivot], work[i]
        scale = work[i][i]
        work[i] = [x / scale for x in work[i]]
        for r in range(n):
            if r != i and work[r][i] != 0:
                factor = work[r][i]
                work[r] = [x - factor * y for x, y in zip(work[r], work[i])]
    return [row[n:] for row in work]
