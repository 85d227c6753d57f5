"""Fit every grid of a folder.

Fit every structured grid of a folder and compare the error with the size of the cells where it occurs. It takes a
minute for thirty grids of less than 50 000 nodes. The output is a row for each file: the errors of its fit, absolute
and relative to the cells, or the reason why it is refused.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from bspline_mdao import FittedModel, Grid, InputError, fit_grid, read_grid
from bspline_mdao.scripts import run


def main(paper: bool = False, folder=None) -> dict:
    """Read, inspect and fit the grids.

    Parameters
    ----------
    paper : bool
        Fit grids of any size; by default only grids of less than 50 000 nodes.
    folder : path-like, optional
        Where the grids are; the environment variable ``BSPLINE_MDAO_GRIDS`` by default.

    Returns
    -------
    dict
        For each file ``blocks``, ``n_nodes``, ``n_interfaces``, ``n_control_points``, ``rms`` (m), ``relative_rms`` (to
        the mean cell edge), ``local_rms`` and ``shortest_rms`` (root mean square of the error relative to the mean and
        to the shortest cell edge at the node), ``n_invalid`` control elements and ``seconds``; or ``refused``, the
        reason in one line; or ``skipped``, its number of nodes.
    """
    folder = folder or os.environ.get("BSPLINE_MDAO_GRIDS")
    if not folder:
        raise InputError("no folder of grids; set BSPLINE_MDAO_GRIDS to one")
    largest = np.inf if paper else 50_000
    return {path.name: fit_file(path, largest) for path in sorted(Path(folder).iterdir()) if path.is_file()}


def fit_file(path: Path, largest: float) -> dict:
    """Fit the grid of one file, if it has at most ``largest`` nodes."""
    try:
        grid = read_grid(path)
        return {"skipped": grid.n_nodes} if grid.n_nodes > largest else numbers_of(fit_grid(grid), grid)
    except InputError as error:
        return {"refused": str(error).replace(str(path), path.name)}


def numbers_of(model: FittedModel, grid: Grid) -> dict:
    """Collect one row of the table."""
    report = model.report
    return {
        "blocks": len(grid.blocks),
        "n_nodes": report.n_nodes,
        "n_interfaces": len(model.topology.interfaces),
        "n_control_points": report.n_control_points,
        "rms": report.rms,
        "relative_rms": report.relative_rms,
        "local_rms": local_rms(model.residual, grid, mean_edges),
        "shortest_rms": local_rms(model.residual, grid, shortest_edges),
        "n_invalid": report.n_invalid,
        "seconds": report.seconds,
    }


def local_rms(residual: np.ndarray, grid: Grid, size_of) -> float:
    """Root mean square of the error of each node relative to the size of the cell edges that meet there."""
    sizes = np.concatenate([size_of(block.nodes).ravel() for block in grid.blocks])
    has_size = sizes > 0.0  # a node on a pole may have no edge in the directions that the block has
    relative = np.linalg.norm(residual, axis=1)[has_size] / sizes[has_size]
    return float(np.sqrt(np.mean(relative**2)))


def edges(nodes: np.ndarray) -> np.ndarray:
    """Lengths of the six edges that meet at each node, shape (ni, nj, nk, 6); nan where there is none of any length."""
    lengths = np.full((*nodes.shape[:3], 6), np.nan)
    for d in range(3):
        edge = np.linalg.norm(np.diff(nodes, axis=d), axis=-1)
        edge[edge == 0.0] = np.nan
        for side, ends in enumerate((slice(None, -1), slice(1, None))):
            lengths[(slice(None),) * d + (ends,)][..., 2 * d + side] = edge
    return lengths


def mean_edges(nodes: np.ndarray) -> np.ndarray:
    """Mean length of the edges at each node that have one, shape (ni, nj, nk); 0 where none has."""
    lengths = edges(nodes)
    return np.nansum(lengths, axis=-1) / np.maximum(np.isfinite(lengths).sum(axis=-1), 1)


def shortest_edges(nodes: np.ndarray) -> np.ndarray:
    """Length of the shortest edge at each node that has one, shape (ni, nj, nk); 0 where none has."""
    lengths = np.nan_to_num(edges(nodes), nan=np.inf).min(axis=-1)
    return np.where(np.isfinite(lengths), lengths, 0.0)


if __name__ == "__main__":
    run(main)
