"""A foreign solver on several ranks is handed its own nodes, and totals are those of one process."""

import sys

import numpy as np
from mphys_cases import Wing, flown, totals
from mpi4py import MPI

solver, generation = sys.argv[1], int(sys.argv[2])
wing = Wing()

alone = flown(wing, solver, generation, MPI.COMM_SELF)
expected = totals(alone)
for mode in alone.model.builder.modes:
    problem = flown(wing, solver, generation, MPI.COMM_WORLD, mode)
    np.testing.assert_allclose(totals(problem), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())

builder = problem.model.builder
moved = np.empty((wing.model.n_nodes, 3))
moved[alone.model.builder.rows] = alone.get_val(f"cruise.{builder.volume_name}").reshape(-1, 3)
handed = problem.get_val(f"cruise.{builder.volume_name}", get_remote=False).reshape(-1, 3)
np.testing.assert_allclose(handed, moved[builder.rows], rtol=0, atol=1e-14)
assert np.abs(handed - builder.solver.volume).max() > 0.05
print(len(builder.numbers), len(builder.rows))
