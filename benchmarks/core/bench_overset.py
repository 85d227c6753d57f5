"""Component grids that overlap, moved by one lattice: inverted cells, walls, heights, and places of fringes in donors.

``python benchmarks/core/bench_overset.py [--spacings 0.12 0.05 0.025] [--json FILE]``

A section and its flap, each in an O-grid, lie in a box of cells that grow away from them. The flap turns about its
nose, or the section pitches while the flap turns and goes away. Overlap is how far nodes of outer boundaries move in
the cells of other grids that they lie in, by the sides of these; heights are those of the first nodes by those before.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from bspline_mdao.generators import naca_section, section_o_grid
from bspline_mdao.grids import Patch, Window
from bspline_mdao.grids.cells.overlap_change import OverlapChange
from bspline_mdao.grids.io.meshes.blocks import marked_grid
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


def moves(walls: np.ndarray, is_section: np.ndarray) -> dict[str, np.ndarray]:
    """Where the nodes of the walls are to be."""
    flap = walls - NOSE
    return {
        "flap 5 deg": np.where(is_section[:, None], walls, placed(flap, 5.0, NOSE)),
        "flap 15 deg": np.where(is_section[:, None], walls, placed(flap, 15.0, NOSE)),
        "pitch 3 deg, flap 10 deg and away": np.where(
            is_section[:, None], placed(walls, 3.0, 0.0 * NOSE), placed(flap, 10.0, NOSE + [0.04, -0.03, 0.0])
        ),
    }


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spacings", type=float, nargs="*", default=[0.12, 0.05, 0.025])
    parser.add_argument("--json", type=Path)
    options, results = parser.parse_args(), []
    marked = marked_grid(two_elements())
    mesh, kinds = marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()}
    before, fringe = mesh.quality(), np.unique((mesh.markers or {})["overset"])
    for spacing in options.spacings:
        start = time.process_time()
        model = MeshModel.of(mesh, kinds, LatticeSettings(spacing=spacing))
        walls, wall_parts = mesh.points[model.wall_rows], model.node_map.embedded.walls
        is_section = np.isin(model.wall_rows, np.unique((mesh.markers or {})["section"]))
        model.mover.move(model.control_points, walls)
        seconds = time.process_time() - start
        print(f"{mesh.n_points:,} nodes, lattice {model.lattice.shape}, made in {seconds:.2f} s")
        for name, asked in moves(walls, is_section).items():
            start = time.process_time()
            nodes = model.node_map.at(model.mover.move(model.control_points, asked).points).nodes
            seconds = time.process_time() - start
            heights = np.quantile(wall_parts.heights(nodes) / wall_parts.heights(mesh.points), [0.0, 0.01, 0.99, 1.0])
            found = {
                "spacing": spacing,
                "move": name,
                "inverted": int((mesh.quality(nodes).is_inverted & ~before.is_inverted).sum()),
                "walls": float(np.abs(nodes[model.wall_rows] - asked).max()),
                "heights": heights.round(3).tolist(),
                **vars(OverlapChange.of(marked.grid, mesh, fringe, nodes)),
                "seconds": seconds,
            }
            results.append(found)
            print(
                f"    {name:34} inverted {found['inverted']}, walls {found['walls']:.0e}, heights {found['heights']}, "
                f"overlap {found['largest']:.2g} at most, {found['median']:.2g} in the median, {seconds:.2f} s"
            )
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
