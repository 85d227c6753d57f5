"""Euler flow about a rectangular NACA 0012 wing at Mach 0.3 and 4 degrees: seconds and memory of flow and adjoint.

A flow starts from coarser members of the grid and ends at a residual of 1e-10; its adjoint, of a random right-hand
side, at 1e-12. The pattern of the factor, which a grid has once, is timed apart. Every size runs in processes of their
own, on one thread and on two, in turn, flow and adjoint twice in each: memory that a process has not touched yet comes
slowly. The fastest of each counts, and seconds are of the wall where threads are compared. The peer is SciPy, in the
same process: the same Jacobian as a matrix of 5 x 5 blocks (BSR, double precision) and its products.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numba
import numpy as np
from scipy.sparse import bsr_array, coo_array
from threadpoolctl import threadpool_limits

from bspline_mdao.flow.euler.block_factor import BlockFactor
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.krylov import RESTART, solve_refined
from bspline_mdao.flow.euler.linearization import Linearization
from bspline_mdao.flow.euler.newton import FlowSolution, solve_flow
from bspline_mdao.flow.euler.preconditioner import compact_factor
from bspline_mdao.flow.euler.reconstruction import INNER
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse, useful_levels
from bspline_mdao.generators import FarField, Spacing, hh_wing_grid, rectangular_wing
from bspline_mdao.grids.topology.detection import find_topology

SHAPES = {
    5_376: (9, 9, 8),
    36_864: (17, 17, 13),
    117_504: (25, 25, 18),
    313_632: (34, 34, 25),
    1_020_000: (51, 51, 35),
    3_993_600: (81, 81, 53),
}
"""Nodes of each of the twelve blocks by the number of cells."""

SMALL, PAPER = 36_864, 1_020_000
"""Largest size by default, and with ``--paper``."""

MACH, ALPHA = 0.3, np.radians(4.0)


def main(largest: int = SMALL, repeats: int = 2, threads: tuple[int, ...] = (1, 2)) -> list[dict]:
    """Measure all sizes up to the largest.

    Parameters
    ----------
    largest : int
        Key of `SHAPES`.
    repeats : int
        Processes for each size and number of threads.
    threads : tuple of int
        Numbers of threads.

    Returns
    -------
    list of dict
        For each size the numbers of `measure` by the number of threads, and the gain in wall time of the last.
    """
    table = []
    for n_cells in [n for n in SHAPES if n <= largest]:
        runs: dict[int, list[dict]] = {n: [] for n in threads}
        for _ in range(repeats):
            for n in threads:
                runs[n].append(_in_a_process(n_cells, n))
        best = {
            n: min(of_one, key=lambda run: run["wall"]["flow"] + run["wall"]["adjoint"]) for n, of_one in runs.items()
        }
        first, last = (best[n]["wall"] for n in (threads[0], threads[-1]))
        table.append({"threads": best, "gain": {name: first[name] / last[name] for name in ("flow", "adjoint")}})
    return table


def _in_a_process(n_cells: int, n_threads: int) -> dict:
    """Run `measure` in a process of its own, whose peak of memory is that of this size."""
    command = [sys.executable, __file__, "--measure", str(n_cells)]
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(n_threads), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def measure(n_cells: int) -> dict:
    """Time flow, adjoint, products and sweeps of one size, in this process.

    Returns
    -------
    dict
        CPU and wall seconds, Newton steps, products with the Jacobian, residuals at the end, bytes per cell of what a
        derivative keeps and at the peak above the imports, nanoseconds per cell of products and sweeps, and the load of
        the machine.
    """
    with threadpool_limits(1):
        _run(SHAPES[min(SHAPES)], with_peer=False)  # compiles
        before = _resident()
        return {"load": os.getloadavg()[0], **_run(SHAPES[n_cells], n_cells <= 117_504, before)}


def _run(shape, with_peer: bool, before: int = 0) -> dict:
    spacing = Spacing(off_wall=5e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    grid = hh_wing_grid(rectangular_wing(), shape, spacing, FarField(10.0))
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    del grid
    flow = FlowGrid.of(topology, nodes)
    n, levels = flow.faces.n_cells, coarse_levels(topology, nodes, useful_levels(topology))
    areas, stream = flow.areas(nodes), free_stream(MACH, ALPHA, flow.axes)
    field = flow.discretization, areas, stream

    def solve():
        return solve_flow(*field, pattern=flow.pattern, states=states_from_coarse(levels, nodes, stream))

    wall, cpu = {}, {}
    _, wall["pattern"], cpu["pattern"] = timed(lambda: flow.pattern.schedule)
    solution, wall["flow"], cpu["flow"] = _faster(solve)
    sizes = flow.discretization.sizes(areas)
    right = np.random.default_rng(0).standard_normal(solution.states.shape)

    def adjoint():
        return _adjoint(flow.discretization.linearize(solution.states, areas, stream), flow, sizes, right)

    (system, linearization, factor), wall["adjoint"], cpu["adjoint"] = _faster(adjoint)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    sizes_of_state = state_bytes(linearization, factor)
    kernels = product_seconds(linearization, factor, right.astype(np.float32))
    peers = peer_seconds(linearization, right) if with_peer else {}
    return {
        "n_cells": n,
        "n_threads": numba.config.NUMBA_NUM_THREADS,
        "wall": wall,
        "cpu": cpu,
        "steps": len(solution.history) - 1,
        "products": {"flow": _n_products(solution), "adjoint": system.n_products},
        "residual": {"flow": solution.residual, "adjoint": system.left},
        "is_converged": {"flow": solution.is_converged, "adjoint": system.is_converged},
        "ns_per_cell": {name: seconds / n * 1e9 for name, seconds in {**kernels, **peers}.items()},
        "bytes_per_cell": {**sizes_of_state, "peak": (peak - before) / n},
    }


def _adjoint(linearization: Linearization, flow: FlowGrid, sizes: np.ndarray, right: np.ndarray):
    """Solve with the transposed Jacobian, unknowns by the surfaces of the cells, to 1e-12."""
    factor = compact_factor(linearization, flow.pattern, np.zeros((len(right), 5, 5), np.float32)).into_transposed()
    rough = linearization.jacobians.transposed_product
    system = solve_refined(linearization.state_vjp, rough, factor.solve, right, 1e-12, scale=sizes)
    return system, linearization, factor


def timed(run: Callable):
    """Result of a function, and its seconds of wall and CPU."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = run()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def fastest(run: Callable, repeats: int = 7) -> float:
    """Shortest wall time of a function (s)."""
    return min(timed(run)[1] for _ in range(repeats))


def product_seconds(linearization: Linearization, factor: BlockFactor, x: np.ndarray) -> dict[str, float]:
    """Seconds of products in single and double precision, and of sweeps; the factor is that of the transpose."""
    jacobians = linearization.jacobians
    kernels = {"product": jacobians.product, "transposed_product": jacobians.transposed_product}
    seconds = {name: fastest(partial(kernel, x)) for name, kernel in kernels.items()}
    seconds["transposed_sweeps"] = fastest(partial(factor.solve, x))
    seconds["sweeps"] = fastest(partial(factor.into_transposed().solve, x))
    exact = {"exact_product": linearization.state_jvp, "exact_transposed_product": linearization.state_vjp}
    return seconds | {name: fastest(partial(kernel, x.astype(float)), 3) for name, kernel in exact.items()}


def peer_seconds(linearization: Linearization, right: np.ndarray) -> dict[str, float]:
    """Seconds of SciPy's product with the Jacobian, which has to agree with ours."""
    matrix = jacobian_of_scipy(linearization)
    other = matrix @ right.ravel()
    np.testing.assert_allclose(linearization.state_jvp(right).ravel(), other, atol=1e-5 * np.abs(other).max())
    return {"bsr_product": fastest(partial(matrix.dot, right.ravel()))}


def jacobian_of_scipy(linearization: Linearization) -> bsr_array:
    """Assemble the Jacobian of the residual from those of the faces, in single precision as they are kept."""
    discretization, jacobians = linearization.discretization, linearization.jacobians
    stencil, n = discretization.stencil, 5 * discretization.faces.n_cells
    inner, matrix = stencil.roles == INNER, coo_array((n, n)).tocsr()
    weights = np.stack([stencil.means[stencil.classes], jacobians.jump_weights[stencil.lines]], axis=1)
    for k in range(4):
        by_mean, by_jump = (
            weights[:, m, k, None, None] * jacobians.values[..., 5 * m : 5 * m + 5].astype(float) for m in range(2)
        )
        blocks = by_mean + by_jump
        matrix += _placed(blocks, stencil.cells[:, 1], stencil.cells[:, k], n)
        matrix -= _placed(blocks[inner], stencil.cells[inner, 2], stencil.cells[inner, k], n)
    return matrix.tobsr((5, 5))


def _placed(blocks, rows, columns, n):
    """Matrix with a block for each face."""
    ids = np.arange(5)
    index = np.broadcast_arrays(5 * rows[:, None, None] + ids[:, None], 5 * columns[:, None, None] + ids)
    return coo_array((blocks.ravel(), [at.ravel() for at in index]), shape=(n, n)).tocsr()


def state_bytes(linearization: Linearization, factor: BlockFactor) -> dict[str, float]:
    """Bytes per cell of what a derivative keeps: Jacobians of the faces, factor, its pattern, and vectors of GMRES."""
    n, pattern, sums = linearization.discretization.faces.n_cells, factor.pattern, linearization.discretization.sums
    jacobians, schedule = linearization.jacobians, factor.pattern.schedule
    return {
        "jacobians": _bytes(jacobians.values, jacobians.shock_rows, jacobians.shocks) / n,
        "factor": _bytes(factor.lower, factor.upper, factor.pivots) / n,
        "pattern": _bytes(*vars(pattern).values(), *vars(schedule).values(), *vars(sums).values()) / n,
        "krylov": 20.0 * (RESTART + 1),
    }


def _bytes(*arrays) -> int:
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def _faster(run: Callable):
    """Call a function twice: what it returned at last, and the least wall and CPU seconds."""
    other, *first = timed(run)
    del other  # it makes room for the next
    found, *second = timed(run)
    return found, *(min(pair) for pair in zip(first, second))


def _end(run: dict, name: str) -> str:
    """How the flow or the adjoint of a run ended."""
    return f"residual {run['residual'][name]:.1e}{'' if run['is_converged'][name] else ', not converged'}"


def _n_products(solution: FlowSolution) -> int:
    return sum(step.n_products for step in solution.history)


def _resident() -> int:
    """Resident memory of this process (bytes)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _report(row: dict) -> None:
    for n_threads, run in row["threads"].items():
        n, wall, cpu, count = run["n_cells"], run["wall"], run["cpu"], run["products"]
        print(f"{n:,} cells, {n_threads} thread(s), load {run['load']:.1f}, pattern {wall['pattern']:.2f} s")
        print(
            f"  flow     wall {wall['flow']:8.2f} s  CPU {cpu['flow']:8.2f} s",
            f" {cpu['flow'] / n * 1e6:6.0f} us per cell",
            end="",
        )
        print(f"  {run['steps']} Newton steps, {count['flow']} products, {_end(run, 'flow')}")
        print(f"  adjoint  wall {wall['adjoint']:8.2f} s  CPU {cpu['adjoint']:8.2f} s", end="")
        print(f"  {cpu['adjoint'] / cpu['flow']:.2f} of a flow, {count['adjoint']} products, {_end(run, 'adjoint')}")
        for name, part in (("ns per cell", run["ns_per_cell"]), ("bytes per cell", run["bytes_per_cell"])):
            print(f"  {name}: " + ", ".join(f"{key} {value:.0f}" for key, value in part.items()))
    print("  gain by threads: " + ", ".join(f"{name} {value:.2f}" for name, value in row["gain"].items()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--large", action="store_true", help="up to 117,504 cells")
    size.add_argument("--paper", action="store_true", help="up to 1,020,000 cells")
    size.add_argument("--largest", action="store_true", help="up to 4 million cells")
    size.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="numbers of threads")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(measure(options.measure)))
        sys.exit()
    largest = 117_504 if options.large else PAPER if options.paper else max(SHAPES) if options.largest else SMALL
    table = main(largest, options.repeats, tuple(options.threads))
    for row in table:
        _report(row)
    if options.json:
        options.json.write_text(json.dumps(table, indent=2) + "\n")
