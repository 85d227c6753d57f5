"""Fields of unstructured meshes for pictures and files: quality of cells, and heights of first nodes."""

from __future__ import annotations

import numpy as np

from .mixed_quality import MixedQuality

__all__ = ["pyramid_ratios", "wall_heights"]


def pyramid_ratios(
    quality: MixedQuality,  # quality measures of the cells, relative to the baseline
    nodes: np.ndarray,  # (n, 3), nodes (m)
) -> np.ndarray:
    """Smallest pyramid of every cell relative to the baseline, (n_cells,); NaN if none counts."""
    ratios = quality.cell_ratios(nodes)
    return np.where(np.isfinite(ratios), ratios, np.nan)


def wall_heights(quality: MixedQuality, nodes: np.ndarray) -> np.ndarray:
    """Heights of the first nodes (m) at the nodes of walls, (n,); NaN elsewhere."""
    heights, found = quality.heights, np.full(len(nodes), np.nan)
    found[heights.rows] = heights.ratios(nodes) * heights.baseline
    return found
