"""Quality of the cells of the paper-size ONERA M6 grid beside plain NumPy, in one process on one thread.

CPU seconds of the one thread, the contenders in turn, ``--repeats`` times; the fastest of each counts.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality, GridValues

NAMES = ("quality_ks", "corner_ks", "volume_ks")
HEIGHTS = ("height_low_ks", "height_high_ks")


def main(shape=(45, 65, 33), repeats: int = 5) -> dict:
    """Time all contenders.

    Parameters
    ----------
    shape : tuple of three int
        Nodes of each of the 12 blocks.
    repeats : int
        Runs of each.

    Returns
    -------
    dict
        Nanoseconds per cell of each, and the ratio of NumPy's to ours for the same measures.
    """
    grid = onera_m6_grid(shape)
    quality, nodes = GridQuality.of_baseline(grid, n_threads=1), grid.to_vector().reshape(-1, 3)
    values, bar = quality.evaluate(nodes, NAMES), GridValues(dict.fromkeys(NAMES, 1.0))
    heights, heights_bar = quality.evaluate(nodes, HEIGHTS), GridValues(dict.fromkeys(HEIGHTS, 1.0))
    d_nodes = np.random.default_rng(0).standard_normal(nodes.shape)
    contenders = {
        "cells": lambda: quality.cells(nodes),
        "numpy_cells": lambda: [numpy_cells(block.nodes) for block in grid.blocks],
        "aggregates": lambda: quality.evaluate(nodes, NAMES),
        "aggregates_jvp": lambda: quality.jvp(nodes, d_nodes, values),
        "aggregates_vjp": lambda: quality.vjp(nodes, values, bar),
        "heights": lambda: quality.evaluate(nodes, HEIGHTS),
        "heights_jvp": lambda: quality.jvp(nodes, d_nodes, heights),
        "heights_vjp": lambda: quality.vjp(nodes, heights, heights_bar),
    }
    with threadpool_limits(1):
        seconds = {name: [] for name in contenders}
        for _ in range(repeats):
            for name, run in contenders.items():
                start = time.thread_time()
                run()
                seconds[name].append(time.thread_time() - start)
    per_cell = {name: min(times) / quality.n_cells * 1e9 for name, times in seconds.items()}
    return {
        "n_cells": quality.n_cells,
        "n_wall_nodes": quality.first_cells.baseline.size,
        "bytes_per_node": quality.bytes_per_node,
        "ns_per_cell": per_cell,
        "numpy_over_ours": per_cell["numpy_cells"] / per_cell["cells"],
    }


def numpy_cells(nodes: np.ndarray) -> tuple[np.ndarray, ...]:
    """Q, smallest corner triple product and smallest corner Jacobian of a block; no volume."""
    edges = [np.diff(nodes, axis=d) for d in range(3)]
    units = [edge / np.linalg.norm(edge, axis=-1, keepdims=True) for edge in edges]
    triples, jacobians = ([_triple(vectors, *at) for at in np.ndindex(2, 2, 2)] for vectors in (units, edges))
    return np.prod(triples, axis=0), np.min(triples, axis=0), np.min(jacobians, axis=0)


def _triple(edges, a, b, d):
    end = lambda s: slice(1, None) if s else slice(-1)  # noqa: E731
    u, v, w = edges[0][:, end(b), end(d)], edges[1][end(a), :, end(d)], edges[2][end(a), end(b)]
    return np.einsum("...c,...c", np.cross(u, v), w)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="blocks of 23 x 33 x 17 nodes")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    numbers = main(*([(23, 33, 17)] if options.small else []), repeats=options.repeats)
    print(f"{numbers['n_cells']:,} cells, {numbers['bytes_per_node']:.1f} bytes of state per node")
    print(f"{numbers['n_wall_nodes']:,} nodes on walls")
    for name, nanoseconds in numbers["ns_per_cell"].items():
        print(f"{name:16}{nanoseconds:8.1f} ns per cell")
    print(f"numpy over ours {numbers['numpy_over_ours']:8.1f}")
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
