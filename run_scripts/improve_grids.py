"""Improve the worst cells of a grid.

Improve the worst cells of ten grids of other projects by moving interior control points at fixed surface. Patches are
declared by the files, or guessed where they declare none, as ``bspline-mdao inspect --draft`` writes them. It takes
some minutes, and half a minute for the three smallest. The output is a row for each grid: Q and the smallest corner
before and after, heights of first cells, how far its walls moved, and seconds.
"""

from __future__ import annotations

import os
import time
import warnings
from pathlib import Path

import numpy as np

from bspline_mdao import FitWarning, Grid, InputError, fit_grid, read_grid
from bspline_mdao.adaptation import Improvement, improve_grid
from bspline_mdao.grids import GridQuality, with_guessed_patches
from bspline_mdao.plotting import figure
from bspline_mdao.scripts import run

GRIDS = {
    "multi-ascii.xyz": (),
    "cgns_5blocks.cgns": (),
    "cgns_nozzle.cgns": (),
    "cfl3d_ejector_nozzle.p3dfmt": (),
    "hopr_sphere_20blocks.cgns": (),
    "cfl3d_axibump.fmt": ("periodic*",),
    "vtk_bluntfin.bin": (),
    "aither_rae2822.xyz": (),
    "mach_naca0012.cgns": (),
    "cfl3d_naca0012_cgrid.fmt": (),
}
"""The grids, and the patches of each that slide in their planes, in addition to symmetry planes."""

SMALLEST = 3
"""Number of grids that are done without ``--paper``: the first ones."""


def main(paper: bool = False, figures=None, folder: str | None = None, grid: tuple[str, ...] = ()) -> dict:
    """Improve the grids.

    Parameters
    ----------
    paper : bool
        All ten; the three smallest by default.
    figures : path-like, optional
        Folder for a picture of each grid before and after: its first surface of constant i, with Q of the cells.
    folder : path-like, optional
        Where the grids are; the environment variable ``BSPLINE_MDAO_GRIDS`` by default.
    grid : sequence of str
        Files of the folder to take instead.

    Returns
    -------
    dict
        For each file ``n_cells``, ``n_control_points``, ``n_values``, ``n_moved``, ``q_min``, ``q_mean`` and
        ``min_corner``, each before and after, ``n_inverted`` likewise, ``largest_fall`` of the worst Q of a block,
        ``height_ratio``, the smallest and the largest, ``wall_motion`` (m), ``evaluations``, ``seconds`` and
        ``reason``; or ``refused``, the reason in one line.
    """
    folder = folder or os.environ.get("BSPLINE_MDAO_GRIDS")
    if not folder:
        raise InputError("no folder of grids; set BSPLINE_MDAO_GRIDS to one")
    for name in grid:
        if not Path(folder, name).is_file():
            there = ", ".join(sorted(path.name for path in Path(folder).glob("*") if path.is_file())) or "none"
            raise InputError(f"{name}: no such file in {folder}; the files there are {there}")
    names = grid or (tuple(GRIDS) if paper else tuple(GRIDS)[:SMALLEST])
    return {name: improve_file(Path(folder, name), GRIDS.get(name, ()), figures) for name in names}


def improve_file(path: Path, sliding: tuple[str, ...], figures=None) -> dict:
    """Improve the grid of one file."""
    try:
        given = with_guessed_patches(read_grid(path))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)
            model = fit_grid(given)
        started = time.process_time()
        found = improve_grid(model, sliding=sliding)
    except InputError as error:
        return {"refused": str(error).replace(str(path), path.name)}
    seconds = time.process_time() - started
    if figures is not None:
        draw(figures, f"improve_{path.stem}", found, given)
    return numbers_of(found, given, seconds)


def draw(folder, name: str, found: Improvement, given: Grid) -> None:
    """Draw the first surface of constant i of the first block, along its axis and away from it, coloured by Q."""
    from matplotlib.collections import PolyCollection

    quality = GridQuality.of_baseline(given)
    with figure(folder, name, size=(9.0, 6.4), n_colours=128) as canvas:
        axes = canvas.subplots(2, 1, sharex=True, sharey=True)
        for ax, grid, when in zip(axes, (given, found.grid), ("before", "after")):
            q = quality.cells(grid.to_vector().reshape(-1, 3))[0].q[0]
            x = grid.blocks[0].nodes[0]
            p = np.stack([x[..., 0], np.hypot(x[..., 1], x[..., 2])], axis=-1)
            corners = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 2)
            cells = PolyCollection(corners, array=q.ravel(), clim=(0.6, 1.0), edgecolors="k", linewidths=0.15)
            ax.add_collection(cells)
            ax.set(title=f"{when}: smallest $Q$ {q.min():.3f}", ylabel="radius (m)", aspect="equal")
            low, high = p[:, 0, 1].min(), p[:, 0, 1].max()
            bump = p[p[:, 0, 1] > low + 0.02 * (high - low), 0, 0]
            width = np.ptp(bump) if bump.size else 0.0
            ax.autoscale()
            if width > 0.0:
                ax.set(xlim=(bump.min() - 0.3 * width, bump.max() + 0.3 * width), ylim=(0.98 * low, high + 0.5 * width))
        axes[1].set_xlabel("$x$ (m)")
        canvas.colorbar(cells, ax=axes, label="orthogonality $Q$")


def numbers_of(found: Improvement, given: Grid, seconds: float) -> dict:
    """Collect one row of the table."""
    names = "q_min", "q_mean", "min_corner", "n_inverted"
    heights = found.after.heights
    return {
        "n_cells": found.before.n_cells,
        "n_control_points": found.shift.n_points,
        "n_values": found.shift.n_values,
        "n_moved": found.n_moved,
        **{name: [getattr(found.before, name), getattr(found.after, name)] for name in names},
        "largest_fall": max(change.before.q - change.after.q for change in found.blocks),
        "height_ratio": [min(h.ratio_min for h in heights), max(h.ratio_max for h in heights)] if heights else None,
        "wall_motion": wall_motion(found.grid, given),
        "evaluations": found.evaluations,
        "seconds": seconds,
        "reason": found.reason,
    }


def wall_motion(grid: Grid, given: Grid) -> float:
    """Largest displacement of a node of a wall (m)."""
    windows = [window for patch in given.patches if patch.kind == "wall" for window in patch.windows]
    moved = (grid.blocks[w.block].nodes[w.slices] - given.blocks[w.block].nodes[w.slices] for w in windows)
    return max((float(np.linalg.norm(each, axis=-1).max()) for each in moved), default=0.0)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/improve_axibump.png'
