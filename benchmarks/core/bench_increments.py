"""Moves of the paper-size ONERA M6 grid in as many increments as are chosen for them, beside IDWarp's recorded times.

Three changes of shape: the rectangular wing of section IV, a bend of the whole span by 60 degrees, and a twist by 30
degrees with 1.5 times the span. A *later* move starts from initial points whose factor is there and counts with the
evaluation of all nodes; the *choice* of the number is made once, before a run. Seconds of the process on one thread,
and of the wall clock on all of them, the shortest of ``--repeats``; IDWarp's are those of the same grid in the docs,
one process.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.increments import increments_for
from bspline_mdao.generators import fit_shape, onera_m6_grid, rectangular_wing
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality

SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)
IDWARP = {"move": 5.09, "reverse": 6.40}
"""Recorded seconds of a warp and of a reverse product on 1,158,300 nodes."""

TARGET = 0.1
"""What a later move may take of IDWarp's warp."""


def surfaces(model: FittedModel, mesh: MovingMesh) -> dict[str, np.ndarray]:
    """Surface control points of the three shapes, each (n_surface, 3), in metres."""
    start = mesh.points[mesh.surface_ids]
    named = {"bend 60 degrees": "bend=60deg@0,length=1", "twist 30 degrees, span x 1.5": "twist=30deg+stretch=1.5"}
    return {
        "rectangular wing": fit_shape(model, mesh.surface_ids, rectangular_wing()),
        **{name: parse_deformation(spec, model, mesh).apply(start) for name, spec in named.items()},
    }


def main(shape=SHAPE, n_control=N_CONTROL, repeats: int = 3) -> dict:
    """Time all shapes.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        Runs of each.

    Returns
    -------
    dict
        Numbers of each shape, see `measure`.
    """
    model = fit_grid(onera_m6_grid(shape), n_control=n_control, keep_residual=False)
    mesh = moving_mesh(model)
    quality = GridQuality.of_baseline(model.regenerate())
    return {name: measure(model, mesh, quality, s, repeats) for name, s in surfaces(model, mesh).items()}


def measure(model: FittedModel, mesh: MovingMesh, quality: GridQuality, surface: np.ndarray, repeats: int) -> dict:
    """Time one shape.

    Returns
    -------
    dict
        ``n_increments``, ``corner_ratio`` (the smallest corner by the baseline's), ``n_inverted`` and ``q_min`` of the
        grid, and CPU and wall seconds of ``later``, ``choice``, ``reverse`` and of five increments, ``paper``.
    """
    n_increments = increments_for(LinearElasticity(mesh), [surface])
    found = LinearElasticity(mesh, n_increments=n_increments).move(mesh.points, surface)
    nodes = model.regenerate(found.points).to_vector().reshape(-1, 3)
    report, ratio = report_quality(quality, nodes), found.report.increments[-1].corner_ratio
    result = {"n_nodes": model.n_nodes, "n_increments": n_increments, "corner_ratio": ratio}
    result |= {"n_inverted": report.n_inverted, "q_min": report.q_min}
    for kind, n_threads, clock in (("cpu", 1, time.process_time), ("wall", None, time.perf_counter)):
        with threadpool_limits(n_threads):
            runs = contenders(model, mesh, surface, nodes, n_increments, n_threads)
            result |= {f"{name}_{kind}": shortest(run, clock, repeats) for name, run in runs.items()}
    return result


def contenders(model, mesh, surface, bar, n_increments, n_threads) -> dict[str, Callable]:
    """All that is timed of one shape, on so many threads; the factor of the initial points is there."""
    solver, evaluator = Cholesky(n_threads=n_threads), model.evaluator().with_threads(n_threads)
    mover, paper = (LinearElasticity(mesh, n_increments=m, solver=solver) for m in (n_increments, 5))
    movement = mover.move(mesh.points, surface)
    start = movement.start

    def moved(mover):
        return evaluator.forward(mover.move(mesh.points, surface, start=start).points)

    return {
        "later": partial(moved, mover),
        "choice": partial(increments_for, mover, [surface]),
        "paper": partial(moved, paper),
        "reverse": lambda: movement.vjp(evaluator.adjoint(bar)),
    }


def shortest(run: Callable, clock: Callable[[], float], repeats: int) -> float:
    """Shortest time of a function (s)."""
    seconds = np.inf
    for _ in range(repeats):
        start = clock()
        run()
        seconds = min(seconds, clock() - start)
    return seconds


def show(numbers: dict) -> None:
    """Print a table."""
    for name, row in numbers.items():
        print(f"{name}: {row['n_nodes']} nodes, {row['n_increments']} increments, {row['corner_ratio']:.2f} left")
        print(f"  {row['n_inverted']} inverted cells, smallest Q {row['q_min']:.1e}")
        for line, unit in (("later", "move"), ("choice", "move"), ("paper", "move"), ("reverse", "reverse")):
            shares = [row[f"{line}_{kind}"] / IDWARP[unit] for kind in ("cpu", "wall")]
            times = f"{row[f'{line}_cpu']:8.3f} s CPU {row[f'{line}_wall']:8.3f} s wall"
            verdict = f"  target {TARGET}: {'met' if shares[0] <= TARGET else 'MISSED'}" if line == "later" else ""
            print(f"  {line:8}{times}  {shares[0]:.3f} and {shares[1]:.3f} of IDWarp's{verdict}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    main((7, 7, 7), (5, 5, 5), repeats=1)  # compiles
    found = main(repeats=options.repeats)
    show(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
