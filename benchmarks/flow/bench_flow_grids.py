"""Flows about grids of others: steps, products and CPU time per cell by Mach number and angle, beside an H-H grid.

The grids are those of the folder ``BSPLINE_MDAO_GRIDS``, as they are in their files, with every second or fourth node,
or made here::

    python benchmarks/flow/bench_flow_grids.py [STEP [NAME...]] [--random N]

With ``--random`` each grid that is solved at an angle is solved at N random Mach numbers from 0.3 to 0.85 and angles
from -2 to 6 degrees instead, others are left out, and the last lines say how many flows were found and what others
cost.
Flows start as in a first run of the component, see `cold_solutions`; steps and products are those of the last way, time
is that of all. The ratio is to the first grid that is solved at that Mach number.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from bspline_mdao.core.generators.canonical import onera_m6_grid
from bspline_mdao.core.generators.hh_wing import hh_wing_grid
from bspline_mdao.core.generators.section_o_grid import section_o_grid
from bspline_mdao.core.generators.wing import Planform, Wing, naca_section
from bspline_mdao.core.generators.wing_spacing import Spacing
from bspline_mdao.flow.euler.cold_start import cold_solutions
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.residual import SHOCK_THRESHOLD
from bspline_mdao.flow.euler.sequencing import coarse_levels, useful_levels
from bspline_mdao.flow.loads.stream import RADIAN
from bspline_mdao.flow.om.euler_state import LARGEST_RESIDUAL
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid

CONDITIONS = ((0.3, 4.0), (0.57, -2.0), (0.7, 2.0), (0.84, 3.0))
"""Mach numbers and angles (deg)."""

SEED = 11
"""Of random conditions, the same for every grid."""


@dataclass(frozen=True)
class Case:
    """A grid, its axes downstream, along the span and up, the conditions, and whether fewer nodes still make a grid."""

    grid: Callable[[], Grid]
    axes: str = "xzy"
    conditions: tuple[tuple[float, float], ...] = CONDITIONS
    is_thinned: bool = True


def from_file(name: str) -> Grid:
    """Read a grid of others, and guess its patches where it has none."""
    return with_guessed_patches(read_grid(Path(os.environ["BSPLINE_MDAO_GRIDS"]) / name))


def sphere() -> Grid:
    """Read the grid about a sphere, in which all patches are said to be walls."""
    grid = from_file("hopr_sphere_20blocks.cgns")
    kinds = {patch.name: "wall" if patch.name == "BC_sphere" else "farfield" for patch in grid.patches}
    return replace(grid, patches=tuple(replace(patch, kind=kinds[patch.name]) for patch in grid.patches))


def rectangular() -> Grid:
    """Make the H-H grid about the rectangular wing of NACA 0012 sections."""
    wing = Wing(Planform(1.0, 3.0), naca_section(0.12))
    return hh_wing_grid(wing, (25, 25, 17), Spacing(5e-3, 5e-3, 5e-3, 1e-2))


CASES = {
    "hh_naca0012_12blocks.xyz": Case(partial(from_file, "hh_naca0012_12blocks.xyz")),
    "rectangular wing": Case(rectangular),
    "onera_m6_grid": Case(partial(onera_m6_grid, (25, 25, 17))),
    "pyhyp_m6_9blocks.xyz": Case(partial(from_file, "pyhyp_m6_9blocks.xyz")),
    "mach_naca0012.cgns": Case(partial(from_file, "mach_naca0012.cgns")),
    "cfl3d_naca0012_cgrid.fmt": Case(partial(from_file, "cfl3d_naca0012_cgrid.fmt"), "xyz"),
    "aither_rae2822.xyz": Case(partial(from_file, "aither_rae2822.xyz")),
    "section_o_grid": Case(partial(section_o_grid, naca_section(0.12), 192, 50.0)),
    "aither_multiblock_cylinder.xyz": Case(
        partial(from_file, "aither_multiblock_cylinder.xyz"), conditions=((0.1, 0.0), (0.3, 0.0))
    ),
    "hopr_sphere_20blocks.cgns": Case(sphere, "xyz", ((0.1, 0.0), (0.3, 0.0), (0.5, 0.0)), False),
    "vtk_bluntfin.bin": Case(
        partial(from_file, "vtk_bluntfin.bin"), "xyz", ((0.3, 0.0), (0.57, 0.0), (0.84, 0.0)), False
    ),
}
"""Grids by name; the first one is what others are compared with."""


def main(step: int = 4, names: tuple[str, ...] = (), n_random: int = 0) -> None:
    """Print a line for every flow about the grids with every ``step``-th node, all or those with one of the names."""
    print(
        f"{'grid':31}{'cells':>8}{'Mach':>7}{'alpha':>7}{'residual':>10}{'steps':>6}{'products':>9}{'us/cell':>9}{'ratio':>7}"
    )
    random = np.random.default_rng(SEED)
    at_random = tuple(tuple(random.uniform((0.3, -2.0), (0.85, 6.0))) for _ in range(n_random))
    costs: dict[float, float] = {}
    for name, case in CASES.items():
        if (names and not any(part in name for part in names)) or (n_random and case.conditions is not CONDITIONS):
            continue
        axes, grid = case.axes, thinned(case.grid(), step if case.is_thinned else 1)
        topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
        flow = FlowGrid.of(topology, nodes, axes, shock_threshold=SHOCK_THRESHOLD)
        n_levels = useful_levels(topology)
        levels = coarse_levels(topology, nodes, n_levels, axes, shock_threshold=SHOCK_THRESHOLD)
        areas, is_first, ends = flow.areas(nodes), True, []
        for mach, alpha in at_random or case.conditions:
            stream = free_stream(mach, RADIAN * alpha, flow.axes)
            for _ in range(1 + is_first):  # the first one compiles, and is not counted
                start = time.process_time()
                for solution in cold_solutions(flow, levels, nodes, areas, stream):
                    if solution.residual <= LARGEST_RESIDUAL:
                        break
                cost = (time.process_time() - start) / flow.faces.n_cells * 1e6
            is_first = False
            ends.append((solution.residual <= LARGEST_RESIDUAL, cost))
            n_steps, products = len(solution.history) - 1, sum(one.n_products for one in solution.history)
            ratio = cost / costs.setdefault(mach, cost)
            print(
                f"{name:31}{flow.faces.n_cells:8}{mach:7.3f}{alpha:7.2f}{solution.residual:10.1e}{n_steps:6}"
                f"{products:9}{cost:9.0f}{ratio:7.1f}",
                flush=True,
            )
        if n_random:
            found, lost = ([cost for is_found, cost in ends if is_found is kind] for kind in (True, False))
            print(
                f"{name}: {len(found)} of {n_random} found, us/cell median {np.median(found):.0f}, most "
                f"{max(found):.0f}; others {', '.join(f'{cost:.0f}' for cost in lost) or 'none'}"
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", nargs="?", type=int, default=4)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--random", type=int, default=0, metavar="N", dest="n_random")
    given = parser.parse_args()
    main(given.step, tuple(given.names), given.n_random)
