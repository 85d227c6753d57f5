"""The worst cells of a grid: which they are, how bad, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cells.grid_quality import GridQuality

__all__ = ["WorstCell", "worst_cells"]


@dataclass(frozen=True)
class WorstCell:
    """A cell among the worst of a grid.

    Parameters
    ----------
    block : str
        Name of the block.
    i, j, k : int
        Number of the cell, from 1.
    q, corner : float
        Orthogonality Q, Eq. (9), and the smallest corner triple product of unit edges.
    place : tuple of float
        Its middle (m).
    """

    block: str
    i: int
    j: int
    k: int
    q: float
    corner: float
    place: tuple[float, ...]

    def __str__(self) -> str:
        return f"cell ({self.i}, {self.j}, {self.k}) of {self.block}"


def worst_cells(quality: GridQuality, nodes: np.ndarray, n: int = 10) -> list[WorstCell]:
    """Find the worst cells: inverted ones first, then those with the smallest Q.

    Parameters
    ----------
    quality : GridQuality
        The cells, all on one process.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of all blocks (m).
    n : int
        How many are wanted.

    Returns
    -------
    list of WorstCell
    """
    found = []
    for block, measures in zip(quality.blocks, quality.cells_in_turn(nodes)):
        valid, q = measures.is_valid.ravel(), np.nan_to_num(measures.q.ravel(), nan=-np.inf)
        ids = _least(valid, q, min(n, q.size))
        x = block.nodes_of(nodes)
        for cell in ids:
            at = np.unravel_index(cell, measures.q.shape)
            corners = x[tuple(slice(i, i + 2) for i in at)].reshape(-1, 3)
            i, j, k = block.number(cell)
            place = tuple(corners.mean(axis=0).tolist())
            worst = float(measures.q.ravel()[cell]), float(measures.min_corner.ravel()[cell])
            found.append((valid[cell], q[cell], WorstCell(block.name, i, j, k, worst[0], worst[1], place)))
    return [cell for *_, cell in sorted(found, key=lambda entry: entry[:2])[:n]]


def _least(valid: np.ndarray, q: np.ndarray, n: int) -> np.ndarray:
    """Numbers of the n worst cells, without sorting all."""
    keys = np.where(valid, q, np.minimum(q, 0.0) - 2.0)  # Q is at least -1
    ids = np.argpartition(keys, n - 1)[:n]
    return ids[np.argsort(keys[ids], kind="stable")]
