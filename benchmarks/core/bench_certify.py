"""Certified validity of grids and of their default fits beside the corner check, in one process on one thread.

CPU seconds, the fastest of ``--repeats`` runs after one that compiles.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from pathlib import Path

from threadpoolctl import threadpool_limits

from bspline_mdao import FitWarning, fit_grid, read_grid
from bspline_mdao.core.evaluation.spline_validity import certify_splines
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.certificate import certify_cells
from bspline_mdao.grids.cells.grid_quality import GridQuality


def main(grids=(), repeats: int = 5) -> list[dict]:
    """Certify grids and time it.

    Parameters
    ----------
    grids : sequence of path-like
        Grid files; the built-in M6 grid where there is none.
    repeats : int
        Runs.

    Returns
    -------
    list of dict
        Counts, the ratio to the corner check, and milliseconds per element of each grid.
    """
    rows = []
    for name in grids or [None]:
        grid = onera_m6_grid((23, 33, 17)) if name is None else read_grid(name)
        quality, nodes = GridQuality.of_baseline(grid, n_threads=1), grid.to_vector().reshape(-1, 3)
        with threadpool_limits(1), warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)
            cells = certify_cells(quality, nodes)
            certified = min(_seconds(certify_cells, quality, nodes) for _ in range(repeats))
            corners = min(_seconds(quality.cells, nodes) for _ in range(repeats))
            model = fit_grid(grid, progress=False)
            of_splines = model.mesh, model.control_points, model.topology.segment_names
            splines = certify_splines(*of_splines)
            seconds = min(_seconds(certify_splines, *of_splines) for _ in range(repeats))
        n_elements = sum(part.n for part in splines)
        rows.append(
            {
                "grid": "@onera_m6" if name is None else Path(name).name,
                "cells": _counts(cells),
                "over_corners": certified / corners,
                "elements": _counts(splines),
                "ms_per_element": seconds / max(n_elements, 1) * 1e3,
                "splines_over_corners": seconds / corners,
            }
        )
    return rows


def _seconds(run, *arguments) -> float:
    start = time.thread_time()
    run(*arguments)
    return time.thread_time() - start


def _counts(parts) -> tuple[int, int, int]:
    """Number, and how many are invalid and undecided."""
    return tuple(sum(getattr(part, name) for part in parts) for name in ("n", "n_invalid", "n_undecided"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("grids", nargs="*", type=Path, help="grid files; the built-in M6 grid by default")
    parser.add_argument("--repeats", type=int, default=5, help="runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    numbers = main(options.grids, options.repeats)
    for row in numbers:
        print(
            f"{row['grid']:34} cells, invalid, undecided {row['cells']} at {row['over_corners']:.1f} corner checks; "
            f"elements {row['elements']} at {row['ms_per_element']:.2f} ms, {row['splines_over_corners']:.0f} in all"
        )
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
