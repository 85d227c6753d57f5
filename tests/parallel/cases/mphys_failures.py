"""What is wrong with the nodes of one rank alone is refused on all, in the same words."""

import numpy as np
import openmdao.api as om
from mphys_cases import Wing
from mpi4py import MPI

from bspline_mdao import InputError
from bspline_mdao.core.om.mphys.distribution import nodes_of_rank
from bspline_mdao.core.om.mphys.warper import VolumeWarper
from bspline_mdao.grids.topology.sharing import numbers_of_points, rows_of_points
from bspline_mdao.grids.topology.stored_grid import StoredGrid

comm, wing = MPI.COMM_WORLD, Wing()
is_wrong = comm.rank == 1


def refused(task, kind=InputError):
    """The words in which all ranks refuse a task."""
    try:
        task()
    except kind as error:
        words = comm.allgather(str(error))
        assert len(set(words)) == 1, words
        return words[0]
    raise AssertionError("not refused")


points = wing.surface.points[:4] + 0.01 * is_wrong
assert "surface: point 1 is" in refused(lambda: numbers_of_points(wing.surface.points, points, "surface", comm))
stored = StoredGrid.of(wing.grid)
assert "volume: point 1 is" in refused(lambda: rows_of_points(stored, wing.model.topology, points, comm=comm))
numbers = [0, 10_000 if is_wrong else 1]
assert "'numbers' are not numbers of nodes" in refused(lambda: nodes_of_rank(numbers, 50, "numbers", comm, "x"))
assert "no process gives any of 'numbers'" in refused(lambda: nodes_of_rank([], 50, "numbers", comm, "x"))

problem = om.Problem(reports=False)
mine = np.arange(comm.rank, wing.surface.n_points, comm.size)
nodes = om.IndepVarComp()
nodes.add_output("x_aero", wing.surface.points[mine].ravel(), distributed=True)
problem.model.add_subsystem("nodes", nodes, promotes=["*"])
warper = VolumeWarper(model=wing.model, mover=wing.mover, surface=wing.surface, numbers=mine)
problem.model.add_subsystem("warper", warper, promotes=["*"])
problem.setup()
problem.run_model()
grid = problem.get_val("aero_vol_coords", get_remote=False).copy()
problem.set_val("x_aero", np.full(3 * len(mine), np.nan if is_wrong else 0.0))
assert "x_aero[0], x of point 1, is nan" in refused(problem.run_model, om.AnalysisError)
problem.set_val("x_aero", wing.surface.points[mine].ravel())
problem.run_model()
np.testing.assert_array_equal(problem.get_val("aero_vol_coords", get_remote=False), grid)
print("done")
