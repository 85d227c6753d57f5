"""Nodes and their transposed product by JAX and by PyTorch, next to direct calls, on the ONERA M6 grid.

What is timed is a value with a gradient: all nodes at control points, and the derivative in these of a sum over the
nodes with weights. Own calls are ``state = node_map.at(points)`` and ``state.vjp(weights)``; those of JAX are compiled.
With ``--linear`` the map has no wall layer, and ``jax.device_grid`` is timed as well. CPU seconds of one thread, in
turn, the fastest of ``--repeats``; points differ from one to the next.

With ``--batch``, this many designs by a twist are evaluated and differentiated both ways, as ``vmap`` requests them: at
once, and one by one.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable

import numpy as np

import bspline_mdao.jax
import bspline_mdao.torch
from bspline_mdao import DesignSurface, FittedModel, fit_grid
from bspline_mdao.core.bridges.functions import grid_function
from bspline_mdao.design import Twist
from bspline_mdao.generators import onera_m6_grid

SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)

ASKED = 1.5
"""A bridge should cost no more own calls than this."""


def main(shape=SHAPE, n_control=N_CONTROL, repeats: int = 3, linear: bool = False) -> dict:
    """Time values with gradients.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        How often each is timed.
    linear : bool
        Without a wall layer, and the evaluation by JAX alone as well.

    Returns
    -------
    dict
        Sizes, CPU seconds, ratios to our own calls, largest relative differences of gradients, and peak memory.
    """
    model = fit_grid(onera_m6_grid(shape), n_control=n_control, wall_layer=not linear)
    weights = np.random.default_rng(0).normal(size=(model.n_nodes, 3))
    ways = {"own": own(model, weights), "torch": by_torch(model, weights)}
    ways["jax"] = by_jax(bspline_mdao.jax.grid(model), weights)
    if linear:
        ways["jax alone"] = by_jax(bspline_mdao.jax.device_grid(model), weights)
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    differences = dict.fromkeys(ways, 0.0)
    for repeat in range(repeats + 1):  # the first one compiles
        points = model.control_points * (1.0 + 1e-3 * repeat)
        found = {}
        for name, way in ways.items():
            began = time.process_time()
            found[name] = way(points)
            seconds[name].append(time.process_time() - began)
        for name, gradient in found.items():
            off = np.abs(gradient - found["own"]).max() / np.abs(found["own"]).max()
            differences[name] = max(differences[name], float(off))
    best = {name: min(times[1:]) for name, times in seconds.items()}
    return {
        "n_nodes": model.n_nodes,
        "seconds": best,
        "first_seconds": {name: times[0] for name, times in seconds.items()},
        "ratios": {name: value / best["own"] for name, value in best.items()},
        "asked": ASKED,
        "differences": differences,
        "peak_gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def batches(shape=SHAPE, n_control=N_CONTROL, n: int = 16) -> dict:
    """Time batches of designs.

    Parameters
    ----------
    shape, n_control : tuple of three int
        As of `main`.
    n : int
        Number of designs.

    Returns
    -------
    dict
        CPU seconds for each design of values, forward and transposed products: of a batch, and of its members one by
        one, which are written to one array as well.
    """
    wing, random = DesignSurface.of(fit_grid(onera_m6_grid(shape), n_control=n_control)), np.random.default_rng(0)
    function = grid_function(wing.model, wing.parametrization([Twist("twist", wing.axis, stations=3)]))
    points = [random.uniform(-5.0, 5.0, size=(n, 3))]
    steps = [random.normal(size=(n, 3))]
    bars = [np.broadcast_to(random.normal(size=(1, wing.model.n_nodes, 3)), (n, wing.model.n_nodes, 3))]
    works = {
        "values": lambda batch, at: function.values(batch, at(points)),
        "jvp": lambda batch, at: function.products(batch, at(points), at(steps), False),
        "vjp": lambda batch, at: function.products(batch, at(points), at(bars), True),
    }
    found: dict[str, dict[str, float]] = {}
    for name, work in works.items():
        work((), lambda arrays: [array[0] for array in arrays])  # compiles
        began = time.process_time()
        work((n,), list)
        between = time.process_time()
        whole = None
        for member in range(n):
            (part,) = work((), lambda arrays, member=member: [array[member] for array in arrays])
            whole = np.empty((n, *part.shape)) if whole is None else whole
            whole[member] = part
        found[name] = {"batch": (between - began) / n, "one by one": (time.process_time() - between) / n}
    return found


def own(model: FittedModel, weights: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Own calls."""

    def gradient(points: np.ndarray) -> np.ndarray:
        state = model.node_map.at(points)
        (state.nodes * weights).sum()
        return state.vjp(weights)["control_points"]

    return gradient


def by_jax(function: Callable, weights: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A function of JAX, compiled."""
    import jax

    jax.config.update("jax_enable_x64", True)
    compiled = jax.jit(jax.value_and_grad(lambda points, weights: (function(points) * weights).sum()))
    weights = jax.numpy.asarray(weights)
    return lambda points: np.asarray(compiled(points, weights)[1])


def by_torch(model: FittedModel, weights: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The function of PyTorch."""
    import torch

    torch.set_num_threads(1)
    function, of_sum = bspline_mdao.torch.grid(model), torch.tensor(weights)

    def gradient(points: np.ndarray) -> np.ndarray:
        wrt = torch.tensor(points, requires_grad=True)
        (function(wrt) * of_sum).sum().backward()
        return wrt.grad.numpy()

    return gradient


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", type=int, nargs=3, default=SHAPE)
    parser.add_argument("--n-control", type=int, nargs=3, default=N_CONTROL)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--linear", action="store_true")
    parser.add_argument("--batch", type=int, metavar="N", help="time batches of N designs")
    given = parser.parse_args()
    sizes = tuple(given.shape), tuple(given.n_control)
    found = batches(*sizes, given.batch) if given.batch else main(*sizes, given.repeats, given.linear)
    print(json.dumps(found, indent=1))
