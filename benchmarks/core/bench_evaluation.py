"""Evaluation of the paper-size ONERA M6 grid, forward and in reverse, beside other ways to do it, in one run.

All get the same parameters and control points. Ours has the curved knots of the fit; the peers that cannot have them
(SciPy's NdBSpline, splinepy) get the mean of the edge knots, which costs them nothing. The sparse matrices are built
beforehand, one per block, with columns of that block alone: the best case for them. CPU seconds of the one thread, the
contenders in turn, ``--repeats`` times; ratios are of the fastest runs, which other work on the machine disturbs least.
Two threads against one are timed by the wall clock, twenty times as often.

The whole map, with the residual that turns and the layer at walls, is timed beside ``A b`` on the same grid with a
viscous spacing at the wall.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks of several layers use
from machine_limits import MultiplyAdds, Triad

from bspline_mdao.core.evaluation.evaluator import Evaluator
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.walls.grid_map import GridMap
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.topology.grid import Grid

try:
    import splinepy
except ImportError:
    splinepy = None

ORDER = 4
SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)
OFF_WALL = 1e-5
MAP = ("map", "map_forward", "map_reverse")
TARGETS = {
    "csr_forward": 7.0,
    "ndbspline_forward": 15.0,
    "csr_reverse": 5.0,
    "reverse_over_forward": 2.0,
    "two_threads_forward": 1.6,
    "two_threads_reverse": 1.6,
}


def main(shape=SHAPE, n_control=N_CONTROL, repeats: int = 15) -> dict:
    """Time all contenders.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        Runs of each.

    Returns
    -------
    dict
        Seconds (fastest and median), ratios, limits of the machine and the fractions of them that are reached.
    """
    load_average = os.getloadavg()[0]
    model = fit_grid(onera_m6_grid(shape), n_control=n_control, order=ORDER, keep_residual=False)
    evaluator = model.evaluator().with_threads(1)
    triad, multiply_adds = Triad(), MultiplyAdds()
    with threadpool_limits(1):
        contenders = {**our_contenders(model, evaluator), **matrix_contenders(model), **constant_contenders(model)}
        contenders |= {"triad": triad, "multiply_adds": multiply_adds}
        seconds = interleaved(contenders, repeats, time.thread_time)
        wall = interleaved(thread_contenders(model, evaluator), 20 * repeats, time.perf_counter)
    best = {name: min(times) for name, times in (seconds | wall).items()}
    limits = {
        "bandwidth_gb_s": triad.n_bytes / best["triad"] / 1e9,
        "multiply_adds_g_s": multiply_adds.count / best["multiply_adds"] / 1e9,
    }
    return {
        "n_nodes": model.n_nodes,
        "bytes_per_node": evaluator.bytes_per_node,
        "seconds": best,
        "median_seconds": {name: float(np.median(times)) for name, times in (seconds | wall).items()},
        "ratios": ratios(best),
        "limits": limits,
        "fractions": fractions(evaluator, best, limits),
        "instructions_per_node": instructions_per_node(),
        "load_average": load_average,
        "whole_map": whole_map(shape, n_control, repeats),
    }


def whole_map(shape, n_control, repeats: int) -> dict:
    """Time the whole map of a viscous grid beside the evaluation alone, on one thread."""
    grid = onera_m6_grid(shape, Spacing(off_wall=OFF_WALL))
    model = fit_grid(grid, n_control=n_control, order=ORDER)
    evaluator, random = model.evaluator().with_threads(1), np.random.default_rng(1)
    arguments = model.topology, model.mesh, model.parameters, model.control_points
    lengths = model.residual_lengths  # which a file has
    began = time.process_time()
    grid_map = GridMap.of(*arguments, model.residual, lengths, True, Evaluator.of_grid(*arguments[:3], n_threads=1))
    build = time.process_time() - began
    turn = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix()
    moved = model.control_points @ turn.T
    state, change, bar = grid_map.at(moved), random.standard_normal(moved.shape), random_nodes(model)
    contenders = {
        **our_contenders(model, evaluator),
        "map": lambda: grid_map.at(moved),
        "map_forward": lambda: state.jvp(change),
        "map_reverse": lambda: state.vjp(bar),
    }
    with threadpool_limits(1):
        best = {name: min(times) for name, times in interleaved(contenders, repeats, time.thread_time).items()}
    found = {f"{name}_by_A": best[name] / best["reverse" if name == "map_reverse" else "forward"] for name in MAP}
    n_bytes = grid_map.n_bytes / model.n_nodes
    share = grid_map.following.layer.n_followers / model.n_nodes
    return {
        "seconds": {name: best[name] for name in MAP},
        "ratios": found,
        "bytes_per_node": n_bytes,
        "with_evaluator": n_bytes + evaluator.bytes_per_node,
        "share_of_layer": share,
        "build": build,
    }


def our_contenders(model: FittedModel, evaluator: Evaluator) -> dict:
    """Our forward and reverse products."""
    out, bar = np.empty((model.n_nodes, 3)), random_nodes(model)
    return {
        "forward": lambda: evaluator.forward(model.control_points, out),
        "reverse": lambda: evaluator.adjoint(bar),
    }


def thread_contenders(model: FittedModel, evaluator: Evaluator) -> dict:
    """Our products on one and on two threads."""
    contenders = {}
    for n_threads in (1, 2):
        for name, run in our_contenders(model, evaluator.with_threads(n_threads)).items():
            contenders[f"{name}_wall_{n_threads}"] = run
    return contenders


def matrix_contenders(model: FittedModel) -> dict:
    """Products with a prebuilt sparse matrix per block, and with its transpose."""
    matrices = [block_matrix(volume, parameters) for volume, parameters in zip(model.mesh.volumes, model.parameters)]
    nets = [net.reshape(-1, 3) for net in model.mesh.nets(model.control_points)]
    bars = np.split(random_nodes(model), len(nets))
    return {
        "csr_forward": lambda: [matrix @ net for matrix, net in zip(matrices, nets)],
        "csr_reverse": lambda: [matrix.T @ bar for matrix, bar in zip(matrices, bars)],
    }


def block_matrix(volume, parameters):
    """Matrix of one block, in its own control points."""
    n_control, n = int(np.prod(volume.n_control)), parameters.size // 3
    mesh = BSplineMesh((volume,), (np.arange(n_control).reshape(volume.n_control),), n_control)
    return Evaluator.build(mesh, [parameters.reshape(-1, 3)], [np.arange(n)], n).matrix()


def constant_contenders(model: FittedModel) -> dict:
    """Ordinary tensor-product B-splines, evaluated by others."""
    nets, splines, peers = model.mesh.nets(model.control_points), [], []
    for volume, net in zip(model.mesh.volumes, nets):
        knots = tuple(k.corners.mean(axis=(0, 1)) for k in volume.knots)
        splines.append(NdBSpline(knots, np.ascontiguousarray(net), ORDER - 1))
        if splinepy is not None:
            points = net.transpose(2, 1, 0, 3).reshape(-1, 3)
            peers.append(splinepy.BSpline([ORDER - 1] * 3, [k.tolist() for k in knots], points))
    parameters = [p.reshape(-1, 3) for p in model.parameters]
    contenders = {"ndbspline_forward": lambda: [spline(p) for spline, p in zip(splines, parameters)]}
    if peers:
        contenders["splinepy_forward"] = lambda: [peer.evaluate(p, nthreads=1) for peer, p in zip(peers, parameters)]
    return contenders


def random_nodes(model: FittedModel) -> np.ndarray:
    """Seed of the reverse products."""
    return np.random.default_rng(0).standard_normal((model.n_nodes, 3))


def interleaved(contenders: dict, repeats: int, clock) -> dict:
    """Seconds of every run of every contender, run in turn."""
    for run in contenders.values():
        run()
    seconds = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, run in contenders.items():
            start = clock()
            run()
            seconds[name].append(clock() - start)
    return seconds


def ratios(best: dict) -> dict:
    """How many times faster we are, and what the targets speak of."""
    found = {
        f"{name}_{way}": best[f"{name}_{way}"] / best[way]
        for name, way in (
            ("csr", "forward"),
            ("csr", "reverse"),
            ("ndbspline", "forward"),
            ("splinepy", "forward"),
        )
        if f"{name}_{way}" in best
    }
    found["reverse_over_forward"] = best["reverse"] / best["forward"]
    for way in ("forward", "reverse"):
        found[f"two_threads_{way}"] = best[f"{way}_wall_1"] / best[f"{way}_wall_2"]
    return found


def fractions(evaluator: Evaluator, best: dict, limits: dict) -> dict:
    """Fractions of the machine's limits: stored bytes and the points, and the multiply-adds of the sums.

    Forward: p-1 multiply-adds for each of p^2 lines, p-1 for each of p planes and p-1, times three. In reverse: every
    line has p - 1 multiply-adds with three factors before them, of each component.
    """
    n = sum(nodes.n_nodes for nodes in evaluator.nodes)
    n_bytes = n * (evaluator.bytes_per_node + 24)
    p = ORDER
    multiply_adds = {"forward": 3 * (p - 1) * (p**2 + p + 1), "reverse": 3 * p**2 * p}
    return {
        way: {
            "memory": n_bytes / best[way] / 1e9 / limits["bandwidth_gb_s"],
            "arithmetic": n * multiply_adds[way] / best[way] / 1e9 / limits["multiply_adds_g_s"],
        }
        for way in ("forward", "reverse")
    }


def instructions_per_node() -> dict | None:
    """Instructions of one product per node, from the counters of ``perf``; None where there are none."""
    counts = {}
    for way in ("forward", "reverse"):
        few, many = (_count_instructions(way, repeats) for repeats in (10, 1010))
        if few is None or many is None:
            return None
        counts[way] = (many - few) / 1000
    return counts


def _count_instructions(way: str, repeats: int) -> float | None:
    """Instructions per node of a process that builds a small case and runs it ``repeats`` times."""
    command = ["perf", "stat", "-x,", "-e", "instructions:u", sys.executable, __file__, "--count", way]
    try:
        result = subprocess.run([*command, "--repeats", str(repeats)], capture_output=True, text=True, check=True)
        count = next(line for line in result.stderr.splitlines() if "instructions" in line).split(",")[0]
        return float(count) / float(result.stdout)
    except (OSError, subprocess.CalledProcessError, StopIteration, ValueError):
        return None


def run_for_counting(way: str, repeats: int) -> None:
    """Run one product of one paper-size block and print its number of nodes."""
    block = onera_m6_grid(SHAPE).blocks[4]
    model = fit_grid(Grid((block,)), n_control=N_CONTROL, order=ORDER, keep_residual=False)
    run = our_contenders(model, model.evaluator().with_threads(1))[way]
    for _ in range(repeats):
        run()
    print(model.n_nodes)


def report(numbers: dict) -> None:
    """Print the numbers beside the targets."""
    print(f"{numbers['n_nodes']:,} nodes, {numbers['bytes_per_node']:.1f} bytes per node (target: 128 at most)\n")
    print(f"{'':24}{'fastest':>12}{'median':>12}")
    for name, best in numbers["seconds"].items():
        print(f"{name:24}{best * 1e3:9.2f} ms{numbers['median_seconds'][name] * 1e3:9.2f} ms")
    print(f"\n{'ratio':24}{'measured':>12}{'target':>12}")
    for name, ratio in numbers["ratios"].items():
        print(f"{name:24}{ratio:12.2f}{TARGETS.get(name, ''):>12}")
    limits = numbers["limits"]
    print(f"load average {numbers['load_average']:.1f}: two threads show their worth below 0.5")
    print(f"\nlimits: {limits['bandwidth_gb_s']:.1f} GB/s (triad), {limits['multiply_adds_g_s']:.1f} G multiply-adds/s")
    for way, fraction in numbers["fractions"].items():
        print(f"{way}: {fraction['memory']:.0%} of the bandwidth, {fraction['arithmetic']:.0%} of the arithmetic")
    counts = numbers["instructions_per_node"]
    if counts is None:
        print("instructions per node: not counted (needs perf)")
    else:
        print(f"instructions per node: {counts['forward']:.0f} (target 180), in reverse {counts['reverse']:.0f} (400)")
    whole = numbers["whole_map"]
    print(
        f"\nwhole map: {whole['bytes_per_node']:.0f} bytes per node, {whole['with_evaluator']:.0f} with the "
        f"evaluator's; {whole['share_of_layer']:.0%} of the nodes follow a wall"
    )
    print(f"built in {whole['build']:.2f} s, {1e6 * whole['build'] / numbers['n_nodes']:.2f} us per node")
    for name in MAP:
        ratio = whole["ratios"][f"{name}_by_A"]
        print(f"{name:24}{whole['seconds'][name] * 1e3:9.2f} ms, {ratio:.2f} times A b or its transpose (target: 3)")
    if splinepy is None:
        print("splinepy: not installed, skipped")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="blocks of 23 x 33 x 17 nodes")
    parser.add_argument("--repeats", type=int, default=15, help="runs of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--count", choices=["forward", "reverse"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.count:
        run_for_counting(options.count, options.repeats)
        sys.exit()
    numbers = main(*(((23, 33, 17), (9, 9, 7)) if options.small else ()), repeats=options.repeats)
    report(numbers)
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
