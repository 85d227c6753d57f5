"""Euler flow on one process and on more: products, seconds and memory of flow and adjoint on every rank.

The wings of `bench_euler.py` at Mach 0.3 and 4 degrees, from coarser members to a residual of 1e-10, and the adjoint of
a random right-hand side to 1e-12. `mpirun` is started here, in turn for each number of ranks; the fastest of some runs
counts. Wall seconds are only meaningful if each rank has a core; CPU seconds are those of the busiest rank,
without what passes in calls of the communicator, where it waits for others.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_euler import ALPHA, MACH, SHAPES, SMALL, timed
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks of several layers use
from mpi_ranks import start_ranks

from bspline_mdao.base.numerics.processes import gathered, world
from bspline_mdao.flow.euler.adjoint import FlowTangent
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse, useful_levels
from bspline_mdao.generators import FarField, Spacing, hh_wing_grid, rectangular_wing
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.partition import Partition

STAGES = ("flow", "adjoint")


def main(n_cells: int = SMALL, ranks: tuple[int, ...] = (1, 2, 4), repeats: int = 2) -> dict[int, dict]:
    """Measure one size on some numbers of ranks.

    Parameters
    ----------
    n_cells : int
        Key of `SHAPES`.
    ranks : tuple of int
        Numbers of ranks.
    repeats : int
        Runs of each.

    Returns
    -------
    dict
        For each number of ranks what `measure` gives, of the run with the shortest wall times.
    """
    runs: dict[int, list[dict]] = {n: [] for n in ranks}
    for _ in range(repeats):
        for n in ranks:
            runs[n] += start_ranks(n, ["--measure", str(n_cells)], __file__)
    return {n: min(of_one, key=lambda run: sum(run["wall"].values())) for n, of_one in runs.items()}


def measure(n_cells: int) -> dict:
    """Solve for flow and adjoint on the ranks of this run.

    Returns
    -------
    dict
        Newton steps, products, cells of every rank and those of others that it sees; seconds of the wall and, of every
        rank, of CPU without waits; peak memory (B) of every rank above that of the imports and a small flow.
    """
    with threadpool_limits(1):
        _run(min(SHAPES))  # compiles
        before = _peak()
        told = _run(n_cells)
    peaks = gathered(world(), np.array([_peak() - before])).tolist()
    return {"load": os.getloadavg()[0], **told, "peaks": peaks}


class _Watched:
    """A communicator that counts the CPU seconds in its calls."""

    def __init__(self, comm):
        self.comm, self.rank, self.size, self.seconds = comm, comm.rank, comm.size, 0.0

    def __getattr__(self, name: str):
        call = getattr(self.comm, name)

        def run(*arguments, **options):
            start = time.process_time()
            result = call(*arguments, **options)
            self.seconds += time.process_time() - start
            return _Request(self, result) if name in ("Isend", "Irecv") else result

        return run


@dataclass(frozen=True)
class _Request:
    """A message on its way, of which the wait is counted."""

    watched: _Watched
    request: Any

    def Wait(self) -> None:
        start = time.process_time()
        self.request.Wait()
        self.watched.seconds += time.process_time() - start


def _run(n_cells: int) -> dict:
    comm, spacing = _Watched(world()), Spacing(off_wall=5e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    grid = hh_wing_grid(rectangular_wing(), SHAPES[n_cells], spacing, FarField(10.0))
    topology = find_topology(grid)
    partition = Partition.of(topology, comm.size)
    subdomain, how = partition.subdomain(comm.rank), {"partition": partition, "comm": comm}
    nodes = grid.to_vector().reshape(-1, 3)[subdomain.rows]
    del grid
    flow = FlowGrid.of(topology, nodes, **how)
    levels = coarse_levels(topology, nodes, useful_levels(topology), **how)
    areas, stream = flow.areas(nodes), free_stream(MACH, ALPHA, flow.axes)
    right = np.random.default_rng(0).standard_normal((n_cells, 5))[subdomain.cells]

    def solve():
        start = states_from_coarse(levels, nodes, stream)
        return solve_flow(flow.discretization, areas, stream, pattern=flow.pattern, states=start)

    def adjoint():
        tangent = FlowTangent.of(flow.discretization, solution.states, areas, stream, flow.pattern)
        return tangent.solve_transposed(right, 1e-12)

    wall, cpu, before = {}, {}, comm.seconds
    solution, wall["flow"], cpu["flow"] = timed(solve)
    cpu["flow"], before = cpu["flow"] - (comm.seconds - before), comm.seconds
    system, wall["adjoint"], cpu["adjoint"] = timed(adjoint)
    cpu["adjoint"] -= comm.seconds - before
    return {
        "steps": len(solution.history) - 1,
        "products": {"flow": sum(step.n_products for step in solution.history), "adjoint": system.n_products},
        "is_converged": {"flow": solution.is_converged, "adjoint": system.is_converged},
        "wall": wall,
        "cpu": {name: gathered(comm, np.array([cpu[name]])).tolist() for name in STAGES},
        "cells": gathered(comm, np.array([flow.faces.n_cells])).tolist(),
        "ghosts": gathered(comm, np.array([flow.faces.n_ghosts])).tolist(),
    }


def _peak() -> int:
    """Largest memory of this process so far (B)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def show(runs: dict[int, dict]) -> None:
    """Print a line for each number of ranks, with what its wall and CPU times gain over those of the first."""
    first = next(iter(runs.values()))
    for n, run in runs.items():
        peak = max(run["peaks"]) / 1e6
        print(f"{sum(run['cells']):,} cells, {n} rank(s), {run['steps']} steps, load {run['load']:.1f}, {peak:.0f} MB")
        for name in STAGES:
            wall, cpu = run["wall"][name], max(run["cpu"][name])
            print(
                f"  {name:8}{run['products'][name]:5} products, wall {wall:6.2f} s, gain "
                f"{first['wall'][name] / wall:.2f}, CPU {cpu:6.2f} s, gain {max(first['cpu'][name]) / cpu:.2f}"
                f"{'' if run['is_converged'][name] else ', not converged'}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, choices=SHAPES, default=SMALL, help="size of the grid")
    parser.add_argument("--ranks", nargs="+", type=int, default=(1, 2, 4), help="numbers of ranks")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        told = measure(options.measure)
        if world().rank == 0:
            options.json.write_text(json.dumps([told]))
        sys.exit()
    table = main(options.cells, tuple(options.ranks), options.repeats)
    show(table)
    if options.json:
        options.json.write_text(json.dumps(table, indent=2) + "\n")
