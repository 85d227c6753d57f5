"""Flows about grids of others: steps, products and CPU time per cell by Mach number and angle, beside an H-H grid.

The grids are those of the folder ``BSPLINE_MDAO_GRIDS``, as they are in their files, with every second or fourth node::

    python benchmarks/bench_flow_grids.py [STEP]
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from bspline_mdao.flow.euler.discretization import SHOCK_THRESHOLD
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse, useful_levels
from bspline_mdao.flow.stream import RADIAN
from bspline_mdao.io.files import read_grid
from bspline_mdao.io.patch_guess import with_guessed_patches
from bspline_mdao.topology.detection import find_topology
from bspline_mdao.topology.grid import Grid

FILES = {
    "hh_naca0012_12blocks.xyz": "xzy",
    "pyhyp_m6_9blocks.xyz": "xzy",
    "mach_naca0012.cgns": "xzy",
    "cfl3d_naca0012_cgrid.fmt": "xyz",
    "aither_rae2822.xyz": "xzy",
}
"""Files, and their axes downstream, along the span and up; the first one is what others are compared with."""

CONDITIONS = ((0.3, 4.0), (0.57, -2.0), (0.7, 2.0), (0.84, 3.0))
"""Mach numbers and angles (deg)."""


def main(step: int = 4) -> None:
    """Print a line for every flow about the grids with every ``step``-th node."""
    print(
        f"{'grid':28}{'cells':>8}{'Mach':>6}{'alpha':>6}{'residual':>10}{'steps':>6}{'products':>9}{'us/cell':>9}{'ratio':>7}"
    )
    costs: dict[float, float] = {}
    for name, axes in FILES.items():
        grid = thinned(with_guessed_patches(read_grid(Path(os.environ["BSPLINE_MDAO_GRIDS"]) / name)), step)
        topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
        flow = FlowGrid.of(topology, nodes, axes, shock_threshold=SHOCK_THRESHOLD)
        n_levels = useful_levels(flow.faces.n_cells)
        levels = coarse_levels(topology, nodes, n_levels, axes, shock_threshold=SHOCK_THRESHOLD)
        areas, is_first = flow.areas(nodes), True
        for mach, alpha in CONDITIONS:
            stream = free_stream(mach, RADIAN * alpha, flow.axes)
            for _ in range(1 + is_first):  # the first one compiles, and is not counted
                start = time.process_time()
                states = states_from_coarse(levels, nodes, stream)
                solution = solve_flow(flow.discretization, areas, stream, pattern=flow.pattern, states=states)
                cost = (time.process_time() - start) / flow.faces.n_cells * 1e6
            is_first = False
            n_steps, products = len(solution.history) - 1, sum(one.n_products for one in solution.history)
            ratio = cost / costs.setdefault(mach, cost)
            print(
                f"{name:28}{flow.faces.n_cells:8}{mach:6}{alpha:6}{solution.residual:10.1e}{n_steps:6}"
                f"{products:9}{cost:9.0f}{ratio:7.1f}"
            )


def thinned(grid: Grid, step: int) -> Grid:
    """Take every ``step``-th node of blocks in the directions in which they have more than one cell."""
    steps = [[step if n > 2 else 1 for n in shape] for shape in grid.shapes]
    blocks = [
        replace(block, nodes=np.ascontiguousarray(block.nodes[tuple(slice(None, None, n) for n in by)]))
        for block, by in zip(grid.blocks, steps)
    ]
    patches = [
        replace(
            patch,
            windows=tuple(
                replace(
                    w, **{end: tuple(np.floor_divide(getattr(w, end), steps[w.block]).tolist()) for end in ("lo", "hi")}
                )
                for w in patch.windows
            ),
        )
        for patch in grid.patches
    ]
    return replace(grid, blocks=tuple(blocks), patches=tuple(patches))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
