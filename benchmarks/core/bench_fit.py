"""Fit of the paper-size ONERA M6 grid beside SciPy's sparse normal equations on the same data, in one run.

Both get the same grid, parameters and numbers of control points, and solve for the control points of every block. The
peer takes SciPy's design matrices (constant knots: the mean of the edges, since no peer has curved ones), multiplies
them to the sparse matrix of Eq. (3), forms the normal equations and solves them with SuperLU. It solves each block on
its own without any constraint, which is *less* work and a *lower* RMS error than an equal treatment would give. Its RMS
error on the curved basis, the unconstrained optimum, is found from our own Gram matrices.

The methods of `fit_grid` are timed on this grid, where least squares are valid, and on one with a boundary layer (first
cells 1e-5 high), where they fold and control points fall back.

Process CPU seconds, BLAS on one thread; the best of ``--repeats`` runs, ours and the peer's in turn.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse.linalg import splu
from threadpoolctl import threadpool_limits

from bspline_mdao.core.fit.design_matrix import build_design_matrix
from bspline_mdao.core.fit.edge_knots import knots_of_segment
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.fit.least_squares import factorize
from bspline_mdao.core.fit.options import METHODS
from bspline_mdao.core.fit.parameters import chord_length_parameters
from bspline_mdao.core.fit.problem import problem_of_mesh
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid

ORDERS = (4, 4, 4)


def main(shape=(45, 65, 33), n_control=(13, 13, 9), repeats: int = 2) -> dict:
    """Time both fits and compare their errors.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        Runs of each.

    Returns
    -------
    dict
        CPU seconds, their ratio, RMS errors and memory.
    """
    grid = onera_m6_grid(shape)
    topology = find_topology(grid)
    fit_grid(onera_m6_grid((9, 9, 9)))  # compile, or load from the cache
    ours, peers, methods = [], [], defaultdict(list)
    viscous = onera_m6_grid(shape, Spacing(off_wall=1e-5))
    with threadpool_limits(1):
        for _ in range(repeats):
            seconds, model = _timed(fit_grid, grid, topology=topology, n_control=n_control)
            ours.append(seconds)
            for name, body in (("m6", grid), ("viscous", viscous)):
                for method in METHODS:
                    seconds, fitted = _timed(fit_grid, body, topology=topology, n_control=n_control, method=method)
                    methods[name, method].append((seconds, fitted.report.rms, fitted.report.n_invalid))
            peers.append(_timed(fit_blocks_with_scipy, grid, n_control)[0])
        optimum = unconstrained_rms(grid, model)
        operator = problem_of_mesh(topology, model.mesh).operator(model.parameters)
    return {
        "n_nodes": grid.n_nodes,
        "n_control_points": model.report.n_control_points,
        "cpu_seconds": min(ours),
        "scipy_cpu_seconds": min(peers),
        "ratio": min(peers) / min(ours),
        "rms": model.report.rms,
        "unconstrained_rms": optimum,
        "rms_ratio": model.report.rms / optimum,
        "operator_bytes_per_node": _operator_bytes(operator) / grid.n_nodes,
    } | {
        f"{name} {method} {what}": min(run[i] for run in runs)
        for (name, method), runs in methods.items()
        for i, what in enumerate(("cpu_seconds", "rms", "n_invalid"))
    }


def fit_blocks_with_scipy(grid: Grid, n_control) -> list[np.ndarray]:
    """Control points of every block by sparse normal equations."""
    return [_fit_block_with_scipy(block.nodes, n_control) for block in grid.blocks]


def unconstrained_rms(grid: Grid, model) -> float:
    """RMS error when every block is fitted on its own with nothing held on its faces."""
    total = 0.0
    for block, volume, parameters in zip(grid.blocks, model.mesh.volumes, model.parameters):
        matrix, nodes = build_design_matrix(volume, parameters.reshape(-1, 3)), block.nodes.reshape(-1, 3)
        n_columns = matrix.shape[1]
        gram = matrix.gram(np.arange(n_columns), n_columns, None)
        points = factorize(gram, False, 1.0).solve(matrix.apply_transpose(nodes))
        total += ((nodes - matrix.apply(points)) ** 2).sum()
    return float(np.sqrt(total / grid.n_nodes))


def _fit_block_with_scipy(nodes: np.ndarray, n_control) -> np.ndarray:
    parameters = chord_length_parameters(nodes)
    knots = knots_of_segment(parameters, n_control, ORDERS, "constant")
    a, b, c = (
        BSpline.design_matrix(parameters[..., d].ravel(), knots[d].knots, ORDERS[d] - 1).tocsr() for d in range(3)
    )
    matrix = _row_products(_row_products(a, b), c)
    return splu((matrix.T @ matrix).tocsc()).solve(matrix.T @ nodes.reshape(-1, 3))


def _row_products(a, b):
    """Face-splitting product of two sparse matrices with the same number of entries in every row."""
    n = a.shape[0]
    data = (a.data.reshape(n, -1, 1) * b.data.reshape(n, 1, -1)).reshape(n, -1)
    columns = (a.indices.reshape(n, -1, 1) * b.shape[1] + b.indices.reshape(n, 1, -1)).reshape(n, -1)
    starts = np.arange(n + 1) * data.shape[1]
    return type(a)((data.ravel(), columns.ravel(), starts), shape=(n, a.shape[1] * b.shape[1]))


def _timed(function, *arguments, **options):
    start = time.process_time()
    result = function(*arguments, **options)
    return time.process_time() - start, result


def _operator_bytes(operator) -> int:
    """Memory that a kept fit operator holds."""
    total = 0
    for step in operator.steps:
        m = step.matrix
        arrays = [m.node_order, m.values, m.starts, m.firsts, step.entity.rows, step.entity.control_ids]
        arrays += [step.factor.lower] if step.factor is not None else []
        total += sum(array.nbytes for array in arrays)
    return total


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="blocks of 23 x 33 x 17 nodes")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    numbers = main(*(((23, 33, 17), (9, 9, 7)) if options.small else ()), repeats=options.repeats)
    for name, value in numbers.items():
        print(f"{name:40} {value:.4g}" if isinstance(value, float) else f"{name:40} {value:,}")
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
