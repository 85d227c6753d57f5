"""Reports on a grid for people: extremes, a distribution of Q, inverted cells by name.

If processes hold pieces of the grid, all of them call these functions and get the same report, bitwise equal to the
report of one process.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.display import InNotebook
from ...base.numerics.processes import from_all, together
from ...errors import InputError
from ..topology.grid import PATCH_KINDS, Patch
from .block_cells import BlockCells
from .cell_fields import cell_middle
from .grid_quality import GridQuality
from .hexahedron import CellQuality
from .pieces import Pieces
from .wall_heights import PatchHeights, report_heights

__all__ = [
    "CellsAfterMove",
    "Distribution",
    "InvertedCell",
    "NamedCell",
    "QualityReport",
    "WorstCell",
    "distribution",
    "inverted_cells",
    "judge_move",
    "patches_of",
    "report_quality",
]

MOST_NAMED = 50
"""Number of inverted cells that a report names, the worst first: enough to find the place, few enough to print."""

MOST_WORST = 10
"""Number of cells with the smallest corners that a report names."""


@dataclass(frozen=True)
class Distribution:
    """Distribution of Q in uniform bins on [0, 1]."""

    edges: np.ndarray  # (n_bins + 1,), ends of the bins
    density: np.ndarray  # (n_bins,), fraction of the cells divided by the width of the bin; integrates to one
    # cells with Q < 0, which have no bin and are not part of the density, and cells whose Q is NaN
    n_negative: int


@dataclass(frozen=True)
class NamedCell:
    """A cell of a grid by its name."""

    block: str  # name of the block
    # number of the cell, from 1
    i: int
    j: int
    k: int

    def __str__(self) -> str:
        return f"cell ({self.i}, {self.j}, {self.k}) of {self.block}"


@dataclass(frozen=True)
class InvertedCell(NamedCell):
    """A cell with a corner that is folded or flat."""

    # block, i, j, k: see `NamedCell`

    corner: float  # smallest corner triple product of unit edges, relative to the handedness of the block
    patches: tuple[str, ...] = ()  # on which it has a face


@dataclass(frozen=True)
class WorstCell(NamedCell):
    """A cell whose smallest corner is among the smallest, inverted or not."""

    # block, i, j, k: see `NamedCell`

    # smallest corner triple product of unit edges, and Q
    corner: float
    q: float
    place: tuple[float, ...]  # middle of the cell (m)
    patch: str  # patch of the cell, a wall before others; empty if there is none


@dataclass(frozen=True)
class QualityReport(InNotebook):
    """Quality of a grid."""

    n_cells: int  # cells of all blocks
    # smallest and mean Q, Eq. (9)
    q_min: float
    q_mean: float
    min_corner: float  # smallest corner triple product of unit edges
    # smallest corner Jacobian and volume (m^3; m^2 in planar blocks)
    min_jacobian: float
    min_volume: float
    n_inverted: int  # cells with a corner that is folded or flat
    inverted: tuple[InvertedCell, ...]  # the worst of them
    histogram: Distribution  # distribution of Q
    heights: tuple[PatchHeights, ...] = ()  # heights of the first cells at every wall, compared with the baseline
    # the cells with the smallest corners, the worst first, even if none is inverted
    worst: tuple[WorstCell, ...] = ()

    def __repr__(self) -> str:
        return (
            f"QualityReport({self.n_cells:,} cells, Q {self.q_min:.3g} to mean {self.q_mean:.3g}, smallest corner "
            f"{self.min_corner:.3g}, {self.n_inverted:,} inverted)"
        )


def distribution(
    q: np.ndarray,  # Q of every cell; what exceeds 1 by rounding counts as 1
    n_bins: int = 50,  # number of bins
) -> Distribution:
    """Distribute Q over uniform bins on [0, 1].

    Examples
    --------
    >>> distribution(np.array([0.1, 0.7, 0.9, -0.2]), n_bins=2)
    Distribution(edges=array([0. , 0.5, 1. ]), density=array([0.66666667, 1.33333333]), n_negative=1)
    """
    # `InputError` if there is not at least one bin
    _require_bins(n_bins)
    return _distribution(*_counts(q, n_bins))


def _require_bins(n_bins: int) -> None:
    if n_bins < 1:
        raise InputError(f"distribution of quality: {n_bins} bins; give at least 1")


def _counts(q: np.ndarray, n_bins: int) -> tuple[np.ndarray, int]:
    """Cells in every bin, and those that have none."""
    counted = np.minimum(q[q >= 0.0], 1.0)
    return np.histogram(counted, bins=n_bins, range=(0.0, 1.0))[0], int(q.size - counted.size)


def _distribution(counts: np.ndarray, n_negative: int) -> Distribution:
    n_bins = len(counts)
    return Distribution(np.linspace(0.0, 1.0, n_bins + 1), counts * (n_bins / max(1, counts.sum())), n_negative)


class _Summary(NamedTuple):
    """Contribution of a process's cells to the report; ``q_sum`` in units of 2**-60, ``least`` of four measures."""

    n_cells: int
    q_sum: float
    least: np.ndarray
    n_inverted: int
    counts: np.ndarray
    n_negative: int

    @classmethod
    def of(cls, cells: CellQuality, n_bins: int) -> _Summary:
        """Summarise the cells of a block."""
        measures = cells.q, cells.min_corner, cells.min_jacobian, cells.volume
        least, n_inverted = np.array([values.min() for values in measures]), int(np.count_nonzero(~cells.is_valid))
        return cls(cells.q.size, _exact_sum(cells.q), least, n_inverted, *_counts(cells.q.ravel(), n_bins))

    @classmethod
    def join(cls, parts: Sequence[_Summary], n_bins: int) -> _Summary:
        """Join the summaries of parts of a grid, of which there may be none."""
        n_cells, q_sum, _, n_inverted, _, n_negative = (sum(column) for column in zip(*parts)) if parts else [0] * 6
        least = np.min([np.full(4, np.inf), *(part.least for part in parts)], axis=0)
        counts = np.sum([np.zeros(n_bins, dtype=int), *(part.counts for part in parts)], axis=0)
        return cls(n_cells, q_sum, least, n_inverted, counts, n_negative)


def _exact_sum(q: np.ndarray) -> int | float:
    """Sum of numbers of size 1, in whole units of 2**-60: the same in any order. NaN if one of them is NaN."""
    if np.isnan(q).any():
        return np.nan
    high = np.rint(q * 2.0**30)
    low = np.rint((q - high * 2.0**-30) * 2.0**60)
    return (int(high.sum(dtype=np.int64)) << 30) + int(low.sum(dtype=np.int64))


def report_quality(quality: GridQuality, nodes: np.ndarray, n_bins: int = 50) -> QualityReport:
    """Report on the cells of a grid.

    Parameters
    ----------
    quality : GridQuality
        The cells, and what the baseline decided about them.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of all blocks (m).
    n_bins : int
        Bins of the distribution of Q.

    Returns
    -------
    QualityReport
        Smallest and mean Q, inverted and worst cells, heights of the first cells at walls.

    Raises
    ------
    InputError
        If there is not at least one bin.

    Examples
    --------
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.grids import GridQuality, report_quality
    >>> grid = brick_grid((5, 5, 5, 5))
    >>> report = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    >>> report.n_cells == sum((i - 1) * (j - 1) * (k - 1) for i, j, k in grid.shapes)
    True
    """
    _require_bins(n_bins)
    comm, cells = quality.pieces.comm, quality.cells_in_turn(nodes)
    summaries, worst, lowest = [], [], []
    with together(comm):
        for block, measures in zip(quality.blocks, cells):
            summaries.append(_Summary.of(measures, n_bins))
            worst += _worst(block, measures, False, quality.pieces)
            lowest += _lowest(block, measures, nodes, quality.pieces)
    whole = _Summary.join(from_all(comm, _Summary.join(summaries, n_bins)), n_bins)
    q_min, min_corner, min_jacobian, min_volume = whole.least.tolist()
    return QualityReport(
        n_cells=whole.n_cells,
        q_min=q_min,
        q_mean=whole.q_sum / (whole.n_cells << 60),
        min_corner=min_corner,
        min_jacobian=min_jacobian,
        min_volume=min_volume,
        n_inverted=whole.n_inverted,
        inverted=_worst_of_all(comm, worst),
        histogram=_distribution(whole.counts, whole.n_negative),
        heights=report_heights(quality.first_cells, nodes),
        worst=_worst_of_all(comm, lowest, MOST_WORST),
    )


class CellsAfterMove(NamedTuple):
    """Changes of the cells of a grid in a move."""

    n_inverted: int  # cells that were valid on the baseline and are inverted now
    q_min: float  # smallest Q of the cells that were valid on the baseline
    q_mean: float  # mean Q of all cells


def judge_move(quality: GridQuality, nodes: np.ndarray) -> CellsAfterMove:
    """Judge a move by the cells that were valid on the baseline.

    Parameters
    ----------
    quality : GridQuality
        The cells, and what the baseline decided about them.
    nodes : ndarray, shape (n_nodes, 3)
        Moved nodes of all blocks (m).

    Returns
    -------
    CellsAfterMove
        ``n_inverted``, the cells that were valid and are not now, ``q_min`` of the valid ones, and ``q_mean`` of all.

    Examples
    --------
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.grids import GridQuality, judge_move
    >>> grid = brick_grid((5, 5, 5, 5))
    >>> judge_move(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3) * [1.0, 1.0, 3.0]).n_inverted
    0
    """
    n_inverted, q_min = 0, np.inf
    total: float = 0
    for block, measures in zip(quality.blocks, quality.cells_in_turn(nodes)):
        was_valid = np.ones(measures.q.size, dtype=bool)
        was_valid[block.was_invalid] = False
        n_inverted += int(np.count_nonzero(was_valid & ~measures.is_valid.ravel()))
        q_min = min(q_min, float(np.min(measures.q.ravel(), where=was_valid, initial=np.inf)))
        total += _exact_sum(measures.q)
    every = from_all(quality.pieces.comm, (n_inverted, q_min, total))
    q_mean = sum(part[2] for part in every) / (quality.pieces.n_cells_of_all << 60)
    return CellsAfterMove(sum(part[0] for part in every), min(part[1] for part in every), q_mean)


def inverted_cells(
    quality: GridQuality,  # the cells, and what the baseline decided about them
    cells: Iterable[CellQuality],  # their measures, from `GridQuality.cells` or `GridQuality.cells_in_turn`
    newly: bool = False,  # only those that were valid on the baseline
) -> tuple[InvertedCell, ...]:
    """Name the inverted cells, the worst first and at most `MOST_NAMED` of them."""
    worst = []
    with together(quality.pieces.comm):
        for block, measures in zip(quality.blocks, cells):
            worst += _worst(block, measures, newly, quality.pieces)
    return _worst_of_all(quality.pieces.comm, worst)


def patches_of(cells: Iterable[InvertedCell]) -> tuple[str, ...]:
    """Patches on which inverted cells have faces, ordered by the number of cells.

    Examples
    --------
    >>> patches_of([InvertedCell("block 1", 1, 1, n, -0.1, at) for n, at in enumerate([("a", "b"), ("b",), ()])])
    ('b', 'a')
    """
    return tuple(name for name, _ in Counter(name for cell in cells for name in cell.patches).most_common())


def _worst(block: BlockCells, measures: CellQuality, newly: bool, pieces: Pieces) -> list[tuple]:
    """Worst inverted cells of a block, each with its sort key: its corner measure, its block and its number there."""
    ids = np.flatnonzero(~measures.is_valid)
    if newly:
        ids = np.setdiff1d(ids, block.was_invalid, assume_unique=True)
    corners = measures.min_corner.ravel()[ids]
    found = []
    for n in np.argsort(corners, kind="stable")[:MOST_NAMED]:
        corner, (i, j, k) = float(corners[n]), block.number(ids[n])
        order = np.inf if math.isnan(corner) else corner
        at = tuple(sorted({patch.name for patch in _patches_at((i - 1, j - 1, k - 1), block.window.block, pieces)}))
        found.append((order, block.window.block, (i, j, k), InvertedCell(block.name, i, j, k, corner, at)))
    return found


def _lowest(block: BlockCells, measures: CellQuality, nodes: np.ndarray, pieces: Pieces) -> list[tuple]:
    """Cells of a block with the smallest corners, each with its sort key, as in `_worst`."""
    corners = np.where(np.isnan(measures.min_corner), -np.inf, measures.min_corner).ravel()
    n = min(MOST_WORST, corners.size)
    limit = np.partition(corners, n - 1)[n - 1]
    # in case of ties the first ones, whichever process holds them
    ids = np.append(np.flatnonzero(corners < limit), np.flatnonzero(corners == limit)[:n])
    x, found = block.nodes_of(nodes), []
    for cell in ids[np.argsort(corners[ids], kind="stable")][:MOST_WORST]:
        index = np.unravel_index(cell, block.degenerate_in_block.shape)
        i, j, k = block.number(cell)
        place = tuple(cell_middle(x, index).tolist())
        corner, q = (float(values.ravel()[cell]) for values in (measures.min_corner, measures.q))
        patch = _patch_of((i - 1, j - 1, k - 1), block.window.block, pieces)
        named = WorstCell(block.name, i, j, k, corner, q, place, patch)
        found.append((float(corners[cell]), block.window.block, (i, j, k), named))
    return found


def _patch_of(cell: tuple[int, ...], block: int, pieces: Pieces) -> str:
    """Patch of a cell of a block, the most important one; empty if there is none."""
    at: dict[str, str] = {}
    for patch in _patches_at(cell, block, pieces):
        at.setdefault(patch.kind, patch.name)
    return next((at[kind] for kind in PATCH_KINDS if kind in at), "")


def _patches_at(cell: tuple[int, ...], block: int, pieces: Pieces) -> Iterator[Patch]:
    """Patches on which a cell of a block has a face; a patch with two windows there is given twice."""
    for patch in pieces.patches:
        for window in (window for window in patch.windows if window.block == block):
            ends = zip(cell, window.lo, window.hi, pieces.shapes[block])
            if all((lo <= c < hi) if lo < hi else c == min(lo, max(n - 2, 0)) for c, lo, hi, n in ends):
                yield patch


def _worst_of_all(comm: Any, worst: Sequence[tuple], most: int = MOST_NAMED) -> tuple:
    """Join the worst cells of the blocks of all processes."""
    every = (cell for part in from_all(comm, sorted(worst, key=_order)[:most]) for cell in part)
    return tuple(cell for *_, cell in sorted(every, key=_order)[:most])


def _order(cell: tuple) -> tuple:
    return cell[:3]
