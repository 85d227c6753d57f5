"""The topology of a grid in a file, found by several ranks of which each reads some blocks."""

import tempfile
from pathlib import Path

import fit_cases
import numpy as np
import topology_cases
from mpi4py import MPI

from bspline_mdao import InputError, open_grid, write_grid
from bspline_mdao.grids.topology.detection import find_topology

comm = MPI.COMM_WORLD

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as own:
        folder = Path(comm.bcast(own))
        for number, nodes in enumerate((topology_cases.sphere_octants(), [topology_cases.c_grid()])):
            grid = fit_cases.grid_of(*nodes)
            if comm.rank == 0:
                write_grid(folder / f"{number}.xyz", grid)
            comm.barrier()
            stored = open_grid(folder / f"{number}.xyz", comm=comm)
            assert find_topology(stored, comm) == find_topology(stored)
        flat = [np.broadcast_to([1.0, 2.0, 3.0], (3, 4, 5, 3)), topology_cases.smooth_box(7, 6, 5)]
        try:
            find_topology(fit_cases.grid_of(*flat), comm)
        except InputError as error:
            said = comm.allgather(str(error))
        assert "at one point" in said[0]
        assert len(set(said)) == 1, said
        comm.barrier()
    print("done")
