"""Moves of the control mesh of the paper-size ONERA M6 grid beside IDWarp, PARDISO and SciPy.

The wing becomes the rectangular one of section IV. A move is all increments and the evaluation of all nodes, a product
with the derivative is from or to all nodes. A move is *first* from initial points that are new, and again
while their factor is there; finding the order of elimination, once per topology, is on its own line. CPU seconds of one
thread, the contenders in turn, the fastest of ``--repeats``. The growth with the number of control points and the peak
memory are of one process per size, which keeps no factor but that of the baseline.

Peers. IDWarp takes Fortran, PETSc and CGNS to build, so that its times are `RECORDED`: of this grid and move, walls
only, one process. They depend on the memory of that machine, ours on that of this one: ``bandwidth_gb_s`` is measured
beside. Factors and solutions of the matrix of the first increment are by those of PARDISO, in the same run where
``pip install pypardiso`` was done; without it there is no ratio.
Radial basis functions are by those of SciPy.
"""

from __future__ import annotations

import argparse
import itertools
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks of several layers use
from machine_limits import bandwidth
from pardiso_peer import IS_INSTALLED, Pardiso

from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.core.evaluation.evaluator import Evaluator
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.movement.elasticity import ElasticElements, LinearElasticity, lame_constants
from bspline_mdao.core.movement.equilibrium import Unknowns
from bspline_mdao.core.movement.interpolation import find_centres
from bspline_mdao.core.movement.radial_basis import RadialBasis
from bspline_mdao.core.movement.springs import TorsionalSprings
from bspline_mdao.core.movement.young_modulus import OrthogonalityLaw
from bspline_mdao.generators import fit_shape, onera_m6_grid, rectangular_wing

SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)
SIZES = {"2k": (7, 7, 5), "5k": (9, 9, 7), "16k": (13, 13, 9), "51k": (19, 19, 14), "150k": (27, 27, 20)}
"""Control points of every block, by the number of unique ones."""

SMALL, LARGE = ("2k", "5k", "16k"), ("51k", "150k")
OURS = Cholesky(n_threads=1)

RECORDED = {"IDWarp, warp": 5.09, "IDWarp, reverse product": 6.40}
"""Seconds of IDWarp on the grid of `SHAPE`."""

LINES = {
    "first move, m = 5": ("IDWarp, warp", None),
    "first move, m = 1": ("IDWarp, warp", 0.1),
    "first move of a topology, m = 5": ("IDWarp, warp", None),
    "move, m = 5": ("IDWarp, warp", None),
    "move, m = 1": ("IDWarp, warp", 0.1),
    "reverse product, m = 5": ("IDWarp, reverse product", 0.1),
    "reverse product, m = 5, factors not kept": ("IDWarp, reverse product", None),
    "reverse product, m = 1": ("IDWarp, reverse product", 0.1),
    "forward product, m = 5": ("IDWarp, warp", None),
    "forward product, m = 5, factors not kept": ("IDWarp, warp", None),
    "forward product, m = 1": ("IDWarp, warp", None),
    "factor Cholesky": ("factor PARDISO", 1.2),
    "solve Cholesky": ("solve PARDISO", None),
    "torsional springs, m = 5": ("IDWarp, warp", None),
    "torsional springs, reverse product": ("IDWarp, reverse product", None),
    "radial basis, m = 1": ("radial basis, SciPy", 1.0),
}
"""The peer that each time is divided by, and what the ratio should not exceed."""


@dataclass(frozen=True, eq=False)
class Case:
    """A control mesh that is ready to move.

    Parameters
    ----------
    mesh : MovingMesh
    surface : ndarray, shape (n_surface, 3)
        Where its surface goes (m).
    evaluator : Evaluator
        Of the nodes, on one thread.
    """

    mesh: MovingMesh
    surface: np.ndarray
    evaluator: Evaluator

    @classmethod
    def of(cls, shape, n_control) -> Case:
        """Prepare the M6 with so many nodes and control points in each block."""
        model = fit_grid(onera_m6_grid(shape), n_control=n_control, keep_residual=False)
        mesh = moving_mesh(model)
        surface = fit_shape(model, mesh.surface_ids, rectangular_wing())
        return cls(mesh, surface, model.evaluator().with_threads(1))

    def elasticity(self, **settings) -> LinearElasticity:
        """Elastic mover with our solver on one thread."""
        return LinearElasticity(self.mesh, **{"n_increments": 5, "solver": OURS, **settings})

    def move(self, mover, initial=None, start=None) -> np.ndarray:
        """Move, by default from the baseline, and evaluate: the nodes, shape (n_nodes, 3)."""
        movement = mover.move(self.mesh.points if initial is None else initial, self.surface, start=start)
        return self.evaluator.forward(movement.points)

    def forward(self, movement) -> np.ndarray:
        """Change of all nodes, shape (n_nodes, 3), with the initial points and the surface."""
        return self.evaluator.forward(movement.jvp(np.cos(self.mesh.points), np.sin(self.surface)))

    def reverse(self, movement, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the initial points and the surface, from those by all nodes, shape (n_nodes, 3)."""
        return movement.vjp(self.evaluator.adjoint(bar))

    def matrix(self, unknowns: Unknowns):
        """Stiffness of the baseline."""
        mesh, law = self.mesh, OrthogonalityLaw()
        modulus = law.modulus(mesh, mesh.points, mesh.points)
        elements = ElasticElements(mesh, law, lame_constants(-0.2), mesh.points, mesh.points, modulus)
        return unknowns.matrix(elements.add_stiffness)


def main(shape=SHAPE, n_control=N_CONTROL, repeats: int = 5, sizes=SMALL) -> dict:
    """Time everything.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks.
    repeats : int
        Runs of each.
    sizes : sequence of str
        Keys of `SIZES`, for the growth.

    Returns
    -------
    dict
        ``seconds`` by line, ``ratios`` to peers by line, ``growth`` by size, numbers of points, memory bandwidth, and
        the largest difference between SciPy's radial basis functions and ours (m).
    """
    growth = {size: grown(size) for size in sizes}  # first: a child counts the peak of its parent as its own
    warm_up()
    case = Case.of(shape, n_control)
    with threadpool_limits(1):
        times = fastest(contenders(case), repeats)
        difference = np.abs(radial_basis(case).points - radial_basis_of_scipy(case)).max()
    peers = {**(RECORDED if shape == SHAPE else {}), **times}
    ratios = {line: times[line] / peers[peer] for line, (peer, _) in LINES.items() if peer in peers}
    sizes_of_case = {"n_nodes": case.evaluator.n_rows, "n_points": case.mesh.n_points}
    numbers = {**sizes_of_case, "seconds": times, "ratios": ratios, "radial_basis_difference": float(difference)}
    return {**numbers, "bandwidth_gb_s": bandwidth() / 1e9, "peak_rss_mb": _peak(), "growth": growth}


def warm_up() -> None:
    """Compile what is timed, or load it from the cache."""
    case = Case.of((7, 7, 7), (5, 5, 5))
    for run in contenders(case).values():
        run()


def fastest(runs: dict[str, Callable], repeats: int) -> dict[str, float]:
    """Shortest CPU time of each of several functions, called in turn (s)."""
    seconds = dict.fromkeys(runs, np.inf)
    for _ in range(repeats):
        for name, run in runs.items():
            seconds[name] = min(seconds[name], _timed(run)[0])
    return seconds


def contenders(case: Case) -> dict[str, Callable]:
    """All that is timed on one mesh."""
    mover, bar = (
        TorsionalSprings(case.mesh, n_increments=5, solver=OURS),
        np.cos(case.evaluator.forward(case.mesh.points)),
    )
    movement = mover.move(case.mesh.points, case.surface)
    springs = {
        "torsional springs, m = 5": partial(case.move, mover, start=movement.start),
        "torsional springs, reverse product": partial(case.reverse, movement, bar),
    }
    rbf = {
        "radial basis, m = 1": partial(radial_basis, case),
        "radial basis, SciPy": partial(radial_basis_of_scipy, case),
    }
    return {**factorisations(case), **elastic_moves(case, bar), **springs, **rbf}


def factorisations(case: Case) -> dict[str, Callable]:
    """Factorisations of the matrix of the first increment, and solutions, by every solver that is installed."""
    runs, right = {}, np.cos(case.mesh.points)
    for solver in (OURS, *([Pardiso()] if IS_INSTALLED else [])):
        unknowns = Unknowns(case.mesh)
        ids, matrix = unknowns.point_ids, case.matrix(unknowns)
        analysis = solver.analyze(matrix.pattern, case.mesh.points[ids])
        runs[f"factor {solver.name}"] = partial(analysis.factorize, matrix)
        runs[f"solve {solver.name}"] = partial(analysis.factorize(matrix).solve, right[ids])
    return runs


def elastic_moves(case: Case, bar: np.ndarray) -> dict[str, Callable]:
    """Moves of the elastic mesh and products with their derivatives, the reverse one with that by all nodes."""
    fresh, runs = itertools.count(1), {}

    def first(mover):
        return case.move(mover, case.mesh.points * (1.0 + 1e-12 * next(fresh)))

    def first_of_topology():
        return case.move(case.elasticity(n_increments=5))

    for m in (5, 1):
        for suffix, keeps in {"": True, ", factors not kept": False}.items():
            if m == 1 and not keeps:
                continue  # the one factor is that of the initial points, which stays
            mover = case.elasticity(n_increments=m, keep_factors=keeps)
            movement = mover.move(case.mesh.points, case.surface)
            runs[f"reverse product, m = {m}{suffix}"] = partial(case.reverse, movement, bar)
            runs[f"forward product, m = {m}{suffix}"] = partial(case.forward, movement)
            if keeps:
                runs[f"move, m = {m}"] = partial(case.move, mover, start=movement.start)
                runs[f"first move, m = {m}"] = partial(first, case.elasticity(n_increments=m))
    return {**runs, "first move of a topology, m = 5": first_of_topology}


def radial_basis(case: Case):
    """Movement by our radial basis functions."""
    return RadialBasis(case.mesh, kernel="volume").move(case.mesh.points, case.surface)


def radial_basis_of_scipy(case: Case) -> np.ndarray:
    """The same from SciPy: same centres, kernel and polynomial, same targets; all points, shape (n_points, 3)."""
    mesh, centres = case.mesh, find_centres(case.mesh)
    displacement = centres.displacement(case.surface - mesh.points[mesh.surface_ids])
    scattered = RBFInterpolator(centres.position @ mesh.points, displacement, kernel="linear", degree=1)
    moved = mesh.points + mesh.slide(centres.at_all_points(scattered(mesh.points[centres.target_ids])))
    moved[mesh.surface_ids] = case.surface
    return moved


def grown(size: str) -> dict:
    """Numbers of one size, from a process of its own."""
    child = [sys.executable, __file__, "--child", size]
    return json.loads(subprocess.run(child, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def one_size(size: str) -> dict:
    """Order, factor, solution and first move in five increments at one size, and the peak of the process."""
    tiny = Case.of((7, 7, 7), (5, 5, 5))
    tiny.move(tiny.elasticity())
    case = Case.of(tuple(n + 4 for n in SIZES[size]), SIZES[size])
    numbers = {"n_points": case.mesh.n_points, "rss_of_fit_mb": _peak()}
    with threadpool_limits(1):
        numbers |= one_system(case)
        mover = case.elasticity(keep_factors=False)
        numbers["first_move"], movement = _timed(partial(mover.move, case.mesh.points, case.surface))
    last = movement.report.increments[-1]
    numbers |= {"residual": last.solve.residual, "n_tangled": last.n_tangled, "peak_rss_mb": _peak()}
    return numbers | {"move_in_factors": numbers["first_move"] / numbers["factor"]}


def one_system(case: Case) -> dict:
    """Order, factor and solution of the first increment; nothing of it stays."""
    unknowns = Unknowns(case.mesh)
    matrix, points = case.matrix(unknowns), case.mesh.points[unknowns.point_ids]
    order, analysis = _timed(partial(OURS.analyze, matrix.pattern, points))
    seconds, factor = _timed(partial(analysis.factorize, matrix))
    solve, _ = _timed(partial(factor.solve, np.cos(points)))
    return {"order": order, "factor": seconds, "solve": solve, "factor_mb": factor.n_bytes / 2**20}


def _peak() -> float:
    """Largest resident memory of this process so far (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _timed(run: Callable):
    start = time.process_time()
    result = run()
    return time.process_time() - start, result


def show(numbers: dict) -> None:
    """Print a table."""
    print(f"{numbers['n_points']} control points, {numbers['n_nodes']} nodes, peak {numbers['peak_rss_mb']:.0f} MB")
    print(f"memory bandwidth of one core {numbers['bandwidth_gb_s']:.1f} GB/s")
    for line, seconds in numbers["seconds"].items():
        peer, target = LINES.get(line, ("", None))
        ratio = numbers["ratios"].get(line)
        verdict = (
            "" if target is None or ratio is None else f"  at most {target}: {'met' if ratio <= target else 'MISSED'}"
        )
        print(f"{line:42}{seconds:9.4f} s" + ("" if ratio is None else f"{ratio:9.3f} of {peer}{verdict}"))
    for peer, seconds in RECORDED.items():
        print(f"{peer:42}{seconds:9.4f} s, recorded")
    print(f"largest difference of the radial basis movers: {numbers['radial_basis_difference']:.1e} m")
    columns = (
        *("n_points", "order", "factor", "solve", "first_move", "move_in_factors"),
        *("residual", "n_tangled", "factor_mb", "rss_of_fit_mb", "peak_rss_mb"),
    )
    print(f"{'':6}" + "".join(f"{column:>16}" for column in columns))
    for size, result in numbers["growth"].items():
        print(f"{size:6}" + "".join(f"{result[column]:16.4g}" for column in columns))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5, help="runs of each")
    parser.add_argument("--large", action="store_true", help="growth up to 160,000 points (10 minutes, 17 GB)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--child", choices=SIZES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(one_size(options.child)))
        sys.exit()
    found = main(repeats=options.repeats, sizes=SMALL + LARGE if options.large else SMALL)
    show(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
