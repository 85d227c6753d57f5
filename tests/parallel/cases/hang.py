"""One rank waits for the others for ever, raises, or leaves without a word."""

import os
import sys

from mpi4py import MPI

comm = MPI.COMM_WORLD
print(f"rank {comm.rank} is {os.getpid()}", flush=True)
comm.Barrier()
if comm.rank == comm.size - 1:
    if sys.argv[1] == "raises":
        raise ValueError("the last rank fails")
    if sys.argv[1] == "dies":
        os._exit(3)
comm.Barrier()
if sys.argv[1] == "hangs" and comm.rank == 0:
    comm.recv(source=1)
