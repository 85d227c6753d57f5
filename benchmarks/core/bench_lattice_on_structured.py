"""One lattice around a structured grid, beside the paper's way: smallest Q, heights at walls and CPU seconds.

``python benchmarks/core/bench_lattice_on_structured.py [--parts 1 0.5] [--json FILE]``

The grid is that of the M6, and with ``BSPLINE_MDAO_GRIDS`` pyHyp's viscous M6 and the rectangular H-H wing. Movers are
linear elasticity in five increments, as in the paper, the default one, and the lattice, which has the cells of the grid
as a mesh. All put the nodes of walls in the same places. Heights are those of the nodes next to walls by those before,
from 1 % to 99 %; ``ratio`` is the smallest Q by that of linear elasticity. Parts are those of the default spacing.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from bench_following_faces import Judge

import bspline_mdao as bm
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.meshes import LatticeSettings, MeshModel

REAL = "pyhyp_m6_9blocks.xyz", "hh_naca0012_12blocks.xyz"
"""Grids of the folder."""

MOVES = "twist=5deg", "twist=20deg", "bend=30deg@0.5,length=0.5"


def grids() -> Iterator[tuple[str, bm.Grid]]:
    """Yield names and grids."""
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    for name in REAL if folder else ():
        yield name, with_guessed_patches(bm.read_grid(Path(folder) / name))
    if not folder:
        yield "M6", bm.generators.onera_m6_grid((13, 15, 11))


def measured(grid: bm.Grid, parts: Sequence[float]) -> Iterator[dict]:
    """Move a grid by all movers, and by lattices of some parts of the default spacing."""
    judge, marked = Judge(bm.fit_grid(grid)), marked_grid(grid)
    model = MeshModel.of(marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()})
    spacing = model.lattice.spacing
    lattices = {part: model.with_settings(LatticeSettings(spacing=part * spacing)) for part in parts}
    walls, numbers = model.node_map.embedded.walls, marked.mesh.numbers
    _, first = np.unique(numbers, return_index=True)
    quality, baseline = GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3)
    was = report_quality(quality, baseline)
    movers = {"elasticity": bm.movers.LinearElasticity(judge.mesh), "rotations": bm.movers.Rotations(judge.mesh)}
    for move in MOVES:
        planes = judge.surface.on_planes(judge.model)
        deformation = bm.design.parse_deformation(move, judge.model, judge.mesh)
        wall = deformation.apply_to_nodes(judge.surface.points, planes)
        asked, found = judge.follower.at(wall).control_points, {}
        for name, mover in movers.items():
            start = time.process_time()
            points = mover.move(judge.model.control_points, asked).points
            found[name] = judge.grid_map.at(points, wall).nodes, time.process_time() - start
        places = marked.mesh.points.copy()
        places[numbers[judge.surface.rows]] = wall
        for part, each in lattices.items():
            start = time.process_time()
            points = each.mover.move(each.control_points, places[each.wall_rows]).points
            nodes = marked.mesh.nodes_of_file(each.node_map.at(points).nodes)
            found["lattice" if part == 1.0 else f"lattice, {part:g}"] = nodes, time.process_time() - start
        smallest = {}
        for name, (nodes, seconds) in found.items():
            report = report_quality(quality, nodes)
            smallest[name] = report.q_min
            ratios = walls.heights(nodes[first]) / walls.heights(marked.mesh.points)
            yield {
                "move": move,
                "mover": name,
                "inverted": report.n_inverted - was.n_inverted,
                "smallest_q": report.q_min,
                "ratio": report.q_min / smallest["elasticity"],
                "mean_q": report.q_mean,
                "heights": np.quantile(ratios, [0.01, 0.99]).round(4).tolist(),
                "seconds": seconds,
            }


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", type=float, nargs="*", default=[1.0])
    parser.add_argument("--json", type=Path)
    options, results = parser.parse_args(), []
    for name, grid in grids():
        was = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
        print(f"{name}: {grid.n_nodes:,} nodes, smallest Q {was.q_min:.3e}, mean {was.q_mean:.4f}")
        for found in measured(grid, options.parts):
            low, high = found["heights"]
            print(
                f"    {found['move']:26} {found['mover']:12} inverted {found['inverted']:3d}, smallest Q "
                f"{found['smallest_q']:.3e} ({found['ratio']:.3f}), mean {found['mean_q']:.4f}, heights {low} to {high}"
                f", {found['seconds']:.2f} s",
                flush=True,
            )
            results.append({"grid": name, **found})
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
