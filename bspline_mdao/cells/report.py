"""Reports on a grid for people: extremes, a distribution of Q, inverted cells by name, first cells at every wall.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..topology.grid import Grid
from .first_cells import FirstCells, WallNode
from .grid_quality import GridQuality
from .hexahedron import CellQuality

__all__ = [
    "CellsAfterMove",
    "Distribution",
    "InvertedCell",
    "PatchHeights",
    "QualityReport",
    "WallSpacing",
    "distribution",
    "flat_plate_y_plus",
    "inverted_cells",
    "judge_move",
    "report_heights",
    "report_quality",
    "wall_spacings",
]

MOST_NAMED = 50
"""Number of inverted cells that a report names, the worst first: enough to find the place, few enough to print."""

KEPT = (0.9, 1.1)
"""Ratios of heights within which users of turbulence models take y+, which is in proportion, for unchanged."""


@dataclass(frozen=True)
class Distribution:
    """Distribution of Q in uniform bins on [0, 1].

    Parameters
    ----------
    edges : ndarray, shape (n_bins + 1,)
        Ends of the bins.
    density : ndarray, shape (n_bins,)
        Fraction of the cells divided by the width of the bin; integrates to one.
    n_negative : int
        Cells with Q < 0, which have no bin and are not part of the density, and cells whose Q is no number.
    """

    edges: np.ndarray
    density: np.ndarray
    n_negative: int


@dataclass(frozen=True)
class InvertedCell:
    """A cell with a corner that is folded or flat.

    Parameters
    ----------
    block : str
        Name of the block.
    i, j, k : int
        Number of the cell, from 1.
    corner : float
        Smallest corner triple product of unit edges, relative to the handedness of the block.
    """

    block: str
    i: int
    j: int
    k: int
    corner: float

    def __str__(self) -> str:
        return f"cell ({self.i}, {self.j}, {self.k}) of {self.block}"


@dataclass(frozen=True)
class QualityReport:
    """Quality of a grid.

    Parameters
    ----------
    n_cells : int
        Cells of all blocks.
    q_min, q_mean : float
        Smallest and mean Q, Eq. (9).
    min_corner : float
        Smallest corner triple product of unit edges.
    min_jacobian, min_volume : float
        Smallest corner Jacobian and volume (m^3; m^2 in planar blocks).
    n_inverted : int
        Cells with a corner that is folded or flat.
    inverted : tuple of InvertedCell
        The worst of them.
    histogram : Distribution
        Distribution of Q.
    heights : tuple of PatchHeights
        Heights of the first cells at every wall, beside those of the baseline.
    """

    n_cells: int
    q_min: float
    q_mean: float
    min_corner: float
    min_jacobian: float
    min_volume: float
    n_inverted: int
    inverted: tuple[InvertedCell, ...]
    histogram: Distribution
    heights: tuple[PatchHeights, ...] = ()


def distribution(q: np.ndarray, n_bins: int = 50) -> Distribution:
    """Distribute Q over uniform bins on [0, 1].

    Parameters
    ----------
    q : ndarray
        Q of every cell. What exceeds 1 by rounding counts as 1.
    n_bins : int
        Number of bins.

    Returns
    -------
    Distribution

    Raises
    ------
    InputError
        If there is not at least one bin.

    Examples
    --------
    >>> distribution(np.array([0.1, 0.7, 0.9, -0.2]), n_bins=2)
    Distribution(edges=array([0. , 0.5, 1. ]), density=array([0.66666667, 1.33333333]), n_negative=1)
    """
    if n_bins < 1:
        raise InputError(f"distribution of quality: {n_bins} bins; give at least 1")
    counted = np.minimum(q[q >= 0.0], 1.0)
    counts, edges = np.histogram(counted, bins=n_bins, range=(0.0, 1.0))
    return Distribution(edges, counts * (n_bins / max(1, counted.size)), int(q.size - counted.size))


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
    """
    cells = quality.cells(nodes)
    q = np.concatenate([block.q.ravel() for block in cells])
    return QualityReport(
        n_cells=q.size,
        q_min=float(q.min()),
        q_mean=float(q.mean()),
        min_corner=float(min(block.min_corner.min() for block in cells)),
        min_jacobian=float(min(block.min_jacobian.min() for block in cells)),
        min_volume=float(min(block.volume.min() for block in cells)),
        n_inverted=sum(int(np.count_nonzero(~block.is_valid)) for block in cells),
        inverted=inverted_cells(quality, cells),
        histogram=distribution(q, n_bins),
        heights=report_heights(quality.first_cells, nodes),
    )


class CellsAfterMove(NamedTuple):
    """What a move made of the cells of a grid.

    Parameters
    ----------
    n_inverted : int
        Cells that were valid on the baseline and are not now.
    q_min : float
        Smallest Q of the cells that were valid on the baseline.
    q_mean : float
        Mean Q of all cells.
    """

    n_inverted: int
    q_min: float
    q_mean: float


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
    """
    n_inverted, q_min, total = 0, np.inf, 0.0
    for block, measures in zip(quality.blocks, quality.cells(nodes)):
        was_valid = np.ones(measures.q.size, dtype=bool)
        was_valid[block.was_invalid] = False
        n_inverted += int(np.count_nonzero(was_valid & ~measures.is_valid.ravel()))
        q_min = min(q_min, float(np.min(measures.q.ravel(), where=was_valid, initial=np.inf)))
        total += float(measures.q.sum())
    return CellsAfterMove(n_inverted, q_min, total / quality.n_cells)


def inverted_cells(quality: GridQuality, cells: Sequence[CellQuality], newly: bool = False) -> tuple[InvertedCell, ...]:
    """Name the inverted cells, the worst first and at most `MOST_NAMED` of them.

    Parameters
    ----------
    quality : GridQuality
        The cells, and what the baseline decided about them.
    cells : sequence of CellQuality
        Their measures, from `GridQuality.cells`.
    newly : bool
        Only those that were valid on the baseline.

    Returns
    -------
    tuple of InvertedCell
    """
    found = []
    for block, measures in zip(quality.blocks, cells):
        ids = np.flatnonzero(~measures.is_valid)
        if newly:
            ids = np.setdiff1d(ids, block.was_invalid, assume_unique=True)
        corners = measures.min_corner.ravel()[ids]
        for n in np.argsort(corners, kind="stable")[:MOST_NAMED]:
            i, j, k = (int(m) + 1 for m in np.unravel_index(ids[n], measures.q.shape))
            found.append(InvertedCell(block.name, i, j, k, float(corners[n])))
    return tuple(sorted(found, key=lambda cell: cell.corner)[:MOST_NAMED])


@dataclass(frozen=True)
class PatchHeights:
    """Heights of the first cells at one wall.

    Parameters
    ----------
    patch : str
        The wall.
    n_nodes, n_left_out : int
        Nodes that have a height on the baseline, and those that have none.
    height_min, height_median, height_max : float
        Heights (m).
    ratio_min, ratio_p01, ratio_median, ratio_p99, ratio_max : float
        Heights divided by those of the baseline: smallest, 1 %, median, 99 % and largest.
    n_off : int
        Nodes whose ratio is not within `KEPT`.
    lowest, highest : WallNode
        Where the ratio is smallest and largest.
    """

    patch: str
    n_nodes: int
    n_left_out: int
    height_min: float
    height_median: float
    height_max: float
    ratio_min: float
    ratio_p01: float
    ratio_median: float
    ratio_p99: float
    ratio_max: float
    n_off: int
    lowest: WallNode
    highest: WallNode

    @property
    def is_kept(self) -> bool:
        """Whether at least 99 % of the nodes keep their heights."""
        return self.n_off <= 0.01 * self.n_nodes

    @property
    def worst(self) -> tuple[float, WallNode]:
        """The ratio that is farthest from 1, as a factor, and where it is."""
        is_low = self.ratio_min * self.ratio_max < 1.0 or self.ratio_min <= 0.0
        return (self.ratio_min, self.lowest) if is_low else (self.ratio_max, self.highest)


@dataclass(frozen=True)
class WallSpacing:
    """Spacings at one wall, as a user of turbulence models looks at them.

    Parameters
    ----------
    patch : str
        The wall.
    n_nodes : int
        Nodes that have a height.
    height_min, height_median, height_max : float
        Heights of the first cells (m).
    growth_median, growth_max : float
        Lengths of the second cells off the wall over those of the first; not a number where no block has second ones.
    aspect_median, aspect_max : float
        Longest edges in the wall at a node over the height there; those across a grid that is one cell deep do not
        count.
    extents : tuple of float
        Sides of the wall's box (m), ascending.
    """

    patch: str
    n_nodes: int
    height_min: float
    height_median: float
    height_max: float
    growth_median: float
    growth_max: float
    aspect_median: float
    aspect_max: float
    extents: tuple[float, float, float]


def report_heights(cells: FirstCells, nodes: np.ndarray) -> tuple[PatchHeights, ...]:
    """Report on the first cells of a grid, wall by wall.

    Parameters
    ----------
    cells : FirstCells
        The first cells of the baseline.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of all blocks (m).

    Returns
    -------
    tuple of PatchHeights
        One for each wall that has heights.
    """
    heights = cells.heights(nodes)
    return tuple(_patch_heights(cells, number, ids, heights[ids]) for number, ids in _by_patch(cells))


def _patch_heights(cells, number, ids, heights):
    ratios = heights / cells.baseline[ids]
    low, median, high = np.quantile(ratios, [0.01, 0.5, 0.99])
    return PatchHeights(
        patch=cells.patches[number],
        n_nodes=ids.size,
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
        lowest=cells.place(ids[ratios.argmin()]),
        highest=cells.place(ids[ratios.argmax()]),
    )


def wall_spacings(grid: Grid) -> tuple[WallSpacing, ...]:
    """Measure the spacings at the walls of a grid.

    Parameters
    ----------
    grid : Grid
        The grid. Its walls are its patches of kind ``"wall"``.

    Returns
    -------
    tuple of WallSpacing
        One for each wall that has heights.
    """
    cells, nodes = FirstCells.of_baseline(grid), grid.to_vector().reshape(-1, 3)
    growth, aspect = _growth(cells, nodes), _longest_edges(cells, nodes) / cells.baseline
    wall = nodes[cells.rows[cells.at]]
    spacings = []
    for number, ids in _by_patch(cells):
        heights, growths = cells.baseline[ids], growth[ids][np.isfinite(growth[ids])]
        spacings.append(
            WallSpacing(
                patch=cells.patches[number],
                n_nodes=ids.size,
                height_min=float(heights.min()),
                height_median=float(np.median(heights)),
                height_max=float(heights.max()),
                growth_median=float(np.median(growths)) if growths.size else np.nan,
                growth_max=float(growths.max(initial=-np.inf)) if growths.size else np.nan,
                aspect_median=float(np.median(aspect[ids])),
                aspect_max=float(aspect[ids].max()),
                extents=tuple(np.sort(np.ptp(wall[ids], axis=0)).tolist()),
            )
        )
    return tuple(spacings)


def flat_plate_y_plus(height: float, reynolds: float, length: float) -> float:
    """Estimate y+ at a height above a flat plate with a turbulent boundary layer.

    Parameters
    ----------
    height : float
        Distance from the wall (m).
    reynolds : float
        Reynolds number per metre, ``U / nu`` (1/m).
    length : float
        Distance from the leading edge (m).

    Returns
    -------
    float
        ``y+ = u_tau y / nu`` with ``u_tau = U sqrt(c_f / 2)`` and the one-seventh power law
        ``c_f = 0.027 / Re_x^(1/7)``.

    References
    ----------
    F. M. White, *Fluid Mechanics*, 7th ed., McGraw-Hill, 2011, section 7.4.

    Examples
    --------
    >>> round(flat_plate_y_plus(1e-5, reynolds=1e7, length=1.0), 1)
    3.7
    """
    friction = 0.027 / (reynolds * length) ** (1.0 / 7.0)
    return height * reynolds * math.sqrt(0.5 * friction)


def _by_patch(cells: FirstCells) -> Iterator[tuple[int, np.ndarray]]:
    """Number, and numbers of the entries, of every wall that has heights."""
    for number in range(len(cells.patches)):
        ids = np.flatnonzero(cells.patch_ids == number)
        if ids.size:
            yield number, ids


def _growth(cells: FirstCells, nodes: np.ndarray) -> np.ndarray:
    """Length of the second edge off the wall over that of the first, shape (n,); not a number where there is none."""
    rows, next_rows = cells.rows[cells.at], cells.next_rows
    has_second = _nodes_along(cells, rows, next_rows) > 2
    far_rows = np.where(has_second, 2 * next_rows - rows, next_rows)
    first, second = (np.linalg.norm(nodes[b] - nodes[a], axis=1) for a, b in ((rows, next_rows), (next_rows, far_rows)))
    return np.where(has_second, second / first, np.nan)


def _longest_edges(cells: FirstCells, nodes: np.ndarray) -> np.ndarray:
    """Longest edge in the wall at every entry (m), shape (n,), but for those across a grid that is one cell deep."""
    rows = cells.rows[cells.quads]
    next_rows = np.roll(rows, -1, axis=1)
    lengths = np.linalg.norm(nodes[next_rows] - nodes[rows], axis=2)
    is_long = _nodes_along(cells, rows, next_rows) > 2
    lengths = np.where(is_long | ~is_long.any(axis=1, keepdims=True), lengths, 0.0)
    longest = np.zeros(cells.rows.size)
    for ends in (cells.quads, np.roll(cells.quads, -1, axis=1)):
        np.maximum.at(longest, ends, lengths)
    return longest[cells.at]


def _nodes_along(cells: FirstCells, rows: np.ndarray, next_rows: np.ndarray) -> np.ndarray:
    """Nodes of a block along the direction from a node to its neighbour, of their shape; 0 for no direction."""
    shapes = np.array(cells.shapes)
    block = np.searchsorted(np.cumsum(shapes.prod(axis=1)), rows, side="right")
    strides = np.stack([shapes[:, 1] * shapes[:, 2], shapes[:, 2], np.ones(len(shapes), dtype=int)], axis=1)
    is_along = strides[block] == np.abs(next_rows - rows)[..., None]
    return np.max(shapes[block], axis=-1, where=is_along, initial=0)
