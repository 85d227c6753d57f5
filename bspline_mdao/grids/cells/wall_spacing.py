"""Spacings at the walls of a grid, as needed for turbulence models: heights, growth, aspect ratios, y+.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..topology.grid import Grid
from .first_cells import FirstCells

__all__ = ["WallSpacing", "flat_plate_y_plus", "wall_spacings"]


@dataclass(frozen=True)
class WallSpacing:
    """Spacings at one wall, as needed for turbulence models."""

    patch: str  # the wall
    n_nodes: int  # nodes that have a height
    # heights of the first cells (m)
    height_min: float
    height_median: float
    height_max: float
    # lengths of the second cells off the wall relative to the first; NaN if no block has second cells
    growth_median: float
    growth_max: float
    # longest edges in the wall at a node relative to the height there, without edges across a grid one cell deep
    aspect_median: float
    aspect_max: float
    extents: tuple[float, float, float]  # sides of the wall's box (m), ascending


def wall_spacings(
    grid: Grid,  # the grid. Its walls are its patches of kind ``"wall"``
    cells: FirstCells | None = None,  # its first cells, if known
) -> tuple[WallSpacing, ...]:  # one for each wall that has heights
    """Measure the spacings at the walls of a grid."""
    cells, nodes = cells or FirstCells.of_baseline(grid), grid.to_vector().reshape(-1, 3)
    growth, aspect = _growth(cells, nodes), _longest_edges(cells, nodes) / cells.baseline
    wall = nodes[cells.rows[cells.at]]
    spacings = []
    for number, ids in cells.by_patch():
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


def flat_plate_y_plus(
    height: float,  # distance from the wall (m)
    reynolds: float,  # reynolds number per metre, ``U / nu`` (1/m)
    length: float,  # distance from the leading edge (m)
) -> float:
    """Estimate y+ at a height above a flat plate with a turbulent boundary layer.

    Examples
    --------
    >>> round(flat_plate_y_plus(1e-5, reynolds=1e7, length=1.0), 1)
    3.7
    """
    # F. M. White, *Fluid Mechanics*, 7th ed., McGraw-Hill, 2011, section 7.4.
    # returns ``y+ = u_tau y / nu`` with ``u_tau = U sqrt(c_f / 2)`` and the one-seventh power law ``c_f = 0.027 /
    # Re_x^(1/7)``
    friction = 0.027 / (reynolds * length) ** (1.0 / 7.0)
    return height * reynolds * math.sqrt(0.5 * friction)


def _growth(cells: FirstCells, nodes: np.ndarray) -> np.ndarray:
    """Length of the second edge off the wall relative to the first, shape (n,); NaN if there is none."""
    rows, next_rows = cells.rows[cells.at], cells.next_rows
    has_second = _nodes_along(cells, rows, next_rows) > 2
    far_rows = np.where(has_second, 2 * next_rows - rows, next_rows)
    first, second = (np.linalg.norm(nodes[b] - nodes[a], axis=1) for a, b in ((rows, next_rows), (next_rows, far_rows)))
    return np.where(has_second, second / first, np.nan)


def _longest_edges(cells: FirstCells, nodes: np.ndarray) -> np.ndarray:
    """Longest edge in the wall at every entry (m), shape (n,), without edges across a grid one cell deep."""
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
    """Number of nodes of a block along the direction from a node to its neighbour; 0 for no direction."""
    shapes = np.array(cells.pieces.shapes)
    block = cells.pieces.partition.layout.owner(rows)
    strides = np.stack([shapes[:, 1] * shapes[:, 2], shapes[:, 2], np.ones(len(shapes), dtype=int)], axis=1)
    is_along = strides[block] == np.abs(next_rows - rows)[..., None]
    return np.max(shapes[block], axis=-1, where=is_along, initial=0)
