"""Numeric Cholesky factorisation, front by front, and the solution of the two triangular systems.

See `.fronts` for the storage. Small fronts are factored whole, by their task's thread (`factorize`); large ones by
tiles, on several threads (`rounds`). Arithmetic is in the precision of the factor.

Theory: ``docs/theory/sparse.rst``, "Fronts".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numba import njit

from .fronts import Fronts
from .lapack import LOWER, NOT_TRANSPOSED, NOT_UNIT, RIGHT, TRANSPOSED, Routines, call
from .symbolic import Supernodes

__all__ = ["TILE", "factorize", "pivots", "rounds", "solve_backward", "solve_forward"]


@njit(cache=True, nogil=True, error_model="numpy")
def factorize(
    # supernodes to do
    first,  # int
    last,  # int
    supernodes,  # Supernodes
    fronts,  # Fronts
    routines,  # Routines, of the precision of the factor
    data,  # (n_blocks, 3, 3), blocks of the matrix
    factor,  # (n_factor,), the panels, to be filled
    # the updates used by other tasks, and space for the others
    kept,  # (n_kept,)
    scratch,  # (n_scratch,)
):  # int, position of the first point whose pivot is not positive and finite, or -1
    """Factor the fronts ``first <= supernode < last``, whose earlier descendants are all done [1] [2]."""
    # With the front F in pieces as in `.fronts`, for each in turn:
    # 1. Assemble F: blocks of the matrix, and the updates of the children ("extend-add").
    # 2. Factor its own columns, ``F_11 = L_11 L_11^T`` (potrf).
    # 3. Divide the rows below, ``L_21 = F_21 L_11^-T`` (trsm).
    # 4. Leave the Schur complement ``F_22 - L_21 L_21^T`` (syrk) as the update for the parent.
    # - [1] I. S. Duff, J. K. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", ACM
    #   Trans. Math. Softw. 9 (1983), 302-325.
    # - [2] J. W. H. Liu, "The multifrontal method for sparse matrix solution: theory and practice", SIAM Review 34
    #   (1992), 82-109.
    signs = np.array([-1.0, 0.0, 1.0]).astype(factor.dtype)
    minus_one, zero, one = signs[0:1], signs[1:2], signs[2:3]
    info = np.zeros(1, np.int32)
    for s in range(first, last):
        n_pivots, n_rest = _extents(s, supernodes)
        n = n_pivots + n_rest
        _assemble(s, np.int64(0), n // 3, supernodes, fronts, data, factor, kept, scratch)  # step 1
        panel = factor[fronts.panel_starts[s] : fronts.panel_starts[s + 1]]
        update = _update_of(fronts.update_starts[s], n_rest, kept, scratch)
        call(routines.potrf, (LOWER, n_pivots, panel, n, info))  # step 2
        failed = info[0] - 1 if info[0] > 0 else _first_unusable(panel, n, n_pivots)
        if failed >= 0:
            return supernodes.firsts[s] + failed // 3
        if n_rest:
            below = panel[n_pivots:]
            call(  # step 3
                routines.trsm,
                (RIGHT, LOWER, TRANSPOSED, NOT_UNIT, n_rest, n_pivots, one, panel, n, below, n),
            )
            beta = one if fronts.child_starts[s + 1] > fronts.child_starts[s] else zero
            call(  # step 4; without children there is nothing yet to subtract from
                routines.syrk,
                (LOWER, NOT_TRANSPOSED, n_rest, n_pivots, minus_one, below, n, beta, update, n_rest),
            )
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _assemble(s, first, last, supernodes, fronts, data, factor, kept, scratch):
    """Sum up the columns of the points ``first <= point < last`` of a front; see `factorize`."""
    # They consist of blocks of the matrix and of the updates of the front's children.
    n_pivots, n_rest = _extents(s, supernodes)
    n, size = n_pivots + n_rest, n_pivots // 3
    panel = factor[fronts.panel_starts[s] : fronts.panel_starts[s + 1]]
    update = _update_of(fronts.update_starts[s], n_rest, kept, scratch)
    children = fronts.children[fronts.child_starts[s] : fronts.child_starts[s + 1]]
    panel[3 * min(first, size) * n : 3 * min(last, size) * n] = 0.0
    _add_blocks(s, 3 * first * n, 3 * last * n, fronts, data, panel, n)
    if len(children):
        for column in range(3 * max(first - size, 0), 3 * (last - size)):
            update[column * n_rest + column : (column + 1) * n_rest] = 0.0
    for child in children:
        low, high = supernodes.row_starts[child], supernodes.row_starts[child + 1]
        child_update = _update_of(fronts.update_starts[child], 3 * (high - low), kept, scratch)
        _add_update(fronts.positions[low:high], first, last, child_update, panel, n, n_pivots, update, n_rest)


@njit(cache=True, nogil=True, error_model="numpy")
def _extents(s, supernodes):
    """Numbers of a front's own scalar columns, and of the others."""
    size, n_rows = (
        supernodes.firsts[s + 1] - supernodes.firsts[s],
        supernodes.row_starts[s + 1] - supernodes.row_starts[s],
    )
    return 3 * np.int64(size), 3 * n_rows


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _update_of(start, n_rows, kept, scratch):
    """The update of ``n_rows`` scalar rows that begins at ``start``, see `Fronts`."""
    if start < 0:
        return scratch[~start : ~start + n_rows * n_rows]
    return kept[start : start + n_rows * n_rows]


@njit(cache=True, nogil=True, error_model="numpy")
def _first_unusable(panel, n, n_pivots):
    """First column whose pivot is not a positive finite number, which LAPACK may accept; -1 if there is none."""
    for column in range(n_pivots):
        if not 0.0 < panel[column * n + column] < np.inf:
            return column
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _add_blocks(s, low, high, fronts, data, panel, n):
    """Add the blocks of the matrix that start at scalars ``low <= place < high`` of a panel of ``n`` scalar rows."""
    for entry in range(fronts.block_starts[s], fronts.block_starts[s + 1]):
        block, place = data[fronts.blocks[entry]], fronts.block_places[entry]
        is_transposed = place < 0
        place = (~place if is_transposed else place) - fronts.panel_starts[s]
        if not low <= place < high:
            continue
        for c in range(3):
            for r in range(3):
                panel[place + c * n + r] = block[c, r] if is_transposed else block[r, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_update(positions, first, last, child, panel, n, n_pivots, update, n_rest):
    """Add a child's update for the points ``first <= point < last`` to the two pieces of a front."""
    n_child = 3 * len(positions)
    for j in range(len(positions)):
        if not first <= positions[j] < last:
            continue
        column = 3 * positions[j]
        for c in range(3):
            source = child[(3 * j + c) * n_child : (3 * j + c + 1) * n_child]
            if column < n_pivots:
                _add_column(source, positions, j, c, panel[(column + c) * n :], np.int64(0))
            else:
                _add_column(source, positions, j, c, update[(column + c - n_pivots) * n_rest :], n_pivots)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_column(source, positions, j, c, target, n_above):
    """Add scalar column ``3 j + c`` of an update to a column of its parent that starts below ``n_above`` rows."""
    above = 3 * positions[j] - n_above
    for r in range(c, 3):
        target[above + r] += source[3 * j + r]
    for i in range(j + 1, len(positions)):
        row = 3 * positions[i] - n_above
        target[row] += source[3 * i]
        target[row + 1] += source[3 * i + 1]
        target[row + 2] += source[3 * i + 2]


TILE = 192
"""Rows and columns of a tile: enough for BLAS to be fast, few enough for threads to share a front. A multiple of 3."""


def rounds(
    s: int,  # the supernode
    # supernodes, fronts, routines, data, factor, kept: as for `bspline_mdao.base.sparse.multifrontal.factorize`; the
    # updates of the children are among the kept ones
    supernodes: Supernodes,
    fronts: Fronts,
    routines: Routines,
    data: np.ndarray,
    factor: np.ndarray,
    kept: np.ndarray,
    # (n_supernodes,) of int, position of the first point of each supernode whose pivot is not positive and finite;
    # unchanged if all are
    failed: np.ndarray,
) -> Iterator[list[Callable[[], None]]]:
    """Yield the tasks of every round of a large front whose children are done, for several threads."""
    # Columns and rows of the front are cut at multiples of `TILE` and where its own columns end. Each *round* is a set
    # of tasks that can run at the same time; every tile is touched by one task of a round, so the order of all sums,
    # hence every bit of the result, is the same for any number of threads. Steps are as in `factorize`:
    #
    # round          step  tasks
    # assembly       1     one for each column of tiles: blocks of the matrix and updates of the children
    # pivot          2     the first diagonal tile
    # for each column of tiles k of its own:
    #   division     3     all tiles below the diagonal tile k, by its factor
    #   subtraction  2, 3  the products of these from all own tiles to their right; (k + 1, k + 1) is also factored
    # update         4     all tiles of the Schur complement of its rows
    n_pivots = 3 * int(supernodes.firsts[s + 1] - supernodes.firsts[s])
    n = n_pivots + 3 * int(supernodes.row_starts[s + 1] - supernodes.row_starts[s])
    eliminated, rest = _tiles(0, n_pivots), _tiles(n_pivots, n)
    panel = factor[fronts.panel_starts[s] : fronts.panel_starts[s + 1]]
    update = _update_of(fronts.update_starts[s], n - n_pivots, kept, kept[:0])
    is_leaf = fronts.child_starts[s + 1] == fronts.child_starts[s]

    def add_up(first: int, last: int) -> None:
        _assemble(s, first // 3, last // 3, supernodes, fronts, data, factor, kept, kept[:0])

    def pivot(tile: tuple[int, int]) -> None:
        column = _pivot(routines, panel, n, *tile)
        if column >= 0:
            failed[s] = supernodes.firsts[s] + column // 3

    def subtract(tile: tuple[int, int], rows: tuple[int, int], columns: tuple[int, int]) -> None:
        _subtract(routines, panel, n, *tile, rows, columns, panel[columns[0] * n + rows[0] :], n, False)
        if rows == columns == eliminated[eliminated.index(tile) + 1]:
            pivot(rows)

    def complement(rows: tuple[int, int], columns: tuple[int, int]) -> None:
        target = update[(columns[0] - n_pivots) * (n - n_pivots) + rows[0] - n_pivots :]
        _subtract(routines, panel, n, 0, n_pivots, rows, columns, target, n - n_pivots, is_leaf)

    yield [partial(add_up, *tile) for tile in eliminated + rest]
    yield [partial(pivot, eliminated[0])]
    for k, tile in enumerate(eliminated, start=1):
        yield [partial(_divide, routines, panel, n, *tile, *rows) for rows in eliminated[k:] + rest]
        yield [partial(subtract, tile, *pair) for pair in _pairs(eliminated[k:], eliminated[k:] + rest)]
    yield [partial(complement, *pair) for pair in _pairs(rest, rest)]


def _tiles(start: int, stop: int) -> list[tuple[int, int]]:
    """First and last scalar of every tile of a range."""
    return [(first, min(first + TILE, stop)) for first in range(start, stop, TILE)]


def _pairs(
    columns: Sequence[tuple[int, int]], rows: Sequence[tuple[int, int]]
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns of the tiles of a lower triangle; ``rows`` starts with ``columns``."""
    return [(row, column) for j, column in enumerate(columns) for row in rows[j:]]


@njit(cache=True, nogil=True, error_model="numpy")
def _pivot(routines, panel, n, first, last):
    """Factor a diagonal tile of a panel of ``n`` rows; return the first unusable column, or -1."""
    info = np.zeros(1, np.int32)
    tile = panel[first * n + first :]
    call(routines.potrf, (LOWER, last - first, tile, n, info))
    failed = info[0] - 1 if info[0] > 0 else _first_unusable(tile, n, last - first)
    return first + failed if failed >= 0 else -1


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(routines, panel, n, first, last, row, end):
    """Multiply rows of a panel by the inverse transpose of a diagonal tile."""
    one = np.ones(1, panel.dtype)
    tile, below = panel[first * n + first :], panel[first * n + row :]
    call(routines.trsm, (RIGHT, LOWER, TRANSPOSED, NOT_UNIT, end - row, last - first, one, tile, n, below, n))


@njit(cache=True, nogil=True, error_model="numpy")
def _subtract(routines, panel, n, first, last, rows, columns, target, n_target, is_new):
    """Subtract the product of two sets of rows of a panel from a target of ``n_target`` rows, or store it there."""
    signs = np.array([-1.0, 0.0 if is_new else 1.0]).astype(panel.dtype)
    n_rows, n_columns, width = rows[1] - rows[0], columns[1] - columns[0], last - first
    left, right = panel[first * n + rows[0] :], panel[first * n + columns[0] :]
    minus_one, beta = signs[:1], signs[1:]
    if rows[0] == columns[0]:
        call(routines.syrk, (LOWER, NOT_TRANSPOSED, n_rows, width, minus_one, left, n, beta, target, n_target))
        return
    sizes = (n_rows, n_columns, width)
    call(routines.gemm, (NOT_TRANSPOSED, TRANSPOSED, *sizes, minus_one, left, n, right, n, beta, target, n_target))


@njit(cache=True, nogil=True, error_model="numpy")
def pivots(supernodes, fronts, factor):
    """Pivots, the squares of the diagonal of the factor, in the order of elimination; shape (n, 3)."""
    squares = np.empty((supernodes.firsts[-1], 3))
    for s in range(len(supernodes.parents)):
        n_pivots, n_rest = _extents(s, supernodes)
        n, panel = n_pivots + n_rest, factor[fronts.panel_starts[s] : fronts.panel_starts[s + 1]]
        for column in range(n_pivots):
            root = np.float64(panel[column * n + column])
            squares[supernodes.firsts[s] + column // 3, column % 3] = root * root
    return squares


@njit(cache=True, nogil=True, error_model="numpy")
def solve_forward(
    # supernodes to do
    first,  # int
    last,  # int
    # see `Supernodes`
    firsts,  # ndarray of int
    row_starts,  # ndarray of int
    rows,  # ndarray of int
    panel_starts,  # ndarray of int64, see `Fronts`
    routines,  # Routines, of the precision of the factor
    factor,  # (n_factor,), the panels, as `factorize` left them
    # right-hand sides in the order of elimination, in the precision of the factor; overwritten for these fronts
    x,  # (3 n, m)
    later,  # (3 (n - firsts[last]), m), accumulates what must be subtracted from the right-hand sides of later fronts
):
    """Solve with the factor for the fronts ``first <= supernode < last``, in place."""
    signs, rest = _signs_and_rest(first, last, row_starts, factor, x)
    for s in range(first, last):
        front_rows = rows[row_starts[s] : row_starts[s + 1]]
        eliminated = x[3 * firsts[s] : 3 * firsts[s + 1]]
        _forward(routines, factor[panel_starts[s] :], eliminated, rest, 3 * len(front_rows), signs)
        for i in range(len(front_rows)):
            place = 3 * (front_rows[i] - firsts[last])
            for r in range(3):
                for side in range(x.shape[1]):
                    if place < 0:
                        x[3 * front_rows[i] + r, side] -= rest[3 * i + r, side]
                    else:
                        later[place + r, side] += rest[3 * i + r, side]


@njit(cache=True, nogil=True, error_model="numpy")
def solve_backward(first, last, firsts, row_starts, rows, panel_starts, routines, factor, x):
    """Solve with the transpose of the factor, after all later fronts are done; see `solve_forward`."""
    signs, rest = _signs_and_rest(first, last, row_starts, factor, x)
    for s in range(last - 1, first - 1, -1):
        front_rows = rows[row_starts[s] : row_starts[s + 1]]
        eliminated = x[3 * firsts[s] : 3 * firsts[s + 1]]
        for i in range(len(front_rows)):
            for r in range(3):
                for side in range(x.shape[1]):
                    rest[3 * i + r, side] = x[3 * front_rows[i] + r, side]
        _backward(routines, factor[panel_starts[s] :], eliminated, rest, 3 * len(front_rows), signs)


@njit(cache=True, nogil=True, error_model="numpy")
def _signs_and_rest(first, last, row_starts, factor, x):
    """The numbers -1, 0 and 1 in the precision of the factor, and space for the rows of any of these fronts."""
    n_rows = 0
    for s in range(first, last):
        n_rows = max(n_rows, row_starts[s + 1] - row_starts[s])
    return np.array([-1.0, 0.0, 1.0]).astype(factor.dtype), np.empty((3 * n_rows, x.shape[1]), factor.dtype)


@njit(cache=True, nogil=True, error_model="numpy")
def _forward(routines, panel, eliminated, rest, n_rest, signs):
    """``own = L_11^-1 eliminated`` and ``rest = L_21 eliminated``; BLAS treats the rows of several sides as columns."""
    n_pivots, m = eliminated.shape
    n, below, zero, one, step = n_pivots + n_rest, panel[n_pivots:], signs[1:2], signs[2:3], 1
    if m == 1:
        call(routines.trsv, (LOWER, NOT_TRANSPOSED, NOT_UNIT, n_pivots, panel, n, eliminated, step))
        call(routines.gemv, (NOT_TRANSPOSED, n_rest, n_pivots, one, below, n, eliminated, step, zero, rest, step))
        return
    call(routines.trsm, (RIGHT, LOWER, TRANSPOSED, NOT_UNIT, m, n_pivots, one, panel, n, eliminated, m))
    call(routines.gemm, (NOT_TRANSPOSED, TRANSPOSED, m, n_rest, n_pivots, one, eliminated, m, below, n, zero, rest, m))


@njit(cache=True, nogil=True, error_model="numpy")
def _backward(routines, panel, eliminated, rest, n_rest, signs):
    """``own = L_11^-T (eliminated - L_21^T rest)``."""
    n_pivots, m = eliminated.shape
    n, below, minus_one, one, step = n_pivots + n_rest, panel[n_pivots:], signs[0:1], signs[2:3], 1
    if m == 1:
        call(routines.gemv, (TRANSPOSED, n_rest, n_pivots, minus_one, below, n, rest, step, one, eliminated, step))
        call(routines.trsv, (LOWER, TRANSPOSED, NOT_UNIT, n_pivots, panel, n, eliminated, step))
        return
    call(
        routines.gemm,
        (NOT_TRANSPOSED, NOT_TRANSPOSED, m, n_pivots, n_rest, minus_one, rest, m, below, n, one, eliminated, m),
    )
    call(routines.trsm, (RIGHT, LOWER, NOT_TRANSPOSED, NOT_UNIT, m, n_pivots, one, panel, n, eliminated, m))
