"""A foreign solver on several ranks is handed its own nodes, and totals are those of one process."""

import sys

import numpy as np
from mphys_cases import SOLVERS, Wing, flown, totals
from mpi4py import MPI

solver, generation = SOLVERS[sys.argv[1]], int(sys.argv[2])
comm, wing = MPI.COMM_WORLD, Wing()

alone = flown(solver(wing, generation), MPI.COMM_SELF)
expected = totals(alone)
for mode in solver.modes:
    problem = flown(solver(wing, generation), comm, mode)
    np.testing.assert_allclose(totals(problem), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())

nodes = problem.model.options["builder"].solver
moved = alone.model.cruise.aero_pre.movement.get_val("grid").reshape(-1, 3)
handed = problem.model.cruise.get_val(solver.volume_name, get_remote=False).reshape(-1, 3)
np.testing.assert_allclose(handed, moved[nodes.rows], rtol=0, atol=1e-14)
assert np.abs(handed - nodes.volume).max() > 0.05
print(len(nodes.walls), len(nodes.volume))
