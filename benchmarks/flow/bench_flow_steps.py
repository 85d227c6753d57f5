"""What a step of an optimiser costs beside a cold flow: the flow about the next design, and gradients of lift and drag.

The wing is a rectangular one of NACA 0012 sections on an H-H grid, at Mach 0.3 and 4 degrees, solved by `EulerFlow`
through OpenMDAO. From the flow about it, its gradients are taken, then designs near it are solved: twisted at the tip,
thicker, at another angle. The cold flow about each of them is the denominator, in the same process::

    python benchmarks/flow/bench_flow_steps.py [CELLS] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openmdao.api as om
from threadpoolctl import threadpool_limits

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.generators import FarField, Spacing, hh_wing_grid, rectangular_wing

SHAPES = {5_376: (9, 9, 8), 13_824: (13, 13, 9), 36_864: (17, 17, 13), 117_504: (25, 25, 18), 1_020_000: (51, 51, 35)}
"""Nodes of each of the twelve blocks by the number of cells."""

SPAN = 3.0

TOLERANCES = (1e-14, 1e-10, 1e-8, 1e-6)
"""Of the linear systems of derivatives, that the second gradient of the lift is taken with."""

ASKED = {"gradient": 0.5, "step": 0.4, "bytes_per_cell": 5000}
"""Parts of a cold flow that a gradient and a step should cost at most, and memory of both."""


def main(n_cells: int = 36_864) -> dict:
    """Solve the wing, take its gradients, and solve designs near it.

    Parameters
    ----------
    n_cells : int
        Key of `SHAPES`.

    Returns
    -------
    dict
        CPU seconds and products with the Jacobian of the first flow, the gradients, and each step from the first design
        and from nothing; bytes per cell at the peak.
    """
    with threadpool_limits(1):
        _measure(min(SHAPES), {})  # compiles
        results: dict = {}
        _measure(n_cells, results)
    return results


def _measure(n_cells: int, results: dict) -> None:
    spacing = Spacing(off_wall=5e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    model = fit_grid(hh_wing_grid(rectangular_wing(), SHAPES[n_cells], spacing, FarField(10.0)))
    before = _resident()
    _forget_peak()
    problem = _problem(model)
    first = problem.get_val("grid").reshape(-1, 3).copy()
    results["cold"] = _timed(problem.run_model) | {"products": _products(problem)}
    gradients = {}
    for name in ("CL", "CD"):
        gradients[name] = _timed(lambda name=name: problem.compute_totals([name], ["grid"]))
    results["gradient"] = gradients
    results["tolerances"] = _by_tolerance(problem)
    results["steps"] = {}
    for name, (nodes, alpha) in _designs(first).items():
        problem.set_val("grid", nodes.ravel())
        problem.set_val("alpha", alpha)
        step = _timed(problem.run_model) | {"products": _products(problem)}
        results["steps"][name] = {"step": step}
        _return(problem, first)
    results["bytes_per_cell"] = (_peak() - before) / n_cells
    for name, (nodes, alpha) in _designs(first).items():
        other = _problem(model)
        other.set_val("grid", nodes.ravel())
        other.set_val("alpha", alpha)
        results["steps"][name]["cold"] = _timed(other.run_model) | {"products": _products(other)}


def _by_tolerance(problem: om.Problem) -> dict[str, dict[str, float]]:
    """CPU seconds of the gradient of the lift, with the factor that is there, and its largest error, relative."""
    options = problem.model.state.options
    exact, found = None, {}
    for tolerance in TOLERANCES:
        options["linear_tolerance"], totals = tolerance, {}
        taken = _timed(lambda totals=totals: totals.update(problem.compute_totals(["CL"], ["grid"])))
        gradient = totals["CL", "grid"]
        exact = gradient if exact is None else exact
        found[f"{tolerance:g}"] = taken | {"error": float(np.abs(gradient - exact).max() / np.abs(exact).max())}
    options["linear_tolerance"] = TOLERANCES[0]
    return found


def _problem(model) -> om.Problem:
    problem = om.Problem(EulerFlow(model=model, reference_area=SPAN, iprint=-1), reports=False)
    problem.setup(mode="rev", force_alloc_complex=False)
    problem.set_val("alpha", 4.0)
    problem.set_val("Mach_number", 0.3)
    problem.final_setup()
    return problem


def _return(problem: om.Problem, nodes: np.ndarray) -> None:
    """Solve the first design again, and take a gradient there, as an optimiser has before each step."""
    problem.set_val("grid", nodes.ravel())
    problem.set_val("alpha", 4.0)
    problem.run_model()
    problem.compute_totals(["CL"], ["alpha"])


def _designs(nodes: np.ndarray) -> dict[str, tuple[np.ndarray, float]]:
    """Nodes and angles of attack (deg) of the designs near the first one."""
    near = np.exp(-np.sum((nodes - [0.5, 0.0, 0.0]) ** 2 * [1.0, 1.0, 0.0], axis=1))  # of the wing, wherever along it
    part = near * np.clip(nodes[:, 2] / SPAN, 0.0, 1.0)
    twisted, thicker = nodes.copy(), nodes.copy()
    twisted[:, 1] -= np.radians(0.2) * part * (nodes[:, 0] - 0.25)
    thicker[:, 1] *= 1.0 + 0.01 * near
    return {"twist of 0.2 deg": (twisted, 4.0), "1 % of thickness": (thicker, 4.0), "0.1 deg of angle": (nodes, 4.1)}


def _products(problem: om.Problem) -> int:
    return sum(step.n_products for step in problem.model.state.solution.history)


def _timed(run: Callable) -> dict[str, float]:
    start = time.process_time()
    run()
    return {"cpu": time.process_time() - start}


def _resident() -> int:
    """Resident memory of this process (bytes)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _forget_peak() -> None:
    """Start looking for the peak of memory again."""
    Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Peak of resident memory since then (bytes)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


def _report(results: dict) -> None:
    cold = results["cold"]["cpu"]
    print(f"cold flow {cold:.2f} s, {results['cold']['products']} products")
    for name, run in results["gradient"].items():
        print(f"gradient of {name} {run['cpu']:.2f} s, {run['cpu'] / cold:.2f} of the flow (asked {ASKED['gradient']})")
    for name, run in results["tolerances"].items():
        print(f"the next of CL, to {name}: {run['cpu'] / cold:.2f} of the flow, wrong by {run['error']:.1e}")
    for name, runs in results["steps"].items():
        step, own = runs["step"], runs["cold"]
        print(
            f"{name}: {step['cpu']:.2f} s, {step['products']} products; from nothing {own['cpu']:.2f} s,",
            f"{own['products']} products: {step['cpu'] / own['cpu']:.2f} (asked {ASKED['step']})",
        )
    print(f"{results['bytes_per_cell']:.0f} bytes per cell at the peak (asked {ASKED['bytes_per_cell']})")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cells", type=int, nargs="?", default=36_864, choices=SHAPES)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    measured = main(options.cells)
    _report(measured)
    if options.json:
        options.json.write_text(json.dumps(measured, indent=2) + "\n")
