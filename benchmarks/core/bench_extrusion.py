"""Hyperbolic extrusion: nodes per CPU second and quality, beside the volumes of another generator on the same surfaces.

``python benchmarks/core/bench_extrusion.py [--layers 48 64] [--repeats 3] [--json FILE]``

Balls of a million nodes and fewer. With ``BSPLINE_MDAO_GRIDS`` and the folder of surfaces beside it, pyHyp's M6 and
blended-wing body: every second node with 40 layers, as in the volumes of pyHyp, whose corners are shown as well, and
all nodes. CPU seconds are those of the process, the fastest of the repeats; the first run compiles.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bspline_mdao import Grid, read_grid
from bspline_mdao.generators import ball_grid, extrude_surface
from bspline_mdao.grids import Block, GridQuality

PEERS = {
    # volume of pyHyp, first cell and distance of it
    "m6": ("grids/pyhyp_m6_9blocks.xyz", 3.2e-5, 24.7),
    "bwb": ("strangers/pyhyp_bwb_9blocks.xyz", 1.1e-5, 980.0),
}


def of_balls(sizes: list[int], layers: list[int]) -> Iterator[tuple[str, Grid, dict]]:
    """Give spheres of six blocks."""
    for n in sizes:
        ball = ball_grid((n, n, n, 3))
        surface = Grid(tuple(Block(block.nodes[:, :, :1], block.name) for block in ball.blocks))
        for count in layers:
            yield f"ball {n}, {count} layers", surface, {"first_cell": 1e-4, "layers": count, "outer": 20.0}


def of_files(folder: Path, layers: list[int]) -> Iterator[tuple[str, Grid, dict]]:
    """Give surfaces of pyHyp: every second node, as its volumes have them, and all."""
    for name, (_, first, outer) in PEERS.items():
        surface = read_grid(folder / "geometry" / f"pyhyp_{name}_surface.fmt")
        half = Grid(tuple(Block(block.nodes[::2, ::2].copy(), block.name) for block in surface.blocks))
        yield f"{name}, every second node, 40 layers", half, {"first_cell": first, "layers": 40, "outer": outer}
        for count in layers:
            yield f"{name}, {count} layers", surface, {"first_cell": first, "layers": count, "outer": outer}


def quality_of(grid: Grid, first: float | None) -> dict:
    """Corners of all cells, and how many first heights are within 1 % of what was asked."""
    quality = GridQuality.of_baseline(grid)
    cells = quality.cells(grid.to_vector().reshape(-1, 3))
    corners = np.concatenate([block.min_corner.ravel() for block in cells])
    found = {
        "n_nodes": grid.n_nodes,
        "n_inverted": int((corners <= 0.0).sum()),
        "min_corner": float(corners.min()),
        "corner_1_percent": float(np.quantile(corners, 0.01)),
        "mean_corner": float(corners.mean()),
    }
    if first is not None:
        found["heights"] = float(np.mean(np.abs(quality.first_cells.baseline / first - 1.0) < 0.01))
    return found


def measured(surface: Grid, options: dict, repeats: int) -> dict:
    """Extrude a surface."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        grid = extrude_surface(surface, progress=False, **options)
        seconds.append(time.process_time() - start)
    return {**quality_of(grid, options["first_cell"]), "seconds": min(seconds)}


def main(sizes: list[int], layers: list[int], repeats: int = 1, folder: Path | None = None) -> dict[str, dict]:
    """Measure all surfaces.

    Parameters
    ----------
    sizes : list of int
        Nodes along the edges of the blocks of balls.
    layers : list of int
        Numbers of layers.
    repeats : int
        Runs of each.
    folder : Path, optional
        Folder of the surfaces of pyHyp, and of its volumes.

    Returns
    -------
    dict
        Numbers of each.
    """
    results = {}
    cases = [*of_balls(sizes, layers), *(of_files(folder, layers) if folder else ())]
    for name, surface, options in cases:
        results[name] = measured(surface, options, repeats)
    if folder:
        for name, (volume, _, _) in PEERS.items():
            results[f"{name}, pyHyp"] = quality_of(read_grid(folder / volume), None)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="*", default=[25, 53], help="nodes along blocks of balls")
    parser.add_argument("--layers", type=int, nargs="*", default=[48, 64])
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    arguments = parser.parse_args()
    grids = os.environ.get("BSPLINE_MDAO_GRIDS")
    numbers = main(arguments.sizes, arguments.layers, arguments.repeats, Path(grids).parent if grids else None)
    print(f"{'':36}{'nodes':>10}{'inverted':>10}{'smallest':>10}{'1 %':>8}{'heights':>9}{'CPU s':>8}{'nodes/s':>10}")
    for title, row in numbers.items():
        text = f"{title:36}{row['n_nodes']:10,}{row['n_inverted']:10}{row['min_corner']:10.3f}"
        text += f"{row['corner_1_percent']:8.3f}"
        if "seconds" in row:
            rate = row["n_nodes"] / row["seconds"]
            text += f"{100.0 * row['heights']:8.1f}%{row['seconds']:8.2f}{rate:10,.0f}"
        print(text)
    if arguments.json:
        arguments.json.write_text(json.dumps(numbers, indent=2) + "\n")
