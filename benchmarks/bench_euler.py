"""Euler flow about a rectangular NACA 0012 wing at Mach 0.3 and 4 degrees: seconds and memory of flow and adjoint.

A flow starts from the uniform stream and ends at a residual of 1e-10; its adjoint, of a random right-hand side, at
1e-10 too. CPU seconds of one thread. The peer is SciPy: the same exact Jacobian as a matrix of 5 x 5 blocks (BSR) and
its products, beside the products from the Jacobians of the faces. Figures of an earlier prototype on two cores, wall
seconds: 36,864 cells in 25 Newton steps and 90 s, 117,504 cells in 7 minutes.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numba
import numpy as np
from scipy.sparse import bsr_array, coo_array
from threadpoolctl import threadpool_limits

from bspline_mdao import Spacing, hh_wing_grid, rectangular_wing
from bspline_mdao.flow.euler.discretization import Linearization
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.krylov import RESTART, solve_system
from bspline_mdao.flow.euler.newton import FlowSolution, solve_flow
from bspline_mdao.flow.euler.preconditioner import BlockFactor, compact_factor
from bspline_mdao.flow.euler.reconstruction import INNER
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse
from bspline_mdao.topology.detection import find_topology

SHAPES = {36_864: (17, 17, 13), 117_504: (25, 25, 18)}
"""Nodes of each of the twelve blocks by the number of cells."""

PROTOTYPE = {36_864: 90.0, 117_504: 420.0}
"""Wall seconds of an earlier prototype on two cores for the flow."""

MACH, ALPHA = 0.3, np.radians(4.0)


def main(n_cells: int = 36_864, repeats: int = 2) -> dict:
    """Time flow, adjoint and products.

    Parameters
    ----------
    n_cells : int
        Key of `SHAPES`.
    repeats : int
        Runs of each, of which the fastest counts.

    Returns
    -------
    dict
        Seconds, Newton steps, products with the Jacobian, bytes per cell, and ratios.
    """
    with threadpool_limits(1):
        numbers = _measure(SHAPES[n_cells], repeats)
    prototype = {"prototype_over_ours": PROTOTYPE[n_cells] / numbers["seconds"]["flow"]}
    return {"n_threads": numba.config.NUMBA_NUM_THREADS, **numbers, **prototype}


def _measure(shape, repeats: int) -> dict:
    grid = hh_wing_grid(rectangular_wing(), shape, Spacing(off_wall=5e-3, leading=5e-3, trailing=5e-3, tip=5e-3))
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    flow, levels = FlowGrid.of(topology, nodes), coarse_levels(topology, nodes, 1)
    areas, stream = flow.areas(nodes), free_stream(MACH, ALPHA, flow.axes)
    field = flow.discretization, areas, stream

    def solve(levels):
        return solve_flow(*field, pattern=flow.pattern, states=states_from_coarse(levels, nodes, stream))

    solve(levels)  # compiles
    cold, solution = fastest(lambda: solve([]), repeats)
    sequenced, _ = fastest(lambda: solve(levels), repeats)
    linearization = flow.discretization.linearize(solution.states, areas, stream)
    factor = compact_factor(linearization, flow.pattern, np.zeros((flow.faces.n_cells, 5, 5)))
    right = np.random.default_rng(0).standard_normal(solution.states.shape)
    adjoint, system = fastest(
        lambda: solve_system(linearization.state_vjp, factor.solve_transposed, right, 1e-10), repeats
    )
    products, peer = product_seconds(linearization, right, 5 * repeats)
    return {
        "n_cells": flow.faces.n_cells,
        "seconds": {"flow": cold, "flow_by_coarse": sequenced, "adjoint": adjoint, **products},
        "steps": len(solution.history) - 1,
        "products": {"flow": _n_products(solution), "adjoint": system.n_products},
        "is_converged": solution.is_converged and system.is_converged,
        "adjoint_over_flow": adjoint / cold,
        "bsr_over_ours": products["bsr_product"] / products["product"],
        "bytes_per_cell": {**state_bytes(linearization, factor), "bsr": _bytes(peer.data, peer.indices) / len(right)},
    }


def fastest(run: Callable, repeats: int):
    """Shortest CPU time of a function (s), and its result."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        result = run()
        seconds.append(time.process_time() - start)
    return min(seconds), result


def product_seconds(linearization: Linearization, right: np.ndarray, repeats: int):
    """Seconds of products with the Jacobian, ours and SciPy's in turn, and SciPy's matrix."""
    matrix = jacobian_of_scipy(linearization)
    transposed = bsr_array(matrix.T)
    pairs = {"product": (linearization.state_jvp, matrix), "transposed_product": (linearization.state_vjp, transposed)}
    seconds = {}
    for name, (ours, theirs) in pairs.items():
        seconds[name], mine = fastest(partial(ours, right), repeats)
        seconds[f"bsr_{name}"], other = fastest(partial(theirs.dot, right.ravel()), repeats)
        np.testing.assert_allclose(mine.ravel(), other, atol=1e-12 * np.abs(other).max())
    return seconds, matrix


def jacobian_of_scipy(linearization: Linearization) -> bsr_array:
    """Assemble the exact Jacobian of the residual, without a sensor of shocks, from those of the faces."""
    stencil, weights = linearization.discretization.stencil, linearization.cell_weights
    jacobians = linearization.state_jacobians
    inner, n = stencil.roles == INNER, 5 * linearization.discretization.faces.n_cells
    matrix = coo_array((n, n)).tocsr()
    for k in range(4):
        by_mean, by_jump = (weights[:, m, k, None, None] * jacobians[..., 5 * m : 5 * m + 5] for m in range(2))
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
    """Bytes per cell of what a derivative keeps: Jacobians of the faces, factor, and vectors of GMRES."""
    n = linearization.discretization.faces.n_cells
    names = ("state_jacobians", "area_jacobians", "cell_weights", "sensors")
    jacobians = [getattr(linearization, name) for name in names]
    return {
        "jacobians": _bytes(*jacobians) / n,
        "factor": _bytes(factor.lower, factor.upper, factor.pivots, factor.pattern.columns) / n,
        "krylov": 40.0 * (RESTART + 1),
    }


def _bytes(*arrays) -> int:
    return sum(array.nbytes for array in arrays)


def _n_products(solution: FlowSolution) -> int:
    return sum(step.n_products for step in solution.history)


def _report(numbers: dict) -> None:
    n, seconds, count = numbers["n_cells"], numbers["seconds"], numbers["products"]
    print(f"{n:,} cells, {numbers['n_threads']} thread(s), converged: {numbers['is_converged']}")
    print(f"flow             {seconds['flow']:8.2f} s  {seconds['flow'] / n * 1e6:6.0f} us per cell", end="")
    print(f"  {numbers['steps']} Newton steps, {count['flow']} products")
    print(f"flow by a coarse {seconds['flow_by_coarse']:8.2f} s")
    print(f"adjoint          {seconds['adjoint']:8.2f} s  {count['adjoint']} products", end="")
    print(f"  {numbers['adjoint_over_flow']:.2f} of a flow")
    for name in ("product", "bsr_product", "transposed_product", "bsr_transposed_product"):
        print(f"{name:24}{seconds[name] / n * 1e9:8.0f} ns per cell")
    for name, size in numbers["bytes_per_cell"].items():
        print(f"{name:24}{size:8.0f} bytes per cell")
    print(f"SciPy's product over ours      {numbers['bsr_over_ours']:6.2f}")
    print(f"prototype (2 cores) over ours  {numbers['prototype_over_ours']:6.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true", help="117,504 cells")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    numbers = main(117_504 if options.large else 36_864, options.repeats)
    _report(numbers)
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
