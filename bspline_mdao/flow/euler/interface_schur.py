"""The cells next to other processes, whose rows of the preconditioner are solved for together.

A process eliminates the cells inside its part first, so that no fill leaves the part. What remains are equations of the
border cells of all processes, one layer on each side of a cut. Each process takes the equations of its own border and,
from their owners, of the border cells of others that it sees, factors them, and keeps its own part of a solution:
restricted additive Schwarz, but only for the borders. Two processes each have both borders, so their factor equals the
factor of one process with another order of elimination.

Theory: ``docs/theory/euler.rst``, "Several processes".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.halo import Halo
from ...base.numerics.vec5 import (
    add_scaled,
    less_product,
    load_block,
    load_half_block,
    load_halves,
    store_block,
    store_half_block,
    store_halves,
    zero_halves,
)
from .block_factor import BLOCK, BlockFactor, Pattern
from .cell_sums import visit

__all__ = ["Border", "BorderedFactor"]


@dataclass(frozen=True, eq=False)
class Border:
    """Border cells of a process and the border cells of others that it sees, and their pairs that have blocks."""

    # Own cells come first, in the order of their rows, and own pairs: first pairs of two own cells, then pairs at the
    # faces of the cut.

    # cells, pairs: exchange of rows of cells and of pairs
    cells: Halo
    pairs: Halo
    n_inside: int  # pairs of two own cells
    # left, right: (n_pairs,) of int, cells of the pairs
    left: np.ndarray
    right: np.ndarray

    @classmethod
    def of(
        cls,
        comm: Any,  # the processes
        n: int,  # own border cells
        # tuple of two ndarray of int, shape (n_inside,) of int, pairs of two own border cells
        inside: tuple[np.ndarray, np.ndarray],
        # own, others, ranks: (n_cut,) of int, for each face of the cut the own cell, the number of the other one among
        # the border cells of its process, and that process
        owned: np.ndarray,
        others: np.ndarray,
        ranks: np.ndarray,
    ) -> Border:
        """Determine which borders of others are seen: all processes call it together."""
        cells, places = Halo.of(comm, n, ranks, others)
        left, right = np.append(inside[0], owned), np.append(inside[1], places)
        names = np.stack([cells.owners(), cells.extend(np.arange(n))])
        outgoing: list[Any] = [np.zeros((5, 0), int)] * comm.size
        for rank, rows in cells.sent:
            is_seen = (names[0] > comm.rank) & (names[0] != rank)  # one of two informs a third about what it may see
            is_seen[rows] = True
            at = np.flatnonzero(is_seen[left] & is_seen[right])
            outgoing[rank] = np.concatenate([at[None], names[:, left[at]], names[:, right[at]]])
        incoming = comm.alltoall(outgoing)
        tellers = np.repeat(np.arange(comm.size), [part.shape[1] for part in incoming])
        numbers, *ends = np.concatenate(incoming, axis=1)
        (more_left, is_left), (more_right, is_right) = (_find(names, *end) for end in (ends[:2], ends[2:]))
        is_seen = is_left & is_right
        pairs, at = Halo.of(comm, len(left), tellers[is_seen], numbers[is_seen])
        left, right = (np.append(end, np.zeros(pairs.n_ghosts, int)) for end in (left, right))
        left[at], right[at] = more_left[is_seen], more_right[is_seen]
        return cls(cells, pairs, len(inside[0]), left, right)


def _find(names: np.ndarray, owners: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of cells among those with given owners and numbers there, shape (2, n), and whether they exist."""
    n = int(max(names[1].max(initial=0), numbers.max(initial=0))) + 1
    keys, wanted = names[0] * n + names[1], owners * n + numbers
    order = np.argsort(keys)
    at = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)] if len(keys) else 0 * wanted
    return at, (keys[at] == wanted if len(keys) else np.zeros(len(wanted), bool))


@dataclass(frozen=True, eq=False)
class BorderedFactor:
    """Factor of the cells of a process, whose border cells are solved for together with other processes."""

    # of the own cells: the last rows, those of the border, only have entries in columns of inner cells, and identity
    # blocks for pivots
    inner: BlockFactor
    # of the border cells that this process sees, after elimination of the inner cells
    outer: BlockFactor
    cells: Halo  # exchange of border cells

    @classmethod
    def of(
        cls,
        pattern: Pattern,  # of the own cells
        border: Border,
        outer_pattern: Any,  # of the border cells that this process sees, made from the pairs of the border
        # lower, upper: (n_entries + n_own_pairs, 5, 5), blocks at the entries of the pattern, then of the own pairs of
        # border cells: for the rows of their left cells in ``lower``, of the right ones in ``upper``
        lower: np.ndarray,
        upper: np.ndarray,
        diagonal: np.ndarray,  # (n, 5, 5), by rank
    ) -> BorderedFactor:
        """Factor a matrix in place, see `BlockFactor.of`: all processes call it together."""
        m, n_first = len(pattern.columns), len(diagonal) - border.cells.n_owned
        rest = lower[m:], upper[m:], diagonal[n_first:].copy()
        inner = BlockFactor.of(pattern, lower[:m], upper[:m], diagonal)
        rows = pattern.starts[n_first:], pattern.columns, lower, upper
        visit(len(rest[2]), lambda part: _eliminate_diagonal(*rows, part.start, part.stop, rest[2]))
        ends = border.left, border.right
        visit(border.n_inside, lambda part: _eliminate(*rows, *ends, part.start, part.stop, *rest[:2]))
        diagonal[n_first:] = np.eye(BLOCK)
        at_left, at_right = (border.pairs.extend(blocks) for blocks in rest[:2])
        placed = np.empty((len(outer_pattern.rank), BLOCK, BLOCK), np.float32)
        placed[outer_pattern.rank] = border.cells.extend(rest[2])
        below, above = (zero_halves((len(outer_pattern.columns), BLOCK, BLOCK)) for _ in range(2))
        is_low = outer_pattern.rank[border.left] > outer_pattern.rank[border.right]
        _place(outer_pattern.places, is_low, at_left, at_right, below, above)
        return cls(inner, BlockFactor.of(outer_pattern, below, above, placed), border.cells)

    def into_transposed(self) -> BorderedFactor:
        """Factor of the transpose, in the memory of this one, which becomes invalid."""
        return BorderedFactor(self.inner.into_transposed(), self.outer.into_transposed(), self.cells)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve approximately, shape (n, 5), in single precision: all processes call it together."""
        x, cells = self.inner.upwards(right), self.cells
        at_border = x[len(x) - cells.n_owned :]
        if self.inner.is_transposed:
            at_border[:] = cells.fold(self.outer.solve(cells.pad(at_border)))
        else:
            at_border[:] = cells.cut(self.outer.solve(cells.extend(at_border)))
        return self.inner.downwards(x).astype(right.dtype, copy=False)


@njit(cache=True, error_model="numpy", nogil=True)
def _eliminate_diagonal(starts, columns, lower, upper, first, end, diagonal):
    """Subtract the elimination of the inner cells from the diagonal blocks of border rows: ``A_ii - L_ik U_ki``."""
    for row in range(first, end):
        block = load_block(diagonal, 25 * row)
        for entry in range(starts[row], starts[row + 1]):
            block = less_product(block, load_half_block(lower, 25 * entry), load_half_block(upper, 25 * entry))
        store_block(diagonal, 25 * row, block)


@njit(cache=True, error_model="numpy", nogil=True)
def _eliminate(starts, columns, lower, upper, left, right, first, end, at_left, at_right):
    """Subtract the elimination of the inner cells from the blocks of pairs of border rows."""
    # ``A_ij - L_ik U_kj`` and ``A_ji - L_jk U_ki`` over the inner cells k that both rows have.
    for pair in range(first, end):
        i, j = left[pair], right[pair]
        low, up = load_half_block(at_left, 25 * pair), load_half_block(at_right, 25 * pair)
        place = starts[i]
        for other in range(starts[j], starts[j + 1]):
            while place < starts[i + 1] and columns[place] < columns[other]:
                place += 1
            if place < starts[i + 1] and columns[place] == columns[other]:
                low = less_product(low, load_half_block(lower, 25 * place), load_half_block(upper, 25 * other))
                up = less_product(up, load_half_block(lower, 25 * other), load_half_block(upper, 25 * place))
        store_half_block(at_left, 25 * pair, low)
        store_half_block(at_right, 25 * pair, up)


@njit(cache=True, error_model="numpy", nogil=True)
def _place(places, is_low, at_left, at_right, lower, upper):
    """Add the blocks of pairs at their entries, blocks of the later row below the diagonal."""
    one = np.float32(1.0)
    for pair in range(len(places)):
        for n in range(0, 25, 5):
            at = 25 * places[pair] + n
            below, above = load_halves(at_left, 25 * pair + n), load_halves(at_right, 25 * pair + n)
            if not is_low[pair]:
                below, above = above, below
            store_halves(lower, at, add_scaled(load_halves(lower, at), one, below))
            store_halves(upper, at, add_scaled(load_halves(upper, at), one, above))
