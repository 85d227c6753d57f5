"""Flows at random Mach numbers and angles about random shapes: how many converge, and what those that do not cost.

Wings (rectangular and tapered, the M6, a blended-wing body) and sections (O- and H-H grids) of 800 to 6,200 cells, of
random thickness, camber, taper, sweep and twist, at Mach 0.3 to 0.85 and -2 to 6 degrees, each by a whole run of the
component with its fallbacks::

    python benchmarks/flow/bench_random_flows.py [N] [SEED]
"""

from __future__ import annotations

import sys
import time
from functools import cache

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.core.generators.hh_wing import hh_wing_grid, infinite_wing_grid
from bspline_mdao.core.generators.section_o_grid import section_o_grid
from bspline_mdao.core.generators.wing import Planform, Section, Wing, cambered_section
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.residual import SHOCK_THRESHOLD
from bspline_mdao.flow.euler.sequencing import coarse_levels, useful_levels
from bspline_mdao.flow.om.euler_state import EulerState
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid
from bspline_mdao.names import GRID, SURFACE_CONTROL_POINTS

MACH, ALPHA = (0.3, 0.85), (-2.0, 6.0)
"""Bounds of Mach numbers and angles (deg)."""


def main(n: int = 100, seed: int = 1) -> None:
    """Print a line for each of n flows, then the share that converged and the cost of the others."""
    random = np.random.default_rng(seed)
    costs: dict[tuple[str, bool], list[float]] = {}
    print(f"{'grid':>14}{'cells':>7}{'Mach':>7}{'alpha':>7}{'CPU s':>8}{'us/cell':>9}  end", flush=True)
    for k in range(n):
        name = list(SHAPES)[k % len(SHAPES)]
        grid, nodes = SHAPES[name](random)
        mach, alpha = random.uniform(*MACH), random.uniform(*ALPHA)
        if k == 0:  # compiles, and is not counted
            fly(grid, nodes, 0.8, 2.0)
        cost, n_cells, complaint = fly(grid, nodes, mach, alpha)
        costs.setdefault((name, not complaint), []).append(cost / n_cells)
        print(
            f"{name:>14}{n_cells:7}{mach:7.3f}{alpha:7.2f}{cost:8.2f}{1e6 * cost / n_cells:9.0f}  {complaint}",
            flush=True,
        )
    n_found = sum(len(part) for (_, is_found), part in costs.items() if is_found)
    print(f"{n_found} of {n} converged")
    for (name, is_found), part in sorted(costs.items()):
        usual = np.median(costs.get((name, True), [np.nan]))
        what = "converged" if is_found else "failed"
        print(
            f"{name:>14}: {len(part):3} {what}, us/cell median {1e6 * np.median(part):.0f}, "
            f"most {1e6 * max(part):.0f}, {max(part) / usual:.1f} times the median of those that converged"
        )


def fly(grid: Grid, moved: np.ndarray, mach: float, alpha: float) -> tuple[float, int, str]:
    """CPU time (s) of a run on moved nodes of a grid, number of cells, and why it failed, if it did."""
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    flow = FlowGrid.of(topology, nodes, "xzy", shock_threshold=SHOCK_THRESHOLD)
    levels = coarse_levels(topology, nodes, useful_levels(topology), "xzy", shock_threshold=SHOCK_THRESHOLD)
    forces = FlowForces.of(flow, nodes, 1.0, 1.0, (0.0, 0.0, 0.0))
    problem, state = (
        om.Problem(reports=None),
        EulerState(flow=flow, levels=levels, nodes=nodes, forces=forces, iprint=0),
    )
    problem.model.add_subsystem("state", state, promotes=["*"])
    problem.setup()
    problem.set_val(GRID, moved.ravel())
    problem.set_val("alpha", alpha)
    problem.set_val("Mach_number", mach)
    problem.final_setup()
    start, complaint = time.process_time(), ""
    try:
        problem.run_model()
    except om.AnalysisError as error:
        complaint = str(error)
    return time.process_time() - start, flow.faces.n_cells, complaint


def twisted(nodes: np.ndarray, degrees: float) -> np.ndarray:
    """Turn stations along the span about the axis at x = 0.25, by ever more up to a span of 1.5."""
    angle = np.radians(degrees) * np.clip(nodes[:, 2] / 1.5, 0.0, 1.0) ** 2
    x, y = nodes[:, 0] - 0.25, nodes[:, 1]
    turned = [0.25 + np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, nodes[:, 2]]
    return np.column_stack(turned)


def _section(random) -> Section:
    return cambered_section(random.uniform(0.08, 0.15), random.uniform(0.0, 0.03))


def _wing(random) -> tuple[Grid, np.ndarray]:
    planform = Planform(1.0, random.uniform(1.5, 4.0), random.uniform(0.4, 1.0), random.uniform(0.0, 35.0))
    grid = hh_wing_grid(
        Wing(planform, _section(random)), random.integers(7, 10, 3), bm.generators.Spacing(0.02, 0.03, 0.03, 0.05)
    )
    return grid, twisted(_nodes(grid), random.uniform(-4.0, 4.0))


def _m6(random) -> tuple[Grid, np.ndarray]:
    grid = bm.generators.onera_m6_grid(tuple(random.integers(7, 10, 3)))
    return grid, twisted(_nodes(grid), random.uniform(-4.0, 4.0))


def _body(random) -> tuple[Grid, np.ndarray]:
    plate, nodes = _blended_wing_body()
    return plate, twisted(nodes, random.uniform(-3.0, 3.0))


@cache
def _blended_wing_body() -> tuple[Grid, np.ndarray]:
    """Grid about a plate, and its nodes about the body that the plate becomes."""
    model = bm.fit_grid(bm.generators.flat_plate_grid((8, 8, 8)), n_control=(6, 6, 6), keep_residual=False)
    mesh = bm.movers.moving_mesh(model)
    surface = bm.generators.fit_shape(model, mesh.surface_ids, bm.generators.generic_blended_wing_body())
    problem = om.Problem(reports=None)
    geometry = bm.GridMovement(model=model, mover=bm.movers.LinearElasticity(mesh, n_increments=5), fit=False)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.setup()
    problem.set_val(SURFACE_CONTROL_POINTS, surface.ravel())
    problem.run_model()
    return model.regenerate(), problem.get_val(GRID).reshape(-1, 3)


def _o_section(random) -> tuple[Grid, np.ndarray]:
    grid = section_o_grid(_section(random), 2 * int(random.integers(20, 45)), far=50.0)
    return grid, _nodes(grid)


def _hh_section(random) -> tuple[Grid, np.ndarray]:
    grid = infinite_wing_grid(
        _section(random), tuple(random.integers(13, 29, 2)), bm.generators.Spacing(0.01, 0.01, 0.01)
    )
    return grid, _nodes(grid)


def _nodes(grid: Grid) -> np.ndarray:
    return grid.to_vector().reshape(-1, 3)


SHAPES = {"wing": _wing, "M6": _m6, "blended body": _body, "O-grid": _o_section, "H-H section": _hh_section}
"""Baseline grids and their moved nodes, shape (n_nodes, 3), by name, from a generator of random numbers."""

if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
