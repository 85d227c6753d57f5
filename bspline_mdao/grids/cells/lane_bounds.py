"""Smooth bounds of the measures of cells while these are in registers: the rules of `.aggregates` on whole registers.

A loop over cells keeps the measures of as many cells as a register has lanes in a table of rows (`ROWS`): corner triple
products, corner Jacobians, volumes, Q. A bound is a record (`BOUND`) of its rows, its rule, and the reference of its
terms. A number beyond the ``limit`` of a bound has a term so small that such terms of a whole grid together are below
the rounding of the sum, so it does not count: registers that hold only such numbers are skipped.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from ...base.numerics.lanes import (
    LANES,
    aligned_zeros,
    any_below,
    below,
    exponential,
    least_of,
    load,
    scaled,
    smaller,
    spread,
    store,
    sum_of,
    within,
)
from .orthogonality import FAST

__all__ = [
    "BOUND",
    "ROWS",
    "VOLUME",
    "Q",
    "add_changes",
    "add_terms",
    "add_weights",
    "bounds_of",
    "finish",
    "finish_jvp",
    "finish_vjp",
    "new_rows",
    "rows_of",
    "set_totals",
    "take_references",
    "weights_of",
]

JACOBIANS, VOLUME, Q, N_ROWS = 8, 16, 17, 18
"""First rows of each measure but the triple products, and the number of rows."""

ROWS = {"triples": (0, JACOBIANS), "jacobians": (JACOBIANS, VOLUME), "volume": (VOLUME, Q), "q": (Q, N_ROWS)}
"""First row of each measure, and the row after its last."""

BOUND = np.dtype([
    ("first", np.int64), ("stop", np.int64),  # rows
    ("sharpness", np.float64),  # of Kreisselmeier and Steinhauser
    ("power", np.int64),  # of a p-norm; 0 of the others
    ("reference", np.float64),  # number whose term is 1
    ("limit", np.float64),  # number beyond which terms do not count
    ("smallest", np.float64),  # term below which none counts
    ("seed", np.float64),  # adjoint
    ("total", np.float64),  # sum of the terms, or change
])  # fmt: skip
"""A bound of a measure."""


def bounds_of(
    rules: Sequence[tuple[str, float, int]],  # measure, sharpness and power of each
    n: int,  # cells of the grid
) -> np.ndarray:  # of `BOUND`
    """Bounds without terms."""
    bounds = np.zeros(len(rules), BOUND)
    for bound, (measure, sharpness, power) in zip(bounds, rules):
        bound["first"], bound["stop"] = ROWS[measure]
        bound["sharpness"], bound["power"] = sharpness, power
    bounds["reference"] = np.where(bounds["power"] == 0, np.inf, 1.0)
    bounds["limit"] = -np.inf
    bounds["smallest"] = np.finfo(float).epsneg / (JACOBIANS * n)
    return bounds


def weights_of(
    bounds: np.ndarray,  # of `BOUND`
    values: Sequence[float],  # of each
    seeds: Sequence[float],  # adjoint of each
) -> np.ndarray:  # of `BOUND`
    """Bounds whose terms are the weights of the numbers: for a p-norm, the terms of one power less."""
    bounds = bounds.copy()
    bounds["power"] -= bounds["power"] > 0
    bounds["reference"], bounds["seed"] = values, seeds
    return bounds


@njit(**FAST)
def _power(x, n):
    """``x**n`` of lanes by repeated squaring."""
    result = spread(1.0)
    while n > 0:
        if n & 1:
            result = result * x
        n >>= 1
        x = x * x
    return result


@njit(**FAST)
def _set_reference(bound, reference):
    """Use terms relative to a number from now on."""
    bound.reference = reference
    if bound.power == 0:
        bound.limit = reference - np.log(bound.smallest) / bound.sharpness
    else:
        bound.limit = 1.0 - (1.0 - reference) * bound.smallest ** (1.0 / bound.power)


@njit(inline="always")
def take_references(bounds):
    """Use the terms of each bound relative to its reference."""
    for b in range(bounds.size):
        _set_reference(bounds[b], bounds[b].reference)


@njit(inline="always")
def set_totals(bounds, totals):
    """Set the totals of bounds to the sums of their lanes."""
    for b in range(bounds.size):
        bounds[b].total = sum_of(load(totals, b * LANES, LANES))


@njit(**FAST)
def _terms(bound, x):
    """Terms of numbers, relative to the term of the reference."""
    if bound.power == 0:
        return below(bound.limit, x, exponential((x - bound.reference) * -bound.sharpness))
    return below(bound.limit, x, _power((1.0 - x) * (1.0 / (1.0 - bound.reference)), bound.power))


@njit(inline="always")
def new_rows():
    """Room for the measures of some cells, or for changes or adjoints of them."""
    return aligned_zeros(N_ROWS * LANES)


@njit(**FAST)
def rows_of(bounds, rows):
    """Rows of triple products, Jacobians and volumes; none for measures without a bound."""
    n_jacobians, n_volumes = 0, 0
    for b in range(bounds.size):
        n_jacobians = VOLUME - JACOBIANS if bounds[b].first == JACOBIANS else n_jacobians
        n_volumes = Q - VOLUME if bounds[b].first == VOLUME else n_volumes
    jacobians = rows[JACOBIANS * LANES : (JACOBIANS + n_jacobians) * LANES]
    return rows[: JACOBIANS * LANES], jacobians, rows[VOLUME * LANES : (VOLUME + n_volumes) * LANES]


@njit(**FAST)
def finish(rows, jacobians, volume, inverse_volume, n):
    """Set Q, divide Jacobians and volumes by the baseline's, and set all lanes beyond ``n`` to infinity."""
    q = load(rows, 0, LANES)
    for row in range(1, JACOBIANS):
        q = q * load(rows, row * LANES, LANES)
    store(rows, Q * LANES, LANES, q)
    for at in range(0, jacobians.size, LANES):
        store(jacobians, at, LANES, scaled(load(jacobians, at, LANES), inverse_volume, np.inf))
    if volume.size > 0:
        store(volume, 0, LANES, scaled(load(volume, 0, LANES), inverse_volume, np.inf))
    if n < LANES:
        for at in range(0, N_ROWS * LANES, LANES):
            store(rows, at, LANES, within(n, load(rows, at, LANES), np.inf))


@njit(**FAST)
def finish_jvp(rows, d_rows, d_jacobians, d_volume, inverse_volume):
    """Change of the results of `finish`."""
    q, d_q = spread(1.0), spread(0.0)
    for at in range(0, JACOBIANS * LANES, LANES):
        triple = load(rows, at, LANES)
        q, d_q = q * triple, d_q * triple + q * load(d_rows, at, LANES)
    store(d_rows, Q * LANES, LANES, d_q)
    for at in range(0, d_jacobians.size, LANES):
        store(d_jacobians, at, LANES, load(d_jacobians, at, LANES) * inverse_volume)
    if d_volume.size > 0:
        store(d_volume, 0, LANES, load(d_volume, 0, LANES) * inverse_volume)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def finish_vjp(rows, bars, jacobians_bar, volume_bar, inverse_volume):
    """Transpose of `finish_jvp`."""
    before = load(bars, Q * LANES, LANES)
    for at in range(0, JACOBIANS * LANES, LANES):  # the product of the corners before multiplies all behind
        behind = before
        for other in range(at + LANES, JACOBIANS * LANES, LANES):
            behind = behind * load(rows, other, LANES)
        store(bars, at, LANES, load(bars, at, LANES) + behind)
        before = before * load(rows, at, LANES)
    for at in range(0, jacobians_bar.size, LANES):
        store(jacobians_bar, at, LANES, load(jacobians_bar, at, LANES) * inverse_volume)
    if volume_bar.size > 0:
        store(volume_bar, 0, LANES, load(volume_bar, 0, LANES) * inverse_volume)


@njit(**FAST)
def add_terms(bounds, rows, totals):
    """Add the terms of some cells to the totals, relative to the smallest number so far."""
    for b in range(bounds.size):
        bound, least = bounds[b], spread(np.inf)
        for row in range(bound.first, bound.stop):
            least = smaller(load(rows, row * LANES, LANES), least)
        total = load(totals, b * LANES, LANES)
        if any_below(bound.reference, least):
            before = spread(bound.reference)
            _set_reference(bound, least_of(least))
            total = total * _terms(bound, before)
        for row in range(bound.first, bound.stop):
            x = load(rows, row * LANES, LANES)
            if any_below(bound.limit, x):
                total = total + _terms(bound, x)
        store(totals, b * LANES, LANES, total)


@njit(**FAST)
def add_weights(bounds, rows, bars):
    """Add the adjoints of the numbers of some cells to ``bars``; return whether there are any for each measure."""
    has_corners, has_volume = False, False
    for b in range(bounds.size):
        bound = bounds[b]
        for row in range(bound.first, bound.stop):
            x = load(rows, row * LANES, LANES)
            if any_below(bound.limit, x):
                bar = load(bars, row * LANES, LANES) + _terms(bound, x) * bound.seed
                store(bars, row * LANES, LANES, bar)
                has_corners, has_volume = has_corners or row != VOLUME, has_volume or row == VOLUME
    return has_corners, has_volume


@njit(**FAST)
def add_changes(bounds, rows, d_rows, totals):
    """Add the changes of the bounds with the numbers of some cells to the totals."""
    for b in range(bounds.size):
        bound = bounds[b]
        total = load(totals, b * LANES, LANES)
        for row in range(bound.first, bound.stop):
            x = load(rows, row * LANES, LANES)
            if any_below(bound.limit, x):
                total = total + _terms(bound, x) * load(d_rows, row * LANES, LANES)
        store(totals, b * LANES, LANES, total)
