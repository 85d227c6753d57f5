"""Fields of meshes without structure, which pictures and files show: how good cells are, and how high first nodes."""

from __future__ import annotations

import numpy as np

from .mixed_quality import MixedQuality

__all__ = ["pyramid_ratios", "wall_heights"]


def pyramid_ratios(
    quality: MixedQuality,  # what judges the cells, by those before
    nodes: np.ndarray,  # (n, 3), nodes (m)
) -> np.ndarray:
    """Smallest pyramid of every cell by that before, (n_cells,); not a number where none counts."""
    ratios = quality.cell_ratios(nodes)
    return np.where(np.isfinite(ratios), ratios, np.nan)


def wall_heights(quality: MixedQuality, nodes: np.ndarray) -> np.ndarray:
    """Heights of the first nodes (m) at the nodes of walls, (n,); not a number elsewhere."""
    heights, found = quality.heights, np.full(len(nodes), np.nan)
    found[heights.rows] = heights.ratios(nodes) * heights.baseline
    return found
