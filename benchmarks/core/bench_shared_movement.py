"""Moves of the control mesh on several processes: who has the factors, and what each process takes.

The control mesh of the ONERA M6, increments with their factors kept. CPU seconds of a move and of a reverse
product, and by how much the memory of every process rose at most, one number for each of them; then the report of the
move. One way in each run, so that none finds the memory of another::

    for way in each first mumps multigrid; do
        mpirun -n 2 python benchmarks/core/bench_shared_movement.py --size 16k --increments 2 --way $way
    done
"""

from __future__ import annotations

import argparse
import gc
import time
from pathlib import Path

import numpy as np
from bench_movement import SIZES

from bspline_mdao.base.numerics.processes import on_first, world
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.base.sparse.petsc import PetscCholesky, PetscMultigrid
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.movement.shared import shared_mover
from bspline_mdao.generators import fit_shape, onera_m6_grid, rectangular_wing
from bspline_mdao.movers import LinearElasticity, moving_mesh

SHAPE = (29, 29, 22)
"""Nodes of each block: a few more than the finest control mesh has points."""

OURS = Cholesky(n_threads=1)
WAYS = {
    "each": (OURS, None),
    "first": (OURS, "first"),
    "mumps": (PetscCholesky(), "all"),
    "multigrid": (PetscMultigrid(), "all"),
}
"""Solver of each way and who moves; None where every process does all."""


def memory(name: str) -> float:
    """Present (VmRSS) or largest (VmHWM) memory of this process in megabytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1e3


def measure(comm, mesh, surface, way: str, n_increments: int) -> str:
    """Move in one way: the line to print."""
    solver, who = WAYS[way]
    mover = LinearElasticity(mesh, n_increments=n_increments, solver=solver, keep_factors=True)
    Path("/proc/self/clear_refs").write_text("5")  # the largest memory counts from here
    before, began = memory("VmRSS"), time.process_time()
    movement = (shared_mover(mover, comm, who) if who else mover).move(mesh.points, surface)
    moved, rose = time.process_time() - began, memory("VmHWM") - before
    began = time.process_time()
    movement.vjp(np.cos(mesh.points))
    found = (moved, time.process_time() - began, rose)
    columns = zip(
        ("CPU s of a move", "of a product", "MB"), zip(*(comm.allgather(found) if comm.size > 1 else [found]))
    )
    numbers = "; ".join(f"{name} {', '.join(f'{value:.3g}' for value in column)}" for name, column in columns)
    return f"{way}: {numbers}; {movement.report}"


def main():
    """Print the lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=SIZES, default="16k", help="control points")
    parser.add_argument("--increments", type=int, default=2, help="increments of the move (2)")
    parser.add_argument("--way", choices=WAYS, default="first", help="who moves, by which solver")
    options, comm = parser.parse_args(), world()

    def prepared():
        model = fit_grid(onera_m6_grid(SHAPE), n_control=SIZES[options.size], keep_residual=False)
        mesh = moving_mesh(model)
        return mesh, fit_shape(model, mesh.surface_ids, rectangular_wing())

    mesh, surface = on_first(comm, prepared)
    tiny = moving_mesh(fit_grid(onera_m6_grid((5, 5, 5)), n_control=(4, 4, 4)))
    measure(
        comm, tiny, tiny.points[tiny.surface_ids], options.way, options.increments
    )  # compiles and loads what is measured
    gc.collect()
    line = measure(comm, mesh, surface, options.way, options.increments)
    if comm.rank == 0:
        print(f"{mesh.n_points:,} control points, {comm.size} processes\n{line}")


if __name__ == "__main__":
    main()
