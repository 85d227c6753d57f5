"""Change of the heights of the first cells at every wall.

If processes hold pieces of the grid, all of them call these functions and get the same report, bitwise equal to the
report of one process.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.numerics.processes import on_first
from .first_cells import FirstCells, WallNode

__all__ = ["KEPT", "PatchHeights", "report_heights"]

KEPT = (0.9, 1.1)
"""Ratios of heights within which users of turbulence models consider y+, which is proportional, unchanged."""


@dataclass(frozen=True)
class PatchHeights:
    """Heights of the first cells at one wall."""

    patch: str  # the wall
    # nodes that have a height on the baseline, and nodes that have none
    n_nodes: int
    n_left_out: int
    # heights (m)
    height_min: float
    height_median: float
    height_max: float
    # heights relative to the baseline: smallest, 1 %, median, 99 % and largest
    ratio_min: float
    ratio_p01: float
    ratio_median: float
    ratio_p99: float
    ratio_max: float
    n_off: int  # nodes whose ratio is not within `KEPT`
    # places of the smallest and largest ratio
    lowest: WallNode
    highest: WallNode

    @property
    def is_kept(self) -> bool:
        """Whether at least 99 % of the nodes keep their heights."""
        return self.n_off <= 0.01 * self.n_nodes

    @property
    def worst(self) -> tuple[float, WallNode]:
        """The ratio farthest from 1, as a factor, and its place."""
        is_low = self.ratio_min * self.ratio_max < 1.0 or self.ratio_min <= 0.0
        return (self.ratio_min, self.lowest) if is_low else (self.ratio_max, self.highest)


def report_heights(
    cells: FirstCells,  # the first cells of the baseline
    nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
) -> tuple[PatchHeights, ...]:  # one for each wall that has heights
    """Report on the first cells of a grid, wall by wall."""
    comm = cells.pieces.comm
    heights = cells.heights(nodes)
    entries = (cells.keys[cells.at], cells.patch_ids, heights, heights / cells.baseline, cells.places)
    every = [entries] if comm.size == 1 else comm.gather(entries, root=0)
    return on_first(comm, lambda: _reports_by_patch(cells, every))


def _reports_by_patch(cells: FirstCells, every: Sequence[tuple[np.ndarray, ...]]) -> tuple[PatchHeights, ...]:
    """Reports on the walls from numbers, patches, heights, their ratios and places of the entries of all processes."""
    keys, patch_ids, heights, ratios, places = (np.concatenate(column) for column in zip(*every))
    in_order = np.argsort(keys)
    ids_of = (in_order[patch_ids[in_order] == number] for number in range(len(cells.patches)))
    columns = heights, ratios, places
    return tuple(
        _patch_heights(cells, number, *(column[ids] for column in columns))
        for number, ids in enumerate(ids_of)
        if ids.size
    )


def _patch_heights(
    cells: FirstCells, number: int, heights: np.ndarray, ratios: np.ndarray, places: np.ndarray
) -> PatchHeights:
    low, median, high = np.quantile(ratios, [0.01, 0.5, 0.99])
    lowest, highest = (places[at].tolist() for at in (ratios.argmin(), ratios.argmax()))
    return PatchHeights(
        patch=cells.patches[number],
        n_nodes=heights.size,
        n_left_out=int(cells.n_left_out[number]),
        height_min=float(heights.min()),
        height_median=float(np.median(heights)),
        height_max=float(heights.max()),
        ratio_min=float(ratios.min()),
        ratio_p01=float(low),
        ratio_median=float(median),
        ratio_p99=float(high),
        ratio_max=float(ratios.max()),
        n_off=int(np.count_nonzero((ratios < KEPT[0]) | (ratios > KEPT[1]))),
        lowest=WallNode(cells.pieces.names[lowest[0]], *lowest[1:]),
        highest=WallNode(cells.pieces.names[highest[0]], *highest[1:]),
    )
