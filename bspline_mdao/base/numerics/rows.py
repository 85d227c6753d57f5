"""Copies and differences of rows of arrays in kernels, number by number.

Numba compiles ``out[:] = row`` and ``out -= row`` for arrays of any shape, including the error for mismatched shapes,
which takes a third of a second each for rows, and seconds for arrays of more dimensions.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True, error_model="numpy", inline="always")
def copy_row(row, out):
    """``out[:] = row``, of the length of ``row``."""
    for n in range(len(row)):
        out[n] = row[n]


@njit(cache=True, error_model="numpy", inline="always")
def subtract_row(row, out):
    """``out -= row``."""
    for n in range(len(row)):
        out[n] -= row[n]
