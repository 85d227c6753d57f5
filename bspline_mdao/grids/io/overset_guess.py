"""Overset faces: outer boundaries of component grids inside others, found by blanking or by place.

A wall inside the box of cells around it also lies inside another grid. Its first cells distinguish it: they are fine
relative to the other end of their grid lines.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...base.text import counted
from ..topology.grid import Grid
from ..topology.index_space import Window
from ..topology.overset import component_numbers, is_fringe, lies_in_others
from ..topology.topology import Topology
from .grid_frame import first_cells
from .patch_certainty import FINE, FaceGuess

__all__ = ["OVERSET", "overlap_text", "with_overset"]

OVERSET = "overset"
"""Kind of such patches, and the name of guessed ones."""


def with_overset(grid: Grid, topology: Topology, guesses: Sequence[FaceGuess]) -> tuple[FaceGuess, ...]:
    """Find overset faces among those taken for walls or far fields; they come last."""
    if component_numbers(topology).max() == 0:
        return tuple(guesses)
    doubtful = [guess for guess in guesses if guess.kind in ("wall", "farfield")]
    inside = lies_in_others(grid, topology, [guess.window for guess in doubtful])
    found = {guess.window: _judged(grid, guess, is_inside) for guess, is_inside in zip(doubtful, inside)}
    guesses = [found.get(guess.window, guess) for guess in guesses]
    names = [name for name in dict.fromkeys(guess.name for guess in guesses) if name != OVERSET] + [OVERSET]
    return tuple(sorted(guesses, key=lambda guess: names.index(guess.name)))


def _judged(grid: Grid, guess: FaceGuess, is_inside: bool) -> FaceGuess:
    """Guess at a face that lies inside other grids, or is blanked as such."""
    if is_fringe(grid, guess.window):
        return FaceGuess(guess.window, OVERSET, OVERSET, "sure", "its nodes are blanked as interpolated")
    if not is_inside:
        return guess
    part = _by_other_end(grid, guess.window)
    cells = "" if part is None else f"; first cells {part:.2g} of those at the other end of their lines"
    reason = f"it lies inside other grids{cells}"
    if part is not None and part < FINE:
        return replace(guess, name="wall", kind="wall", level="likely", reason=f"{reason}, as at walls")
    return FaceGuess(guess.window, OVERSET, OVERSET, "unsure" if part is None else "likely", reason)


def _by_other_end(grid: Grid, window: Window) -> float | None:
    """Height of the first cells at a face relative to the other end of their grid lines; None for few cells."""
    shape = grid.shapes[window.block]
    axis = max((d for d in range(3) if window.lo[d] == window.hi[d]), key=lambda d: shape[d])
    at = 0 if window.lo[axis] else shape[axis] - 1
    lo, hi = ((*end[:axis], at, *end[axis + 1 :]) for end in (window.lo, window.hi))
    here, there = first_cells(grid, window), first_cells(grid, Window(window.block, lo, hi))
    return here / there if here is not None and there else None


def overlap_text(grid: Grid, topology: Topology, guesses: Sequence[FaceGuess]) -> str:
    """Say that component grids overlap, and how this is known; empty if they do not."""
    declared = [patch.name for patch in grid.patches if patch.kind == OVERSET]
    found = [guess for guess in guesses if guess.kind == OVERSET]
    n_blanked = sum(guess.level == "sure" for guess in found)
    reasons = []
    if declared:
        reasons.append(f"patches declared as overset: {', '.join(declared)}")
    if n_blanked:
        reasons.append(f"{counted(n_blanked, 'face')} blanked as interpolated")
    if len(found) > n_blanked:
        reasons.append(f"{counted(len(found) - n_blanked, 'face')} of no patch inside the blocks of others")
    if not reasons:
        return ""
    n = int(component_numbers(topology).max()) + 1
    return f"{counted(n, 'component grid')} overlap{'s' * (n == 1)} ({'; '.join(reasons)})"
