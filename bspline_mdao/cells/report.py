"""What is told about the cells of a grid: extremes, a distribution of Q, inverted cells by name, heights at walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .grid_quality import GridQuality
from .hexahedron import CellQuality
from .wall_report import PatchHeights, report_heights

__all__ = ["Distribution", "InvertedCell", "QualityReport", "distribution", "inverted_cells", "report_quality"]

MOST_NAMED = 50
"""Inverted cells that a report names, the worst first."""


@dataclass(frozen=True)
class Distribution:
    """Distribution of Q in uniform bins on [0, 1].

    Parameters
    ----------
    edges : ndarray, shape (n_bins + 1,)
        Ends of the bins.
    density : ndarray, shape (n_bins,)
        Share of the cells by the width of the bin; integrates to one.
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


def inverted_cells(quality: GridQuality, cells: Sequence[CellQuality], newly: bool = False) -> tuple[InvertedCell, ...]:
    """Name the inverted cells, the worst first and at most `MOST_NAMED` of them.

    Parameters
    ----------
    quality : GridQuality
        The cells, and what the baseline decided about them.
    cells : sequence of CellQuality
        Their measures, by `GridQuality.cells`.
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
            place = (int(m) + 1 for m in np.unravel_index(ids[n], measures.q.shape))
            found.append(InvertedCell(block.name, *place, float(corners[n])))
    return tuple(sorted(found, key=lambda cell: cell.corner)[:MOST_NAMED])
