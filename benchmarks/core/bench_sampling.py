"""CPU time of many designs of a wing: `sample`, beside OpenMDAO's ``DOEDriver`` about the same chain.

The grid is that of the M6 with 1,158,300 nodes; all designs are other twists. The driver has `Quality` judge the cells,
which it does twice, once for inverted cells and once for its bounds, and records no grid. `sample` moves 16 control
meshes together, the driver each alone. Times are of one thread.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import openmdao.api as om

from bspline_mdao import DesignSurface, fit_grid
from bspline_mdao.design import Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.sampling import Designs, Sobol, sample

SHAPE, N_CONTROL = (65, 45, 33), (9, 9, 7)
"""Nodes and control points of each of twelve blocks."""

TARGET = 60.0
"""Milliseconds of CPU a design without writing, and five minutes of the clock for 1,000 on disk."""

STORED = {"numbers alone": "", "control points": "control_points", "nodes": "nodes"}


def problem_of(wing: DesignSurface, driver: om.DOEDriver | None = None, **options: bool) -> om.Problem:
    """The chain of the wing, by its twist."""
    shape = wing.grid_movement([Twist("twist", wing.axis, stations=3)], fit=False, **options)
    problem = om.Problem(shape, driver=driver, reports=None)
    problem.model.add_design_var("twist", lower=-5.0, upper=5.0, units="deg")
    problem.setup()
    problem.run_model()
    return problem


def timed(task: Callable[[], object], n: int) -> dict[str, float]:
    """Milliseconds of CPU and of the clock for each of n designs."""
    began = time.process_time(), time.perf_counter()
    task()
    cpu, clock = time.process_time() - began[0], time.perf_counter() - began[1]
    return {"cpu": 1e3 * cpu / n, "clock": 1e3 * clock / n}


def main(n: int = 40, shape: tuple[int, int, int] = SHAPE) -> dict:
    """Time n designs by each way.

    Parameters
    ----------
    n : int
        Number of designs.
    shape : tuple of int
        Nodes of each block.

    Returns
    -------
    dict
        Number of nodes, and milliseconds of CPU and of the clock a design by each way.
    """
    wing = DesignSurface.of(fit_grid(onera_m6_grid(shape), n_control=N_CONTROL))
    problem = problem_of(wing, quality=False, require_valid=False)
    numbers: dict = {"n_nodes": wing.model.n_nodes, "ways": {}}
    with tempfile.TemporaryDirectory() as folder:
        sample(problem, wing.model, Sobol(1), Path(folder, "first.h5"))  # compiled before the clock runs
        for name, stored in STORED.items():
            file = Path(folder, f"{stored or 'numbers'}.h5")
            run = lambda: sample(problem, wing.model, Sobol(n), file, store=stored)  # noqa: B023, E731
            numbers["ways"][name] = timed(run, n)
            numbers["n_made"] = len(Designs(file))
            file.unlink()
    doe = problem_of(wing, om.DOEDriver(Sobol(n)))
    numbers["ways"]["DOEDriver"] = timed(doe.run_driver, n)
    return numbers


def report(numbers: dict) -> None:
    """Print the times beside the target."""
    print(f"{numbers['n_nodes']:,} nodes, {numbers['n_made']} designs made\n")
    print(f"{'ms a design':20}{'CPU':>10}{'clock':>10}")
    for name, times in numbers["ways"].items():
        print(f"{name:20}{times['cpu']:10.1f}{times['clock']:10.1f}")
    ratio = numbers["ways"]["DOEDriver"]["cpu"] / numbers["ways"]["numbers alone"]["cpu"]
    print(f"\nDOEDriver by numbers alone: {ratio:.2f}; target of these: {TARGET:.0f} ms of CPU")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=40, help="number of designs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    found = main(options.n)
    report(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
