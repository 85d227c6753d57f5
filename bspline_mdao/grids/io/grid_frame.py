"""The middle of the nodes of a grid, its extent, and the growth of its cells from a face, for guesses at patches.

Nothing here depends on the position, orientation, handedness or unit of the grid.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.numerics.vectors import dots, lengths
from ..topology.grid import Grid
from ..topology.index_space import Window

__all__ = ["GridFrame", "first_cells"]

_NODES_SAMPLED = 100_000  # enough for the middle, which need not be exact

STEPS = 20
"""Steps of reweighting. They are few: a grid one cell deep may have two likeliest locations, one in each of its planes,
between which round-off would choose after about fifty steps."""

NARROW = 0.05
"""Scale of the Cauchy distribution of nodes about their middle, relative to the largest distance from their mean."""


@dataclass(frozen=True)
class GridFrame:
    """Extent of a grid and the middle of its nodes."""

    middle: np.ndarray  # (3,), where most nodes are (m)
    radius: float  # distance of the farthest node from there (m)

    @classmethod
    def of(cls, grid: Grid) -> GridFrame:
        """Measure a grid; its middle is estimated from nodes spread over it."""
        step = 1 + grid.n_nodes // _NODES_SAMPLED
        return cls._of_sample(np.concatenate([block.nodes.reshape(-1, 3)[::step] for block in grid.blocks]))

    @classmethod
    def of_points(cls, points: np.ndarray) -> GridFrame:
        """Measure a mesh by its nodes, shape (n, 3)."""
        return cls._of_sample(points[:: 1 + len(points) // _NODES_SAMPLED])

    @classmethod
    def _of_sample(cls, sample: np.ndarray) -> GridFrame:
        middle = _middle(sample)
        return cls(middle, float(lengths(sample - middle).max()))

    def distance(self, nodes: np.ndarray) -> float:
        """Smallest distance of nodes (..., 3) from the middle, relative to the radius."""
        return float(lengths(nodes - self.middle).min() / self.radius)


def _middle(points: np.ndarray) -> np.ndarray:
    """Likely location of the Cauchy distribution of points, shape (n, 3), by steps of reweighting from their mean."""
    # Medians by coordinates depend on the axes; the far field attracts the point of the smallest sum of distances.
    middle = points.mean(axis=0)
    radius = lengths(points - middle).max()
    for _ in range(STEPS):
        off = points - middle
        weights = 1.0 / (dots(off, off) + (NARROW * radius) ** 2)
        middle = middle + weights @ off / weights.sum()
    return middle


def first_cells(grid: Grid, window: Window) -> float | None:
    """Median height of the first cells at a window relative to the mean of their grid lines; None for few cells."""
    nodes = grid.blocks[window.block].nodes
    flat = [d for d in range(3) if window.lo[d] == window.hi[d]]
    axis = max(flat, key=lambda d: nodes.shape[d])
    if nodes.shape[axis] < 4:
        return None
    ranges = tuple(slice(lo, hi + 1) for lo, hi in zip(window.lo, window.hi))
    lines = np.moveaxis(nodes[tuple(slice(None) if d == axis else ranges[d] for d in range(3))], axis, 0)
    heights = lengths(np.diff(lines[:: -1 if window.lo[axis] else 1], axis=0))
    means = heights.mean(axis=0)
    is_line = means > 0.0
    return float(np.median(heights[0][is_line] / means[is_line])) if is_line.any() else None
