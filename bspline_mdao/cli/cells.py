"""Cells of a grid before and after a move, for a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..grids.hexahedron import CellQuality, cell_quality, collapsed_corners
from ..grids.multiblock import Grid


@dataclass(frozen=True)
class CellChange:
    """Quality of the cells before and after a move.

    Parameters
    ----------
    before, after : dict of str to float
        ``q_min``, ``q_mean``, ``n_inverted``, ``min_corner`` and ``min_volume`` (m^3).
    n_inverted : int
        Cells that are inverted after the move and were not before.
    place : str
        The worst of them; empty where there is none.
    """

    before: dict[str, float]
    after: dict[str, float]
    n_inverted: int
    place: str


def compare_cells(baseline: Grid, grid: Grid) -> CellChange:
    """Measure all cells of a grid before and after a move."""
    collapsed = [collapsed_corners(block.nodes) for block in baseline.blocks]
    before, after = ([cell_quality(b.nodes, c) for b, c in zip(g.blocks, collapsed)] for g in (baseline, grid))
    n_inverted, place, least = 0, "", np.inf
    for number, (old, new) in enumerate(zip(before, after), start=1):
        corner = np.where(old.is_valid, new.min_corner * (old.handedness * new.handedness), np.inf)
        n_inverted += int(np.count_nonzero(~(corner > 0.0)))
        worst = np.unravel_index(np.argmin(corner), corner.shape)
        if not corner[worst] >= min(least, np.finfo(float).tiny):
            least = corner[worst]
            place = f"cell ({', '.join(str(int(n) + 1) for n in worst)}) of block {number}"
    return CellChange(_numbers(before), _numbers(after), n_inverted, place)


def _numbers(blocks: Sequence[CellQuality]) -> dict[str, float]:
    """Numbers of all blocks together."""
    return {
        "q_min": min(float(block.q.min()) for block in blocks),
        "q_mean": sum(float(block.q.sum()) for block in blocks) / sum(block.q.size for block in blocks),
        "n_inverted": sum(int(np.count_nonzero(~block.is_valid)) for block in blocks),
        "min_corner": min(float(block.min_corner.min()) for block in blocks),
        "min_volume": min(float(block.volume.min()) for block in blocks),
    }
