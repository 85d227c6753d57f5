"""Fields of the cells of a grid, block by block: for files that ParaView shows, and for pictures.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..topology.block_layout import has_cells
from ..topology.grid import PATCH_KINDS, Grid, Patch
from ..topology.index_space import Window
from .grid_quality import GridQuality

__all__ = ["FIELDS", "cell_fields", "cell_middle", "face_layer", "patch_numbers"]

FIELDS = ("Q", "smallest_corner", "wall_height", "block", "patch")
"""Names of the fields, in the order in which files have them."""


def cell_fields(grid: Grid) -> dict[str, list[np.ndarray]]:
    """Find the quality and the place of every cell.

    Examples
    --------
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> grid = onera_m6_grid((7, 6, 5))
    >>> grid.shapes[0], cell_fields(grid)["Q"][0].shape
    ((7, 6, 5), (6, 5, 4))
    """
    # `InputError` if no block has cells, or all nodes of a block are at one point
    # returns by the names in `FIELDS`, one array per block, of shape (ni - 1, nj - 1, nk - 1), where a direction with
    # one node has one layer. ``Q`` of Eq. (9) and ``smallest_corner``, the smallest corner triple product of unit edges
    # (NaN in a block without cells); ``wall_height`` of the first cells off walls (m), the mean at the nodes of the
    # cell on the wall, and NaN elsewhere; the numbers ``block`` and ``patch`` from 1, where a cell at no patch has 0,
    # and a cell at several patches counts for a wall before a plane of symmetry
    shapes = [tuple(max(n - 1, 1) for n in shape) for shape in grid.shapes]
    found = {name: [np.full(shape, np.nan) for shape in shapes] for name in FIELDS[:3]}
    quality, nodes = GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3)
    for block, cells in zip(quality.blocks, quality.cells_in_turn(nodes)):
        for name, values in (("Q", cells.q), ("smallest_corner", cells.min_corner)):
            found[name][block.window.block][...] = values.reshape(shapes[block.window.block])
    _set_heights(grid, quality, nodes, found["wall_height"])
    found["block"] = [np.full(shape, n, dtype=np.int32) for n, shape in enumerate(shapes, 1)]
    found["patch"] = patch_numbers(grid)
    return found


def patch_numbers(grid: Grid) -> list[np.ndarray]:
    """Number, from 1, of the patch at every cell, 0 if there is none; one array per block, see `cell_fields`."""
    found = [np.zeros(tuple(max(n - 1, 1) for n in shape), dtype=np.int32) for shape in grid.shapes]
    numbered = list(enumerate(grid.patches, 1))
    for kind in reversed(PATCH_KINDS):  # a cell at several patches counts for the first of the kinds
        for number, window in _windows(numbered, kind):
            face_layer(found[window.block], window, grid.shapes[window.block])[...] = number
    return found


def _windows(numbered: list[tuple[int, Patch]], kind: str) -> list[tuple[int, Window]]:
    """Numbers and windows of the patches of a kind."""
    return [(number, window) for number, patch in numbered if patch.kind == kind for window in patch.windows]


def face_layer(
    cells: np.ndarray,  # (ni - 1, nj - 1, nk - 1, ...), values of the cells of a block
    window: Window,  # on a face of the block
    shape: tuple[int, ...],  # nodes of the block
) -> np.ndarray:  # of one layer of cells in the flat direction; a view
    """View the cells behind a face window."""
    parts = []
    for lo, hi, n in zip(window.lo, window.hi, shape):
        if lo < hi:
            parts.append(slice(lo, hi))
        else:
            at = min(lo, max(n - 2, 0))
            parts.append(slice(at, at + 1))
    return cells[tuple(parts)]


def cell_middle(nodes: np.ndarray, index: Sequence[int]) -> np.ndarray:
    """Mean of the corners of a cell (m), shape (3,), from the nodes (n_i, n_j, n_k, 3) and its indices from 0."""
    return nodes[tuple(slice(at, at + 2) for at in index)].reshape(-1, 3).mean(axis=0)


def _set_heights(grid: Grid, quality: GridQuality, nodes: np.ndarray, heights: list[np.ndarray]) -> None:
    """Set the heights of the cells behind walls: means over their nodes on the wall that have one."""
    first = quality.first_cells
    values, places = first.heights(nodes), first.places
    walls = [patch for patch in grid.patches if patch.kind == "wall"]
    for number, ids in first.by_patch():
        for window in walls[number].windows:
            in_block = ids[places[ids, 0] == window.block]
            at = places[in_block, 1:] - 1
            is_inside = ((at >= window.lo) & (at <= window.hi)).all(axis=1)
            if has_cells(grid.shapes[window.block]):
                on_nodes = np.full(window.shape, np.nan)
                on_nodes[tuple((at[is_inside] - window.lo).T)] = values[in_block[is_inside]]
                layer = face_layer(heights[window.block], window, grid.shapes[window.block])
                layer[...] = _mean_at_corners(on_nodes).reshape(layer.shape)


def _mean_at_corners(on_nodes: np.ndarray) -> np.ndarray:
    """Mean over the corners of each face of a window, ignoring corners without a value."""
    sums = np.zeros(tuple(max(n - 1, 1) for n in on_nodes.shape))
    counts = np.zeros_like(sums)
    for corner in np.ndindex(*(min(n, 2) for n in on_nodes.shape)):
        part = on_nodes[tuple(slice(c, c + n) for c, n in zip(corner, sums.shape))]
        sums += np.nan_to_num(part)
        counts += np.isfinite(part)
    return np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)
