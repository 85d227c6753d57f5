"""Component grids that overlap, moved by one lattice: inverted cells, walls, heights, and places of fringes in donors.

``python benchmarks/core/bench_overset.py [--spacings 0.12 0.05 0.025] [--json FILE]``

A section and its flap, each in an O-grid, lie in a box of cells that grow away from them. The flap turns about its
nose, or the section pitches while the flap turns and goes away. Overlap is how far nodes of outer boundaries move in
the cells of other grids that they lie in, by the sides of these; heights are those of the first nodes by those before.
With ``BSPLINE_MDAO_GRIDS``, pyHyp's M6 is twisted and bent over a ball that stays.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bspline_mdao import read_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.generators import ball_grid, naca_section, section_o_grid
from bspline_mdao.grids import Patch, Window
from bspline_mdao.grids.cells.overlap_change import OverlapChange
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.meshes import LatticeSettings, MeshModel

NOSE = np.array([1.02, -0.05, 0.0])
"""Nose of the flap, behind and below the trailing edge of the section (m)."""


def placed(points: np.ndarray, degrees: float, nose: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Scale points about the origin in the plane, turn them clockwise, and put them at a nose."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return points * [scale, scale, 1.0] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) + nose


def line(low: float, high: float, width: float, reach: float) -> np.ndarray:
    """Places that are even from one end to another, and then grow by a fifth each, over a reach at least."""
    widths = width * 1.2 ** np.arange(1, 1 + int(np.ceil(np.log1p(0.2 * reach / width) / np.log(1.2))))
    inner = np.linspace(low, high, 1 + round((high - low) / width))
    return np.concatenate([low - np.cumsum(widths)[::-1], inner, high + np.cumsum(widths)])


def two_elements() -> Grid:
    """Make the grids of both and the box, whose sides are a far field."""
    blocks: list[Block] = []
    patches: list[Patch] = []
    for name, n, layers, where in (("section", 96, 26, (0.0, 0.0 * NOSE)), ("flap", 64, 18, (20.0, NOSE, 0.3))):
        grid = section_o_grid(naca_section(0.12), n_around=n, far=4.0, n_away=60 * n // 96)
        nodes = grid.blocks[0].nodes[:, :layers]
        whole = Window.whole(len(blocks), nodes.shape[:3])
        patches += [
            Patch(name, "wall", (whole.face(2),)),
            Patch(f"{name} sides", "symmetry", (whole.face(4), whole.face(5))),
        ]
        blocks.append(Block(placed(nodes, *where), name))
    axes = line(-1.0, 2.0, 0.02, 20.0), line(-0.8, 0.8, 0.02, 20.0), np.array([0.0, 1.0])
    box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    whole = Window.whole(len(blocks), box.shape[:3])
    patches += [
        Patch("far", "farfield", tuple(whole.face(side) for side in range(4))),
        Patch("box sides", "symmetry", (whole.face(4), whole.face(5))),
    ]
    return Grid((*blocks, Block(box, "box")), tuple(patches), source="a section and its flap")


def wing_and_ball(folder: Path) -> Grid:
    """Make pyHyp's M6 up to 0.4 chords off the wing, a ball below it, and the box from the plane of symmetry on."""
    grid = with_guessed_patches(read_grid(folder / "pyhyp_m6_9blocks.xyz"))
    across = grid.blocks[1].nodes[18, 16]
    n = int(np.searchsorted(np.linalg.norm(across - across[0], axis=-1), 0.4)) + 1
    blocks = [Block(block.nodes[:, :, :n], f"wing {k}") for k, block in enumerate(grid.blocks, 1)]
    patches = [
        replace(patch, windows=tuple(replace(w, hi=(*w.hi[:2], min(w.hi[2], n - 1))) for w in patch.windows))
        for patch in grid.patches
        if patch.kind != "farfield"
    ]
    ball = ball_grid((9, 9, 9, 13), radius=0.1, far=0.25, off_wall=2e-3)
    windows = next(patch.windows for patch in ball.patches if patch.kind == "wall")
    patches.append(Patch("ball", "wall", tuple(replace(w, block=w.block + len(blocks)) for w in windows)))
    blocks += [Block(block.nodes + [0.75, -0.2, 0.75], f"ball {k}") for k, block in enumerate(ball.blocks, 1)]
    axes = line(-0.5, 1.9, 0.06, 10.0), line(-0.6, 0.5, 0.06, 10.0), line(0.0, 2.1, 0.06, 10.0)
    box = np.stack(np.meshgrid(*axes[:2], axes[2][axes[2] >= -1e-9], indexing="ij"), axis=-1)
    whole = Window.whole(len(blocks), box.shape[:3])
    patches.append(Patch("far", "farfield", tuple(whole.face(side) for side in (0, 1, 2, 3, 5))))
    patches.append(Patch("box side", "symmetry", (whole.face(4),)))
    return Grid((*blocks, Block(box, "box")), tuple(patches), source="a wing and a ball below it")


def of_section(model: MeshModel) -> dict[str, np.ndarray]:
    """Where the nodes of the walls of the section and its flap are to be."""
    mesh = model.mesh
    walls, first = mesh.points[model.wall_rows], np.unique((mesh.markers or {})["section"])
    is_section, flap = np.isin(model.wall_rows, first)[:, None], walls - NOSE
    away = placed(flap, 10.0, NOSE + [0.04, -0.03, 0.0])
    return {
        "flap 5 deg": np.where(is_section, walls, placed(flap, 5.0, NOSE)),
        "flap 15 deg": np.where(is_section, walls, placed(flap, 15.0, NOSE)),
        "pitch 3 deg, flap 10 deg and away": np.where(is_section, placed(walls, 3.0, 0.0 * NOSE), away),
    }


def of_wing(model: MeshModel) -> dict[str, np.ndarray]:
    """Where the nodes of the walls are to be when the wing alone is deformed."""
    design, found = model.design_mesh("wall"), {}
    for text in ("twist=20deg", "bend=30deg@0.5,length=0.5"):
        found[text] = model.mesh.points[model.wall_rows].copy()
        found[text][design.surface_ids] = model.deformed(parse_deformation((text,), model, design))
    return found


def measured(grid: Grid, spacing: float, moves: Callable[[MeshModel], dict[str, np.ndarray]]) -> Iterator[dict]:
    """Move a grid by a lattice of some spacing."""
    marked, start = marked_grid(grid), time.process_time()
    mesh, kinds = marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()}
    model = MeshModel.of(mesh, kinds, LatticeSettings(spacing=spacing))
    walls, fringe = model.node_map.embedded.walls, np.unique((mesh.markers or {})["overset"])
    model.mover.move(model.control_points, mesh.points[model.wall_rows])
    seconds = time.process_time() - start
    print(f"{grid.source}: {mesh.n_points:,} nodes, lattice {model.lattice.shape}, made in {seconds:.2f} s")
    for name, asked in moves(model).items():
        start = time.process_time()
        nodes = model.node_map.at(model.mover.move(model.control_points, asked).points).nodes
        seconds = time.process_time() - start
        heights = np.quantile(walls.heights(nodes) / walls.heights(mesh.points), [0.0, 0.01, 0.99, 1.0])
        overlap = OverlapChange.of(marked.grid, mesh, fringe, nodes)
        yield {
            "grid": grid.source,
            "spacing": spacing,
            "move": name,
            "inverted": int((mesh.quality(nodes).is_inverted & ~mesh.quality().is_inverted).sum()),
            "walls": float(np.abs(nodes[model.wall_rows] - asked).max()),
            "heights": heights.round(3).tolist(),
            **vars(overlap),
            "seconds": seconds,
        }


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spacings", type=float, nargs="*", default=[0.12, 0.05, 0.025])
    parser.add_argument("--json", type=Path)
    options, results = parser.parse_args(), []
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    cases = [(two_elements(), spacing, of_section) for spacing in options.spacings]
    cases += [(wing_and_ball(Path(folder)), 0.12, of_wing)] if folder else []
    for grid, spacing, moves in cases:
        for found in measured(grid, spacing, moves):
            results.append(found)
            print(
                f"    {found['move']:34} inverted {found['inverted']}, walls {found['walls']:.0e}, heights "
                f"{found['heights']}, overlap {found['largest']:.2g} at most, {found['median']:.2g} in the median, "
                f"{found['n_left']} of {found['n_donors']} out of their cells, {found['seconds']:.2f} s",
                flush=True,
            )
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
