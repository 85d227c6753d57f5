"""Exchange of grid pieces between processes to shorten the cuts between them.

The communication between processes, and the loss in their preconditioners, grow with the faces between them.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .index_space import Window, by_blocks
from .topology import Topology

__all__ = ["faces_between", "with_short_cuts"]

SLACK = 0.02
"""Increase of the largest load that exchanges may cause, relative to the mean."""

PATIENCE = 10
"""Number of successive exchanges without gain before a pass ends."""


def with_short_cuts(topology: Topology, dealt: Sequence[Sequence[Window]]) -> list[list[Window]]:
    """Exchange pieces between processes until there are few faces between these, after Kernighan and Lin [1].

    In passes, until one gains nothing:

    1. Of all exchanges of two pieces and all moves of one, without those that took part in this pass, do the best one
       that keeps the largest load, even if it is a loss.
    2. Continue until several in a row have led to nothing better; undo those after the best.

    [1] B. W. Kernighan and S. Lin, "An efficient heuristic procedure for partitioning graphs", Bell System Technical
    Journal 49 (1970), 291-307.
    """
    pieces, n = [piece for pieces_of_rank in dealt for piece in pieces_of_rank], len(dealt)
    sizes, faces = np.array([math.prod(piece.shape) for piece in pieces]), faces_between(topology, pieces)
    ranks = np.repeat(np.arange(n), [len(pieces_of_rank) for pieces_of_rank in dealt])
    loads = np.bincount(ranks, sizes, n)
    most = max(loads.max(), (1.0 + SLACK) * loads.mean())
    is_better = n > 1 and len(pieces) > 1
    while is_better:
        ranks, is_better = _after_a_pass(faces, sizes, ranks, n, most)
    return [[piece for piece, at in zip(pieces, ranks) if at == k] for k in range(n)]


def _after_a_pass(
    faces: np.ndarray, sizes: np.ndarray, ranks: np.ndarray, n: int, most: float
) -> tuple[np.ndarray, bool]:
    """Processes of the pieces after a pass, and whether it gained anything."""
    best, now, gain, most_gained, n_tried = ranks, ranks.copy(), 0.0, 0.0, 0
    is_free = np.ones(len(ranks), bool)
    while n_tried < PATIENCE:
        one, other, target, change = _best_exchange(faces, sizes, now, n, most, is_free)
        if change == -np.inf:
            break
        now[[one, other]] = target, now[one]  # in a move, both are the same
        now[one], is_free[[one, other]] = target, False
        gain, n_tried = gain + change, n_tried + 1
        if gain > most_gained:
            best, most_gained, n_tried = now.copy(), gain, 0
    return best, most_gained > 0.0


def _best_exchange(
    faces: np.ndarray, sizes: np.ndarray, ranks: np.ndarray, n: int, most: float, is_free: np.ndarray
) -> tuple[int, int, int, float]:
    """Piece that goes, the piece that replaces it or the same one, its new process, and the gain."""
    loads, each = np.bincount(ranks, sizes, n), np.arange(len(ranks))
    shared = np.stack([faces[:, ranks == k].sum(axis=1) for k in range(n)], axis=1)  # of a piece with a process
    gains = shared - shared[each, ranks][:, None]
    fits = (loads + sizes[:, None] <= most) & is_free[:, None] & (ranks[:, None] != np.arange(n))
    moves = np.where(fits, gains, -np.inf)
    rest = loads[ranks][:, None] + sizes - sizes[:, None]  # at the process of the row, with the piece of the column
    fits = (np.maximum(rest, rest.T) <= most) & is_free & is_free[:, None] & (ranks != ranks[:, None])
    both = gains[:, ranks]
    swaps = np.where(fits, both + both.T - 2.0 * faces, -np.inf)
    if moves.max() > swaps.max():
        one, target = np.unravel_index(np.argmax(moves), moves.shape)
        return int(one), int(one), int(target), float(moves.max())
    one, other = np.unravel_index(np.argmax(swaps), swaps.shape)
    return int(one), int(other), int(ranks[other]), float(swaps.max())


def faces_between(topology: Topology, pieces: Sequence[Window]) -> np.ndarray:
    """Cell faces that any two pieces of blocks share, within blocks and through interfaces: shape (n, n)."""
    number, of_block = {piece: n for n, piece in enumerate(pieces)}, by_blocks(pieces)
    faces = np.zeros((len(pieces), len(pieces)))

    def add(one: Window, other: Window, n: int) -> None:
        if one != other:
            faces[number[one], number[other]] += n
            faces[number[other], number[one]] += n

    for windows in of_block.values():
        for at, one in enumerate(windows):
            for other in windows[at + 1 :]:
                add(one, other, _n_faces(one, other))
    for interface in topology.interfaces:
        for one in of_block.get(interface.a.block, ()):
            part = _common(one, interface.a)
            if _n_faces(part, part):
                there = interface.map_window(part)
                for other in of_block.get(interface.b.block, ()):
                    add(one, other, _n_faces(there, other))
    return faces


def _common(one: Window, other: Window) -> Window:
    """Nodes that two windows of a block share; none if any ``lo`` is above ``hi``."""
    lo, hi = np.maximum(one.lo, other.lo), np.minimum(one.hi, other.hi)
    return Window(one.block, tuple(lo.tolist()), tuple(hi.tolist()))


def _n_faces(one: Window, other: Window) -> int:
    """Cell faces in the plane that two windows of a block share; 0 if they share no plane."""
    steps = [n - 1 for n in _common(one, other).shape]
    return math.prod(step for step in steps if step) if min(steps) == 0 and steps.count(0) == 1 else 0
