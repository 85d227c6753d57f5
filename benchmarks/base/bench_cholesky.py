"""The package's sparse Cholesky, PARDISO and SciPy's SuperLU on stiffness matrices of control meshes, in one run.

The matrices are those of the first increment on control meshes of the 12-block ONERA M6 grid. CPU seconds, one thread,
the contenders in turn, the fastest of ``--repeats``; ratios are to PARDISO where ``pip install pypardiso`` was done.
SuperLU gets our order.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu
from threadpoolctl import threadpool_info, threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks of several layers use
from pardiso_peer import IS_INSTALLED, Pardiso

from bspline_mdao.base.sparse.blocks import LinearSolution, residual_norm
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.movement.elasticity import ElasticElements, lame_constants
from bspline_mdao.core.movement.equilibrium import Unknowns
from bspline_mdao.core.movement.young_modulus import OrthogonalityLaw
from bspline_mdao.generators import onera_m6_grid

SIZES = {"2k": (7, 7, 5), "5k": (9, 9, 7), "16k": (13, 13, 9), "51k": (19, 19, 14), "150k": (27, 27, 20)}
"""Control points of every block, by the number of unique ones."""

LARGEST_FOR_SUPERLU = 20_000
"""Block rows beyond which SuperLU takes minutes."""


@dataclass(frozen=True)
class SuperLU:
    """SciPy's direct solver for general matrices, with the order that `Cholesky` finds."""

    name = "SuperLU"

    def analyze(self, pattern, points):
        """Order."""
        order = Cholesky().analyze(pattern, points).supernodes.order
        return SuperLUAnalysis((3 * order[:, None] + np.arange(3)).ravel())


@dataclass(frozen=True, eq=False)
class SuperLUAnalysis:
    """Order of the unknowns."""

    order: np.ndarray

    def factorize(self, matrix):
        """Factor."""
        lower = matrix.to_scipy()
        full = lower + scipy.sparse.tril(lower, -1).T
        options = {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        return SuperLUFactor(matrix, self.order, splu(full.tocsc()[self.order][:, self.order], **options))


@dataclass(frozen=True, eq=False)
class SuperLUFactor:
    """Factor."""

    matrix: object
    order: np.ndarray
    factor: object

    @property
    def n_bytes(self):
        """Memory of the factor."""
        return 12 * self.factor.nnz

    def solve(self, right):
        """Solve."""
        x = np.empty(right.size)
        x[self.order] = self.factor.solve(right.ravel()[self.order])
        x = x.reshape(right.shape)
        return LinearSolution(x, 0, residual_norm(self.matrix, x, right), 0.0)


SOLVERS = (Cholesky(n_threads=1), Cholesky(single=True, n_threads=1), *([Pardiso()] if IS_INSTALLED else []), SuperLU())


def main(sizes=("2k", "5k", "16k", "51k"), repeats: int = 3, only: str | None = None) -> dict:
    """Time all solvers that are installed.

    Parameters
    ----------
    sizes : sequence of str
        Keys of `SIZES`.
    repeats : int
        Runs of each.
    only : str, optional
        Name of the one solver to run, for the peak memory of the process.

    Returns
    -------
    dict
        By size and solver: seconds, relative residual, memory of the factor (bytes) and ratios.
    """
    numbers = {"blas": [f"{lib['prefix']} {lib['version']} {lib.get('architecture')}" for lib in threadpool_info()]}
    with threadpool_limits(1):
        for size in sizes:
            matrix, points = stiffness_matrix(SIZES[size])
            solvers = [s for s in SOLVERS if only in (None, s.name)]
            if matrix.pattern.n > LARGEST_FOR_SUPERLU:
                solvers = [s for s in solvers if not isinstance(s, SuperLU)]
            numbers[size] = {"n_rows": matrix.pattern.n} | compare(solvers, matrix, points, repeats)
    return numbers | {"peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def stiffness_matrix(n_control):
    """Stiffness of the control mesh with so many points in each block, and the points of its block rows."""
    grid = onera_m6_grid(tuple(n + 4 for n in n_control))
    model = fit_grid(grid, n_control=n_control, keep_residual=False)
    mesh, law = moving_mesh(model), OrthogonalityLaw()
    unknowns = Unknowns(mesh)
    modulus = law.modulus(mesh, mesh.points, mesh.points)
    elements = ElasticElements(mesh, law, lame_constants(-0.2), mesh.points, mesh.points, modulus)
    return unknowns.matrix(elements.add_stiffness), mesh.points[unknowns.point_ids]


def compare(solvers, matrix, points, repeats: int) -> dict:
    """Numbers of every solver, and their ratios to those of PARDISO."""
    right = matrix.dot(np.sin(points))
    results, analyses = {}, {}
    for solver in solvers:
        start = time.process_time()
        analyses[solver] = solver.analyze(matrix.pattern, points)
        seconds = time.process_time() - start
        factor = analyses[solver].factorize(matrix)
        results[solver.name] = {"analyze": seconds, "factor": np.inf, "solve": np.inf, "n_bytes": factor.n_bytes}
    for _ in range(repeats):
        for solver, analysis in analyses.items():
            result = results[solver.name]
            seconds, factor = _timed(analysis.factorize, matrix)
            result["factor"] = min(result["factor"], seconds)
            seconds, solution = _timed(factor.solve, right)
            result["solve"] = min(result["solve"], seconds)
            result["residual"], result["iterations"] = solution.residual, solution.iterations
    for result in results.values():
        if "PARDISO" in results:
            result["factor_ratio"] = result["factor"] / results["PARDISO"]["factor"]
            result["solve_ratio"] = result["solve"] / results["PARDISO"]["solve"]
    return results


def _timed(function, argument):
    start = time.process_time()
    result = function(argument)
    return time.process_time() - start, result


def show(numbers: dict) -> None:
    """Print a table."""
    print("BLAS:", "; ".join(numbers["blas"]))
    columns = ("analyze", "factor", "solve", "factor_ratio", "solve_ratio", "residual", "n_bytes")
    print(f"{'':6} {'':26}" + "".join(f"{column:>13}" for column in columns))
    for size in SIZES:
        for name, result in numbers.get(size, {}).items():
            if name == "n_rows":
                continue
            print(f"{size:6} {name:26}" + "".join(f"{result.get(column, np.nan):13.3g}" for column in columns))
    print(f"peak of the process: {numbers['peak_rss_mb']:.0f} MB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=["2k", "5k", "16k", "51k"])
    parser.add_argument("--repeats", type=int, default=3, help="runs of each")
    parser.add_argument("--only", metavar="NAME", help="one solver alone, for its peak memory")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    found = main(options.sizes, options.repeats, options.only)
    show(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
