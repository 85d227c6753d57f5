"""One rank of a script under MPI: ``parallel_rank.py folder n_ranks limit script arguments...``.

What it prints goes to a file of its own in the folder. A rank that raises ends all of them, where it would otherwise
wait for them in the end of MPI. One that is there after the limit (s), or is ended from outside, shows where it stands.
"""

import faulthandler
import os
import runpy
import signal
import sys
import traceback
from pathlib import Path

if __name__ == "__main__":
    folder, n_ranks, limit, script = sys.argv[1:5]
    sys.argv = sys.argv[4:]
    sys.path[0:1] = [str(Path(script).parent), str(Path(__file__).parent)]
    faulthandler.dump_traceback_later(float(limit), exit=True)
    faulthandler.register(signal.SIGTERM, all_threads=False, chain=True)

    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if comm.size != int(n_ranks):
        sys.exit(f"mpirun is of another MPI than mpi4py ({MPI.Get_library_version()}): every rank is alone")
    own_file = os.open(os.path.join(folder, f"{comm.rank}.txt"), os.O_WRONLY | os.O_CREAT)
    os.dup2(own_file, 1)
    os.dup2(own_file, 2)
    try:
        runpy.run_path(script, run_name="__main__")
    except Exception:
        traceback.print_exc()
        sys.stdout.flush()
        comm.Abort(1)
