"""The gradient of one number in 1,000 variables at the paper's size of the ONERA M6 grid, in forward analyses.

The chain is that of `GridMovement` without the fit: variables, surface control points, control mesh in five increments,
1.16 million nodes, quality of the cells. The 13 x 13 x 9 control points of each block leave some 600 coordinates of
surface control points; points of a lattice around the wing make up the rest. An analysis is a run of the model at new
values, a gradient a reverse total of ``quality_ks`` in all of them. CPU seconds of one thread, the two in turn, the
fastest of ``--repeats``.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openmdao.api as om
from threadpoolctl import threadpool_limits

from bspline_mdao import GridMovement, fit_grid
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.om.drivers.recorded_run import time_components
from bspline_mdao.design import FreeForm, Lattice, Local, NearPlane, Parametrization
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import LinearElasticity, moving_mesh

SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)
LATTICE = (7, 4, 7)
"""Points of the lattice along the three axes."""

ASKED = 2.0
"""A gradient should cost no more analyses than this."""


def main(shape=SHAPE, n_control=N_CONTROL, repeats: int = 3) -> dict:
    """Time analyses and gradients.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        How often each is timed.

    Returns
    -------
    dict
        Sizes, CPU seconds, their ratio, shares of the components and peak memory.
    """
    problem = make_problem(shape, n_control)
    names = list(problem.model.shape.options["parametrization"].initial)
    gradient = problem.compute_totals(["quality_ks"], names)  # compiles, and sets up what is kept
    shares = {"analysis": time_components(problem)}
    shares["gradient"] = dict.fromkeys(shares["analysis"], 0.0)
    seconds: dict[str, list[float]] = {"analysis": [], "gradient": []}
    for repeat in range(repeats):
        move(problem, names, seed=repeat)
        for name, work in (
            ("analysis", problem.run_model),
            ("gradient", lambda: problem.compute_totals(["quality_ks"], names)),
        ):
            before = dict(shares["analysis"])
            seconds[name].append(cpu_seconds(work))
            if name == "gradient":  # the timers count everything: give the gradient what is its own
                for key, total in shares["analysis"].items():
                    shares["gradient"][key] += total - before[key]
                    shares["analysis"][key] = before[key]
    best = {name: min(times) for name, times in seconds.items()}
    return {
        "n_nodes": problem.get_val("grid").size // 3,
        "n_variables": sum(total.size for total in gradient.values()),
        "seconds": best,
        "ratio": best["gradient"] / best["analysis"],
        "asked": ASKED,
        "shares": {name: normalised(parts) for name, parts in shares.items()},
        "peak_gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def make_problem(shape, n_control) -> om.Problem:
    """The chain at its baseline."""
    model = fit_grid(onera_m6_grid(shape), n_control=n_control)
    mesh = moving_mesh(model)
    chain = GridMovement(
        model=model,
        fit=False,
        parametrization=Parametrization(mesh, variables(mesh)),
        mover=LinearElasticity(mesh, n_increments=5, solver=Cholesky(n_threads=1)),
    )
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("shape", chain, promotes=["*"])
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def variables(mesh: MovingMesh) -> list:
    """All surface control points in all directions in which they are free, and the points of a lattice in all."""
    off_root = ~NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    local = [Local("in_plane", None, "xy"), Local("spanwise", off_root, "z")]
    return [*local, FreeForm("lattice", Lattice.box(mesh, LATTICE), np.s_[:, :, 1:], "xyz")]


def move(problem: om.Problem, names: list[str], seed: int) -> None:
    """Set small random values, other ones for every seed."""
    rng = np.random.default_rng(seed)
    for name in names:
        problem.set_val(name, 1e-5 * rng.standard_normal(problem.get_val(name).shape))


def cpu_seconds(work: Callable[[], object]) -> float:
    """Process time of some work (s)."""
    start = time.process_time()
    work()
    return time.process_time() - start


def normalised(parts: dict[str, float]) -> dict[str, float]:
    """Shares that sum to one."""
    return {name: part / sum(parts.values()) for name, part in parts.items()}


def show(numbers: dict) -> None:
    """Print the times and their ratio."""
    print(f"{numbers['n_nodes']} nodes, {numbers['n_variables']} variables, {numbers['peak_gigabytes']:.2f} GB at most")
    for name, seconds in numbers["seconds"].items():
        parts = ", ".join(f"{key} {share:.0%}" for key, share in numbers["shares"][name].items() if share > 0.005)
        print(f"{name:10s} {seconds:7.2f} s   {parts}")
    print(f"a gradient takes {numbers['ratio']:.2f} analyses (asked: at most {numbers['asked']:g})")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="a grid of 9 x 9 x 9 nodes in each block")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    arguments = parser.parse_args()
    size = {"shape": (9, 9, 9), "n_control": (7, 6, 6)} if arguments.small else {}
    with threadpool_limits(1):
        result = main(repeats=arguments.repeats, **size)
    show(result)
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")
