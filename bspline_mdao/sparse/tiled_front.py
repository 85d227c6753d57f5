"""A large front, factored by tiles on several threads.

Columns and rows of a front are cut at multiples of `TILE` and where its own columns end. Each *round* is a set of tasks
that can be done at the same time; every tile is touched by one task of a round, so that the order of all sums, hence
every bit of the result, is the same for any number of threads::

    round          tasks
    assembly       one for each column of tiles: blocks of the matrix and updates of the children
    pivot          the first diagonal tile
    for each column of tiles k of its own:
      division     all tiles below the diagonal tile k, by its factor
      subtraction  the products of these from all own tiles to their right; (k + 1, k + 1) is also factored
    update         all tiles of the Schur complement of its rows
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numba import njit

from .fronts import Fronts
from .lapack import LOWER, NOT_TRANSPOSED, NOT_UNIT, RIGHT, TRANSPOSED, Routines, call
from .multifrontal import assemble, first_unusable, update_of
from .supernodes import Supernodes

__all__ = ["TILE", "rounds"]

TILE = 192
"""Rows and columns of a tile: enough for BLAS to be fast, few enough for threads to share a front. A multiple of 3."""


def rounds(
    s: int,
    supernodes: Supernodes,
    fronts: Fronts,
    routines: Routines,
    data: np.ndarray,
    factor: np.ndarray,
    kept: np.ndarray,
    failed: np.ndarray,
) -> Iterator[list[Callable[[], None]]]:
    """Yield the tasks of every round of a front whose children are done.

    Parameters
    ----------
    s : int
        The supernode.
    supernodes, fronts, routines, data, factor, kept
        As for `bspline_mdao.sparse.multifrontal.factorize`; the updates of the children are among those kept.
    failed : ndarray of int64, shape (n_supernodes,)
        Place of the first point of each supernode whose pivot is not positive and finite; left alone where all are.
    """
    n_own = 3 * int(supernodes.firsts[s + 1] - supernodes.firsts[s])
    n = n_own + 3 * int(supernodes.row_starts[s + 1] - supernodes.row_starts[s])
    own, rest = _tiles(0, n_own), _tiles(n_own, n)
    panel = factor[fronts.panel_starts[s] : fronts.panel_starts[s + 1]]
    update = update_of(fronts.update_starts[s], n - n_own, kept, kept[:0])
    is_leaf = fronts.child_starts[s + 1] == fronts.child_starts[s]

    def add_up(first, last):
        assemble(s, first // 3, last // 3, supernodes, fronts, data, factor, kept, kept[:0])

    def pivot(tile):
        column = _pivot(routines, panel, n, *tile)
        if column >= 0:
            failed[s] = supernodes.firsts[s] + column // 3

    def subtract(tile, rows, columns):
        _subtract(routines, panel, n, *tile, rows, columns, panel[columns[0] * n + rows[0] :], n, False)
        if rows == columns == own[own.index(tile) + 1]:
            pivot(rows)

    def complement(rows, columns):
        target = update[(columns[0] - n_own) * (n - n_own) + rows[0] - n_own :]
        _subtract(routines, panel, n, 0, n_own, rows, columns, target, n - n_own, is_leaf)

    yield [partial(add_up, *tile) for tile in own + rest]
    yield [partial(pivot, own[0])]
    for k, tile in enumerate(own, start=1):
        yield [partial(_divide, routines, panel, n, *tile, *rows) for rows in own[k:] + rest]
        yield [partial(subtract, tile, *pair) for pair in _pairs(own[k:], own[k:] + rest)]
    yield [partial(complement, *pair) for pair in _pairs(rest, rest)]


def _tiles(start, stop):
    """First and last scalar of every tile of a range."""
    return [(first, min(first + TILE, stop)) for first in range(start, stop, TILE)]


def _pairs(columns, rows):
    """Rows and columns of the tiles of a lower triangle; ``rows`` starts with ``columns``."""
    return [(row, column) for j, column in enumerate(columns) for row in rows[j:]]


@njit(cache=True, nogil=True, error_model="numpy")
def _pivot(routines, panel, n, first, last):
    """Factor a diagonal tile of a panel of ``n`` rows; the first column that is unusable, or -1."""
    info = np.zeros(1, np.int32)
    tile = panel[first * n + first :]
    call(routines.potrf, (LOWER, last - first, tile, n, info))
    failed = info[0] - 1 if info[0] > 0 else first_unusable(tile, n, last - first)
    return first + failed if failed >= 0 else -1


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(routines, panel, n, first, last, row, end):
    """Multiply rows of a panel by the inverse transpose of a diagonal tile."""
    one = np.ones(1, panel.dtype)
    tile, below = panel[first * n + first :], panel[first * n + row :]
    call(routines.trsm, (RIGHT, LOWER, TRANSPOSED, NOT_UNIT, end - row, last - first, one, tile, n, below, n))


@njit(cache=True, nogil=True, error_model="numpy")
def _subtract(routines, panel, n, first, last, rows, columns, target, n_target, is_new):
    """Subtract the product of two sets of rows of a panel from a target of ``n_target`` rows, or put it there."""
    signs = np.array([-1.0, 0.0 if is_new else 1.0]).astype(panel.dtype)
    n_rows, n_columns, width = rows[1] - rows[0], columns[1] - columns[0], last - first
    left, right = panel[first * n + rows[0] :], panel[first * n + columns[0] :]
    minus_one, beta = signs[:1], signs[1:]
    if rows[0] == columns[0]:
        call(routines.syrk, (LOWER, NOT_TRANSPOSED, n_rows, width, minus_one, left, n, beta, target, n_target))
        return
    sizes = (n_rows, n_columns, width)
    call(routines.gemm, (NOT_TRANSPOSED, TRANSPOSED, *sizes, minus_one, left, n, right, n, beta, target, n_target))
