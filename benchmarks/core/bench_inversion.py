"""Point inversion beside its peers: points per second in one process, on a mesh that all of them can take.

``python benchmarks/core/bench_inversion.py [--points N] [--json FILE]``

The mesh is one cubic volume of 13 x 13 x 9 control points with constant knots, the size of a block of the paper's M6
grid; peers take no curved knots. `splinepy` takes part where it is installed. The peers get fewer points, as they are
slow, and all get points inside. Ours is measured with curved knots and with points outside as well.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from bspline_mdao.core.evaluation.inversion import invert_points
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume, evaluate

N_CONTROL = (13, 13, 9)


def warped_box(curved: bool) -> tuple[BSplineMesh, np.ndarray]:
    """Make a mesh of one warped volume, and its control points."""
    constant = [ConstantKnots.uniform(n, 4) for n in N_CONTROL]
    volume = Volume(tuple(_curve(k) for k in constant) if curved else tuple(constant))
    x, y, z = np.meshgrid(*(np.linspace(0, 1, n) for n in N_CONTROL), indexing="ij")
    net = np.stack([x + 0.1 * np.sin(2 * y + z), y + 0.1 * np.sin(2 * x), z + 0.1 * np.sin(2 * x * y)], axis=-1)
    ids = np.arange(x.size).reshape(N_CONTROL)
    return BSplineMesh((volume,), (ids,), ids.size), net.reshape(-1, 3)


def _curve(knots: ConstantKnots) -> BilinearKnots:
    """Bend constant knots by a power of them that differs from edge to edge."""
    powers = np.array([[1.0, 1.1], [0.9, 1.2]])
    return BilinearKnots(knots.knots ** powers[..., None], knots.order)


def ours(mesh, control_points, points, n_threads: int = 1):
    """Invert with this package."""
    return invert_points(mesh, control_points, points, n_threads=n_threads).parameters


def scipy_per_point(mesh, control_points, points):
    """Invert with a bounded least squares of SciPy for each point, from the nearest of a lattice of samples."""
    knots = tuple(k.knots for k in mesh.volumes[0].knots)
    spline = NdBSpline(knots, control_points.reshape(*N_CONTROL, 3), 3)
    lattice = np.stack(np.meshgrid(*[np.linspace(0.02, 0.98, 20)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    _, ids = cKDTree(spline(lattice)).query(points)

    def jacobian(xi, point):
        return np.stack([spline(xi, nu=nu) for nu in np.eye(3, dtype=int)], axis=-1)

    def residual(xi, point):
        return spline(xi) - point

    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    solve = [least_squares(residual, lattice[i], jacobian, (0, 1), args=(p,), **tight) for i, p in zip(ids, points)]
    return np.array([s.x for s in solve])


def splinepy_proximity(mesh, control_points, points):
    """Invert with `splinepy`, on one thread."""
    import splinepy

    knots = [k.knots for k in mesh.volumes[0].knots]
    net = control_points.reshape(*N_CONTROL, 3).transpose(2, 1, 0, 3).reshape(-1, 3)
    spline = splinepy.BSpline(degrees=[3, 3, 3], knot_vectors=knots, control_points=net)
    return spline.proximities(points, initial_guess_sample_resolutions=[20, 20, 20], nthreads=1, tolerance=1e-15)


def measure(invert, mesh, control_points, parameters) -> dict:
    """Time one way of inversion, and see how near it comes."""
    net = control_points.reshape(*N_CONTROL, 3)
    points = evaluate(mesh.volumes[0], net, parameters)
    started = time.perf_counter()
    found = invert(mesh, control_points, points)
    seconds = time.perf_counter() - started
    errors = np.linalg.norm(evaluate(mesh.volumes[0], net, np.clip(found, 0, 1)) - points, axis=1)
    return {"n_points": len(points), "points_per_second": len(points) / seconds, "max_error": float(errors.max())}


def measure_outside(mesh, control_points, n: int) -> dict:
    """Time points of which most are outside."""
    points = np.random.default_rng(2).uniform(-0.5, 1.5, (n, 3))
    started = time.perf_counter()
    inversion = invert_points(mesh, control_points, points, n_threads=1)
    seconds = time.perf_counter() - started
    return {"n_points": n, "points_per_second": n / seconds, "n_outside": int((~inversion.is_inside).sum())}


def main(n_points: int = 100_000) -> dict:
    """Run the benchmark.

    Parameters
    ----------
    n_points : int
        Number of points for this package; peers get fewer.

    Returns
    -------
    dict
        For each run its points per second and largest error; for each peer also the ratio to ours on one thread.
    """
    straight, curved = warped_box(curved=False), warped_box(curved=True)
    parameters = np.random.default_rng(1).random((n_points, 3))
    ours(*straight, straight[1][:10])
    numbers = {"two_threads": measure(partial(ours, n_threads=2), *straight, parameters)}
    numbers["one_thread"] = measure(ours, *straight, parameters)
    numbers["curved_knots"] = measure(ours, *curved, parameters)
    numbers["outside"] = measure_outside(*curved, n_points // 10)
    numbers["scipy"] = measure(scipy_per_point, *straight, parameters[: n_points // 500])
    try:
        numbers["splinepy"] = measure(splinepy_proximity, *straight, parameters[: n_points // 100])
    except ImportError:
        print("splinepy is not installed: left out")
    for peer in numbers.keys() & {"scipy", "splinepy"}:
        numbers[peer]["ratio"] = numbers["one_thread"]["points_per_second"] / numbers[peer]["points_per_second"]
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Point inversion beside its peers.")
    parser.add_argument("--points", type=int, default=100_000, help="points for this package (default 100000)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    arguments = parser.parse_args()
    results = main(arguments.points)
    for name, run in results.items():
        print(f"{name:14s}", "  ".join(f"{key} {value:.4g}" for key, value in run.items()))
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")
